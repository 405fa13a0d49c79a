"""Do the streams arrive as often as they are needed? What was asked for and what comes are not the same thing."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from guidance.autopilots import (
    ATTITUDE,
    GLOBAL_POSITION_INT,
    LOCAL_POSITION_NED,
    ODOMETRY,
    POSITION_TARGET_LOCAL_NED,
    Autopilot,
    Finding,
    Verdict,
)
from guidance.messages import Attitude, GlobalPosition, LocalPosition, Message, Odometry, PositionTarget
from guidance.preflight.survey import Facts


class _Stream(NamedTuple):
    name: str
    kind: type[Message]
    message_id: int
    least_hz: float
    otherwise: Verdict
    without: str


_STREAMS: Final = (
    _Stream("LOCAL_POSITION_NED", LocalPosition, LOCAL_POSITION_NED, 10.0, Verdict.REFUSE, "the game plays on it"),
    _Stream("ATTITUDE", Attitude, ATTITUDE, 4.0, Verdict.REFUSE, "the heading is held by it"),
    _Stream("GLOBAL_POSITION_INT", GlobalPosition, GLOBAL_POSITION_INT, 1.0, Verdict.WARN, "frames are checked by it"),
    _Stream("ODOMETRY", Odometry, ODOMETRY, 5.0, Verdict.WARN, "estimator resets are seen by it"),
    _Stream(
        "POSITION_TARGET_LOCAL_NED",
        PositionTarget,
        POSITION_TARGET_LOCAL_NED,
        1.0,
        Verdict.WARN,
        "setpoints of other sources are seen by it",
    ),
)


def rows(facts: Facts, autopilot: Autopilot) -> Iterator[Finding]:
    """Judge the rates of all streams that this autopilot is asked for."""
    for stream in _STREAMS:
        asked_hz = autopilot.streams_hz.get(stream.message_id)
        # ArduCopter tells its setpoint in GUIDED only.
        if asked_hz is None or (stream.kind is PositionTarget and not autopilot.tells_setpoint_always):
            continue
        rate_hz = facts.rates_hz.get(stream.kind, 0.0)
        passed = rate_hz >= stream.least_hz
        yield Finding(
            stream.name,
            f"{rate_hz:.1f} Hz",
            f"at least {stream.least_hz:g} Hz ({asked_hz:g} asked for)",
            Verdict.PASS if passed else stream.otherwise,
            "" if passed else f"{stream.without}: is the link fast enough for {asked_hz:g} Hz?",
        )
