"""From a scenario to what its players play: strategies, with their courses laid out from where the players start."""

import numpy as np
from numpy.typing import ArrayLike

from guidance.game import Ball, SpeedSet
from guidance.game.game import horizontal_speed
from guidance.scenarios.model import Player, Scenario
from guidance.strategies import Course, Strategy, random_turns, recorded, waypoints
from guidance.strategies.course import Array

PURSUER_STREAM, EVADER_STREAM = 1, 2
"""Streams of random numbers, so that the players of one seed turn independently."""


def pursuer_strategy(scenario: Scenario, start_m: Array, speeds: SpeedSet, seed: ArrayLike) -> Strategy:
    """Return the pursuer's strategy from starts (..., 3) with speeds and seeds (...), all else as the scenario says."""
    course = _course(scenario.pursuer, scenario, start_m, speeds, seed, PURSUER_STREAM)
    return Strategy(scenario.pursuer.policy, course, scenario.pursuer.navigation_gain)


def evader_strategy(scenario: Scenario, start_m: Array, speed_m_s: ArrayLike, seed: ArrayLike) -> Strategy:
    """Return the evader's strategy; arguments as of `pursuer_strategy`."""
    course = _course(scenario.evader, scenario, start_m, Ball(speed_m_s), seed, EVADER_STREAM)
    return Strategy(scenario.evader.policy, course)


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
                horizontal_speed(speeds),
                seed,
                stream=stream,
                every_s=player.turn_every_s,
                most_rad=np.deg2rad(player.turn_most_deg),
                duration_s=scenario.time_limit_s,
            )
        case "recorded":
            return recorded(start_m, player.track)
    return None
