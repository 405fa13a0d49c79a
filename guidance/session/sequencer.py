"""Orders of a mission: they replace the person at the ground station while no person gives orders."""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.flight import FINAL, Authority, Event, Outputs, State

LINGER_S: Final = 2.0
"""Wait of a mission after the flight held or yielded by itself."""

CONTACT_PATIENCE_S: Final = 60.0
"""Wait of a mission for a person's engage order after a telemetry gap."""

PATIENCE_S: Mapping[State, float] = {
    State.READY: 60.0,
    State.RETURNING: 300.0,
    State.LANDING: 300.0,
    State.OUT_OF_CONTACT: 60.0,
}
"""Longest stay in states without a limit of their own; then the run ends."""

_PLAYED: Final = frozenset({State.ENGAGED, State.PAUSED, State.ON_STATION})


class MissionPolicy(NamedTuple):
    """Which orders a mission may give, and how the vehicle is handed over.

    Attributes:
        engage: The mission may start and engage as soon as that can be done; else both wait for `guidance ctl start`
            and `guidance ctl engage`.
        end_with: The order that ends the game, where the run has the vehicle for itself: one that is armed already is
            refused then, and in the end it is watched until it is disarmed. None leaves it to `hand_over`.
        hand_over: The order that hands the vehicle over in the end; None for a mock.
    """

    engage: bool
    end_with: Event | None = None
    hand_over: Event | None = None


MOCKED: Final = MissionPolicy(engage=True, end_with=Event.LAND)


class MissionSequencer:
    """Start when everything is ready, engage when both stand by, end after the game or its time limit.

    While an operator's order stands the mission orders nothing and does not end.

    Args:
        hold_s: How long to stay on station.
        time_limit_s: Of the game.
        policy: Whether states have time limits (not if a person gives the orders), and the order that ends the game.

    Attributes:
        engaged_s: When the game began; anew if an operator engages again after a hold. None before.
        captured_s: When it was captured; None before.
        timed_out: Whether the game lasted too long.
    """

    def __init__(self, *, hold_s: float, time_limit_s: float, policy: MissionPolicy = MOCKED) -> None:
        self._hold_s = hold_s
        self._time_limit_s = time_limit_s
        self._patience_s = PATIENCE_S if policy.engage else {}
        self._end_with = policy.end_with or Event.LAND
        self._state = State.CONNECTING
        self._since_s = self._now_s = 0.0
        self._lost_contact = False
        self.by_operator = False
        self.engaged_s: float | None = None
        self.captured_s: float | None = None
        self.timed_out = False

    @property
    def playing(self) -> bool:
        """From engagement until capture. The evader plays in this time, also while the pursuer pauses."""
        return self.engaged_s is not None and self._state in {State.ENGAGED, State.PAUSED}

    @property
    def finished(self) -> bool:
        """True if the flight is over, or stays too long in a state."""
        waited_s = self._now_s - self._since_s
        if self._state is State.YIELDED:
            return waited_s >= LINGER_S  # the record then shows the silence
        if self._state in FINAL:
            return True
        return not self.by_operator and waited_s > self._patience_s.get(self._state, math.inf)

    def follow(self, now_s: float, outputs: Outputs) -> None:
        """Take note of what a cycle did."""
        self._now_s = now_s
        cause = outputs.cause
        self.by_operator = cause is not None and cause.by is Authority.OPERATOR
        self._lost_contact = cause is not None and cause.event is Event.CONTACT
        before = self._state
        if outputs.state is before:
            return
        self._state, self._since_s = outputs.state, now_s
        if self._state is State.ENGAGED and before not in _PLAYED:
            self.engaged_s, self.captured_s = now_s, None
        if self._state is State.ON_STATION and self.captured_s is None:
            self.captured_s = now_s

    def orders(self, now_s: float, *, evader_ready: bool, evader_fresh: bool) -> Sequence[Event]:
        """Give the orders for this cycle."""
        if self.by_operator:
            return ()
        first = self.engaged_s is None and not self._lost_contact
        if self._state is State.READY and evader_ready:
            return (Event.START,)
        if self._state is State.STANDING_BY and first and evader_ready and evader_fresh:
            return (Event.ENGAGE,)
        if self._state in {State.ENGAGED, State.PAUSED} and self._overtime(now_s):
            self.timed_out = True
            return (self._end_with,)
        return (self._end_with,) if now_s - self._since_s >= self._lingers_s() else ()

    def _lingers_s(self) -> float:
        """Longest stay in the present state; then the mission ends the flight."""
        if self._state is State.ON_STATION:
            return self._hold_s
        if self._state is State.STANDING_BY and self._lost_contact:
            return CONTACT_PATIENCE_S
        return LINGER_S if self._state in {State.HOLDING, State.STANDING_BY} else math.inf

    def _overtime(self, now_s: float) -> bool:
        return self.engaged_s is not None and now_s - self.engaged_s > self._time_limit_s
