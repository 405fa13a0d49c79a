"""One mock vehicle: whole MAVLink frames in, whole frames out, time as an argument; no I/O, no clock."""

import math
from collections.abc import Mapping, Sequence
from random import Random
from typing import Any, Final

from sitl_mock.craft import Craft, Severity
from sitl_mock.dynamics import Body, Kind, Motion, Setpoint, Surroundings, attitude_of
from sitl_mock.conditions import Conditions
from sitl_mock.dynamics.values import Euler
from sitl_mock.errors import ConfigError
from sitl_mock.estimator import Estimator
from sitl_mock.flavour import flavour as flavour_named
from sitl_mock.links import Link
from sitl_mock.mavlink import Signing
from sitl_mock.pilot import Sticks
from sitl_mock.protocols import (
    ParameterError,
    ParameterStore,
    Place,
    PlanStore,
    Reply,
    StatusTexts,
    addressed,
)
from sitl_mock.telemetry import Report
from sitl_mock.world import DEFAULT_HOME, Home, LocalFrame, Vector, wrap_pi

TICK_S: Final = 0.01
COMPONENT: Final = 1
_SETPOINTS: Final = frozenset(
    {"SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET"}
)
_EPOCH_US: Final = 1_750_000_000_000_000
_BATTERY_EVERY: Final = 10


class MockVehicle:
    """A vehicle that real MAVLink clients can fly.

    Equal arguments and equal frames at equal times give equal frames, byte for byte.

    Args:
        flavour: px4, arducopter or rover.
        system_id: MAVLink system id, 1 to 255.
        home: Where start_ned counts from.
        start_ned: Where it stands at first: metres north, east, down of home. LOCAL_POSITION_NED counts from there
            unless origin says otherwise.
        yaw_deg: Where the nose points at first.
        seed: Of all randomness.
        noise: Whether the estimate has the error that was measured on the real autopilot.
        parameters: Values that differ from the defaults.
        ready_after_s: From boot until it can be armed; None for what was measured (PX4 5 s, ArduCopter 39 s).
        texts: Whether STATUSTEXT goes out; None for what was measured (PX4 no, ArduPilot yes).
        origin: Origin of the local frame, if it is not where the vehicle starts.
        links: Name of each link to its kind, onboard or gcs, which gives its default rates.
        signing: MAVLink signing of all links.
        unix_us: Microseconds since 1970 at time 0 of the caller's clock.

    Raises:
        ConfigError: An argument is outside of what is allowed.
    """

    def __init__(
        self,
        flavour: str = "px4",
        *,
        system_id: int = 1,
        home: Home = DEFAULT_HOME,
        start_ned: Vector = (0.0, 0.0, 0.0),
        yaw_deg: float = 0.0,
        seed: int = 0,
        noise: bool = True,
        parameters: Mapping[str, float] | None = None,
        ready_after_s: float | None = None,
        texts: bool | None = None,
        origin: Home | None = None,
        links: Mapping[str, str] | None = None,
        signing: Signing | None = None,
        unix_us: int = _EPOCH_US,
    ) -> None:
        if not 1 <= system_id <= 255:
            raise ConfigError(f"system_id = {system_id}: allowed is 1 to 255")
        self.flavour = flavour_named(flavour)
        self.system_id = system_id
        self.signing = signing or Signing()
        self.identity = self.flavour.identity(system_id)
        self.texts = self.flavour.texts if texts is None else texts
        self.conditions = Conditions()
        self.plans = PlanStore()
        self._seed = seed
        self._noise = self.flavour.noise if noise else None
        self._ready_after_s = self.flavour.ready_s if ready_after_s is None else ready_after_s
        self._unix_us = unix_us
        self._status_texts = StatusTexts()
        try:
            self.parameters = ParameterStore(self.flavour.parameters, parameters)
        except ParameterError as error:
            raise ConfigError(f"parameters: {error}") from None
        start = LocalFrame(home).to_geodetic(*start_ned)
        self.frame = LocalFrame(origin or start)
        place = self.frame.to_local(*start)
        self._ground_m = place[2]
        self._plant_revision = -1
        self._refresh_plant()
        self._motion: Motion = self._plant.initial(place, wrap_pi(math.radians(yaw_deg)))
        self._started = False
        self._origin_s = 0.0
        self._ticks = 0
        self._boots = 0
        self._time_jump_s = 0.0
        self._boot(0.0)
        self._kinds = dict(links or {"onboard": "onboard"})
        self.links: dict[str, Link] = {}
        for name, kind in self._kinds.items():
            self._add_link(name, kind)

    # What a caller does

    def step(self, now_s: float, frames_in: Sequence[bytes] = (), link: str | None = None) -> list[bytes]:
        """Move on to now_s, then take the frames that have come by one link; return what that link sends.

        Args:
            now_s: Seconds of the caller's clock; must not fall.
            frames_in: Whole MAVLink frames; anything else is counted and dropped.
            link: Which link; the first one if not given.
        """
        name = next(iter(self.links)) if link is None else link
        return self.step_links(now_s, {name: frames_in})[name]

    def step_links(self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]) -> dict[str, list[bytes]]:
        """Do `step` for all links at once."""
        out: dict[str, list[bytes]] = {name: [] for name in self.links}
        if not self._started:
            self._started = True
            self._origin_s = now_s
            self._restart(now_s)
        last = math.floor((now_s - self._origin_s) / TICK_S + 1e-6)
        while self._ticks <= last:
            self._tick(self._origin_s + self._ticks * TICK_S, out)
            self._ticks += 1
        for name, frames in frames_in.items():
            link = self.links[name]
            for frame in frames:
                out[name] += link.receive(now_s, frame)
        if self.conditions.silent:
            return {name: [] for name in self.links}
        return out

    def inject(self, name: str, value: Any = True) -> None:  # noqa: ANN401, FBT002 - a condition from a file or a test
        """Put a condition upon the vehicle (names and values: `sitl_mock.conditions.CONDITIONS`).

        Raises:
            ConfigError: The name is unknown, or the value is not one of those allowed.
        """
        self.conditions.put(name, value)

    @property
    def truth(self) -> Body:
        """The true motion, in the local frame."""
        return self._motion.body

    @property
    def mode(self) -> str:
        """Name of the mode that is flown."""
        return self.brain.mode

    @property
    def armed(self) -> bool:
        """Whether the motors are armed."""
        return self.craft.armed

    # What links hand in

    def take(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a message that belongs to no protocol; those for others are ignored."""
        kind = message.get_type()
        if message.get_srcSystem() == self.system_id and message.get_srcComponent() == COMPONENT:
            return
        if kind == "HEARTBEAT":
            if not self.conditions.gcs_lost:
                self.craft.peers.hear(now_s, message.type)
            return
        if kind == "MANUAL_CONTROL":
            self._manual_control(now_s, message)
            return
        if not addressed(message, self.system_id, COMPONENT):
            return
        if kind in _SETPOINTS:
            self.brain.offer(now_s, message)
        elif kind == "SET_MODE":
            self.brain.set_mode(now_s, message.base_mode, message.custom_mode)
        elif kind == "RC_CHANNELS_OVERRIDE":
            self._override(now_s, message)

    def set_mission_item(self, now_s: float, seq: int) -> list[Reply]:
        """MISSION_SET_CURRENT: go on there, and say so."""
        del now_s
        self.brain.mission.set_current(seq)
        return []

    def set_origin(self, now_s: float, place: Place) -> bool:
        """SET_GPS_GLOBAL_ORIGIN: taken only while there is no position."""
        del now_s
        if self.craft.estimator.global_valid:
            return False
        old = self.frame.origin
        return math.isclose(old.lat_deg, place.latitude_deg) and math.isclose(old.lon_deg, place.longitude_deg)

    def set_home(self, now_s: float, place: Place) -> bool:
        """SET_HOME_POSITION."""
        del now_s
        self.craft.home_m = self.frame.to_local(*place)
        return True

    # Within

    def _add_link(self, name: str, kind: str) -> None:
        if kind not in self.flavour.rates_hz:
            raise ConfigError(f"links.{name} = {kind!r}: allowed are {', '.join(self.flavour.rates_hz)}")
        self.links[name] = Link(self, kind, len(self.links))

    def _boot(self, now_s: float) -> None:
        """Begin from nothing; the body stays where it is and moves as it does."""
        seed = self._seed * 1_000_003 + self._boots
        self._boots += 1
        estimator = Estimator(
            self._noise,
            Random(seed),
            ready_s=now_s + self._ready_after_s,
            position_limit_m=float(self.parameters.get("COM_POS_FS_EPH", 5.0)),
            dead_reckoning_s=float(self.parameters.get("EKF2_NOAID_TOUT", 5e6)) * 1e-6,
        )
        body = self._motion.body
        self.craft = Craft(
            frame=self.frame,
            parameters=self.parameters,
            body=body,
            estimator=estimator,
            conditions=self.conditions,
            attitude=attitude_of(body),
            position_m=body.position_ned_m,
            ground_m=self._ground_m,
            booted_s=now_s,
            now_s=now_s,
        )
        self.brain = self.flavour.brain(self.craft, self.plans)
        self.setpoint = Setpoint(Kind.STOPPED)
        self.report = Report(self.flavour, self.craft, self.brain, self.setpoint)
        self._renew_times(now_s)

    def _restart(self, now_s: float) -> None:
        self._boots = 0
        self._boot(now_s)

    def _reboot(self, now_s: float) -> None:
        self._time_jump_s = 0.0
        self._boot(now_s)
        for name, kind in self._kinds.items():
            sequence = 0
            self.links[name] = Link(self, kind, list(self._kinds).index(name))
            self.links[name].encoder.sequence = sequence

    def _tick(self, now_s: float, out: dict[str, list[bytes]]) -> None:
        craft, conditions = self.craft, self.conditions
        if conditions.events:
            self._take_events(now_s)
            craft = self.craft
        craft.now_s = now_s
        self._hear_radio(now_s)
        estimator = craft.estimator
        estimator.advance(now_s, conditions, flying=not craft.body.on_ground)
        self.setpoint = self.report.setpoint = self.brain.tick(now_s)
        if self._ticks:
            self._move(estimator)
        self._renew_times(now_s)
        for name, link in self.links.items():
            frames = link.send(self.report, now_s, only_heartbeat=conditions.telemetry_frozen)
            if frames:
                out[name] += frames
        if craft.texts or self.brain.mission.reached:
            self._announce(out)

    def _move(self, estimator: Estimator) -> None:
        craft = self.craft
        if self.parameters.revision != self._plant_revision:
            self._refresh_plant()
        around = Surroundings(
            self.conditions.wind_m_s, estimator.position_error_m, estimator.velocity_error_m_s, self._ground_m
        )
        self._motion = self._plant.step(self._motion, self.setpoint, around, TICK_S)
        body = self._motion.body
        craft.body = body
        craft.position_m, craft.velocity_m_s = self._plant.estimate(body, around)
        attitude = attitude_of(body)
        if estimator.yaw_error_rad:
            attitude = attitude._replace(yaw_rad=wrap_pi(attitude.yaw_rad + estimator.yaw_error_rad))
        craft.attitude = attitude
        craft.track_landing()
        if self._ticks % _BATTERY_EVERY == 0:
            craft.battery.advance(TICK_S * _BATTERY_EVERY, body.thrust_m_s2 / 9.80665)

    def _refresh_plant(self) -> None:
        self._plant = self.flavour.plant(self.parameters)
        self._plant_revision = self.parameters.revision

    def _renew_times(self, now_s: float) -> None:
        report = self.report
        since_boot_s = max(0.0, now_s - self.craft.booted_s + self._time_jump_s)
        report.boot_us = round(since_boot_s * 1e6)
        report.boot_ms = report.boot_us // 1000 & 0xFFFFFFFF
        report.unix_us = self._unix_us + round(now_s * 1e6)

    def _announce(self, out: dict[str, list[bytes]]) -> None:
        replies: list[Reply] = [("MISSION_ITEM_REACHED", seq) for seq in self.brain.mission.reached]
        self.brain.mission.reached.clear()
        if self.texts:
            for severity, text in self.craft.texts:
                replies += self._status_texts.replies(severity, text)
        self.craft.texts.clear()
        for name, link in self.links.items():
            out[name] += link.tell(replies)

    def _hear_radio(self, now_s: float) -> None:
        conditions, pilot = self.conditions, self.craft.pilot
        if conditions.rc is False:
            return
        if conditions.sticks is not None:
            pilot.hear(now_s, Sticks(*conditions.sticks))
        elif conditions.rc:
            pilot.hear(now_s, pilot.sticks)

    def _manual_control(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        if message.target != self.system_id or self.conditions.rc is False:
            return
        pitch, roll, throttle, yaw = (value / 1000.0 for value in (message.x, message.y, message.z, message.r))
        if max(map(abs, (pitch, roll, throttle, yaw))) <= 1.0:
            self.craft.pilot.hear(now_s, Sticks(roll, pitch, 2.0 * throttle - 1.0, yaw))

    def _override(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        if self.conditions.rc is False:
            return
        raw = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
        if not all(800 <= value <= 2200 for value in raw):
            return
        roll, pitch, throttle, yaw = (min(max((value - 1500) / 500.0, -1.0), 1.0) for value in raw)
        self.craft.pilot.hear(now_s, Sticks(roll, -pitch, throttle, yaw))

    def _take_events(self, now_s: float) -> None:
        for name, value in self.conditions.take():
            _EVENTS[name](self, now_s, value)

    def _switch(self, now_s: float, mode: str) -> None:
        if mode not in self.flavour.modes.by_name():
            raise ConfigError(f"pilot_mode = {mode!r}: allowed are {', '.join(self.flavour.modes.by_name())}")
        self.brain.switch(now_s, mode)

    def _jump_time(self, _now_s: float, by_s: float) -> None:
        self._time_jump_s += by_s

    def _push(self, _now_s: float, by_m_s: Vector) -> None:
        body = self._motion.body
        n, e, d = body.velocity_ned_m_s
        moved = body._replace(velocity_ned_m_s=(n + by_m_s[0], e + by_m_s[1], d + by_m_s[2]))
        self._motion = self._motion._replace(body=moved)


_EVENTS: Final = {
    "pilot_mode": MockVehicle._switch,
    "ekf_jump_m": lambda vehicle, _now_s, by_m: vehicle.craft.estimator.jump(by_m),
    "ekf_yaw_jump_deg": lambda vehicle, _now_s, by: vehicle.craft.estimator.jump_yaw(math.radians(by)),
    "battery": lambda vehicle, _now_s, share: setattr(vehicle.craft.battery, "remaining", share),
    "push_m_s": MockVehicle._push,
    "reboot": lambda vehicle, now_s, _value: vehicle._reboot(now_s),
    "time_jump_s": MockVehicle._jump_time,
}
