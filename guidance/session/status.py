"""What a daemon says of itself when it is asked: one JSON object."""

from collections.abc import Sequence
from typing import Any

from guidance.flight import Flight, Outputs
from guidance.log.codec import plain
from guidance.messages import Heartbeat, LocalPosition
from guidance.preflight import Finding, refusals


def status(
    name: str, now_s: float, flight: Flight, outputs: Outputs | None, rows: Sequence[Finding], *, recording: str
) -> dict[str, Any]:
    """Lay out where the flight stands. NaN and infinities become null."""
    vehicle = flight.vehicle
    certificate = None if outputs is None else outputs.certificate
    shown: dict[str, Any] = plain(
        {
            "name": name,
            "state": str(flight.state),
            "mode": flight.mode_name,
            "armed": vehicle.armed,
            "engage_on": str(flight.settings.engage_on),
            "after_capture": str(flight.settings.after_capture),
            "streaming": outputs is not None and outputs.setpoint is not None,
            "heartbeat_age_s": vehicle.age_s(Heartbeat, now_s),
            "position_age_s": vehicle.age_s(LocalPosition, now_s),
            "evader_silence_s": flight.tracking.silence_s(now_s),
            "checks_failed": [check.name for check in flight.checks(now_s) if not check.passed],
            "preflight_refused": list(refusals(rows)),
            "recording": recording,
            "certificate": certificate,
        }
    )
    return shown
