"""MAVLink messages that report an evader: how each becomes an `EvaderReport`, with its units, datum and clock.

A vehicle sends FOLLOW_TARGET, GLOBAL_POSITION_INT or ODOMETRY of itself. A receiver relays ADSB_VEHICLE and
OPEN_DRONE_ID_LOCATION of others.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from guidance.errors import ConfigError
from guidance.frames import Amsl, Ellipsoid, LocalFrame, Vector
from guidance.links import codec
from guidance.links.frames import Fields
from guidance.messages import UNKNOWN_VELOCITY, AltitudeSaid, Datum, EvaderReport
from guidance.vehicle import FARTHEST_M, is_plausible

CAPABILITY_VELOCITY: Final = 1 << 1
_DIAGONAL: Final = (0, 6, 11)  # of the upper right triangle of a 6 x 6 matrix, row by row


UNKNOWN_MOTION: Final = (36100, 25500, 6300)
"""Direction (1/100 degree), horizontal and vertical speed (cm/s) that OPEN_DRONE_ID_LOCATION defines as unknown."""

UNKNOWN_ALTITUDE_M: Final = -1000.0
HORIZONTAL_BOUNDS_M: Final = (
    math.nan, 18520.0, 7408.0, 3704.0, 1852.0, 926.0, 555.6, 185.2, 92.6, 30.0, 10.0, 3.0, 1.0,
)  # fmt: skip
SPEED_BOUNDS_M_S: Final = (math.nan, 10.0, 3.0, 1.0, 0.3)


class Refused(ValueError):  # noqa: N818 -- a verdict on a report, counted and never shown as an error
    """A report that must not be used; `reason` is a short word for the counters."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(slots=True)
class SenderClock:
    """Unwraps readings of a clock with a period, in its own unit.

    Each reading is taken as the one nearest to the last: a late report from before the wrap stays before it. Gaps must
    therefore be shorter than half a period. A restart of the sender is a step back; the estimator judges it.
    """

    period: float = 2.0**32
    last: float = math.nan

    def unwrap(self, reading: float) -> float:
        """Return the reading plus the periods that have passed."""
        half = self.period / 2.0
        if math.isnan(self.last):
            self.last = reading
        else:
            self.last += (reading - self.last + half) % self.period - half
        return self.last


@dataclass(slots=True)
class FollowTarget:
    """Carrier of FOLLOW_TARGET, which phones, ground stations and beacons send.

    * Position: WGS-84 degrees; altitude above mean sea level, metres.
    * Velocity: north, east, down, m/s. (0, 0, 0) means unknown, by the message's definition. So does a velocity whose
      bit in `est_capabilities` is not set although others are. Many senders set no capabilities.
    * Accuracy: `position_cov` carries standard deviations (ground stations fill in "eph, epv"), zero for unknown.
    * Clock: milliseconds since the sender's boot, unwrapped at 2^32 since many senders count in 32 bits.
    """

    message: ClassVar[str] = "FOLLOW_TARGET"
    clock: SenderClock = field(default_factory=SenderClock)

    def report(self, m: Fields, received_s: float) -> EvaderReport:
        """Convert a message."""
        place = *codec.degrees(m.lat, m.lon), m.alt
        sent_s = self.clock.unwrap(m.timestamp % 2**32) / 1e3
        known = m.est_capabilities == 0 or m.est_capabilities & CAPABILITY_VELOCITY
        velocity = known_velocity(m.vel) if known and any(m.vel) else UNKNOWN_VELOCITY
        sd_m = standard_deviation(*(value * abs(value) for value in m.position_cov))
        said = AltitudeSaid(m.alt, Datum.AMSL)
        return EvaderReport(received_s, sent_s, self.message, *place, velocity, sd_m, said=said)


@dataclass(slots=True)
class GlobalPositionInt:
    """Carrier of GLOBAL_POSITION_INT of another vehicle.

    * Position: WGS-84 degrees; `alt` above mean sea level, millimetres. `relative_alt` is not used: it is above the
      other vehicle's home.
    * Velocity: north, east, down, cm/s. Always known: zero means at rest.
    * Clock: `time_boot_ms`, unwrapped at 2^32.
    """

    message: ClassVar[str] = "GLOBAL_POSITION_INT"
    clock: SenderClock = field(default_factory=SenderClock)

    def report(self, m: Fields, received_s: float) -> EvaderReport:
        """Convert a message."""
        place = *codec.degrees(m.lat, m.lon), m.alt / 1e3
        velocity = (m.vx / 1e2, m.vy / 1e2, m.vz / 1e2)
        sent_s = self.clock.unwrap(m.time_boot_ms) / 1e3
        said = AltitudeSaid(m.alt / 1e3, Datum.AMSL)
        return EvaderReport(received_s, sent_s, self.message, *place, velocity, said=said)


@dataclass(frozen=True, slots=True)
class OdometryCarrier:
    """Carrier of ODOMETRY, another vehicle's pose in its own local frame; `frame` must have the same origin.

    * Position: metres in MAV_FRAME_LOCAL_NED about that origin (the evader's GPS_GLOBAL_ORIGIN, altitude above mean
      sea level). Other frames are refused; LOCAL_FRD does not say where north is.
    * Velocity: in `child_frame_id`. LOCAL_NED is used as it is, BODY_FRD is rotated by the attitude; unknown otherwise.
    * Accuracy: the largest of the three axes' variances, NaN for unknown (MAVLink's NaN or zero).
    * Clock: `time_usec` of the sender, 64 bits: it does not wrap.
    """

    frame: LocalFrame
    message: ClassVar[str] = "ODOMETRY"

    def report(self, m: Fields, received_s: float) -> EvaderReport:
        """Convert a message."""
        if m.frame_id != mavlink.MAV_FRAME_LOCAL_NED:
            raise Refused("frame")
        position = (m.x, m.y, m.z)
        if not all(abs(part) <= FARTHEST_M for part in position):  # NaN fails this too
            raise Refused("position")
        latitude, longitude, altitude = self.frame.wgs84_from_ned(position)
        velocity = known_velocity((m.vx, m.vy, m.vz))
        if m.child_frame_id != mavlink.MAV_FRAME_LOCAL_NED:
            velocity = rotate(m.q, velocity) if m.child_frame_id == mavlink.MAV_FRAME_BODY_FRD else UNKNOWN_VELOCITY
        place = latitude, longitude, altitude.metres
        sd_m = standard_deviation(*(m.pose_covariance[index] for index in _DIAGONAL))
        sd_m_s = standard_deviation(*(m.velocity_covariance[index] for index in _DIAGONAL))
        said = AltitudeSaid(-m.z, Datum.ORIGIN)
        return EvaderReport(received_s, m.time_usec / 1e6, self.message, *place, velocity, sd_m, sd_m_s, said=said)


@dataclass(frozen=True, slots=True)
class AdsbVehicle:
    """Carrier of ADSB_VEHICLE: one aircraft, by its ICAO address.

    * Position: WGS-84 degrees. Altitude in millimetres, by `altitude_type`: QNH pressure is taken as above mean sea
      level; geometric is above the WGS-84 ellipsoid, converted with the undulation that `frame` declares.
    * Velocity: course over ground and speeds, up positive; known only if the flags say so.
    * Clock: none (`sent_s` is NaN). `tslc` counts whole seconds since the aircraft was received; old ones are refused.

    Raises:
        ConfigError: If the frame does not declare the undulation.
    """

    frame: LocalFrame
    icao_address: int
    oldest_s: int = 2
    message: ClassVar[str] = "ADSB_VEHICLE"

    def __post_init__(self) -> None:
        self.frame.amsl(Ellipsoid(0.0))

    def report(self, m: Fields, received_s: float) -> EvaderReport:
        """Convert a message."""
        for refused, reason in (
            (m.ICAO_address != self.icao_address, "other_id"),
            (m.tslc > self.oldest_s, "old"),
            (not m.flags & mavlink.ADSB_FLAGS_VALID_COORDS, "position"),
            (not m.flags & mavlink.ADSB_FLAGS_VALID_ALTITUDE, "altitude"),
        ):
            if refused:
                raise Refused(reason)
        given_m = m.altitude / 1e3
        altitude, said = Amsl(given_m), AltitudeSaid(given_m, Datum.AMSL)
        if m.altitude_type == mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC:
            altitude, said = self.frame.amsl(Ellipsoid(given_m)), AltitudeSaid(given_m, Datum.ELLIPSOID)
        place = *codec.degrees(m.lat, m.lon), altitude.metres
        known = m.flags & codec.VALID_MOTION == codec.VALID_MOTION
        velocity = codec.velocity_over_ground(m.heading, m.hor_velocity, m.ver_velocity) if known else UNKNOWN_VELOCITY
        return EvaderReport(received_s, math.nan, self.message, *place, velocity, said=said)


@dataclass(slots=True)
class OpenDroneIdLocation:
    """Carrier of OPEN_DRONE_ID_LOCATION: remote identification, about once a second (ASTM F3411).

    * Position: WGS-84 degrees, 0/0 for unknown. Altitude: `altitude_geodetic`, metres above the WGS-84 ellipsoid,
      converted with the undulation that `frame` declares. The barometric altitude (against 1013.25 hPa) is not used.
    * Velocity: course over ground and speeds, up positive; 36100, 25500 and 6300 mean unknown.
    * Accuracy: classes that bound 95 % of the errors; half of the bound is taken as the standard deviation.
    * Clock: seconds of the hour UTC, unwrapped at 3600; 0xFFFF for unknown.

    `id_or_mac` selects one of the drones that are relayed.

    Raises:
        ConfigError: If the frame does not declare the undulation.
    """

    frame: LocalFrame
    id_or_mac: bytes | None = None
    message: ClassVar[str] = "OPEN_DRONE_ID_LOCATION"
    clock: SenderClock = field(default_factory=lambda: SenderClock(period=3600.0))

    def __post_init__(self) -> None:
        self.frame.amsl(Ellipsoid(0.0))

    def report(self, m: Fields, received_s: float) -> EvaderReport:
        """Convert a message."""
        if self.id_or_mac is not None and bytes(m.id_or_mac) != self.id_or_mac.ljust(20, b"\0"):
            raise Refused("other_id")
        if not m.altitude_geodetic > UNKNOWN_ALTITUDE_M:
            raise Refused("altitude")
        place = *codec.degrees(m.latitude, m.longitude), self.frame.amsl(Ellipsoid(m.altitude_geodetic)).metres
        motion = m.direction, m.speed_horizontal, m.speed_vertical
        known = all(value < unknown for value, unknown in zip(motion, UNKNOWN_MOTION, strict=True))
        velocity = codec.velocity_over_ground(*motion) if known else UNKNOWN_VELOCITY
        sent_s = self.clock.unwrap(m.timestamp) if 0.0 <= m.timestamp <= 3600.0 else math.nan
        sd_m, sd_m_s = _half(HORIZONTAL_BOUNDS_M, m.horizontal_accuracy), _half(SPEED_BOUNDS_M_S, m.speed_accuracy)
        said = AltitudeSaid(m.altitude_geodetic, Datum.ELLIPSOID)
        return EvaderReport(received_s, sent_s, self.message, *place, velocity, sd_m, sd_m_s, said=said)


Carrier = FollowTarget | GlobalPositionInt | OdometryCarrier | AdsbVehicle | OpenDroneIdLocation
"""Converts one MAVLink message to a report, and may remember the sender's clock.

`report` raises `Refused` if the message must not be used, ValueError if a value is unknown or implausible.
"""


class EvaderIdentity(NamedTuple):
    """The evader's identity, as far as its carrier needs it: MAVLink ids, an ICAO address, a remote id."""

    system_id: int | None = None
    component_id: int | None = None
    icao_address: int | None = None
    id_or_mac: bytes | None = None


def _adsb(frame: LocalFrame, identity: EvaderIdentity) -> Carrier:
    if identity.icao_address is None:
        raise ConfigError("evader.icao_address is missing: ADSB_VEHICLE needs the aircraft's address")
    return AdsbVehicle(frame, identity.icao_address)


CARRIERS: Final[Mapping[str, Callable[[LocalFrame, EvaderIdentity], Carrier]]] = {
    "follow_target": lambda _frame, _identity: FollowTarget(),
    "global_position": lambda _frame, _identity: GlobalPositionInt(),
    "odometry": lambda frame, _identity: OdometryCarrier(frame),
    "open_drone_id": lambda frame, identity: OpenDroneIdLocation(frame, identity.id_or_mac),
    "adsb": _adsb,
}
"""Carriers on a MAVLink wire, by their name in a configuration."""


def _half(bounds: tuple[float, ...], index: int) -> float:
    return bounds[index] / 2.0 if 0 <= index < len(bounds) else math.nan


def plausible(report: EvaderReport) -> EvaderReport:
    """Return the same report.

    Raises:
        Refused: If its position is implausible, see `guidance.vehicle.is_plausible`.
    """
    if not is_plausible(report):
        raise Refused("implausible")
    return report


def known_velocity(velocity: Sequence[float]) -> Vector:
    """Return a velocity; unknown (NaN) if any part is not finite."""
    x, y, z = velocity
    return (x, y, z) if math.isfinite(x + y + z) else UNKNOWN_VELOCITY


def standard_deviation(*variances: float) -> float:
    """Return the largest standard deviation; NaN if no variance is known (positive and finite)."""
    known = [variance for variance in variances if math.isfinite(variance) and variance > 0.0]
    return math.sqrt(max(known)) if known else math.nan


def rotate(quaternion_wxyz: Sequence[float], vector: Vector) -> Vector:
    """Rotate a vector by q v q*; unknown (NaN) if the quaternion's length is not 1 within 5 %."""
    w, x, y, z = quaternion_wxyz
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) < 0.05:
        return UNKNOWN_VELOCITY
    w, x, y, z = w / length, x / length, y / length, z / length
    vx, vy, vz = vector
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )
