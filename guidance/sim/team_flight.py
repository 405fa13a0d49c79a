"""A scenario of teams as pursuits for flights."""

from guidance.config import parse
from guidance.errors import ConfigError
from guidance.sim.scenario import Pursuit, Scenario
from guidance.sim.teams import Teams, TeamScenario, opening_of, teams_of


def pursuits_of_team(scenario: TeamScenario) -> tuple[Pursuit, ...]:
    """Return a pursuit for each vehicle, with the evader of the first matching. Names are uav1, rover1 etc.

    Raises:
        ConfigError: If there are more evaders than vehicles, or a pursuit cannot be flown.
    """
    teams = teams_of(scenario)
    if len(teams.evaders_m) > len(teams.pursuers_m):
        counts = f"{len(teams.evaders_m)} evaders and {len(teams.pursuers_m)} vehicles"
        raise ConfigError(f"{counts}: a flight needs a vehicle for each evader")
    return tuple(
        Pursuit(_scenario_of(scenario, teams, number, evader), f"uav{number + 1}", f"rover{evader + 1}")
        for number, evader in enumerate(_covered(opening_of(scenario).evader_of.tolist(), len(teams.evaders_m)))
    )


def _covered(evader_of: list[int], evaders: int) -> list[int]:
    """Give every evader at least one vehicle: those that share one go to an evader that has none."""
    for evader in range(evaders):
        if evader not in evader_of:
            spare = next(number for number, one in enumerate(evader_of) if evader_of.count(one) > 1)
            evader_of[spare] = evader
    return evader_of


def _scenario_of(scenario: TeamScenario, teams: Teams, number: int, evader: int) -> Scenario:
    """Return the game of one vehicle against one evader.

    Raises:
        ConfigError: If the vehicle cannot fly it.
    """
    flight, keys = scenario.flight, ("policy", "position_m", "speed_m_s")
    pursuer = teams.pursuer_policy[number], teams.pursuers_m[number].tolist(), float(teams.pursuer_speed_m_s[number])
    chased = teams.evader_policy[evader], teams.evaders_m[evader, :2].tolist(), float(teams.evader_speed_m_s[evader])
    own = {name: getattr(flight, name) for name in ("autopilot", "takeoff_height_m")}
    document = {
        **{name: getattr(scenario, name) for name in ("title", "game", "target", "seed", "time_limit_s")},
        **{name: getattr(flight, name) for name in ("standoff", "limits", "sensor", "site", "hold_s")},
        "pursuer": dict(zip(keys, pursuer, strict=True)) | own,
        "evader": dict(zip(keys, chased, strict=True)),
    }
    return parse(Scenario, document, source=f"{scenario.title}, uav{number + 1} in flight")
