"""A user's policy in flight: asked once a cycle, and given up on for the cycle if it takes longer than one.

The flight holds in a cycle without an answer, and stays in its hold until a person engages again. In real time the
policy runs in a thread of its own, so that one that never returns does not stop the setpoints: while it computes, there
is no answer. In virtual time it runs in the cycle itself, and the clock of the flight, which only the policy could
move, says how long it took; so a flight in virtual time does not depend on the computer.
"""

import queue
import threading
from typing import TYPE_CHECKING, Final

import numpy as np

from guidance.clock import Clock
from guidance.errors import ConfigError
from guidance.game.arrays import FloatArray
from guidance.strategies.own import (
    EVADER_SHARES,
    PURSUER_COLUMNS,
    PURSUER_SHARES,
    TARGET_COLUMNS,
    Answer,
    Ask,
    answer_of,
    is_own,
    load_policy,
    require_fit,
)

if TYPE_CHECKING:
    from guidance.sim.scenario import Scenario

LONGEST_ANSWER_S: Final = 0.02
"""Longest time for an answer: a cycle."""


def require_policies(scenario: "Scenario", *, beside_vehicle: bool) -> None:
    """Load the users' policies of a scenario and ask each once, before anything is opened.

    Args:
        scenario: With its policies.
        beside_vehicle: Whether a vehicle that is no mock flies; its evader is simulated in this process.

    Raises:
        ConfigError: If one is unknown or does not fit the game, or plays the evader beside a vehicle.
    """
    evader = scenario.evader.policy
    with_target = scenario.target is not None
    require_pursuer(scenario.pursuer.policy, with_target=with_target)
    if is_own(evader) and beside_vehicle:
        raise ConfigError(
            f"evader.policy = {evader!r}: your own policy plays the evader in mathematics and on the mock only, "
            "because one that never returns would stop the vehicle's setpoints; choose a built-in one"
        )
    if is_own(evader):
        require_fit(evader, _any_observation(with_target), EVADER_SHARES)


def require_pursuer(policy: str, *, with_target: bool) -> None:
    """Load the pursuer's policy if it is the user's, and ask it once.

    Raises:
        ConfigError: If it is unknown or does not fit the game.
    """
    if is_own(policy):
        require_fit(policy, _any_observation(with_target), PURSUER_SHARES)


def _any_observation(with_target: bool) -> FloatArray:
    return np.ones((1, PURSUER_COLUMNS + TARGET_COLUMNS if with_target else PURSUER_COLUMNS))


def asked_in_flight(name: str, clock: Clock, *, real_time: bool) -> Ask | None:
    """Return the `Ask` for the pursuer's policy of a name; None if it is not the user's."""
    if not is_own(name):
        return None
    timed = TimedPolicy(name, clock)
    return PolicyThread(timed) if real_time else timed


class TimedPolicy:
    """Asks a policy, and refuses an answer that took longer than a cycle by a clock."""

    def __init__(self, name: str, clock: Clock) -> None:
        self.name = name
        self._choose = load_policy(name)
        self._clock = clock

    def __call__(self, observation: FloatArray) -> Answer:
        """Return the answer to an observation, (1, k), or why there is none."""
        asked_s = self._clock.now_s()
        answer = answer_of(self.name, self._choose, observation)
        took_s = self._clock.now_s() - asked_s
        if took_s > LONGEST_ANSWER_S:
            return f"{self.name} took {1e3 * took_s:.0f} ms; a cycle has {1e3 * LONGEST_ANSWER_S:.0f} ms"
        return answer


class PolicyThread:
    """Asks a policy in a thread of its own, and waits for a cycle at most."""

    def __init__(self, timed: TimedPolicy) -> None:
        self._timed = timed
        self._questions = queue.SimpleQueue[FloatArray]()
        self._answers = queue.SimpleQueue[Answer]()
        self._is_late = False
        # It ends with the process, even within a policy that does not.
        threading.Thread(target=self._work, name="own policy", daemon=True).start()

    def __call__(self, observation: FloatArray) -> Answer:
        """Return the answer to an observation, (1, k), or why there is none; never an answer to an earlier one."""
        if self._is_late and self._answers.empty():
            return f"{self._timed.name} still computes an earlier cycle"
        if self._is_late:
            self._answers.get()
            self._is_late = False
        self._questions.put(observation)
        try:
            return self._answers.get(timeout=LONGEST_ANSWER_S)
        except queue.Empty:
            self._is_late = True
            return (
                f"{self._timed.name} takes longer than a cycle of {1e3 * LONGEST_ANSWER_S:.0f} ms"
            )

    def _work(self) -> None:
        while True:
            self._answers.put(self._timed(self._questions.get()))
