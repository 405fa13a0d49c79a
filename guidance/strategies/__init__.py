"""Every way to play either part, by name: the game's own policies, navigation laws, and courses laid out beforehand."""

from guidance.strategies.catalogue import (
    COURSES,
    EVADER_STRATEGIES,
    OPTIMAL,
    PURSUER_STRATEGIES,
    Strategy,
    StrategyMemory,
    evade,
    pursue,
)
from guidance.strategies.course import Course, bounded, random_turns, recorded, waypoints
from guidance.strategies.draws import normal, uniform

__all__ = [
    "COURSES",
    "EVADER_STRATEGIES",
    "OPTIMAL",
    "PURSUER_STRATEGIES",
    "Course",
    "Strategy",
    "StrategyMemory",
    "bounded",
    "evade",
    "normal",
    "pursue",
    "random_turns",
    "recorded",
    "uniform",
    "waypoints",
]
