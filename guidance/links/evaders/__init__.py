"""Reports of the evader from many carriers, each with explicit units, datum and clock.

`MavlinkEvader` reads a wire with one of the MAVLink carriers. `guidance.links.evaders.zenoh` reads a Zenoh key; it is
imported separately because it loads Zenoh.

Carriers:
    FollowTarget, GlobalPositionInt, OdometryCarrier, AdsbVehicle, OpenDroneIdLocation: MAVLink messages.
    Refused: raised by a carrier for a message that must not be used.
"""

from guidance.links.evaders.carriers import (
    AdsbVehicle,
    FollowTarget,
    GlobalPositionInt,
    OdometryCarrier,
    OpenDroneIdLocation,
    Refused,
)
from guidance.links.evaders.mavlink import MavlinkEvader

__all__ = [
    "AdsbVehicle",
    "FollowTarget",
    "GlobalPositionInt",
    "MavlinkEvader",
    "OdometryCarrier",
    "OpenDroneIdLocation",
    "Refused",
]
