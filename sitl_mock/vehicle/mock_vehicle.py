"""One mock vehicle: takes and returns MAVLink frames; time is an argument, without I/O or clock."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from sitl_mock.dynamics import Body
from sitl_mock.errors import ConfigError
from sitl_mock.flavours import flavour_named
from sitl_mock.logs import LOG_BYTES, FlightLog
from sitl_mock.mavlink import Signing
from sitl_mock.vector import ZERO, Vector
from sitl_mock.vehicle.autopilot import TICK_S, Autopilot, Settings
from sitl_mock.vehicle.flavour import AnyLink
from sitl_mock.vehicle.link import TOPICS, Link
from sitl_mock.world import DEFAULT_HOME, Home

DEFAULT_LINKS: Final[Mapping[str, str]] = {"onboard": "onboard"}
_SLACK: Final = 1e-6


class MockVehicle:
    """A vehicle that real MAVLink clients can fly.

    Equal arguments and equal frames at equal times give identical frames.

    Args:
        flavour: px4, arducopter or rover.
        system_id: MAVLink system id, 1 to 255.
        home: Reference point of start_ned.
        start_ned: Initial position: metres north, east, down of home. It is the origin of LOCAL_POSITION_NED unless
            origin is given.
        yaw_deg: Initial heading.
        seed: Seed of all randomness.
        noise: Whether the estimate has the error measured on the real autopilot.
        parameters: Values that differ from the defaults.
        ready_after_s: Time from boot until it can be armed; None for the measured one (PX4 5 s, ArduCopter 39 s).
        texts: Whether it sends STATUSTEXT; None for the measured behaviour (ArduPilot: yes; PX4: on links with a
            ground station's heartbeats).
        origin: Origin of the local frame, if it is not the initial position.
        links: Name of each link to its kind, which gives its default rates: onboard, gcs, or quiet (HEARTBEAT only
            until a client asks for more); topics is PX4's link without MAVLink (`px4.topic_link`).
        signing: MAVLink signing of all links.
        unix_us: Microseconds since 1970 at time 0 of the caller's clock; None for a fixed date.
        log_bytes: Most bytes of its flight logs, which are in memory; 0 for none, which saves time.

    Raises:
        ConfigError: An argument is not allowed.
    """

    def __init__(
        self,
        flavour: str = "px4",
        *,
        system_id: int = 1,
        home: Home = DEFAULT_HOME,
        start_ned: tuple[float, float, float] = ZERO,
        yaw_deg: float = 0.0,
        seed: int = 0,
        noise: bool = True,
        parameters: Mapping[str, float] | None = None,
        ready_after_s: float | None = None,
        texts: bool | None = None,
        origin: Home | None = None,
        links: Mapping[str, str] | None = None,
        signing: Signing | None = None,
        unix_us: int | None = None,
        log_bytes: int = LOG_BYTES,
    ) -> None:
        settings = Settings(
            flavour=flavour_named(flavour),
            system_id=system_id,
            home=home,
            start_ned=Vector(start_ned),
            yaw_deg=yaw_deg,
            seed=seed,
            noise=noise,
            parameters={} if parameters is None else parameters,
            ready_after_s=ready_after_s,
            texts=texts,
            origin=origin,
            unix_us=Settings.unix_us if unix_us is None else unix_us,
            log_bytes=log_bytes,
        )
        if signing is None:
            signing = Signing(trusted_links=settings.flavour.trusted_links)
        self.autopilot = Autopilot(settings, signing)
        self._kinds = dict(DEFAULT_LINKS if links is None else links)
        allowed = [*settings.flavour.rates_hz, *([TOPICS] if settings.flavour.topics else [])]
        for name, kind in self._kinds.items():
            if kind not in allowed:
                raise ConfigError(f"links.{name} = {kind!r}: allowed are {', '.join(allowed)}")
        self.links = self._fresh_links()
        self._boots = self.autopilot.boots
        self._first_s = math.nan
        self._ticks = 0

    def step(
        self, now_s: float, frames_in: Sequence[bytes] = (), link: str | None = None
    ) -> list[bytes]:
        """Advance to now_s, then take the frames received on one link; return the frames to send on it.

        Args:
            now_s: Seconds of the caller's clock, not decreasing. The first call boots the vehicle.
            frames_in: Whole MAVLink frames; others are counted and dropped.
            link: Name of the link; default: the first one.
        """
        name = next(iter(self.links)) if link is None else link
        return self.step_links(now_s, {name: frames_in})[name]

    def step_links(
        self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]
    ) -> dict[str, list[bytes]]:
        """Do `step` for all links."""
        out: dict[str, list[bytes]] = {name: [] for name in self.links}
        if math.isnan(self._first_s):
            self._first_s = now_s
            self.autopilot.boots = 0
            self.autopilot.boot(now_s)
        last = math.floor((now_s - self._first_s) / TICK_S + _SLACK)
        while self._ticks <= last:
            tick_s = self._first_s + self._ticks * TICK_S
            if self._ticks == last or not self._is_idle(tick_s):
                autopilot = self.autopilot
                ticks = self._ticks
                autopilot.tick(tick_s, ticks)
                if autopilot.boots != self._boots:
                    self._boots = autopilot.boots
                    self.links = self._fresh_links()
                for name, link in self.links.items():
                    out[name] += link.send(tick_s, ticks)
                announcements = autopilot.announcements()
                if announcements is not None and not autopilot.conditions.telemetry_frozen:
                    for name, link in self.links.items():
                        out[name] += link.pack(announcements.everywhere)
                        out[name] += link.say(tick_s, announcements.texts)
            self._ticks += 1
        for name, frames in frames_in.items():
            link = self.links[name]
            for frame in frames:
                out[name] += link.receive(now_s, frame)
        self._forward(out)
        if self.autopilot.conditions.silent:
            return {name: [] for name in self.links}
        return out

    def _forward(self, out: dict[str, list[bytes]]) -> None:
        """Send what each link has received for others on the other links."""
        for name, link in self.links.items():
            messages = link.to_forward
            link.to_forward = []
            for other_name, other in self.links.items():
                if messages and other_name != name:
                    out[other_name] += other.passed_on(messages)

    def inject(self, name: str, value: Any = True) -> None:  # noqa: ANN401 - a condition from a file or a test
        """Set a condition of the vehicle (names and values: `sitl_mock.vehicle.conditions.CONDITIONS`).

        Raises:
            ConfigError: The name is unknown, or the value is not allowed.
        """
        if name == "pilot_mode" and value not in self.modes:
            raise ConfigError(
                f"condition pilot_mode = {value!r}: allowed are {', '.join(self.modes)}"
            )
        self.autopilot.conditions.put(name, value)

    @property
    def truth(self) -> Body:
        """The true motion, in the local frame."""
        return self.autopilot.motion.body

    @property
    def mode(self) -> str:
        """Name of the flown mode."""
        return self.autopilot.commander.mode

    @property
    def modes(self) -> Sequence[str]:
        """Names of all modes."""
        return [mode.name for mode in self.autopilot.flavour.modes.modes]

    @property
    def armed(self) -> bool:
        """True if the vehicle is armed."""
        return self.autopilot.state.armed

    @property
    def system_id(self) -> int:
        """MAVLink system id."""
        return self.autopilot.system_id

    @property
    def flavour(self) -> str:
        """Name of the flavour."""
        return self.autopilot.flavour.name

    @property
    def logs(self) -> Sequence[FlightLog]:
        """Its flight logs, oldest first; the last one may still be written."""
        return self.autopilot.storage.logs.logs

    def counters(self) -> dict[str, dict[str, int]]:
        """Return the counts of each link's decoder."""
        return {name: link.counts() for name, link in self.links.items()}

    def _fresh_links(self) -> dict[str, AnyLink]:
        topics = self.autopilot.flavour.topics
        return {
            name: topics(self.autopilot)
            if kind == TOPICS and topics is not None
            else Link(self.autopilot, kind, index)
            for index, (name, kind) in enumerate(self._kinds.items())
        }

    def _is_idle(self, now_s: float) -> bool:
        for link in self.links.values():
            if link.is_due(now_s):
                return False
        return self.autopilot.boots == self._boots and self.autopilot.is_idle(self._ticks)
