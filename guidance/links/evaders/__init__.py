"""Reports of the evader from many carriers, each with its units, datum and clock made explicit.

`MavlinkEvader` reads a wire with one of the MAVLink carriers; `guidance.links.evaders.zenoh_source` reads a Zenoh key
and is imported apart, since it brings Zenoh with it.
"""

from guidance.links.evaders.adsb_vehicle import AdsbVehicle
from guidance.links.evaders.follow_target import FollowTarget
from guidance.links.evaders.global_position import GlobalPositionInt
from guidance.links.evaders.mavlink_source import MavlinkEvader
from guidance.links.evaders.odometry import OdometryCarrier
from guidance.links.evaders.open_drone_id import OpenDroneIdLocation
from guidance.links.evaders.refusal import Refused
from guidance.links.evaders.ros_pose import RosPose, rmw_key

__all__ = [
    "AdsbVehicle",
    "FollowTarget",
    "GlobalPositionInt",
    "MavlinkEvader",
    "OdometryCarrier",
    "OpenDroneIdLocation",
    "Refused",
    "RosPose",
    "rmw_key",
]
