"""The description of an autopilot: its protocol, how its vehicle flies, and how its parameters are judged."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from guidance.autopilots.rules import Quantities, Quantity, Rule
from guidance.control import Handling, Speeds
from guidance.frames import Projection
from guidance.messages import Command, Heartbeat

MAV_CMD_NAV_LAND = 21
MAV_CMD_NAV_TAKEOFF = 22
MAV_CMD_DO_SET_MODE = 176
MAV_CMD_DO_REPOSITION = 192
MAV_CMD_COMPONENT_ARM_DISARM = 400
MAV_CMD_SET_MESSAGE_INTERVAL = 511
MAV_CMD_REQUEST_MESSAGE = 512
MAV_FRAME_GLOBAL = 0
MAV_FRAME_GLOBAL_RELATIVE_ALT = 3

MULTICOPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
"""MAV_TYPEs of vehicles that hover and move in any direction."""


_TYPE_NAMES = {
    1: "fixed wing",
    7: "airship",
    8: "balloon",
    10: "rover",
    11: "boat",
    12: "submarine",
    **dict.fromkeys(MULTICOPTERS, "multicopter"),
    **dict.fromkeys(range(19, 26), "VTOL"),
}


def type_name(vehicle_type: int | None) -> str:
    """Return a MAV_TYPE in words: `fixed wing (MAV_TYPE 1)`."""
    if vehicle_type is None:
        return "MAV_TYPE unknown"
    return f"{_TYPE_NAMES.get(vehicle_type, 'vehicle')} (MAV_TYPE {vehicle_type})"


class Mode(StrEnum):
    """A flight mode by its meaning to the guidance. Every other mode is OTHER."""

    GUIDED = "guided"  # PX4 OFFBOARD, ArduCopter GUIDED
    HOLD = "hold"
    TAKEOFF = "takeoff"
    RETURN = "return"
    LAND = "land"
    OTHER = "other"


class Bound(NamedTuple):
    """A parameter that bounds a key of the vehicle file. Its value times `scale` has the key's unit."""

    section: str
    key: str
    parameter: str
    scale: float = 1.0


class Version(NamedTuple):
    """A version of an autopilot: its parameters, and their units.

    Attributes:
        number: Major and minor number. It describes newer versions too, up to the next one in `Autopilot.versions`.
        rules: How its parameters are judged before a flight. All versions judge the same quantities.
        bounds: Parameters that bound the keys of a new vehicle file.
    """

    number: tuple[int, int]
    rules: tuple[Rule, ...]
    bounds: tuple[Bound, ...] = ()

    @property
    def words(self) -> str:
        """The number: `4.7`."""
        major, minor = self.number
        return f"{major}.{minor}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """An autopilot that a flight can use. One module describes each; `guidance.autopilots.register` adds another.

    Attributes:
        name: Its name in configuration files.
        autopilot_id: MAV_AUTOPILOT in HEARTBEAT.
        custom_modes: HEARTBEAT.custom_mode of each mode. Beyond 16 bits it is a main mode in the third byte and a sub
            mode in the fourth, as on PX4.
        arming_mode: Mode requested before arming, so that the take-off starts from one of our modes.
        projection: Its map between degrees and metres.
        unused: Value of a command's unused parameters.
        takeoff_frame: Datum of NAV_TAKEOFF's altitude.
        stream_before_guided: Whether it grants the guided mode only while setpoints arrive.
        setpoint_timeout_s: How long it waits for setpoints, until its parameter is read (`loss_times`).
        waits_in_guided: Whether it stays in the guided mode and hovers when setpoints stop.
        prearm_always_told: Whether SYS_STATUS reports the arming checks in `health` even if `present` lacks the bit.
        streams_hz: Requested rate of each message id.
        mode_titles: Name of each mode in a ground station.
        handling: How its vehicle flies.
        versions: The versions that are known, the oldest first. A newer one is judged as the newest of them.
        uploaded_fence_counts: Whether it heeds an uploaded fence, given the quantities that were read. An unknown one
            counts.
        one_inclusion_is_enough: Whether being inside one of several uploaded areas is enough (PX4), or all count.
        tells_setpoint_always: Whether it sends POSITION_TARGET_LOCAL_NED in every mode, or only in the guided mode.
        vehicle_types: MAV_TYPEs that may be flown: by default everything that hovers and moves in any direction.
        guided_is_ours: Whether the guided mode is one that guidance itself registered. Then no other program
            sends setpoints in it.
        setpoint_modes: Modes, as HEARTBEAT.custom_mode, in which its own checks wait for setpoints or our readiness. It
            may stay in one after a landing, also in the one of another link.
        as_mode: The same autopilot with a flight mode of ours as its guided mode; None if it has no such modes.
        mock: Flavour of `sitl-mock` that plays this autopilot in mocked flights.
        mock_speeds: The mock's parameters for the climb and descent rates of a scenario.
    """

    name: str
    autopilot_id: int
    custom_modes: Mapping[Mode, int]
    arming_mode: Mode
    projection: Projection
    unused: float
    takeoff_frame: int
    stream_before_guided: bool
    setpoint_timeout_s: float
    waits_in_guided: bool
    prearm_always_told: bool
    streams_hz: Mapping[int, float] = field(default_factory=dict)
    mode_titles: Mapping[Mode, str] = field(default_factory=dict)
    handling: Handling
    versions: tuple[Version, ...]
    uploaded_fence_counts: Callable[[Quantities], bool]
    one_inclusion_is_enough: bool
    tells_setpoint_always: bool
    mock: str
    mock_speeds: Callable[[Speeds], Mapping[str, float]] = lambda _: {}
    vehicle_types: frozenset[int] = MULTICOPTERS
    guided_is_ours: bool = False
    setpoint_modes: frozenset[int] = frozenset()
    as_mode: "Autopilot | None" = None

    @property
    def loss_times(self) -> Mapping[str, float]:
        """The parameters that say how long it waits for setpoints, in any version, and their units in seconds."""
        return {
            rule.name: rule.unit
            for version in self.versions
            for rule in version.rules
            if rule.quantity == Quantity.LOSS_TIME
        }

    def speaks(self, beat: Heartbeat) -> bool:
        """Return whether a HEARTBEAT is from this autopilot, in a vehicle that may be flown."""
        if beat.autopilot != self.autopilot_id:
            return False
        return beat.vehicle_type is None or beat.vehicle_type in self.vehicle_types

    def version_of(self, number: tuple[int, int] | None) -> Version:
        """Return the description of a version by its major and minor number; the oldest for an unknown one."""
        version = self.versions[0]
        for candidate in self.versions:
            if number is not None and candidate.number <= number:
                version = candidate
        return version

    def mode_title(self, mode: Mode) -> str:
        """Return a mode's name in a ground station: OFFBOARD on PX4, GUIDED on ArduCopter."""
        return self.mode_titles.get(mode, "another mode" if mode is Mode.OTHER else mode.upper())

    def mode_of(self, custom_mode: int) -> Mode:
        """Return the mode of HEARTBEAT.custom_mode."""
        return next(
            (mode for mode, number in self.custom_modes.items() if number == custom_mode),
            Mode.OTHER,
        )

    def set_mode(self, mode: Mode) -> Command:
        """DO_SET_MODE with the custom flag (base mode 1)."""
        number = self.custom_modes[mode]
        main = number
        sub = 0
        if number > 0xFFFF:
            main = number >> 16 & 0xFF
            sub = number >> 24
        return _command(self.unused, MAV_CMD_DO_SET_MODE, 1, main, sub)

    def arm(self) -> Command:
        """COMPONENT_ARM_DISARM, never forced."""
        return _command(self.unused, MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)

    def disarm(self) -> Command:
        """COMPONENT_ARM_DISARM, never forced, so the autopilot refuses it in the air."""
        return _command(self.unused, MAV_CMD_COMPONENT_ARM_DISARM, 0, 0)

    def takeoff(self, *, height_m: float, home_amsl_m: float) -> Command:
        """NAV_TAKEOFF to a height above home. PX4 expects it above mean sea level, ArduCopter above home."""
        altitude = (
            height_m
            if self.takeoff_frame == MAV_FRAME_GLOBAL_RELATIVE_ALT
            else height_m + home_amsl_m
        )
        return _command(self.unused, MAV_CMD_NAV_TAKEOFF, *[self.unused] * 6, altitude)

    def land(self) -> Command:
        """NAV_LAND here."""
        return _command(self.unused, MAV_CMD_NAV_LAND)

    def reposition(
        self, *, latitude_deg: float, longitude_deg: float, altitude_amsl_m: float
    ) -> Command:
        """DO_REPOSITION at the autopilot's own speed, with a change to the mode that flies it (Hold, GUIDED)."""
        params = (-1.0, 1.0, 0.0, math.nan, latitude_deg, longitude_deg, altitude_amsl_m)
        return Command(MAV_CMD_DO_REPOSITION, params, frame=MAV_FRAME_GLOBAL)

    def stop(self) -> Command:
        """DO_REPOSITION to where it is, which ends an earlier one. For an autopilot that repositions in its hold."""
        return _command(self.unused, MAV_CMD_DO_REPOSITION, -1, 1, 0)

    def stream_requests(self) -> tuple[Command, ...]:
        """SET_MESSAGE_INTERVAL for every stream in `streams_hz`."""
        return tuple(
            _command(0.0, MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz)
            for message_id, hz in self.streams_hz.items()
        )

    def request_message(self, message_id: int) -> Command:
        """REQUEST_MESSAGE, once."""
        return _command(0.0, MAV_CMD_REQUEST_MESSAGE, message_id)


def _command(unused: float, number: int, *params: float) -> Command:
    """Return a command whose other parameters are `unused`."""
    parameters = [*map(float, params), *[unused] * (7 - len(params))]
    p1, p2, p3, p4, p5, p6, p7 = parameters
    return Command(number, (p1, p2, p3, p4, p5, p6, p7))


HEARTBEAT = 0
AUTOPILOT_VERSION = 148
ATTITUDE = 30
LOCAL_POSITION_NED = 32
GLOBAL_POSITION_INT = 33
SYS_STATUS = 1
GPS_GLOBAL_ORIGIN = 49
HOME_POSITION = 242
EXTENDED_SYS_STATE = 245
ODOMETRY = 331
POSITION_TARGET_LOCAL_NED = 85
GPS_RAW_INT = 24

STREAMS_HZ = {
    ATTITUDE: 20.0,
    LOCAL_POSITION_NED: 50.0,
    GLOBAL_POSITION_INT: 10.0,
    SYS_STATUS: 2.0,
    EXTENDED_SYS_STATE: 5.0,
    GPS_RAW_INT: 1.0,
    POSITION_TARGET_LOCAL_NED: 50.0,
}
