"""Readiness checks: one row for each condition of arming and engaging."""

import math
from typing import NamedTuple

from guidance.autopilots import AutopilotProfile, Mode
from guidance.flight.settings import FlightSettings
from guidance.flight.tracking import Tracking
from guidance.messages import Attitude, Heartbeat, Home, LandedState, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

# MAV_SYS_STATUS_SENSOR bits that must be healthy if the autopilot reports them.
_PREARM_CHECK = 1 << 28

HEARTBEAT_LIMIT_S = 3.0
TELEMETRY_LIMIT_S = 1.0


class Check(NamedTuple):
    """One condition: name, result, and the value found."""

    name: str
    passed: bool
    found: str


def checks(
    vehicle: VehicleState, profile: AutopilotProfile, now_s: float, *, battery_minimum: float
) -> tuple[Check, ...]:
    """Evaluate every condition for arming and engaging.

    Args:
        vehicle: Last known state of the vehicle.
        profile: The expected autopilot.
        now_s: The present, on the clock that stamped the messages.
        battery_minimum: Least battery remaining, 0 to 1; unknown (NaN) passes, since not every vehicle measures it.
    """
    heartbeat = vehicle.last(Heartbeat)
    return (
        Check(
            "autopilot",
            heartbeat is not None and heartbeat.autopilot == profile.autopilot_id,
            "not heard" if heartbeat is None else f"MAV_AUTOPILOT {heartbeat.autopilot}, want {profile.autopilot_id}",
        ),
        _fresh(vehicle, Heartbeat, now_s, HEARTBEAT_LIMIT_S),
        _fresh(vehicle, LocalPosition, now_s, TELEMETRY_LIMIT_S),
        _fresh(vehicle, Attitude, now_s, TELEMETRY_LIMIT_S),
        _fresh(vehicle, LandedState, now_s, 2.0 * TELEMETRY_LIMIT_S),
        _fresh(vehicle, Home, now_s, math.inf),
        *_status(vehicle, profile, battery_minimum),
    )


def evader_refusal(tracking: Tracking, settings: FlightSettings, now_s: float) -> str:
    """Return why this evader may not be engaged now; empty if it may."""
    silence_s, limit_s = tracking.silence_s(now_s), settings.cycle.evader_timeout_s
    if silence_s > limit_s:
        heard = "was never heard" if math.isinf(silence_s) else f"was last heard {silence_s:.1f} s ago"
        return f"the evader {heard}; at most {limit_s:g} s is allowed"
    rival = tracking.rival(now_s)
    if rival and settings.hold_on_rival:
        return f"two sources report as the evader (told apart by {rival}); silence one, or set evader.second_source"
    return ""


def telemetry_gap(vehicle: VehicleState, now_s: float) -> str:
    """Return the missing messages of the vehicle, and for how long."""
    ages_s = {
        "HEARTBEAT": vehicle.age_s(Heartbeat, now_s),
        "LOCAL_POSITION_NED": vehicle.age_s(LocalPosition, now_s),
        "ATTITUDE": vehicle.age_s(Attitude, now_s),
    }
    limits_s = {"HEARTBEAT": HEARTBEAT_LIMIT_S, "LOCAL_POSITION_NED": TELEMETRY_LIMIT_S}
    everything_s = min(ages_s.values())
    if everything_s > 0.5 * TELEMETRY_LIMIT_S:  # a message that still came would be younger than that
        return f"no telemetry for {everything_s:.1f} s"
    missing = [name for name, limit_s in limits_s.items() if ages_s[name] > limit_s]
    return "; ".join(f"no {name} for {ages_s[name]:.1f} s" for name in missing) or "telemetry is back"


def _fresh(
    vehicle: VehicleState,
    kind: type[Heartbeat | LocalPosition | Attitude | LandedState | Home],
    now_s: float,
    limit_s: float,
) -> Check:
    age_s = vehicle.age_s(kind, now_s)
    heard = math.isfinite(age_s)
    return Check(kind.__name__, heard and age_s <= limit_s, f"{age_s:.1f} s old" if heard else "not heard")


def _status(vehicle: VehicleState, profile: AutopilotProfile, battery_minimum: float) -> tuple[Check, Check]:
    status = vehicle.last(SystemStatus)
    if status is None:
        return Check("prearm", passed=False, found="not heard"), Check("battery", passed=False, found="not heard")
    reported = profile.prearm_always_told or bool(status.sensors_present & _PREARM_CHECK)
    healthy = bool(status.sensors_health & _PREARM_CHECK)
    found = "healthy" if healthy else "the autopilot's own checks fail"
    if reported and not healthy and _waits_in_guided(vehicle, profile):
        # PX4 keeps OFFBOARD after a landing, and its checks then miss our setpoints. We arm in its hold, where it
        # refuses by itself what really is wrong.
        reported, found = False, "of a mode that misses setpoints; asked again as it arms"
    battery = status.battery_remaining
    return (
        Check("prearm", healthy or not reported, found),
        Check("battery", not battery < battery_minimum, "unknown" if math.isnan(battery) else f"{battery:.0%} left"),
    )


def _waits_in_guided(vehicle: VehicleState, profile: AutopilotProfile) -> bool:
    """Whether a disarmed vehicle is in the guided mode of an autopilot that needs a stream for it."""
    heartbeat = vehicle.last(Heartbeat)
    if heartbeat is None or heartbeat.armed or not profile.stream_before_guided:
        return False
    return profile.mode_of(heartbeat.custom_mode) is Mode.GUIDED
