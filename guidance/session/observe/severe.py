"""Which events people should notice, in the log and on ground stations."""

from typing import Final

from guidance.flight import Event

SEVERE: Final = frozenset({
    Event.PILOT, Event.FOREIGN, Event.TELEMETRY_LOST, Event.LATE, Event.SECOND_SENDER,
    Event.EVADER_LOST, Event.ESTIMATOR_RESET, Event.LOOP_LATE,
    Event.OPERATOR_LOST, Event.OPERATOR_GONE, Event.RIVAL,
    Event.BATTERY_LOW, Event.BATTERY_UNKNOWN, Event.FENCE, Event.FLOOR, Event.CEILING, Event.STAND_OFF,
    Event.POLICY_FAILED,
    Event.NO_GAME, Event.REBOOTED, Event.TIMED_OUT, Event.CHASE_TIMED_OUT, Event.ABORT, Event.FAULT,
})  # fmt: skip
"""Events that end, interrupt or forbid a game: warnings if they change the state."""
