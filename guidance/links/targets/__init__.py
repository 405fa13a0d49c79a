"""Reports of the target from many carriers, each with its units, datum and clock made explicit.

`MavlinkTarget` reads a wire with one of the MAVLink carriers; `guidance.links.targets.zenoh_source` reads a Zenoh key
and is imported apart, since it brings Zenoh with it.
"""

from guidance.links.targets.adsb_vehicle import AdsbVehicle
from guidance.links.targets.follow_target import FollowTarget
from guidance.links.targets.global_position import GlobalPositionInt
from guidance.links.targets.mavlink_source import MavlinkTarget
from guidance.links.targets.odometry import Odometry
from guidance.links.targets.open_drone_id import OpenDroneIdLocation
from guidance.links.targets.refusal import Refused
from guidance.links.targets.ros_pose import RosPose, rmw_key

__all__ = [
    "AdsbVehicle",
    "FollowTarget",
    "GlobalPositionInt",
    "MavlinkTarget",
    "Odometry",
    "OpenDroneIdLocation",
    "Refused",
    "RosPose",
    "rmw_key",
]
