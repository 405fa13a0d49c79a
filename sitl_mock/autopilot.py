"""The autopilot of one vehicle: body, beliefs and brain, moved on a fixed grid; no I/O, time is an argument."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.conditions import Conditions
from sitl_mock.craft import Craft
from sitl_mock.dynamics import ZERO, Euler, Kind, Motion, Setpoint, Surroundings, Vehicle, Wind, attitude_of
from sitl_mock.errors import ConfigError
from sitl_mock.estimator import STEP_S as ESTIMATOR_S
from sitl_mock.estimator import Estimator
from sitl_mock.events import EVENTS
from sitl_mock.flavour import Flavour
from sitl_mock.mavlink import Message, Signing
from sitl_mock.pilot import Sticks
from sitl_mock.protocols import (
    EventLog,
    ParameterError,
    ParameterStore,
    Place,
    PlanItem,
    PlanStore,
    Reply,
    StatusTexts,
)
from sitl_mock.reception import take
from sitl_mock.sensors import EXACT, Sensors
from sitl_mock.telemetry import BUILDERS, Report
from sitl_mock.world import DEFAULT_HOME, Home, LocalFrame, Vector, wrap_pi

if TYPE_CHECKING:
    from sitl_mock.brain import Brain

TICK_S: Final = 0.01
MOVE_TICKS: Final = 2
"""The body moves every 20 ms; in between, what is reported is carried on by its rates."""
_SLOW_TICKS: Final = round(ESTIMATOR_S / TICK_S)
_MOVE_S: Final = TICK_S * MOVE_TICKS
_OWN_NUMBER: Final = frozenset({"MAV_SYS_ID", "SYSID_THISMAV"})
_EPOCH_US: Final = 1_750_000_000_000_000


@dataclass(frozen=True)
class Settings:
    """What a vehicle is made with; see `MockVehicle`."""

    flavour: Flavour
    system_id: int = 1
    home: Home = DEFAULT_HOME
    start_ned: Vector = ZERO
    yaw_deg: float = 0.0
    seed: int = 0
    noise: bool = True
    parameters: Mapping[str, float] = field(default_factory=dict)
    ready_after_s: float | None = None
    texts: bool | None = None
    origin: Home | None = None
    unix_us: int = _EPOCH_US


class Announcements(NamedTuple):
    """What a vehicle says by itself: on every link, and as texts on those that take texts."""

    everywhere: Sequence[Reply] = ()
    texts: Sequence[Reply] = ()


_NOTHING: Final = Announcements()


class Autopilot:
    """One vehicle without its links.

    Attributes:
        craft: State that every flavour shares; new after each boot.
        brain: The flavour's decisions; new after each boot.
        report: What telemetry is made from; new after each boot.
        boots: How often it has been switched on.
    """

    def __init__(self, settings: Settings, signing: Signing) -> None:
        if not 1 <= settings.system_id <= 255:
            raise ConfigError(f"system_id = {settings.system_id}: allowed is 1 to 255")
        self.settings = settings
        self.flavour = settings.flavour
        self.system_id = settings.system_id
        self.signing = signing
        self.identity = self.flavour.identity(self.system_id)
        self.conditions = Conditions()
        self.plans = PlanStore()
        try:
            self.parameters = ParameterStore(self.flavour.parameters, settings.parameters)
        except ParameterError as error:
            raise ConfigError(f"parameters: {error}") from None
        for name in _OWN_NUMBER & self.parameters.keys():
            self.parameters.set(name, self.system_id)
        start = LocalFrame(settings.home).to_geodetic(*settings.start_ned)
        self.frame = LocalFrame(settings.origin or start)
        place = self.frame.to_local(*start)
        self.ground_m = place[2]
        self.plant: Vehicle = self.flavour.plant(self.parameters)
        self._plant_revision = self.parameters.revision
        self.motion: Motion = self.plant.initial(place, wrap_pi(math.radians(settings.yaw_deg)))
        self.texts = self.flavour.texts if settings.texts is None else settings.texts
        self._status_texts = StatusTexts()
        self.events = EventLog()
        self._gust: Vector = ZERO
        self.time_jump_s = 0.0
        self.boots = 0
        self.craft: Craft
        self.brain: Brain
        self.boot(0.0)

    def boot(self, now_s: float) -> None:
        """Begin from nothing; the body stays where it is and moves as it does."""
        settings = self.settings
        ready_after_s = self.flavour.ready_s if settings.ready_after_s is None else settings.ready_after_s
        self._random = Random(settings.seed * 1_000_003 + self.boots)
        self.boots += 1
        self.time_jump_s = 0.0
        body = self.motion.body
        self.craft = Craft(
            frame=self.frame,
            parameters=self.parameters,
            body=body,
            estimator=Estimator(
                self.flavour.wander if settings.noise else None,
                self._random,
                ground_wander=self.flavour.ground_wander if settings.noise else None,
                ready_s=now_s + ready_after_s,
                position_limit_m=float(self.parameters.get("COM_POS_FS_EPH", 5.0)),
                dead_reckoning_s=float(self.parameters.get("EKF2_NOAID_TOUT", 5e6)) * 1e-6,
            ),
            sensors=Sensors(
                self.flavour.sensors if settings.noise else EXACT, Random(f"sensors {settings.seed} {self.boots}")
            ),
            conditions=self.conditions,
            attitude=attitude_of(body),
            position_m=body.position_ned_m,
            ground_m=self.ground_m,
            booted_s=now_s,
            now_s=now_s,
        )
        self.brain = self.flavour.brain(self.craft, self.plans)
        self.report = Report(self.flavour, self.craft, self.brain, Setpoint(Kind.STOPPED), self.events)
        self._renew_times(now_s)

    def tick(self, now_s: float, count: int) -> None:
        """Go on to tick number `count` of the grid."""
        conditions = self.conditions
        if conditions.events:
            for name, value in conditions.take():
                EVENTS[name](self, now_s, value)
        craft = self.craft
        craft.now_s = now_s
        if count % _SLOW_TICKS == 0:
            self._slowly(now_s)
        if count % MOVE_TICKS == 0:
            if conditions.rc is not None or conditions.sticks is not None:
                self._hear_radio(now_s)
            if count:
                self._move()
            self.report.setpoint = self.brain.tick(now_s)
        else:
            self._carry_on()
        self._renew_times(now_s)

    def take(self, now_s: float, message: Message) -> None:
        """Take a message that belongs to no protocol."""
        take(self, now_s, message)

    def announcements(self) -> Announcements:
        """Return what is to be said without having been asked for."""
        texts, reached = self.craft.texts, self.brain.mission.reached
        if not texts and not reached and not self.craft.news:
            return _NOTHING
        said: list[Reply] = []
        everywhere: list[Reply] = [("MISSION_ITEM_REACHED", seq) for seq in reached]
        for severity, text in texts:
            said += self._status_texts.replies(severity, text)
            event = self.flavour.event_of(severity, text) if self.flavour.event_of is not None else None
            if event is not None:
                everywhere.append(self.events.add(self.report.boot_ms, *event))
        for name in dict.fromkeys(self.craft.news):
            fields = BUILDERS[name](self.report)
            if fields is not None:
                everywhere.append((name, *fields))
        self.craft.news.clear()
        texts.clear()
        reached.clear()
        return Announcements(everywhere, said)

    def set_mission_item(self, _now_s: float, seq: int) -> list[Reply]:
        """MISSION_SET_CURRENT: go on there; MISSION_CURRENT follows at its own rate."""
        self.brain.mission.set_current(seq)
        return []

    def home_place(self) -> Place:
        """Where home is; zeros while there is none."""
        home_m = self.craft.home_m
        return Place(0.0, 0.0, 0.0) if home_m is None else Place(*self.craft.frame.to_geodetic(*home_m))

    def guide(self, now_s: float, item: PlanItem) -> bool:
        """A mission item that is an order."""
        return self.brain.guide(now_s, item)

    def set_origin(self, _now_s: float, place: Place) -> bool:
        """SET_GPS_GLOBAL_ORIGIN: disarmed, the local frame moves there; armed it stays."""
        if self.craft.armed:
            return False
        body, craft, old = self.motion.body, self.craft, self.frame
        self.frame = craft.frame = LocalFrame(Home(*place))
        here = self.frame.to_local(*old.to_geodetic(*body.position_ned_m))
        self.ground_m = craft.ground_m = here[2]
        self.motion = self.plant.initial(here, body.yaw_rad)
        craft.body = self.motion.body
        craft.position_m = here
        if craft.home_m is not None:
            moved = self.frame.to_local(*old.to_geodetic(*craft.home_m))
            craft.set_home(moved, attitude=craft.home_attitude, given=craft.home_given)
        return True

    def set_home(self, _now_s: float, place: Place) -> bool:
        """SET_HOME_POSITION."""
        self.craft.set_home(self.frame.to_local(*place), given=True)
        return True

    def _slowly(self, now_s: float) -> None:
        """What changes slowly: the estimator, gusts, the battery, the parameters of the dynamics."""
        craft, conditions = self.craft, self.conditions
        craft.estimator.advance(now_s, conditions, flying=not craft.body.on_ground)
        craft.battery.advance(ESTIMATOR_S, craft.body.thrust_m_s2 / 9.80665)
        self._gust = (
            Wind(gust_sd_m_s=conditions.gust_m_s).gust_after(self._gust, self._random, ESTIMATOR_S)
            if conditions.gust_m_s
            else ZERO
        )
        if self.parameters.revision != self._plant_revision:
            self._plant_revision = self.parameters.revision
            self.plant = self.flavour.plant(self.parameters)

    def _move(self) -> None:
        """One step of the body under the last decision, and what the estimator makes of it."""
        craft, estimator = self.craft, self.craft.estimator
        wind, gust = self.conditions.wind_m_s, self._gust
        around = Surroundings(
            (wind[0] + gust[0], wind[1] + gust[1], wind[2] + gust[2]),
            estimator.position_error_m,
            estimator.velocity_error_m_s,
            self.ground_m,
        )
        self.motion = self.plant.step(self.motion, self.report.setpoint, around, _MOVE_S)
        body = self.motion.body
        self.report.reference = self.plant.reference(self.motion)
        craft.body = body
        craft.sensors.advance(craft.now_s, body)
        craft.position_m, craft.velocity_m_s = self.plant.estimate(body, around)
        craft.attitude = attitude_of(body)
        if estimator.yaw_error_rad:
            craft.attitude = craft.attitude._replace(yaw_rad=wrap_pi(body.yaw_rad + estimator.yaw_error_rad))
        craft.track_landing()

    def _carry_on(self) -> None:
        """Half way between two moves: position and attitude by their rates."""
        craft = self.craft
        if craft.body.on_ground and not self.flavour.ground_vehicle:
            return
        (n, e, d), (v_n, v_e, v_d) = craft.position_m, craft.velocity_m_s
        craft.position_m = (n + v_n * TICK_S, e + v_e * TICK_S, d + v_d * TICK_S)
        roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate = craft.attitude
        craft.attitude = Euler(
            roll + roll_rate * TICK_S,
            pitch + pitch_rate * TICK_S,
            yaw + yaw_rate * TICK_S,
            roll_rate,
            pitch_rate,
            yaw_rate,
        )

    def since_boot_s(self, now_s: float) -> float:
        """The vehicle's own clock, by which telemetry and TIMESYNC count."""
        return now_s - self.craft.booted_s + self.time_jump_s

    def _renew_times(self, now_s: float) -> None:
        report = self.report
        report.boot_us = boot_us = max(0, int(self.since_boot_s(now_s) * 1e6 + 0.5))
        report.boot_ms = boot_us // 1000 & 0xFFFFFFFF
        report.unix_us = self.settings.unix_us + int(now_s * 1e6)

    def _hear_radio(self, now_s: float) -> None:
        conditions, pilot = self.conditions, self.craft.pilot
        if conditions.rc is False:
            return
        pilot.radio_s = now_s
        if conditions.sticks is not None:
            pilot.hear(now_s, Sticks(*conditions.sticks))
        elif conditions.rc:
            pilot.hear(now_s, pilot.sticks)
