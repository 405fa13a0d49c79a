"""From a scenario to its game and its players: strategies, with their courses laid out from where the players start."""

import numpy as np
from numpy.typing import ArrayLike

from guidance.frames import Amsl, Vector
from guidance.game import Ball, Cylinder, Game, SpeedSet, StandOff
from guidance.sim.evader import EvaderSettings
from guidance.sim.scenario import Player, Scenario
from guidance.strategies import Course, Strategy, random_turns, recorded, waypoints
from guidance.strategies.course import Array

PURSUER_STREAM, EVADER_STREAM = 1, 2
"""Streams of random numbers, so that the players of one seed turn independently."""


def site(scenario: Scenario) -> tuple[float, float, Amsl]:
    """Return where the game frame has its zero: on the evader's plane."""
    where = scenario.site
    return where.latitude_deg, where.longitude_deg, Amsl(where.altitude_amsl_m + scenario.evader.height_m)


def speed_set(scenario: Scenario) -> SpeedSet:
    """Return the pursuer's speeds as the game knows them."""
    pursuer = scenario.pursuer
    if pursuer.speed_set == "ball":
        return Ball(pursuer.speed_m_s)
    return Cylinder(pursuer.speed_m_s, pursuer.climb_m_s, pursuer.descent_m_s)


def standoff(scenario: Scenario) -> StandOff:
    """Return the terminal disc, its height above the evader's plane."""
    return StandOff(scenario.standoff.radius_m, scenario.standoff.height_m - scenario.evader.height_m)


def game(scenario: Scenario) -> Game:
    """Return the game of a scenario as the evader, who knows its own speed, plays it in flight."""
    return Game(speed_set(scenario), scenario.evader.speed_m_s, standoff=standoff(scenario))


def target_game_m(scenario: Scenario) -> Vector | None:
    """Return the place that the evader wants to reach, in the game frame."""
    return None if scenario.target is None else (*scenario.target.position_m, 0.0)


def pursuer_strategy(scenario: Scenario, start_m: Array, speeds: SpeedSet, seed: ArrayLike) -> Strategy:
    """Return the pursuer's strategy.

    Args:
        scenario: Policy, course and gain.
        start_m: Starts, (..., 3), m.
        speeds: The speed set, of numbers (...), m/s.
        seed: One a row, (...).
    """
    course = _course(scenario.pursuer, scenario, start_m, speeds, seed, PURSUER_STREAM)
    return Strategy(scenario.pursuer.policy, course, scenario.pursuer.navigation_gain)


def evader_strategy(scenario: Scenario, start_m: Array, speed_m_s: ArrayLike, seed: ArrayLike) -> Strategy:
    """Return the evader's strategy.

    Args:
        scenario: Policy and course.
        start_m: Starts, (..., 3), m.
        speed_m_s: One a row, (...).
        seed: One a row, (...).
    """
    course = _course(scenario.evader, scenario, start_m, Ball(speed_m_s), seed, EVADER_STREAM)
    return Strategy(scenario.evader.policy, course)


def evader_settings(scenario: Scenario) -> EvaderSettings:
    """Return the evader's play."""
    evader = scenario.evader
    strategy = evader_strategy(scenario, np.array((*evader.position_m, 0.0)), evader.speed_m_s, scenario.seed)
    return EvaderSettings(game(scenario), strategy, target_game_m(scenario), site(scenario))


def _course(
    player: Player, scenario: Scenario, start_m: Array, speeds: SpeedSet, seed: ArrayLike, stream: int
) -> Course | None:
    match player.policy:
        case "waypoints":
            points = np.array([(*point, 0.0)[:3] for point in player.waypoints_m])
            return waypoints(start_m, points, speeds)
        case "random_turns":
            return random_turns(
                start_m,
                speeds.horizontal_m_s,
                seed,
                stream=stream,
                every_s=player.turn_every_s,
                most_rad=np.deg2rad(player.turn_most_deg),
                duration_s=scenario.time_limit_s,
            )
        case "recorded":
            return recorded(start_m, player.track)
    return None
