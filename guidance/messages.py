"""Messages from and to a vehicle: typed values with units and frames, independent of the wire.

Adapters in `guidance.links` convert them from and to MAVLink. Every message carries `received_s`, its arrival on our
clock; `time_boot_s` is the sender's clock if the message has one.
"""

import math
from enum import StrEnum
from typing import Final, NamedTuple

from guidance.frames import Ned

UNKNOWN_VELOCITY: Final = Ned((math.nan, math.nan, math.nan))


class Heartbeat(NamedTuple):
    """HEARTBEAT from the autopilot's ids: the only trusted source of its flight mode.

    Companion programs send HEARTBEATs with the same ids, so `autopilot` and `vehicle_type` are compared with the
    configuration (`guidance.autopilots.Autopilot.speaks`). `vehicle_type` is None in records of older versions.
    """

    received_s: float
    custom_mode: int
    armed: bool
    system_status: int
    autopilot: int
    vehicle_type: int | None = None


class LocalPosition(NamedTuple):
    """LOCAL_POSITION_NED: position from the estimator's origin (not home), m, and velocity, m/s; north-east-down."""

    received_s: float
    time_boot_s: float
    position_ned_m: Ned
    velocity_ned_m_s: Ned


class GlobalPosition(NamedTuple):
    """GLOBAL_POSITION_INT: WGS-84 degrees, altitude above mean sea level and above home in metres, velocity NED."""

    received_s: float
    time_boot_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    altitude_above_home_m: float
    velocity_ned_m_s: Ned


class Attitude(NamedTuple):
    """ATTITUDE: only the heading is used, radians from north, clockwise."""

    received_s: float
    time_boot_s: float
    yaw_rad: float


class Odometry(NamedTuple):
    """ODOMETRY: only its reset counter is used, an 8 bit number that changes when the estimator jumps."""

    received_s: float
    reset_counter: int


class EstimatorStatus(NamedTuple):
    """ESTIMATOR_STATUS: the standard deviation of the height, m; NaN where unknown."""

    received_s: float
    height_sd_m: float


class LandedState(NamedTuple):
    """EXTENDED_SYS_STATE: MAV_LANDED_STATE (1 on ground, 2 in air, 3 taking off, 4 landing)."""

    received_s: float
    landed_state: int


class SystemStatus(NamedTuple):
    """SYS_STATUS: bits of MAV_SYS_STATUS_SENSOR and the battery (0 to 1, volts), NaN where unknown."""

    received_s: float
    sensors_present: int
    sensors_health: int
    battery_remaining: float
    voltage_v: float = math.nan


class GpsFix(NamedTuple):
    """GPS_RAW_INT: GPS_FIX_TYPE (3 is a position in three dimensions) and satellites used. For display only."""

    received_s: float
    fix_type: int
    satellites: int | None


class Home(NamedTuple):
    """HOME_POSITION: WGS-84 degrees, altitude above mean sea level in metres, and home in the local frame."""

    received_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    position_ned_m: Ned


class Origin(NamedTuple):
    """GPS_GLOBAL_ORIGIN: where the local NED frame has its zero, which need not be home."""

    received_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


class CommandAck(NamedTuple):
    """COMMAND_ACK: only a hint (PX4 accepts modes that it then refuses)."""

    received_s: float
    command: int
    result: int


class StatusText(NamedTuple):
    """STATUSTEXT, chunks joined."""

    received_s: float
    severity: int
    text: str


class PositionTarget(NamedTuple):
    """POSITION_TARGET_LOCAL_NED: the setpoint that the autopilot uses; reveals a second source of setpoints."""

    received_s: float
    time_boot_s: float
    type_mask: int
    velocity_ned_m_s: Ned


class Timesync(NamedTuple):
    """TIMESYNC: `remote_ns` is the answering clock, `local_ns` ours when we asked (0 in a request)."""

    received_s: float
    remote_ns: int
    local_ns: int


class Parameter(NamedTuple):
    """PARAM_VALUE: name and value as a number, independent of the autopilot's encoding.

    `param_type` is MAV_PARAM_TYPE; None in records of older versions.
    """

    received_s: float
    name: str
    value: float
    param_type: int | None = None


class AutopilotVersion(NamedTuple):
    """AUTOPILOT_VERSION: the version of the firmware."""

    received_s: float
    major: int
    minor: int
    patch: int

    @property
    def words(self) -> str:
        """The version: `4.7.1`."""
        return f"{self.major}.{self.minor}.{self.patch}"


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
    """MISSION_ACK to our request for the uploaded fence: MAV_MISSION_RESULT, the reason why it is refused."""

    received_s: float
    result: int


class Aircraft(NamedTuple):
    """ADSB_VEHICLE, or GLOBAL_POSITION_INT of another system: an aircraft that is neither ours nor of the team.

    Attributes:
        received_s: When it arrived.
        name: "ICAO " and its address, or "system " and its id.
        latitude_deg: WGS-84.
        longitude_deg: WGS-84.
        altitude_amsl_m: Above mean sea level; NaN if unknown.
        velocity_ned_m_s: North, east, down; NaN if unknown.
        age_s: Time since the sender last heard of it.
        error_m: Largest error of its place.
    """

    received_s: float
    name: str
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_ned_m_s: Ned
    age_s: float
    error_m: float


Moved = LocalPosition | GlobalPosition | Attitude | Odometry | EstimatorStatus | Home | Origin
Stated = Heartbeat | LandedState | SystemStatus | GpsFix | StatusText | PositionTarget | Timesync
Answered = CommandAck | Parameter | AutopilotVersion | FenceCount | FenceItem | FenceRefused
Message = Moved | Stated | Answered | Aircraft


class Datum(StrEnum):
    """The zero of an altitude."""

    AMSL = "amsl"
    ELLIPSOID = "ellipsoid"
    RELATIVE = "relative"
    ORIGIN = "origin"


class AltitudeSaid(NamedTuple):
    """An altitude in metres as it was received: above mean sea level, WGS-84, our home, or the sender's own origin."""

    altitude_m: float
    datum: Datum


class EvaderReport(NamedTuple):
    """One report of the evader, from any source. Unknown values are NaN, never zero.

    Attributes:
        received_s: Arrival on our clock.
        sent_s: The sender's clock.
        source: Name of the message or key.
        latitude_deg: WGS-84.
        longitude_deg: WGS-84.
        altitude_amsl_m: Above mean sea level, converted from `said`.
        velocity_ned_m_s: North, east, down.
        position_sd_m: Standard deviation, largest axis.
        velocity_sd_m_s: Standard deviation, largest axis.
        timesync: The sender's answer to our TIMESYNC, attached to the first report after it.
        said: The altitude as received.
        sequence: Number of the MAVLink frame.
        peer: The sender, if the carrier names it.
        impostors: Messages in the evader's name from other addresses since the last report; None for none.
        evader: Its name, if the vehicle hears several evaders.
    """

    received_s: float
    sent_s: float
    source: str
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_ned_m_s: Ned
    position_sd_m: float = math.nan
    velocity_sd_m_s: float = math.nan
    timesync: Timesync | None = None
    said: AltitudeSaid | None = None
    sequence: int | None = None
    peer: str | None = None
    impostors: int | None = None
    evader: str | None = None


class MateState(NamedTuple):
    """State of another vehicle of the team, as `guidance.team` accepts it.

    Attributes:
        name: The vehicle.
        at_s: When it was true, on our clock.
        latitude_deg: WGS-84.
        longitude_deg: WGS-84.
        altitude_amsl_m: Above mean sea level.
        velocity_ned_m_s: North, east, down.
        top_speed_m_s: Its largest speed.
        doubt_m: Sum of its jumps that no motion explains: it may be this far from the place it reports.
        airborne: Whether it flies; on the ground no vehicle has to avoid it.
    """

    name: str
    at_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_ned_m_s: Ned
    top_speed_m_s: float
    doubt_m: float
    airborne: bool


class Role(NamedTuple):
    """Role of a vehicle in its team: its evader, and its height above the game's disc."""

    evader: str
    above_m: float = 0.0


class Setpoint(NamedTuple):
    """SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED. The autopilot chooses parts that are None."""

    velocity_ned_m_s: Ned
    acceleration_ned_m_s2: Ned | None = None
    yaw_rad: float | None = None


class Command(NamedTuple):
    """COMMAND_LONG, or COMMAND_INT if `frame` is given (then x and y are degrees; on the wire 1e-7 degrees)."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int | None = None


class ParameterRequest(NamedTuple):
    """PARAM_REQUEST_READ by name."""

    name: str


class ParameterSet(NamedTuple):
    """PARAM_SET: `param_type` is MAV_PARAM_TYPE as read, since an autopilot refuses any other."""

    name: str
    value: float
    param_type: int


class FenceRequest(NamedTuple):
    """MISSION_REQUEST_LIST of the uploaded fence; with a sequence number MISSION_REQUEST_INT of one item."""

    sequence: int | None = None


class FenceReceived(NamedTuple):
    """MISSION_ACK that ends reading the uploaded fence."""


Request = Command | ParameterRequest | ParameterSet | FenceRequest | FenceReceived
