"""What the core hears from a vehicle and says to it: typed values with units and frames, whatever the wire was.

Adapters in `guidance.links` turn MAVLink messages into these and back. Every message carries `received_s`, the time
of our own clock at which it arrived; `time_boot_s` is the sender's clock where the message has one.
"""

from enum import StrEnum
from typing import NamedTuple

from guidance.frames import Vector


class Heartbeat(NamedTuple):
    """HEARTBEAT of the autopilot: the only source of the flight mode that is believed."""

    received_s: float
    custom_mode: int
    armed: bool
    system_status: int
    autopilot: int


class LocalPosition(NamedTuple):
    """LOCAL_POSITION_NED: position about the estimator's origin (not home), metres and m/s, north-east-down."""

    received_s: float
    time_boot_s: float
    position_ned_m: Vector
    velocity_ned_m_s: Vector


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT: WGS-84 degrees, altitude above mean sea level and above home in metres, velocity NED."""

    received_s: float
    time_boot_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    altitude_above_home_m: float
    velocity_ned_m_s: Vector


class Attitude(NamedTuple):
    """ATTITUDE: only the heading is used, radians from north, clockwise."""

    received_s: float
    time_boot_s: float
    yaw_rad: float


class Odometry(NamedTuple):
    """ODOMETRY: only its reset counter is used, an 8 bit number that changes when the estimator jumps."""

    received_s: float
    reset_counter: int


class LandedState(NamedTuple):
    """EXTENDED_SYS_STATE: MAV_LANDED_STATE (1 on ground, 2 in air, 3 taking off, 4 landing)."""

    received_s: float
    landed_state: int


class SystemStatus(NamedTuple):
    """SYS_STATUS: bits of MAV_SYS_STATUS_SENSOR and the battery, NaN where unknown."""

    received_s: float
    sensors_present: int
    sensors_health: int
    battery_remaining: float


class Home(NamedTuple):
    """HOME_POSITION: WGS-84 degrees, altitude above mean sea level in metres, and home in the local frame."""

    received_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    position_ned_m: Vector


class Origin(NamedTuple):
    """GPS_GLOBAL_ORIGIN: where the local NED frame has its zero, which need not be home."""

    received_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


class CommandAck(NamedTuple):
    """COMMAND_ACK: the autopilot's word on a command, a hint only (PX4 accepts modes it then refuses)."""

    received_s: float
    command: int
    result: int


class StatusText(NamedTuple):
    """STATUSTEXT, chunks joined."""

    received_s: float
    severity: int
    text: str


class PositionTarget(NamedTuple):
    """POSITION_TARGET_LOCAL_NED: what the autopilot believes it was told; shows a second source of setpoints."""

    received_s: float
    time_boot_s: float
    type_mask: int
    velocity_ned_m_s: Vector


class Timesync(NamedTuple):
    """TIMESYNC: `remote_ns` is the answerer's clock, `local_ns` ours when we asked (0 in a request)."""

    received_s: float
    remote_ns: int
    local_ns: int


class Parameter(NamedTuple):
    """PARAM_VALUE: name and value as a number, whatever the flavour's encoding.

    `param_type` is MAV_PARAM_TYPE; a record of before it was kept has none.
    """

    received_s: float
    name: str
    value: float
    param_type: int | None = None


class FenceCount(NamedTuple):
    """MISSION_COUNT of the uploaded fence (MAV_MISSION_TYPE_FENCE): how many items it has."""

    received_s: float
    items: int


class FenceItem(NamedTuple):
    """MISSION_ITEM_INT of the uploaded fence: a corner, or a circle's centre, in WGS-84 degrees.

    `command` is MAV_CMD_NAV_FENCE_*; `size` its first parameter: a polygon's number of corners, a circle's metres.
    """

    received_s: float
    sequence: int
    command: int
    size: float
    latitude_deg: float
    longitude_deg: float


class FenceRefused(NamedTuple):
    """MISSION_ACK to our asking for the uploaded fence: MAV_MISSION_RESULT, why there is none to be had."""

    received_s: float
    result: int


Message = (
    Heartbeat
    | LocalPosition
    | GlobalPosition
    | Attitude
    | Odometry
    | LandedState
    | SystemStatus
    | Home
    | Origin
    | CommandAck
    | StatusText
    | PositionTarget
    | Timesync
    | Parameter
    | FenceCount
    | FenceItem
    | FenceRefused
)


class Datum(StrEnum):
    """What an altitude was counted from."""

    AMSL = "amsl"
    ELLIPSOID = "ellipsoid"
    RELATIVE = "relative"
    ORIGIN = "origin"


class AltitudeSaid(NamedTuple):
    """An altitude in metres as it was received: above mean sea level, WGS-84, our home, or the sender's own origin."""

    altitude_m: float
    datum: Datum


class EvaderReport(NamedTuple):
    """One report of the evader, from whichever source. NaN velocity means unknown, never zero.

    `sent_s` is the sender's clock (NaN where the source has none); `altitude_amsl_m` is above mean sea level, made so
    from `said`. `timesync` is the sender's own answer to our TIMESYNC, with the first report after it came: it tells
    its clock from ours. `sequence` is the number of the MAVLink frame, `peer` who sent it where the carrier tells.
    """

    received_s: float
    sent_s: float
    source: str
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_ned_m_s: Vector
    position_sd_m: float
    velocity_sd_m_s: float
    timesync: Timesync | None = None
    said: AltitudeSaid | None = None
    sequence: int | None = None
    peer: str | None = None


class Setpoint(NamedTuple):
    """One SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED. None leaves that part to the autopilot."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector | None = None
    yaw_rad: float | None = None


class Command(NamedTuple):
    """COMMAND_LONG, or COMMAND_INT where `frame` is given (then x, y are degrees here and 1e7 degrees on the wire)."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int | None = None


class ParameterRequest(NamedTuple):
    """PARAM_REQUEST_READ by name."""

    name: str


class ParameterSet(NamedTuple):
    """PARAM_SET: `param_type` is MAV_PARAM_TYPE as it was read, since an autopilot refuses any other."""

    name: str
    value: float
    param_type: int


class FenceRequest(NamedTuple):
    """MISSION_REQUEST_LIST of the uploaded fence, or with a sequence number MISSION_REQUEST_INT of one item."""

    sequence: int | None = None


class FenceReceived(NamedTuple):
    """MISSION_ACK that ends the reading of the uploaded fence."""


Request = Command | ParameterRequest | ParameterSet | FenceRequest | FenceReceived
