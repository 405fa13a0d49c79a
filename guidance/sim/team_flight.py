"""A scenario of teams as pursuits for flights, and the rows of such a flight: one for each evader."""

import math
from collections.abc import Sequence

import numpy as np

from guidance.config import parse
from guidance.errors import ConfigError
from guidance.frames import Vector
from guidance.game import Cylinder, Game, StandOff
from guidance.game.team import match_teams
from guidance.sim.scenario import Evader, Pursuer, Pursuit, Scenario
from guidance.sim.teams import TeamOutcome, Teams, TeamScenario, opening_of, outcomes_of, teams_of


def pursuits_of_team(scenario: TeamScenario) -> tuple[Pursuit, ...]:
    """Return a pursuit for each vehicle, with the evader of the first matching. Names are uav1, rover1 etc.

    Raises:
        ConfigError: If there are more evaders than vehicles, or a pursuit cannot be flown.
    """
    teams = teams_of(scenario)
    if len(teams.evaders_m) > len(teams.pursuers_m):
        raise ConfigError(
            f"{len(teams.evaders_m)} evaders and {len(teams.pursuers_m)} vehicles: "
            "a flight needs a vehicle for each evader"
        )
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
    flight, (x, y, z), (east_m, north_m, _) = scenario.flight, teams.pursuers_m[number], teams.evaders_m[evader]
    document = {
        **{name: getattr(scenario, name) for name in ("title", "game", "target", "seed", "time_limit_s")},
        **{name: getattr(flight, name) for name in ("standoff", "limits", "sensor", "site", "hold_s")},
        "pursuer": Pursuer(
            policy=teams.pursuer_policy[number],
            position_m=(float(x), float(y), float(z)),
            speed_m_s=float(teams.pursuer_speed_m_s[number]),
            autopilot=flight.autopilot,
            takeoff_height_m=flight.takeoff_height_m,
        ),
        "evader": Evader(
            policy=teams.evader_policy[evader],
            position_m=(float(east_m), float(north_m)),
            speed_m_s=float(teams.evader_speed_m_s[evader]),
        ),
    }
    return parse(Scenario, document, source=f"{scenario.title}, uav{number + 1} in flight")


def _flown_game(scenario: TeamScenario, teams: Teams) -> Game:
    """Return the game of the vehicles, with their own speeds and the stand-off disc."""
    pursuers = [one.scenario.pursuer for one in pursuits_of_team(scenario)]
    speeds = np.array([(one.speed_m_s, one.climb_m_s, one.descent_m_s) for one in pursuers])
    standoff = StandOff(scenario.flight.standoff.radius_m, scenario.flight.standoff.height_m)
    return Game(Cylinder(*speeds.T[..., None]), teams.evader_speed_m_s, standoff=standoff)


def rows_of(
    scenario: TeamScenario,
    way: str,
    began: tuple[float, Sequence[Vector], Sequence[Vector]],
    ends: Sequence[tuple[str, float, Vector, int]],
) -> list[TeamOutcome]:
    """Return the rows of a flight, one for each evader.

    Args:
        scenario: As flown.
        way: The kind of run: "fast" or "live".
        began: When the game began, s, and the places of vehicles and evaders then, m.
        ends: Of each evader: the end, its time, s, the evader's place then, m, and the number of the captor.
    """
    teams, (began_s, pursuers_m, evaders_m) = teams_of(scenario), began
    ground, target_m = np.array(evaders_m) * [1.0, 1.0, 0.0], teams.target_m
    first = match_teams(_flown_game(scenario, teams), np.array(pursuers_m), ground, target_m)
    lasted = [
        (end, now_s - began_s, math.nan if target_m is None else math.dist(place_m[:2], target_m[:2]), captor)
        for end, now_s, place_m, captor in ends
    ]
    return outcomes_of(scenario, way, teams, first, lasted)
