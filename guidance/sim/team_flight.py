"""A scenario of teams as pursuits for flights."""

from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.sim.scenario import Pursuit, Scenario
from guidance.sim.teams import TeamScenario, opening_of, teams_of


def pursuits_of_team(scenario: TeamScenario) -> tuple[Pursuit, ...]:
    """Return a pursuit for each vehicle, with the evader of the first matching. Names are uav1, rover1 etc.

    Raises:
        ConfigError: If there are more evaders than vehicles, or a vehicle cannot fly its pursuit.
    """
    teams = teams_of(scenario)
    flight = scenario.flight
    vehicles = len(teams.pursuers_m)
    evaders = len(teams.evaders_m)
    if evaders > vehicles:
        raise ConfigError(
            f"{evaders} evaders and {vehicles} vehicles: a flight needs a vehicle for each evader"
        )
    chased = opening_of(scenario).evader_of.tolist()
    # One of the vehicles that share an evader goes to each evader that no vehicle chases.
    unchased = {*range(evaders)} - {*chased}
    for evader in sorted(unchased):
        spare_vehicle = next(
            number for number, evader_number in enumerate(chased) if chased.count(evader_number) > 1
        )
        chased[spare_vehicle] = evader
    pursuits = []
    for number, evader in enumerate(chased):
        vehicle = f"uav{number + 1}"
        pursuer = {
            "autopilot": flight.autopilot,
            "takeoff_height_m": flight.takeoff_height_m,
            "policy": teams.pursuer_policy[number],
            "position_m": teams.pursuers_m[number].tolist(),
            "speed_m_s": float(teams.pursuer_speed_m_s[number]),
        }
        fleeing = {
            "policy": teams.evader_policy[evader],
            "position_m": teams.evaders_m[evader, :2].tolist(),
            "speed_m_s": float(teams.evader_speed_m_s[evader]),
        }
        document = {
            "title": scenario.title,
            "game": scenario.game,
            "target": scenario.target,
            "seed": scenario.seed,
            "time_limit_s": scenario.time_limit_s,
            "standoff": flight.standoff,
            "limits": flight.limits,
            "sensor": flight.sensor,
            "site": flight.site,
            "hold_s": flight.hold_s,
            "pursuer": pursuer,
            "evader": fleeing,
        }
        source = f"{scenario.title}, {vehicle} in flight"
        member_scenario = parse_document(Scenario, document, source=source)
        pursuit = Pursuit(member_scenario, vehicle, f"rover{evader + 1}")
        pursuits.append(pursuit)
    return tuple(pursuits)
