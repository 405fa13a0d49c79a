"""ODOMETRY of another vehicle: a pose in its own local frame, so the frame's origin has to be told.

* Position: metres in MAV_FRAME_LOCAL_NED about the origin given here (the evader's GPS_GLOBAL_ORIGIN, altitude above
  mean sea level). Other frames are refused: LOCAL_FRD does not know where north is.
* Velocity: in `child_frame_id`, LOCAL_NED as it is, BODY_FRD turned by the attitude; unknown in any other.
* Accuracy: the largest of the three axes' variances, NaN for unknown, which is what MAVLink says with NaN or zero.
* Clock: `time_usec`, the sender's, 64 bits: it does not wrap.
"""

from dataclasses import dataclass
from typing import ClassVar, Final

from guidance.frames import LocalFrame, Vector
from guidance.links.codec import Fields, finite, number
from guidance.links.evaders.refusal import UNKNOWN_VELOCITY, Refused, finite_altitude, standard_deviation
from guidance.links.evaders.rotation import rotate
from guidance.messages import AltitudeSaid, Datum, EvaderReport

MAV_FRAME_LOCAL_NED: Final = 1
MAV_FRAME_BODY_FRD: Final = 12
_DIAGONAL: Final = (0, 6, 11)  # of the upper right triangle of a 6 x 6 matrix, row by row


@dataclass(frozen=True, slots=True)
class OdometryCarrier:
    """Carrier of ODOMETRY; `frame` is the evader's local frame."""

    frame: LocalFrame
    message: ClassVar[str] = "ODOMETRY"

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn the message into a report."""
        if fields["frame_id"] != MAV_FRAME_LOCAL_NED:
            raise Refused("frame")
        position = finite(fields["x"], fields["y"], fields["z"])
        if max(map(abs, position)) > 1e6:
            raise Refused("position")
        latitude, longitude, altitude = self.frame.wgs84_from_ned(position)
        pose, velocity = fields["pose_covariance"], fields["velocity_covariance"]
        return EvaderReport(
            received_s=received_s,
            sent_s=fields["time_usec"] / 1e6,
            source=self.message,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=finite_altitude(altitude.metres),
            velocity_ned_m_s=_velocity(fields),
            position_sd_m=standard_deviation(*(number(pose[index]) for index in _DIAGONAL)),
            velocity_sd_m_s=standard_deviation(*(number(velocity[index]) for index in _DIAGONAL)),
            said=AltitudeSaid(-position[2], Datum.ORIGIN),
        )


def _velocity(fields: Fields) -> Vector:
    try:
        velocity = finite(fields["vx"], fields["vy"], fields["vz"])
    except ValueError:
        return UNKNOWN_VELOCITY
    if fields["child_frame_id"] == MAV_FRAME_LOCAL_NED:
        return velocity
    if fields["child_frame_id"] == MAV_FRAME_BODY_FRD:
        return rotate([number(part) for part in fields["q"]], velocity)
    return UNKNOWN_VELOCITY
