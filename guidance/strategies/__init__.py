"""Policies of either player by name: those of the game, proportional navigation, and courses.

Contents:
    PURSUER_STRATEGIES, EVADER_STRATEGIES: the names. OPTIMAL: the game's own.
    Strategy: a policy's name, course and gain; a `StrategyMemory` is passed in and out.
    pursue, evade: the velocity of a policy.
    Course: places and times; `waypoints`, `random_turns`, `circle` and `recorded` make one, and COURSES names them.
    bounded: shortens velocities to a speed.
    uniform, normal: random numbers that depend on a seed and a place in its stream only.
"""

from guidance.game.speed_sets import bounded
from guidance.strategies.catalogue import (
    EVADER_STRATEGIES,
    OPTIMAL,
    PURSUER_STRATEGIES,
    Strategy,
    evade,
    pursue,
)
from guidance.strategies.course import (
    COURSES,
    Course,
    circle,
    normal,
    random_turns,
    recorded,
    uniform,
    waypoints,
)
from guidance.strategies.navigation import StrategyMemory

__all__ = [
    "COURSES",
    "EVADER_STRATEGIES",
    "OPTIMAL",
    "PURSUER_STRATEGIES",
    "Course",
    "Strategy",
    "StrategyMemory",
    "bounded",
    "circle",
    "evade",
    "normal",
    "pursue",
    "random_turns",
    "recorded",
    "uniform",
    "waypoints",
]
