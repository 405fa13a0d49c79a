"""What one autopilot is to us, as data: modes and commands, how its vehicle handles, how its parameters are judged."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from guidance.autopilots.rules import Parameters, Rule
from guidance.certificate import Acceleration
from guidance.control import Following
from guidance.frames import MapProjection
from guidance.messages import Command

MAV_CMD_NAV_LAND = 21
MAV_CMD_NAV_TAKEOFF = 22
MAV_CMD_DO_SET_MODE = 176
MAV_CMD_DO_REPOSITION = 192
MAV_CMD_COMPONENT_ARM_DISARM = 400
MAV_CMD_SET_MESSAGE_INTERVAL = 511
MAV_CMD_REQUEST_MESSAGE = 512
MAV_FRAME_GLOBAL = 0
MAV_FRAME_GLOBAL_RELATIVE_ALT = 3

_NAN = math.nan


class Mode(StrEnum):
    """A flight mode by what it means to us; everything a pilot may choose besides is OTHER."""

    GUIDED = "guided"  # PX4 OFFBOARD, ArduCopter GUIDED
    HOLD = "hold"
    TAKEOFF = "takeoff"
    RETURN = "return"
    LAND = "land"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotProfile:
    """What is said to one autopilot, and how it is understood.

    Attributes:
        name: As in configurations.
        autopilot_id: MAV_AUTOPILOT in HEARTBEAT.
        custom_modes: HEARTBEAT.custom_mode of each mode.
        mode_parameters: DO_SET_MODE's second and third parameter for each mode.
        arming_mode: Asked for before arming, so that taking off starts from a mode of ours.
        projection: The autopilot's own map between degrees and metres.
        unused: What fills a command's parameters that are not given.
        takeoff_frame: Datum of NAV_TAKEOFF's altitude.
        stream_before_guided: Whether setpoints must flow before the guided mode is granted.
        loss_parameter: The parameter that says how long the autopilot waits for setpoints.
        setpoint_timeout_s: Its default.
        waits_in_guided: Whether it stays in the guided mode once setpoints have stopped, hovering until told otherwise.
        prearm_always_told: SYS_STATUS has the arming checks' verdict in `health` even where `present` lacks the bit.
        streams_hz: Rate to ask of each message id.
        mode_titles: What a pilot's ground station calls each mode.
    """

    name: str
    autopilot_id: int
    custom_modes: Mapping[Mode, int]
    mode_parameters: Mapping[Mode, tuple[int, int]]
    arming_mode: Mode
    projection: MapProjection
    unused: float
    takeoff_frame: int
    stream_before_guided: bool
    loss_parameter: str
    setpoint_timeout_s: float
    waits_in_guided: bool
    prearm_always_told: bool
    streams_hz: Mapping[int, float] = field(default_factory=dict)
    mode_titles: Mapping[Mode, str] = field(default_factory=dict)

    def mode_title(self, mode: Mode) -> str:
        """Call a mode as a pilot knows it: OFFBOARD on PX4, GUIDED on ArduCopter."""
        return self.mode_titles.get(mode, "another mode" if mode is Mode.OTHER else mode.upper())

    def mode_of(self, custom_mode: int) -> Mode:
        """Name what HEARTBEAT.custom_mode says."""
        return next((mode for mode, number in self.custom_modes.items() if number == custom_mode), Mode.OTHER)

    def set_mode(self, mode: Mode) -> Command:
        """DO_SET_MODE with the custom flag (base mode 1)."""
        main, sub = self.mode_parameters[mode]
        return self._command(MAV_CMD_DO_SET_MODE, 1, main, sub)

    def arm(self) -> Command:
        """COMPONENT_ARM_DISARM, never forced."""
        return self._command(MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)

    def disarm(self) -> Command:
        """COMPONENT_ARM_DISARM, never forced: refused in the air, as it should be."""
        return self._command(MAV_CMD_COMPONENT_ARM_DISARM, 0, 0)

    def takeoff(self, *, height_m: float, home_amsl_m: float) -> Command:
        """NAV_TAKEOFF to a height above home; PX4 wants it above mean sea level, ArduCopter above home."""
        altitude = height_m if self.takeoff_frame == MAV_FRAME_GLOBAL_RELATIVE_ALT else height_m + home_amsl_m
        unused = self.unused
        return Command(MAV_CMD_NAV_TAKEOFF, (unused, unused, unused, unused, unused, unused, altitude))

    def land(self) -> Command:
        """NAV_LAND here."""
        return self._command(MAV_CMD_NAV_LAND)

    def reposition(self, *, latitude_deg: float, longitude_deg: float, altitude_amsl_m: float) -> Command:
        """DO_REPOSITION at the autopilot's own speed, changing to the mode that can (Hold, GUIDED)."""
        return Command(
            MAV_CMD_DO_REPOSITION,
            (-1.0, 1.0, 0.0, _NAN, latitude_deg, longitude_deg, altitude_amsl_m),
            frame=MAV_FRAME_GLOBAL,
        )

    def stream_requests(self) -> tuple[Command, ...]:
        """SET_MESSAGE_INTERVAL for every stream the core needs."""
        return tuple(
            Command(MAV_CMD_SET_MESSAGE_INTERVAL, (float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0))
            for message_id, rate_hz in self.streams_hz.items()
        )

    def request_message(self, message_id: int) -> Command:
        """REQUEST_MESSAGE, once."""
        return Command(MAV_CMD_REQUEST_MESSAGE, (float(message_id), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def _command(self, number: int, *params: float) -> Command:
        given = tuple(float(value) for value in params)
        p1, p2, p3, p4, p5, p6, p7 = given + (self.unused,) * (7 - len(given))
        return Command(number, (p1, p2, p3, p4, p5, p6, p7))


@dataclass(frozen=True, slots=True, kw_only=True)
class Handling:
    """One vehicle's handling.

    `acceleration` is what the vehicle surely achieves, by which the time that it needs is told: the autopilot's own
    parameter (PX4's MPC_ACC_HOR and MPC_ACC_DOWN_MAX, ArduCopter's WPNAV_ACCEL and WPNAV_ACCEL_Z) at its default. The
    last seven are of `guidance.control.Envelope`, with its names and meanings.
    """

    following: Following
    acceleration: Acceleration
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    braking_m_s2: float
    vertical_braking_m_s2: float
    reaction_s: float
    easing_m_s3: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot(AutopilotProfile):
    """One autopilot that a flight can be flown with: everything that is known of it.

    Attributes:
        handling: Of its vehicle, at default parameters.
        rules: How its parameters are judged before a flight.
        uploaded_fence_counts: Whether it heeds an uploaded fence, given its parameters.
        one_inclusion_is_enough: Whether it is enough to be within one of several uploaded areas, or all of them count.
        tells_setpoint_always: Whether it tells its setpoint in every mode (POSITION_TARGET_LOCAL_NED), or in ours only.
    """

    handling: Handling
    rules: tuple[Rule, ...]
    uploaded_fence_counts: Callable[[Parameters], bool]
    one_inclusion_is_enough: bool
    tells_setpoint_always: bool


HEARTBEAT, ATTITUDE, LOCAL_POSITION_NED, GLOBAL_POSITION_INT, SYS_STATUS = 0, 30, 32, 33, 1
GPS_GLOBAL_ORIGIN, HOME_POSITION, EXTENDED_SYS_STATE, ODOMETRY = 49, 242, 245, 331
POSITION_TARGET_LOCAL_NED = 85

STREAMS_HZ = {
    ATTITUDE: 20.0,
    LOCAL_POSITION_NED: 50.0,
    GLOBAL_POSITION_INT: 10.0,
    SYS_STATUS: 2.0,
    EXTENDED_SYS_STATE: 5.0,
    POSITION_TARGET_LOCAL_NED: 50.0,
}
