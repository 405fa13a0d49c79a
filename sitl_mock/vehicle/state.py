"""State shared by all flavours: one vehicle's body, estimate, battery, pilot and texts."""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from sitl_mock.dynamics import Body, Euler
from sitl_mock.protocols.parameter import ParameterStore
from sitl_mock.vector import ZERO, Vector
from sitl_mock.vehicle.conditions import Conditions
from sitl_mock.vehicle.estimator import Estimator
from sitl_mock.vehicle.pilot import Peers, Pilot
from sitl_mock.vehicle.sensors import Sensors
from sitl_mock.world import LocalFrame

_CHARGE_LAG_S = 1.0
"""PX4's reported charge follows that of the pack with this time constant."""
_FILTERED = 2.7e-5
"""PX4's filter of that lag, in single precision, comes this close and no closer; so a half is shown as 51 %."""
LEAST_CHARGE = 0.5
"""Flying does not drain ArduPilot's battery below this, so that long tests do not end in failsafes."""


class Pack(NamedTuple):
    """A simulated battery pack.

    Attributes:
        cells: Cells in series.
        full_v: Its voltage down to a charge of `flat_share`.
        empty_v: Its voltage without charge; between the two it falls linearly.
        flat_share: As above.
        idle_a: Current with the motors off.
        hover_a: Current more in hover.
        capacity_mah: Full charge.
        drained_by_time: The charge falls with the time armed and is full while disarmed, as in PX4's simulation
            (``BatterySimulator.cpp``); else it falls with the current.
    """

    cells: int
    full_v: float
    empty_v: float
    flat_share: float
    idle_a: float
    hover_a: float
    capacity_mah: float
    drained_by_time: bool = False


PX4_PACK = Pack(4, 16.2, 14.4, 1.0, 0.4, 14.0, 5000.0, drained_by_time=True)
ARDUPILOT_PACK = Pack(3, 12.6, 9.6, 0.5, 0.0, 28.12, 3300.0)
"""ArduCopter 4.5.7's simulator keeps 12.6 V and draws 28.12 A in hover (measured)."""


@dataclass(slots=True)
class Battery:
    """State of charge.

    Attributes:
        pack: Its kind.
        remaining: Reported fraction in [0, 1].
        charge: That of the pack; the report of one that is drained by time follows it with a lag.
        current_a: Present current.
        consumed_mah: Charge taken since start.
        failed: It has been emptied by an injected failure.
    """

    pack: Pack = PX4_PACK
    remaining: float = 1.0
    charge: float = 1.0
    current_a: float = 0.0
    consumed_mah: float = 0.0
    failed: bool = False
    _set_share: float = math.nan

    def put(self, share: float) -> None:
        """Set the charge, which stays there if flying would drain it no further."""
        self.charge = share
        self.remaining = share
        self._set_share = share

    def advance(self, dt_s: float, thrust_share: float) -> None:
        """Draw the current of dt_s at a share of hover thrust (0: motors off)."""
        self.current_a = self.pack.idle_a + self.pack.hover_a * thrust_share
        used_mah = self.current_a * dt_s / 3.6
        self.consumed_mah += used_mah
        if not self.pack.drained_by_time and self.charge > LEAST_CHARGE:
            self.charge = max(LEAST_CHARGE, self.charge - used_mah / self.pack.capacity_mah)
            self.remaining = self.charge

    def drain(self, dt_s: float, *, armed: bool, whole_s: float, least: float) -> None:
        """Drain a pack by time: a full one in `whole_s`, down to `least`."""
        if armed:
            # A charge that was set below the least one is not raised to it.
            floor = least if math.isnan(self._set_share) else min(least, self._set_share)
            used_share = dt_s / whole_s if whole_s > 0.0 else 1.0
            self.charge = max(self.charge - used_share, floor)
        elif math.isnan(self._set_share):
            self.charge = 1.0
        goal = 0.0 if self.failed else self.charge
        if abs(goal - self.remaining) > _FILTERED:
            self.remaining += (goal - self.remaining) * min(dt_s / _CHARGE_LAG_S, 1.0)

    @property
    def voltage_v(self) -> float:
        """Voltage of the pack."""
        pack = self.pack
        if self.failed:
            return pack.empty_v
        share = min(self.charge / pack.flat_share, 1.0)
        return pack.empty_v + (pack.full_v - pack.empty_v) * share


_LEVEL = Euler(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Severity(IntEnum):
    """MAV_SEVERITY, as far as autopilots use it."""

    EMERGENCY = 0
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Reported(NamedTuple):
    """A FOLLOW_TARGET: arrival time, and position and velocity of its sender in the local frame."""

    at_s: float
    position_m: Vector
    velocity_m_s: Vector


@dataclass(slots=True)
class VehicleState:
    """One vehicle.

    Attributes:
        system_id: MAVLink system id.
        frame: The local frame of the estimator.
        parameters: Values by name.
        body: True motion, in the local frame.
        position_m: Estimated position (north, east, down of the local frame).
        velocity_m_s: Estimated velocity.
        attitude: Estimated attitude.
        sensors: GPS receiver and barometer.
        home_m: Home in the local frame, None before it is set.
        home_s: Time when it was last set.
        home_attitude: Attitude at that time.
        home_given: Home was set by a command.
        booted_s: Time of the boot.
        armed_s: Time of arming; minus infinity while disarmed.
        was_armed: It has been armed since the boot.
        landed_s: Time of touchdown; plus infinity in the air.
        flew: It has left the ground since arming.
        news: Names of messages to send once, unsolicited, on every link.
        parameter_news: Names of parameters that the vehicle itself has changed, to be sent on every link.
        notices: Whole messages to send once, unsolicited, on every link: name and fields.
        events: Events without a text, to be sent once on every link: id, log levels and arguments.
        target: The last FOLLOW_TARGET.
        servos: Pulse width (µs) of each output that DO_SET_SERVO has set, by number from 1.
        fence_breached: The vehicle is outside the fence, as ArduPilot judges it.
    """

    system_id: int
    frame: LocalFrame
    parameters: ParameterStore
    body: Body
    estimator: Estimator
    sensors: Sensors
    conditions: Conditions
    attitude: Euler
    position_m: Vector
    ground_m: float
    velocity_m_s: Vector = ZERO
    home_m: Vector | None = None
    home_s: float = -math.inf
    home_attitude: Euler = _LEVEL
    home_given: bool = False
    booted_s: float = 0.0
    armed: bool = False
    armed_s: float = -math.inf
    was_armed: bool = False
    landed_s: float = -math.inf
    flew: bool = False
    now_s: float = 0.0
    fence_breached: bool = False
    target: Reported | None = None
    pilot: Pilot = field(default_factory=Pilot)
    peers: Peers = field(default_factory=Peers)
    battery: Battery = field(default_factory=Battery)
    servos: dict[int, int] = field(default_factory=dict)
    texts: list[tuple[int, str]] = field(default_factory=list)
    news: list[str] = field(default_factory=list)
    parameter_news: list[str] = field(default_factory=list)
    events: list[tuple[int, int, bytes]] = field(default_factory=list)
    notices: list[tuple[Any, ...]] = field(default_factory=list)

    @property
    def on_ground(self) -> bool:
        """True if the vehicle is on the ground."""
        return self.body.on_ground

    @property
    def yaw_rad(self) -> float:
        """Estimated heading."""
        return self.attitude.yaw_rad

    def say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append((int(severity), text))

    def set_home(
        self, position_m: Vector, *, attitude: Euler | None = None, given: bool = False
    ) -> None:
        """Set home; the attitude defaults to the present one."""
        self.home_m = position_m
        self.home_s = self.now_s
        self.home_attitude = self.attitude if attitude is None else attitude
        self.home_given = given

    def arm(self) -> None:
        """Arm."""
        self.armed = True
        self.armed_s = self.now_s
        self.was_armed = True
        self.flew = False

    def disarm(self) -> None:
        """Disarm."""
        self.armed = False
        self.armed_s = -math.inf

    def track_landing(self) -> None:
        """Update the time of touchdown."""
        if not self.body.on_ground:
            self.landed_s = math.inf
            if not self.flew:
                self.flew = self.armed
        elif self.landed_s == math.inf:
            self.landed_s = self.now_s

    @property
    def standing_s(self) -> float:
        """Time since touchdown; negative infinity in the air."""
        return self.now_s - self.landed_s
