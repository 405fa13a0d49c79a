"""Who gives the orders in a mocked flight, in place of the person at the ground station."""

import math
from collections.abc import Mapping, Sequence

from guidance.flight import FINAL, Event, Outputs, State

_LINGER_S = 2.0
"""How long a flight is watched that has been taken over, or holds without an end in sight."""

PATIENCE_S: Mapping[State, float] = {
    State.READY: 60.0,
    State.RETURNING: 300.0,
    State.LANDING: 300.0,
}
"""From when on a state leads nowhere in which the flight itself has no limit; the run is given up then."""


class MissionSequencer:
    """Start when all is ready, engage when both stand by, end when the game is over or has lasted too long.

    Args:
        hold_s: How long to stay on station.
        time_limit_s: Of the game.
        patience_s: How long a state is watched that leads nowhere.
        end_with: The order that ends the game: land where it is, or return.
    """

    def __init__(
        self,
        *,
        hold_s: float,
        time_limit_s: float,
        patience_s: Mapping[State, float] = PATIENCE_S,
        end_with: Event = Event.LAND,
    ) -> None:
        self._hold_s = hold_s
        self._time_limit_s = time_limit_s
        self._patience_s = patience_s
        self._end_with = end_with
        self._state = State.CONNECTING
        self._since_s = self._now_s = 0.0
        self.engaged_s: float | None = None
        self.captured_s: float | None = None
        self.timed_out = False

    @property
    def playing(self) -> bool:
        """From engagement until capture; the evader plays in this time, also while the pursuer pauses."""
        return self.engaged_s is not None and self._state in {State.ENGAGED, State.PAUSED}

    @property
    def finished(self) -> bool:
        """The flight has come to its end, or to where it has none."""
        waited_s = self._now_s - self._since_s
        if self._state is State.YIELDED:
            return waited_s >= _LINGER_S  # the record is to show that nothing is sent any more
        return self._state in FINAL or waited_s > self._patience_s.get(self._state, math.inf)

    def follow(self, now_s: float, outputs: Outputs) -> None:
        """Take note of what a cycle did."""
        self._now_s = now_s
        if outputs.state is not self._state:
            self._state, self._since_s = outputs.state, now_s
        if self._state is State.ENGAGED and self.engaged_s is None:
            self.engaged_s = now_s
        if self._state is State.ON_STATION and self.captured_s is None:
            self.captured_s = now_s

    def orders(self, now_s: float, *, evader_ready: bool, evader_fresh: bool) -> Sequence[Event]:
        """Give the orders for this cycle."""
        waited_s = now_s - self._since_s
        match self._state:
            case State.READY if evader_ready:
                return (Event.START,)
            case State.STANDING_BY if evader_ready and evader_fresh and self.engaged_s is None:
                return (Event.ENGAGE,)
            case State.ON_STATION if waited_s >= self._hold_s:
                return (self._end_with,)
            case State.HOLDING | State.STANDING_BY if waited_s >= _LINGER_S:
                return (self._end_with,)
            case State.ENGAGED | State.PAUSED if self._overtime(now_s):
                self.timed_out = True
                return (self._end_with,)
        return ()

    def _overtime(self, now_s: float) -> bool:
        return self.engaged_s is not None and now_s - self.engaged_s > self._time_limit_s
