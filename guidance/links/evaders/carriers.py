"""MAVLink messages that report an evader: how each becomes an `EvaderReport`, with its units, datum and clock.

A vehicle sends FOLLOW_TARGET, GLOBAL_POSITION_INT or ODOMETRY of itself. A receiver relays ADSB_VEHICLE and
OPEN_DRONE_ID_LOCATION of others.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from guidance.frames import Ellipsoid, LocalFrame, Ned
from guidance.links.mavlink import codec
from guidance.links.mavlink.frames import Fields
from guidance.messages import UNKNOWN_VELOCITY, AltitudeSaid, Datum, EvaderReport
from guidance.vehicle import FARTHEST_M, is_plausible

CAPABILITY_VELOCITY: Final = 1 << 1
_OLDEST_S: Final = 2
"""Largest age of an ADSB_VEHICLE."""

_MOST_COUNTERS: Final = 32

_DIAGONAL: Final = (0, 6, 11)  # of the upper right triangle of a 6 x 6 matrix, row by row


UNKNOWN_MOTION: Final = (36100, 25500, 6300)
"""Direction (1/100 degree), horizontal and vertical speed (cm/s) that OPEN_DRONE_ID_LOCATION defines as unknown."""

UNKNOWN_ALTITUDE_M: Final = -1000.0
_HOUR_S: Final = 3600.0
HORIZONTAL_BOUNDS_M: Final = (
    math.nan, 18520.0, 7408.0, 3704.0, 1852.0, 926.0, 555.6, 185.2, 92.6, 30.0, 10.0, 3.0, 1.0,
)  # fmt: skip
SPEED_BOUNDS_M_S: Final = (math.nan, 10.0, 3.0, 1.0, 0.3)


class RefusedReport(ValueError):  # noqa: N818 -- a verdict on a report, counted and never shown as an error
    """A report that must not be used; its text is a short word for the counters."""


def accepted(
    counts: Counter[str],
    read: Callable[[Any, float], EvaderReport],
    data: object,
    received_s: float,
) -> EvaderReport | None:
    """Return what `read` makes of the data, None if it is refused or implausible; count either, by reason."""
    reason = "implausible"
    try:
        report = read(data, received_s)
        if is_plausible(report):
            counts["reports"] += 1
            return report
    except RefusedReport as refused:
        reason = str(refused)
    except (ValueError, ArithmeticError):
        reason = "invalid"
    counter = f"refused_{reason}"
    if counter not in counts and len(counts) >= _MOST_COUNTERS:  # reasons may quote the sender
        counter = "refused_otherwise"
    counts[counter] += 1
    return None


class Zero(NamedTuple):
    """The zero of a sender's altitudes, and the geoid's height above the ellipsoid, m; NaN where it is not needed."""

    datum: Datum
    undulation_m: float = math.nan

    def said(self, altitude_m: float) -> AltitudeSaid:
        """Return an altitude as it was received."""
        return AltitudeSaid(altitude_m, self.datum)

    def amsl_m(self, altitude_m: float) -> float:
        """Return an altitude above mean sea level."""
        return altitude_m - self.undulation_m if self.datum is Datum.ELLIPSOID else altitude_m


SEA_LEVEL: Final = Zero(Datum.AMSL)


class Carrier(NamedTuple):
    """A MAVLink message that reports an evader.

    Attributes:
        message: Its name.
        report: Converts the message that arrived at a time of our clock. Raises `RefusedReport` if it must not be used,
            ValueError if a value is unknown.
        period_s: When the sender's clock wraps.
    """

    message: str
    report: Callable[[Fields, float], EvaderReport]
    period_s: float = 2.0**32 / 1e3


def _follow_target(zero: Zero, fields: Fields, received_s: float) -> EvaderReport:
    """Convert FOLLOW_TARGET, which phones, ground stations and beacons send.

    * Position: WGS-84 degrees; altitude above mean sea level, metres. QGroundControl on Android sends heights above
      the ellipsoid instead: `zero` says which.
    * Velocity: north, east, down, m/s. (0, 0, 0) means unknown, by the message's definition. So does a velocity whose
      bit in `est_capabilities` is not set although others are. Many senders set no capabilities.
    * Accuracy: `position_cov` carries standard deviations (ground stations fill in "eph, epv"), zero for unknown.
    * Clock: milliseconds since the sender's boot, which wrap at 2^32 since many senders count in 32 bits.
    """
    position = (*codec.degrees(fields.lat, fields.lon), zero.amsl_m(fields.alt))
    altitude = zero.said(fields.alt)
    velocity = UNKNOWN_VELOCITY
    without_capabilities = fields.est_capabilities == 0
    if any(fields.vel) and (without_capabilities or fields.est_capabilities & CAPABILITY_VELOCITY):
        velocity = known_velocity(fields.vel)
    sd_m = standard_deviation(*(value * abs(value) for value in fields.position_cov))
    return EvaderReport(
        received_s,
        fields.timestamp % 2**32 / 1e3,
        fields.msgname,
        *position,
        velocity,
        sd_m,
        said=altitude,
    )


def _global_position(zero: Zero, fields: Fields, received_s: float) -> EvaderReport:
    """Convert GLOBAL_POSITION_INT of another vehicle.

    * Position: WGS-84 degrees; `alt` above mean sea level unless `zero` says otherwise, millimetres. `relative_alt` is
      not used: it is above the other vehicle's home.
    * Velocity: north, east, down, cm/s. Always known: zero means at rest.
    * Clock: `time_boot_ms`, which wraps at 2^32.
    """
    position = (*codec.degrees(fields.lat, fields.lon), zero.amsl_m(fields.alt / 1e3))
    altitude = zero.said(fields.alt / 1e3)
    return EvaderReport(
        received_s,
        fields.time_boot_ms / 1e3,
        fields.msgname,
        *position,
        codec.velocity_in_cm_s(fields),
        said=altitude,
    )


def _odometry(frame: LocalFrame, fields: Fields, received_s: float) -> EvaderReport:
    """Convert ODOMETRY, another vehicle's pose in its own local frame; `frame` must have the same origin.

    * Position: metres in MAV_FRAME_LOCAL_NED about that origin (the evader's GPS_GLOBAL_ORIGIN, altitude above mean
      sea level). Other frames are refused; LOCAL_FRD does not say where north is.
    * Velocity: in `child_frame_id`. LOCAL_NED is used as it is, BODY_FRD is rotated by the attitude; unknown otherwise.
    * Accuracy: the largest of the three axes' variances, NaN for unknown (MAVLink's NaN or zero).
    * Clock: `time_usec` of the sender, 64 bits.
    """
    if fields.frame_id != mavlink.MAV_FRAME_LOCAL_NED:
        raise RefusedReport("frame")
    position = place_in(frame, Ned((fields.x, fields.y, fields.z)))
    altitude = AltitudeSaid(-fields.z, Datum.ORIGIN)
    velocity = known_velocity((fields.vx, fields.vy, fields.vz))
    if fields.child_frame_id == mavlink.MAV_FRAME_BODY_FRD:
        velocity = Ned(rotate(fields.q, velocity))
    elif fields.child_frame_id != mavlink.MAV_FRAME_LOCAL_NED:
        velocity = UNKNOWN_VELOCITY
    sd_m = standard_deviation(*(fields.pose_covariance[index] for index in _DIAGONAL))
    sd_m_s = standard_deviation(*(fields.velocity_covariance[index] for index in _DIAGONAL))
    return EvaderReport(
        received_s,
        fields.time_usec / 1e6,
        fields.msgname,
        *position,
        velocity,
        sd_m,
        sd_m_s,
        said=altitude,
    )


def _adsb(
    undulation_m: float, icao_address: int | None, fields: Fields, received_s: float
) -> EvaderReport:
    """Convert ADSB_VEHICLE of one aircraft.

    * Position: WGS-84 degrees. Altitude in millimetres, by `altitude_type`: QNH pressure is taken as above mean sea
      level; geometric is above the WGS-84 ellipsoid, converted with the undulation.
    * Velocity: course over ground and speeds, up positive; known only if the flags say so.
    * Clock: none (`sent_s` is NaN). `tslc` counts whole seconds since the aircraft was received; old ones are refused.
    """
    for is_refused, reason in (
        (fields.ICAO_address != icao_address, "other_id"),
        (fields.tslc > _OLDEST_S, "old"),
        (not fields.flags & mavlink.ADSB_FLAGS_VALID_COORDS, "position"),
        (not fields.flags & mavlink.ADSB_FLAGS_VALID_ALTITUDE, "altitude"),
    ):
        if is_refused:
            raise RefusedReport(reason)
    geometric = fields.altitude_type == mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC
    zero = Zero(Datum.ELLIPSOID, undulation_m) if geometric else SEA_LEVEL
    altitude = zero.said(fields.altitude / 1e3)
    position = (*codec.degrees(fields.lat, fields.lon), zero.amsl_m(altitude.altitude_m))
    velocity = UNKNOWN_VELOCITY
    if fields.flags & codec.VALID_MOTION == codec.VALID_MOTION:
        velocity = codec.velocity_over_ground(
            fields.heading, fields.hor_velocity, fields.ver_velocity
        )
    return EvaderReport(received_s, math.nan, fields.msgname, *position, velocity, said=altitude)


def _open_drone_id(
    zero: Zero, id_or_mac: str | None, fields: Fields, received_s: float
) -> EvaderReport:
    """Convert OPEN_DRONE_ID_LOCATION: remote identification, about once a second (ASTM F3411).

    * Identity: `id_or_mac` (hexadecimal) selects one of the drones that are relayed.
    * Position: WGS-84 degrees, 0/0 for unknown. Altitude: `altitude_geodetic`, metres above the WGS-84 ellipsoid
      unless `zero` says otherwise. The barometric altitude (against 1013.25 hPa) is not used.
    * Velocity: course over ground and speeds, up positive; 36100, 25500 and 6300 mean unknown.
    * Accuracy: classes that bound 95 % of the errors; half of the bound is taken as the standard deviation.
    * Clock: seconds of the hour UTC, which wrap at 3600; 0xFFFF for unknown.
    """
    if id_or_mac is not None and bytes(fields.id_or_mac) != bytes.fromhex(id_or_mac).ljust(
        20, b"\0"
    ):
        raise RefusedReport("other_id")
    altitude = zero.said(fields.altitude_geodetic)
    if not altitude.altitude_m > UNKNOWN_ALTITUDE_M:
        raise RefusedReport("altitude")
    position = (*codec.degrees(fields.latitude, fields.longitude), zero.amsl_m(altitude.altitude_m))
    motion = fields.direction, fields.speed_horizontal, fields.speed_vertical
    velocity = UNKNOWN_VELOCITY
    if all(value < unknown for value, unknown in zip(motion, UNKNOWN_MOTION, strict=True)):
        velocity = codec.velocity_over_ground(*motion)
    sent_s = fields.timestamp if 0.0 <= fields.timestamp <= _HOUR_S else math.nan
    sd_m = _half(HORIZONTAL_BOUNDS_M, fields.horizontal_accuracy)
    sd_m_s = _half(SPEED_BOUNDS_M_S, fields.speed_accuracy)
    return EvaderReport(
        received_s, sent_s, fields.msgname, *position, velocity, sd_m, sd_m_s, said=altitude
    )


FOLLOW_TARGET: Final = Carrier("FOLLOW_TARGET", partial(_follow_target, SEA_LEVEL))
GLOBAL_POSITION: Final = Carrier("GLOBAL_POSITION_INT", partial(_global_position, SEA_LEVEL))


def carrier_of(
    kind: str,
    frame: LocalFrame,
    icao_address: int | None = None,
    id_or_mac: str | None = None,
    datum: Datum | None = None,
) -> Carrier:
    """Return the carrier of a kind that a vehicle file names.

    Args:
        kind: "follow_target", "global_position", "odometry", "open_drone_id" or "adsb".
        frame: The evader's local frame, for metres and for heights above the ellipsoid.
        icao_address: The aircraft of ADSB_VEHICLE.
        id_or_mac: The drone of OPEN_DRONE_ID_LOCATION, hexadecimal; None for any.
        datum: The zero of the sender's altitudes; None is the message's own.

    Raises:
        ConfigError: If the frame does not declare the undulation although the heights need it.
    """
    if kind == "odometry":
        return Carrier("ODOMETRY", partial(_odometry, frame), 2.0**64 / 1e6)
    if kind == "adsb":
        return Carrier("ADSB_VEHICLE", partial(_adsb, _undulation_m(frame), icao_address))
    if kind == "open_drone_id":
        zero = _zero(frame, Datum.ELLIPSOID if datum is None else datum)
        return Carrier("OPEN_DRONE_ID_LOCATION", partial(_open_drone_id, zero, id_or_mac), _HOUR_S)
    zero = _zero(frame, Datum.AMSL if datum is None else datum)
    if kind == "follow_target":
        return Carrier("FOLLOW_TARGET", partial(_follow_target, zero))
    return Carrier("GLOBAL_POSITION_INT", partial(_global_position, zero))


def _zero(frame: LocalFrame, datum: Datum) -> Zero:
    return Zero(datum, _undulation_m(frame)) if datum is Datum.ELLIPSOID else Zero(datum)


def _undulation_m(frame: LocalFrame) -> float:
    return -frame.amsl(Ellipsoid(0.0)).metres


def _half(bounds: tuple[float, ...], index: int) -> float:
    return bounds[index] / 2.0 if 0 <= index < len(bounds) else math.nan


def place_in(frame: LocalFrame, position_ned_m: Ned) -> tuple[float, float, float]:
    """Return latitude and longitude, degrees, and the altitude above mean sea level, m, of a position.

    Raises:
        RefusedReport: If it is not finite or too far away.
    """
    if not all(abs(part) <= FARTHEST_M for part in position_ned_m):  # NaN fails this too
        raise RefusedReport("position")
    latitude, longitude, altitude = frame.wgs84_from_ned(position_ned_m)
    return latitude, longitude, altitude.metres


def known_velocity(velocity: Sequence[float]) -> Ned:
    """Return a velocity; unknown (NaN) if any part is not finite."""
    x, y, z = velocity
    if math.isfinite(x + y + z):
        return Ned((x, y, z))
    return UNKNOWN_VELOCITY


def standard_deviation(*variances: float) -> float:
    """Return the largest standard deviation; NaN if no variance is known (positive and finite)."""
    positive = [variance for variance in variances if math.isfinite(variance) and variance > 0.0]
    return math.sqrt(max(positive)) if positive else math.nan


def rotate(quaternion_wxyz: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Rotate a vector by q v q*; unknown (NaN) if the quaternion's length is not 1 within 5 %."""
    w, x, y, z = quaternion_wxyz
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) < 0.05:
        return UNKNOWN_VELOCITY
    w = w / length
    x = x / length
    y = y / length
    z = z / length
    vx, vy, vz = vector
    tx = 2 * (y * vz - z * vy)
    ty = 2 * (z * vx - x * vz)
    tz = 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )
