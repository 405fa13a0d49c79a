"""The autopilot of one vehicle: body, estimator and commander on a fixed time grid; no I/O, time is an argument."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sitl_mock.dynamics import (
    ZERO,
    Euler,
    Kind,
    Motion,
    Setpoint,
    Surroundings,
    Vehicle,
    attitude_of,
    gust_after,
)
from sitl_mock.dynamics.shaping import Reference
from sitl_mock.dynamics.values import maker_of
from sitl_mock.errors import ConfigError
from sitl_mock.logs import LOG_BYTES, LogBook
from sitl_mock.mavlink import Message, Signing
from sitl_mock.protocols import (
    EventLog,
    ParameterError,
    ParameterStore,
    Place,
    PlanItem,
    PlanStore,
    Reply,
    StatusTexts,
    Storage,
    named,
)
from sitl_mock.telemetry import BUILDERS, Report
from sitl_mock.vector import Vector
from sitl_mock.vehicle.conditions import Conditions
from sitl_mock.vehicle.estimator import STEP_S as ESTIMATOR_S
from sitl_mock.vehicle.estimator import Estimator
from sitl_mock.vehicle.flavour import Flavour
from sitl_mock.vehicle.pilot import Sticks
from sitl_mock.vehicle.reception import take
from sitl_mock.vehicle.sensors import EXACT, Sensors
from sitl_mock.vehicle.state import Battery, VehicleState
from sitl_mock.world import DEFAULT_HOME, Home, LocalFrame, wrap_pi

if TYPE_CHECKING:
    from sitl_mock.vehicle.flavour import Commander, FlightRecorder

TICK_S: Final = 0.01
MOVE_TICKS: Final = 2
"""The body moves every 20 ms; between two moves, telemetry is extrapolated by the rates."""
_SLOW_TICKS: Final = round(ESTIMATOR_S / TICK_S)
_MOVE_S: Final = TICK_S * MOVE_TICKS
_OWN_NUMBER: Final = frozenset({"MAV_SYS_ID", "SYSID_THISMAV", "MAV_SYSID"})
_EPOCH_US: Final = 1_750_000_000_000_000


@dataclass(frozen=True)
class Settings:
    """Settings of a vehicle; see `MockVehicle`."""

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
    log_bytes: int = LOG_BYTES


class Announcements(NamedTuple):
    """Unsolicited messages: those for every link, and texts for the links that send texts."""

    everywhere: Sequence[Reply]
    texts: Sequence[Reply]


_euler = maker_of(Euler)
_surroundings = maker_of(Surroundings)


class Autopilot:
    """One vehicle without its links.

    Attributes:
        state: State that every flavour shares; new after each boot.
        commander: The flavour's decisions; new after each boot.
        report: Source of the telemetry; new after each boot.
        recorder: Writes the flight logs; new after each boot.
        boots: Number of boots.
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
        self.storage = Storage(LogBook(settings.log_bytes))
        try:
            self.parameters = ParameterStore(self.flavour.parameters, settings.parameters)
        except ParameterError as error:
            raise ConfigError(f"parameters: {error}") from None
        start = LocalFrame(settings.home).to_geodetic(*settings.start_ned)
        origin = start if settings.origin is None else settings.origin
        self.frame = LocalFrame(origin)
        position_m = self.frame.to_local(*start)
        self.ground_m = position_m[2]
        self.plant: Vehicle = self.flavour.plant(self.parameters)
        self._plant_revision = self.parameters.revision
        self.motion: Motion = self.plant.initial(
            position_m, wrap_pi(math.radians(settings.yaw_deg))
        )
        self.texts = self.flavour.texts if settings.texts is None else settings.texts
        self._status_texts = StatusTexts()
        self.events = EventLog()
        self._gust: Vector = ZERO
        self.time_jump_s = 0.0
        self.boots = 0
        self.state: VehicleState
        self.commander: Commander
        self.recorder: FlightRecorder
        self.boot(0.0)

    def boot(self, now_s: float) -> None:
        """Restart the autopilot; the body keeps its motion."""
        settings = self.settings
        if self.parameters.reset_at_boot:
            self.parameters.reset()
        for name in _OWN_NUMBER & self.parameters.definitions.keys():
            self.parameters.set(name, self.system_id)
        ready_after_s = (
            self.flavour.ready_s if settings.ready_after_s is None else settings.ready_after_s
        )
        self._random = Random(settings.seed * 1_000_003 + self.boots)
        self.boots += 1
        self.time_jump_s = 0.0
        body = self.motion.body
        self.state = VehicleState(
            system_id=self.system_id,
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
                self.flavour.sensors if settings.noise else EXACT,
                Random(f"sensors {settings.seed} {self.boots}"),
            ),
            conditions=self.conditions,
            battery=Battery(self.flavour.pack),
            attitude=attitude_of(body),
            position_m=body.position_ned_m,
            ground_m=self.ground_m,
            booted_s=now_s,
            now_s=now_s,
        )
        self.commander = self.flavour.commander(self.state, self.plans)
        self.storage.logs.end()
        self.storage.logs.listener = None
        self.recorder = self.flavour.recorder(self.storage.logs)
        self.report = Report(
            self.flavour,
            self.state,
            self.commander,
            Setpoint(Kind.STOPPED),
            self.events,
            settings.unix_us,
            self._reference,
        )
        self._renew_times(now_s)

    def tick(self, now_s: float, count: int) -> None:
        """Advance to tick number `count` of the grid."""
        conditions = self.conditions
        if conditions.events:
            for name, value in conditions.take():
                self._happen(now_s, name, value)
        state = self.state
        state.now_s = now_s
        if count % _SLOW_TICKS == 0:
            self._slowly(now_s)
        if count % MOVE_TICKS == 0:
            if conditions.rc is not None or conditions.sticks is not None:
                pilot = self.state.pilot
                if conditions.rc is not False:
                    pilot.radio_s = now_s
                    if conditions.sticks is not None:
                        pilot.hear(now_s, Sticks(*conditions.sticks))
                    elif conditions.rc:
                        pilot.hear(now_s, pilot.sticks)
            if count:
                self._move()
            self.report.setpoint = self.commander.tick(now_s)
            self._renew_times(now_s)
            logs = self.storage.logs
            if logs.most_bytes or logs.listener is not None:
                self.recorder.tick(self.report)
        else:
            # Half way between two moves, position and attitude are extrapolated by their rates.
            state = self.state
            if self.flavour.ground_vehicle or not state.body.on_ground:
                state.position_m = state.position_m.after(state.velocity_m_s, TICK_S)
                roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate = state.attitude
                state.attitude = _euler(
                    (
                        roll + roll_rate * TICK_S,
                        pitch + pitch_rate * TICK_S,
                        yaw + yaw_rate * TICK_S,
                        roll_rate,
                        pitch_rate,
                        yaw_rate,
                    )
                )
            self._renew_times(now_s)

    def is_idle(self, count: int) -> bool:
        """True if tick `count` would only extrapolate telemetry: half way between two moves, without news."""
        state = self.state
        if not count % MOVE_TICKS:
            return False
        has_news = state.texts or state.news or state.parameter_news or state.notices
        has_news = has_news or state.events
        return not (has_news or self.commander.mission.reached or self.conditions.events)

    def take(self, now_s: float, message: Message) -> None:
        """Take a message outside the protocols."""
        take(self.state, self.commander, now_s, message)

    def announcements(self) -> Announcements | None:
        """Return the unsolicited messages since the last call."""
        state = self.state
        reached = self.commander.mission.reached
        texts = state.texts
        news = state.news
        changed = state.parameter_news
        events = state.events
        if not (texts or reached or news or changed or events or state.notices):
            return None
        replies: list[Reply] = []
        everywhere: list[Reply] = [("MISSION_ITEM_REACHED", seq) for seq in reached]
        for severity, text in texts:
            sent = text
            if self.flavour.text_as_sent is not None:
                sent = self.flavour.text_as_sent(text)
            replies += self._status_texts.replies(severity, sent)
            self.recorder.say(self.report, severity, text)
            event = (
                self.flavour.event_of(severity, text) if self.flavour.event_of is not None else None
            )
            if event is not None:
                everywhere.append(self.events.add(self.report.boot_ms, *event))
        everywhere += state.notices
        everywhere += [self.events.add(self.report.boot_ms, *event) for event in events]
        everywhere += [
            named(self.parameters, self.flavour.parameter_rules, name) for name in changed
        ]
        for name in dict.fromkeys(news):
            fields = BUILDERS[name](self.report)
            if fields is not None:
                everywhere.append((name, *fields))
        for queue in (news, changed, texts, reached, events, state.notices):
            queue.clear()
        return Announcements(everywhere, replies)

    def set_mission_item(self, _now_s: float, seq: int) -> list[Reply]:
        """MISSION_SET_CURRENT: continue at this item; ArduPilot answers with MISSION_CURRENT, PX4 at its own rate."""
        mission = self.commander.mission
        if not mission.set_current(seq) or mission.ends_for_good:
            return []
        fields = BUILDERS["MISSION_CURRENT"](self.report)
        return [] if fields is None else [("MISSION_CURRENT", seq, *fields[1:])]

    def home_place(self) -> Place:
        """Return home, or zeros if there is none."""
        home_m = self.state.home_m
        return (
            Place(0.0, 0.0, 0.0)
            if home_m is None
            else Place(*self.state.frame.to_geodetic(*home_m))
        )

    def guide(self, now_s: float, item: PlanItem) -> bool:
        """Fly to a single mission item, if the flavour does."""
        return self.commander.guide(now_s, item)

    def set_origin(self, _now_s: float, place: Place) -> bool:
        """SET_GPS_GLOBAL_ORIGIN: moves the local frame while disarmed; refused while armed."""
        if self.state.armed:
            return False
        body = self.motion.body
        state = self.state
        old = self.frame
        self.frame = state.frame = LocalFrame(Home(*place))
        position_m = self.frame.to_local(*old.to_geodetic(*body.position_ned_m))
        self.ground_m = state.ground_m = position_m[2]
        self.motion = self.plant.initial(position_m, body.yaw_rad)
        state.body = self.motion.body
        state.position_m = position_m
        if state.home_m is not None:
            moved = self.frame.to_local(*old.to_geodetic(*state.home_m))
            state.set_home(moved, attitude=state.home_attitude, given=state.home_given)
        return True

    def set_home(self, _now_s: float, place: Place) -> bool:
        """SET_HOME_POSITION."""
        self.state.set_home(self.frame.to_local(*place), given=True)
        return True

    def _happen(self, now_s: float, name: str, value: Any) -> None:  # noqa: ANN401 - a condition's value
        """Carry out a condition that is an event."""
        match name:
            case "pilot_mode":
                self.commander.switch(now_s, value)
            case "ekf_jump_m":
                self.state.estimator.jump(value)
            case "ekf_yaw_jump_deg":
                self.state.estimator.jump_yaw(math.radians(value))
            case "battery":
                self.state.battery.put(value)
            case "push_m_s":
                body = self.motion.body
                pushed = body._replace(velocity_ned_m_s=body.velocity_ned_m_s + value)
                self.motion = self.motion._replace(body=pushed)
            case "reboot":
                self.boot(now_s)
            case "time_jump_s":
                self.time_jump_s += value

    def _slowly(self, now_s: float) -> None:
        """Update the slow parts: estimator, gusts, battery, parameters of the dynamics."""
        state = self.state
        conditions = self.conditions
        state.estimator.advance(now_s, conditions, flying=not state.body.on_ground)
        state.battery.advance(ESTIMATOR_S, state.body.thrust_m_s2 / 9.80665)
        if state.battery.pack.drained_by_time:
            state.battery.drain(
                ESTIMATOR_S,
                armed=state.armed,
                whole_s=float(self.parameters["SIM_BAT_DRAIN"]),
                least=float(self.parameters["SIM_BAT_MIN_PCT"]) * 0.01,
            )
        self._gust = (
            gust_after(self._gust, conditions.gust_m_s, self._random, ESTIMATOR_S)
            if conditions.gust_m_s
            else ZERO
        )
        if self.parameters.revision != self._plant_revision:
            self._plant_revision = self.parameters.revision
            self.plant = self.flavour.plant(self.parameters)

    def _move(self) -> None:
        """Advance the body under the last setpoint, and update the estimate."""
        state = self.state
        conditions = self.conditions
        estimator = state.estimator
        wind_m_s = conditions.wind_m_s
        if self._gust is not ZERO:
            wind_m_s += self._gust
        around = _surroundings(
            (
                wind_m_s,
                estimator.position_error_m,
                estimator.velocity_error_m_s,
                self.ground_m,
                conditions.thrust_share,
            )
        )
        self.motion = self.plant.step(self.motion, self.report.setpoint, around, _MOVE_S)
        was = state.body
        body = self.motion.body
        state.body = body
        state.sensors.advance(state.now_s, body)
        state.position_m, state.velocity_m_s = self.plant.estimate(body, around)
        yaw_rad = body.yaw_rad
        if estimator.yaw_error_rad:
            yaw_rad = wrap_pi(yaw_rad + estimator.yaw_error_rad)
        if body is not was or state.attitude.yaw_rad != yaw_rad:
            attitude = attitude_of(body)
            state.attitude = (
                attitude._replace(yaw_rad=yaw_rad) if estimator.yaw_error_rad else attitude
            )
        state.track_landing()

    def _reference(self) -> Reference | None:
        """Return the controller's reference motion, or None."""
        return self.plant.reference(self.motion)

    def since_boot_s(self, now_s: float) -> float:
        """Return the vehicle's own clock, which telemetry and TIMESYNC use."""
        return now_s - self.state.booted_s + self.time_jump_s

    def _renew_times(self, now_s: float) -> None:
        report = self.report
        since_us = (now_s - self.state.booted_s + self.time_jump_s) * 1e6 + 0.5
        report.boot_us = boot_us = int(since_us) if since_us > 0.0 else 0
        report.boot_ms = boot_us // 1000 & 0xFFFFFFFF
