"""The autopilots that a flight can be flown with, each described in one module. Another one is one more module here.

Which ones:
    PX4, ARDUCOPTER: all that is known of them; each is an `Autopilot`. ROVER: how ArduPilot's rover is spoken to.
    AUTOPILOTS: those that are flown, by name; `autopilot_named` looks one up and says which there are.
    AutopilotProfile: what is said to one, and how it is understood; an `Autopilot` has handling and rules besides.
    Handling: how one vehicle flies: what it follows, how it brakes, what it surely achieves.
    Mode: a flight mode by what it means to us.

How one is judged before a flight:
    Wants: what the configuration asks of it.
    Finding: one row: what was found, what is wanted, how to come there; its `Verdict` is pass, warn or refuse.

Numbers of MAVLink:
    HEARTBEAT, SYS_STATUS, ATTITUDE, LOCAL_POSITION_NED, GLOBAL_POSITION_INT, GPS_GLOBAL_ORIGIN, HOME_POSITION,
    ODOMETRY, POSITION_TARGET_LOCAL_NED, EXTENDED_SYS_STATE: ids of messages.
    MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE, MAV_CMD_SET_MESSAGE_INTERVAL: numbers of commands.
"""

from collections.abc import Mapping

from guidance.autopilots.arducopter import ARDUCOPTER, ROVER
from guidance.autopilots.description import (
    ATTITUDE,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_GLOBAL_ORIGIN,
    HEARTBEAT,
    HOME_POSITION,
    LOCAL_POSITION_NED,
    MAV_CMD_COMPONENT_ARM_DISARM,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_SET_MESSAGE_INTERVAL,
    ODOMETRY,
    POSITION_TARGET_LOCAL_NED,
    SYS_STATUS,
    Autopilot,
    AutopilotProfile,
    Handling,
    Mode,
)
from guidance.autopilots.px4 import PX4
from guidance.autopilots.rules import Finding, Verdict, Wants
from guidance.errors import ConfigError

AUTOPILOTS: Mapping[str, Autopilot] = {one.name: one for one in (PX4, ARDUCOPTER)}


def autopilot_named(name: str) -> Autopilot:
    """Look an autopilot up by its name in configurations.

    Raises:
        ConfigError: If there is none of this name.
    """
    try:
        return AUTOPILOTS[name]
    except KeyError:
        raise ConfigError(f"autopilot = {name!r}: allowed are {', '.join(AUTOPILOTS)}") from None


__all__ = [
    "ARDUCOPTER",
    "ATTITUDE",
    "AUTOPILOTS",
    "EXTENDED_SYS_STATE",
    "GLOBAL_POSITION_INT",
    "GPS_GLOBAL_ORIGIN",
    "HEARTBEAT",
    "HOME_POSITION",
    "LOCAL_POSITION_NED",
    "MAV_CMD_COMPONENT_ARM_DISARM",
    "MAV_CMD_DO_SET_MODE",
    "MAV_CMD_SET_MESSAGE_INTERVAL",
    "ODOMETRY",
    "POSITION_TARGET_LOCAL_NED",
    "PX4",
    "ROVER",
    "SYS_STATUS",
    "Autopilot",
    "AutopilotProfile",
    "Finding",
    "Handling",
    "Mode",
    "Verdict",
    "Wants",
    "autopilot_named",
]
