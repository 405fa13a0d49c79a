"""ROS 2 poses as rmw_zenoh carries them: geometry_msgs/PoseStamped and nav_msgs/Odometry in CDR.

* Position: metres east, north, up (REP 103) about the origin of `frame`, whose altitude is above mean sea level.
* Velocity: PoseStamped has none. Odometry's twist is in the child frame, forward-left-up of the body, and is turned
  by the pose's orientation.
* Accuracy: Odometry's covariances, row by row, the largest of the three axes; zero for unknown.
* Clock: `header.stamp`, the sender's; zero for none.
"""

import math
import struct
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.frames import LocalFrame, Vector, ned_from_game
from guidance.links.evaders.carrier import UNKNOWN_VELOCITY, Refused, finite_altitude, rotate, standard_deviation
from guidance.messages import AltitudeSaid, Datum, EvaderReport

POSE_TYPE: Final = "geometry_msgs::msg::dds_::PoseStamped_"
ODOMETRY_TYPE: Final = "nav_msgs::msg::dds_::Odometry_"
_DIAGONAL: Final = (0, 7, 14)  # of a 6 x 6 matrix, row by row
_ORDERS: Final = {b"\x00\x00": ">", b"\x00\x01": "<"}  # CDR_BE, CDR_LE
LONGEST_STRING: Final = 256


class CdrReader:
    """Reads plain CDR version 1 (OMG DDS-RTPS 2.x), value after value; every access is checked.

    Four bytes of encapsulation, then values aligned to their own size, counted from after those four.

    Raises:
        Refused: From every method, if the bytes end early or are not plain CDR.
    """

    def __init__(self, data: bytes) -> None:
        order = _ORDERS.get(data[:2])
        if order is None or len(data) < 4:
            raise Refused("encoding")
        self._order = order
        self._body = data[4:]
        self._at = 0

    def _take(self, code: str, size: int, count: int = 1) -> tuple[float, ...]:
        start = -(-self._at // size) * size
        end = start + size * count
        if end > len(self._body):
            raise Refused("length")
        self._at = end
        values: tuple[float, ...] = struct.unpack_from(f"{self._order}{count}{code}", self._body, start)
        return values

    def int32(self) -> int:
        """A signed 32 bit integer."""
        return int(self._take("i", 4)[0])

    def uint32(self) -> int:
        """An unsigned 32 bit integer."""
        return int(self._take("I", 4)[0])

    def float64(self, count: int) -> tuple[float, ...]:
        """A fixed number of doubles, without a length before them."""
        return self._take("d", 8, count)

    def string(self) -> str:
        """A string: length with the closing zero, then the bytes."""
        length = self.uint32()
        if not 1 <= length <= LONGEST_STRING or self._at + length > len(self._body):
            raise Refused("length")
        raw = self._body[self._at : self._at + length]
        self._at += length
        if raw[-1] != 0:
            raise Refused("encoding")
        return raw[:-1].decode(errors="replace")


def rmw_key(topic: str, dds_type: str) -> str:
    """The Zenoh key that rmw_zenoh publishes a topic on, whatever the ROS domain and the type's hash."""
    return f"*/{topic.strip('/')}/{dds_type}/*"


class _Header(NamedTuple):
    stamp_s: float
    frame_id: str


def _header(reader: CdrReader) -> _Header:
    seconds, nanoseconds, frame_id = reader.int32(), reader.uint32(), reader.string()
    stamp_s = seconds + nanoseconds / 1e9
    return _Header(stamp_s if stamp_s != 0.0 else math.nan, frame_id)


def _finite(vector: tuple[float, ...], most: float) -> Vector:
    x, y, z = vector
    if not (abs(x) < most and abs(y) < most and abs(z) < most):  # NaN fails this too
        raise Refused("position")
    return x, y, z


@dataclass(frozen=True, slots=True)
class RosPose:
    """Reads either type. `frame` is what ROS's `frame_id` stands for; poses in another frame are refused."""

    frame: LocalFrame
    frame_id: str = "map"

    def pose_stamped(self, payload: bytes, received_s: float) -> EvaderReport:
        """A geometry_msgs/PoseStamped.

        Raises:
            Refused: If the bytes are not one, or it is in another frame.
        """
        reader = CdrReader(payload)
        header = _header(reader)
        position = _finite(reader.float64(3), 1e6)
        reader.float64(4)
        return self._report(header, received_s, position, UNKNOWN_VELOCITY, math.nan, math.nan)

    def odometry(self, payload: bytes, received_s: float) -> EvaderReport:
        """A nav_msgs/Odometry.

        Raises:
            Refused: If the bytes are not one, or it is in another frame.
        """
        reader = CdrReader(payload)
        header = _header(reader)
        reader.string()
        position = _finite(reader.float64(3), 1e6)
        x, y, z, w = reader.float64(4)
        pose_variance = reader.float64(36)
        vx, vy, vz = reader.float64(3)
        reader.float64(3)
        twist_variance = reader.float64(36)
        velocity_enu = rotate((w, x, y, z), (vx, vy, vz))
        return self._report(
            header,
            received_s,
            position,
            ned_from_game(velocity_enu) if math.isfinite(sum(velocity_enu)) else UNKNOWN_VELOCITY,
            standard_deviation(*(pose_variance[index] for index in _DIAGONAL)),
            standard_deviation(*(twist_variance[index] for index in _DIAGONAL)),
        )

    def _report(
        self, header: _Header, received_s: float, enu_m: Vector, velocity_ned: Vector, sd_m: float, sd_m_s: float
    ) -> EvaderReport:
        if header.frame_id != self.frame_id:
            raise Refused("frame")
        latitude, longitude, altitude = self.frame.wgs84_from_ned(ned_from_game(enu_m))
        return EvaderReport(
            received_s=received_s,
            sent_s=header.stamp_s,
            source="ROS 2",
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(altitude.metres),
            velocity_ned_m_s=velocity_ned,
            position_sd_m=sd_m,
            velocity_sd_m_s=sd_m_s,
            said=AltitudeSaid(enu_m[2], Datum.ORIGIN),
        )
