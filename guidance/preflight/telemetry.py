"""Rows about the vehicle's telemetry: consistent positions and heights, and stream rates.

An old estimator origin or a wrong height datum has flown vehicles into the ground. Comparing two messages about the
same place reveals both.
"""

import math
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
    Wants,
)
from guidance.frames import Amsl, LocalFrame, Projection, Vector
from guidance.messages import (
    Attitude,
    GlobalPosition,
    Home,
    LocalPosition,
    Message,
    Odometry,
    Origin,
    PositionTarget,
    SystemStatus,
)
from guidance.preflight.survey import Facts

_AGREEMENT_M = 5.0
_HOME_HEIGHT_M = 3.0


def position_rows(facts: Facts, projection: Projection, wants: Wants) -> Iterator[Finding]:
    """Judge battery, origin, home, position and height datum."""
    vehicle = facts.vehicle
    if wants.battery_needed is not None:
        yield _battery(vehicle.last(SystemStatus), wants.battery_needed)
    origin, home = vehicle.last(Origin), vehicle.last(Home)
    if origin is None or home is None:
        missing = " and ".join(
            name for name, one in (("GPS_GLOBAL_ORIGIN", origin), ("HOME_POSITION", home)) if one is None
        )
        yield Finding("local frame", "unknown", f"{missing} heard", Verdict.REFUSE, "wait for a position fix")
        return
    frame = LocalFrame(
        origin.latitude_deg,
        origin.longitude_deg,
        Amsl(origin.altitude_amsl_m),
        Amsl(home.altitude_amsl_m),
        projection=projection,
    )
    yield _origin(frame, home, wants)
    yield _home(frame, home)
    position, local = vehicle.last(GlobalPosition), vehicle.last(LocalPosition)
    if position is None or local is None:
        yield Finding("position", "unknown", "GLOBAL_POSITION_INT and LOCAL_POSITION_NED heard", Verdict.REFUSE)
        return
    yield _position(frame, position, local)
    yield _datum(home, position)
    yield _evader(facts, home, wants)


def _battery(status: SystemStatus | None, needed: float) -> Finding:
    wanted = f"at least {needed:.0%}, to fly home from the edge of the fence"
    if status is None or math.isnan(status.battery_remaining):
        return Finding("battery reserve", "unknown", wanted, Verdict.WARN, "the autopilot does not report the battery")
    left, advice = status.battery_remaining, "charge the battery or make the fence smaller; see flight.reserve"
    verdict = Verdict.REFUSE if left < needed else Verdict.PASS
    return Finding("battery reserve", f"{left:.0%}", wanted, verdict, advice if left < needed else "")


def _origin(frame: LocalFrame, home: Home, wants: Wants) -> Finding:
    north, east, _ = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m))
    distance_m = math.hypot(north, east)
    limit_m = wants.preflight.origin_distance_limit_m
    return _within("frame origin", distance_m, limit_m, "m from home", "restart the autopilot here: its origin is old")


def _home(frame: LocalFrame, home: Home) -> Finding:
    reckoned = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m))
    return _agree("home in the frame", reckoned, home.position_ned_m, "home was set in another frame: set it again")


def _position(frame: LocalFrame, position: GlobalPosition, local: LocalPosition) -> Finding:
    reckoned = frame.ned_from_wgs84(position.latitude_deg, position.longitude_deg, Amsl(position.altitude_amsl_m))
    advice = "LOCAL_POSITION_NED and GLOBAL_POSITION_INT contradict each other: restart the autopilot here"
    return _agree("local = global", reckoned, local.position_ned_m, advice)


def _datum(home: Home, position: GlobalPosition) -> Finding:
    home_amsl_m = position.altitude_amsl_m - position.altitude_above_home_m
    difference_m = abs(home_amsl_m - home.altitude_amsl_m)
    advice = "the altitudes have different datums (sea level, ellipsoid, home?)"
    return _within("datum of home", difference_m, _HOME_HEIGHT_M, "m apart", advice)


def _evader(facts: Facts, home: Home, wants: Wants) -> Finding:
    limit_m = wants.preflight.evader_height_limit_m
    if facts.evader_amsl_m is None:
        return Finding(
            "evader's altitude", "not heard", f"within {limit_m:g} m of home", Verdict.WARN, "is it sending?"
        )
    difference_m = abs(facts.evader_amsl_m - home.altitude_amsl_m)
    advice = "a different datum? The geoid is about 50 m above the ellipsoid: see evader.frame.undulation_m"
    return _within("evader's altitude", difference_m, limit_m, "m from home's", advice)


def _agree(name: str, one: Vector, other: Vector, advice: str) -> Finding:
    return _within(name, math.dist(one, other), _AGREEMENT_M, "m apart", advice)


def _within(name: str, found: float, limit: float, what: str, advice: str) -> Finding:
    passed = found <= limit
    verdict = Verdict.PASS if passed else Verdict.REFUSE
    return Finding(name, f"{found:.1f} {what}", f"at most {limit:g} m", verdict, "" if passed else advice)


class _Stream(NamedTuple):
    name: str
    kind: type[Message]
    message_id: int
    least_hz: float
    otherwise: Verdict
    without: str


_STREAMS: Final = (
    _Stream("LOCAL_POSITION_NED", LocalPosition, LOCAL_POSITION_NED, 10.0, Verdict.REFUSE, "the game needs it"),
    _Stream("ATTITUDE", Attitude, ATTITUDE, 4.0, Verdict.REFUSE, "the heading needs it"),
    _Stream("GLOBAL_POSITION_INT", GlobalPosition, GLOBAL_POSITION_INT, 1.0, Verdict.WARN, "the frame check needs it"),
    _Stream("ODOMETRY", Odometry, ODOMETRY, 5.0, Verdict.WARN, "the detection of estimator resets needs it"),
    _Stream(
        "POSITION_TARGET_LOCAL_NED",
        PositionTarget,
        POSITION_TARGET_LOCAL_NED,
        1.0,
        Verdict.WARN,
        "the detection of foreign setpoints needs it",
    ),
)


def stream_rows(facts: Facts, autopilot: Autopilot) -> Iterator[Finding]:
    """Judge the rate of every requested stream."""
    for stream in _STREAMS:
        asked_hz = autopilot.streams_hz.get(stream.message_id)
        # ArduCopter reports its setpoint in GUIDED only.
        if asked_hz is None or (stream.kind is PositionTarget and not autopilot.tells_setpoint_always):
            continue
        rate_hz = facts.rates_hz.get(stream.kind, 0.0)
        passed = rate_hz >= stream.least_hz
        yield Finding(
            stream.name,
            f"{rate_hz:.1f} Hz",
            f"at least {stream.least_hz:g} Hz ({asked_hz:g} requested)",
            Verdict.PASS if passed else stream.otherwise,
            "" if passed else f"{stream.without}: is the link fast enough for {asked_hz:g} Hz?",
        )
