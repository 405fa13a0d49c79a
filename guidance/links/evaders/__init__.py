"""Reports of the evader from many carriers, each with its units, datum and clock made explicit.

`MavlinkEvader` reads a wire with one of the MAVLink carriers; `guidance.links.evaders.zenoh` reads a Zenoh key
and is imported apart, since it brings Zenoh with it.

Carriers:
    FollowTarget, GlobalPositionInt, OdometryCarrier, AdsbVehicle, OpenDroneIdLocation: messages of MAVLink.
    RosPose: a ROS 2 message as rmw_zenoh sends it, on the key that `rmw_key` makes of its topic.
    Refused: why a message became no report.
"""

from guidance.links.evaders.broadcasts import AdsbVehicle, OpenDroneIdLocation
from guidance.links.evaders.carrier import Refused
from guidance.links.evaders.mavlink import FollowTarget, GlobalPositionInt, MavlinkEvader, OdometryCarrier
from guidance.links.evaders.ros import RosPose, rmw_key

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
