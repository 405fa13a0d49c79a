"""Policies of either player by name, with their memory; for a flight's cycle and for a batch."""

from dataclasses import dataclass
from typing import Final

from guidance.errors import ConfigError
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, Game
from guidance.game.arrays import Array, Real
from guidance.game.speed_sets import bounded
from guidance.strategies.course import COURSES, Course
from guidance.strategies.navigation import StrategyMemory, proportional_navigation
from guidance.strategies.own import asked_evasion, asked_pursuit, is_own

OPTIMAL: Final = "optimal"
PROPORTIONAL: Final = "proportional_navigation"

PURSUER_STRATEGIES: Final = (*PURSUER_POLICIES, PROPORTIONAL, *COURSES)
EVADER_STRATEGIES: Final = (*EVADER_POLICIES, *COURSES)


@dataclass(frozen=True, slots=True)
class Strategy:
    """A player's policy.

    Attributes:
        name: One of `PURSUER_STRATEGIES` or `EVADER_STRATEGIES`, or a user's policy (`guidance.strategies.own`).
        course: The course, if the name is one of `COURSES`.
        gain: The navigation constant N of proportional navigation.
    """

    name: str = OPTIMAL
    course: Course | None = None
    gain: float = 3.0

    def __post_init__(self) -> None:
        names = dict.fromkeys((*PURSUER_STRATEGIES, *EVADER_STRATEGIES))
        if self.name not in names and not is_own(self.name):
            raise ConfigError(
                f"policy = {self.name!r}: allowed are {', '.join(names)}, module:function and file.py:function"
            )
        if (self.course is not None) != (self.name in COURSES):
            courses = ", ".join(COURSES)
            raise ConfigError(
                f"policy = {self.name!r}: a course is needed for {courses}, and only for these"
            )

    @property
    def is_own(self) -> bool:
        """True if it is a user's policy."""
        return self.name not in PURSUER_STRATEGIES and self.name not in EVADER_STRATEGIES


def pursue(
    strategy: Strategy,
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None,
    seen_m_s: Array,
    memory: StrategyMemory,
    *,
    dt_s: Real,
) -> Array:
    """Return the pursuer's velocity, (..., 3), m/s.

    Args:
        strategy: Of `PURSUER_STRATEGIES`, or a user's policy, whose rows without an answer are NaN.
        game: The game.
        pursuer: P, (..., 3), m.
        evader: E, (..., 3), m.
        target: T, (..., 3), m, or None in PE.
        seen_m_s: The evader's velocity as seen, (..., 3).
        memory: The last command and the time since the start.
        dt_s: Time since the last command, one number or one for each row.
    """
    if strategy.course is not None:
        return game.pursuer.flyable(strategy.course.velocity_m_s(memory.played_s, pursuer))
    if strategy.name == PROPORTIONAL:
        return proportional_navigation(
            game, pursuer, evader, seen_m_s, memory, dt_s=dt_s, gain=strategy.gain
        )
    if strategy.is_own:
        last_m_s = memory.velocity_m_s
        return asked_pursuit(strategy.name, game, pursuer, evader, target, seen_m_s, last_m_s)
    return PURSUER_POLICIES[strategy.name](game, pursuer, evader, target, seen_m_s)


def evade(
    strategy: Strategy,
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None,
    memory: StrategyMemory,
    *,
    last_m_s: Array | None = None,
) -> Array:
    """Return the evader's velocity, (..., 3), m/s.

    Args:
        strategy: Of `EVADER_STRATEGIES`, or a user's policy, which gives NaN where it has no answer.
        game: The game.
        pursuer: P, (..., 3), m.
        evader: E, (..., 3), m.
        target: T, (..., 3), m, or None in PE.
        memory: The time since the start, and for a user's policy the pursuer's velocity.
        last_m_s: For a user's policy: the evader's last velocity, (..., 3).
    """
    if strategy.course is not None:
        return bounded(strategy.course.velocity_m_s(memory.played_s, evader), game.evader_speed_m_s)
    if strategy.is_own:
        seen_m_s = memory.velocity_m_s
        return asked_evasion(strategy.name, game, pursuer, evader, target, seen_m_s, last_m_s)
    return EVADER_POLICIES[strategy.name](game, pursuer, evader, target)
