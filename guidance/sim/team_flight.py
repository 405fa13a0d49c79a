"""A scenario of teams as pursuits for flights."""

from guidance.config import parse
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
    # One of those that share an evader goes to it
    for evader in sorted({*range(evaders)} - {*chased}):
        chased[
            next(
                number
                for number, evader_number in enumerate(chased)
                if chased.count(evader_number) > 1
            )
        ] = evader
    game = {
        name: getattr(scenario, name)
        for name in ("title", "game", "target", "seed", "time_limit_s")
    }
    game |= {
        name: getattr(flight, name) for name in ("standoff", "limits", "sensor", "site", "hold_s")
    }
    vehicle_settings = {name: getattr(flight, name) for name in ("autopilot", "takeoff_height_m")}
    pursuits = []
    for number, evader in enumerate(chased):
        vehicle = f"uav{number + 1}"
        pursuer = {
            "policy": teams.pursuer_policy[number],
            "position_m": teams.pursuers_m[number].tolist(),
        }
        fleeing = {
            "policy": teams.evader_policy[evader],
            "position_m": teams.evaders_m[evader, :2].tolist(),
        }
        document = game | {
            "pursuer": vehicle_settings
            | pursuer
            | {"speed_m_s": float(teams.pursuer_speed_m_s[number])},
            "evader": fleeing | {"speed_m_s": float(teams.evader_speed_m_s[evader])},
        }
        member_scenario = parse(Scenario, document, source=f"{scenario.title}, {vehicle} in flight")
        pursuits.append(Pursuit(member_scenario, vehicle, f"rover{evader + 1}"))
    return tuple(pursuits)
