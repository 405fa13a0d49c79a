"""Checks before a flight: of this computer, `guidance doctor`, and of the autopilot, `guidance check`.

`doctor` leaves the computer unchanged: it binds and releases ports, and tries real-time scheduling and gives it back.
`check` runs only preflight, and can set the parameters that preflight requires, on the ground only.
"""

import contextlib
import ctypes
import os
import platform
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from serial.tools import list_ports

from guidance import messages
from guidance.autopilots import AUTOPILOTS, Finding, Verdict
from guidance.clock import Clock, MonotonicClock
from guidance.errors import ConfigError, FlightError
from guidance.extras import EXTRAS, how_to_add
from guidance.game.speed_sets import SPEED_SETS
from guidance.links.evaders.kinds import EVADER_KINDS
from guidance.links.kinds import LINKS
from guidance.links.port import parse, scheme_of
from guidance.links.world import World
from guidance.preflight import (
    COUNTED_S,
    EVADER_ALTITUDE,
    Facts,
    ParameterChange,
    another_autopilot,
    changes,
    single,
)
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import PERIOD_S, PRIORITY
from guidance.session.observe.outputs import OUTPUTS
from guidance.session.open.links import open_all
from guidance.session.orders.control_token import token_path
from guidance.session.orders_section import Control
from guidance.session.plan import FlightPlan, plan_of
from guidance.session.vehicle_file import SECTIONS, Config

SURVEY_LIMIT_S: Final = 20.0
SET_WITHIN_S: Final = 5.0
"""Time limit for an autopilot to confirm a parameter; PX4 takes 20 ms."""

_FRESH_S: Final = 2.5
_HEARD: Final = {
    messages.Heartbeat: "HEARTBEAT",
    messages.Home: "HOME_POSITION",
    messages.Origin: "GPS_GLOBAL_ORIGIN",
    messages.GlobalPosition: "GLOBAL_POSITION_INT",
    messages.LocalPosition: "LOCAL_POSITION_NED",
}
"""Messages needed before anything is judged, by their MAVLink names."""


class Checkup:
    """Reads, judges and sets the parameters of one vehicle on the ground. It neither arms nor changes the mode.

    Args:
        name: Of the vehicle in `world`.
        plan: Its flight plan; preflight judges the vehicle against it.
        world: Its links, open.
        clock: The clock.
        evader_simulated: Whether the flight itself will simulate the evader, so no reports arrive yet.
    """

    def __init__(
        self,
        name: str,
        plan: FlightPlan,
        world: World,
        clock: Clock,
        *,
        evader_simulated: bool = False,
    ) -> None:
        self._evader_simulated = evader_simulated
        self._plan = plan
        self._link = world.links[name]
        self._clock = clock
        self._due_s = clock.now_s()
        self._daemon = Daemon(name, plan, self._link, world.evaders[name], Equipment())

    def rows(
        self, limit_s: float = SURVEY_LIMIT_S, report: Callable[[str], None] = lambda _: None
    ) -> Sequence[Finding]:
        """Wait for all inputs, and return preflight's rows and the flight's own checks.

        Args:
            limit_s: Longest wait. HEARTBEATs of another autopilot with the vehicle's ids are named only after it.
            report: Called with the names of missing inputs.
        """
        daemon = self._daemon
        clock = self._clock
        begun_s = clock.now_s()
        complete_s = begun_s
        while clock.now_s() - begun_s < limit_s:
            self._step()
            latest = self._daemon.flight.vehicle.latest
            names = [name for kind, name in _HEARD.items() if latest.get(kind) is None]
            missing = ", ".join([*names, *self._daemon.survey.memory.missing])
            report(missing)
            if missing:
                complete_s = clock.now_s()
                continue
            # It takes some HEARTBEATs to identify the systems that are there instead of a silent evader.
            is_heard = self._facts().evader is not None
            evader_s = 1.0 if self._evader_simulated or is_heard else 3.0
            if clock.now_s() - complete_s > COUNTED_S + evader_s:
                break
        another = another_autopilot(self._facts(), self._plan.flight.autopilot)
        if another is not None:
            return (another,)
        # The flight's own checks may still pass later, so none is a refusal here.
        readiness = (
            Finding.of(
                check.verdict is Verdict.PASS,
                f"ready: {check.name}",
                check.value,
                "before start",
                "",
                Verdict.WARN,
            )
            for check in daemon.flight.checks(clock.now_s())
        )
        judged = [
            row
            for row in daemon.survey.rows
            if not (self._evader_simulated and row.name == EVADER_ALTITUDE)
        ]
        return (*judged, *readiness)

    def _facts(self) -> Facts:
        flight = self._daemon.flight
        now_s = self._clock.now_s()
        return self._daemon.survey.memory.facts(flight.vehicle, now_s, flight.observed.other_beat)

    def changes(self, *, advised: bool) -> Sequence[ParameterChange]:
        """Return the parameters to set, from the values read."""
        wants = self._plan.wants
        if wants is None:
            return ()
        return changes(self._facts(), self._plan.flight.autopilot, wants, advised=advised)

    def apply(self, wanted: Sequence[ParameterChange]) -> Iterator[tuple[str, float | None, bool]]:
        """Set parameters one after another, and read each back.

        Yields:
            Its name, the value read back (None without an answer), and whether that is the requested one.

        Raises:
            FlightError: If the vehicle is armed, in the air, or does not say that it is neither; parameters set
                before that stay set.
        """
        for change in wanted:
            vehicle = self._daemon.flight.vehicle
            beat_age_s = vehicle.age_s(messages.Heartbeat, self._clock.now_s())
            if vehicle.armed:
                raise FlightError(
                    "the vehicle is armed: parameters are set on the ground only, disarmed"
                )
            if beat_age_s > _FRESH_S or vehicle.latest.get(messages.LandedState) is None:
                raise FlightError(
                    "the vehicle does not say whether it is on the ground: no parameter is set"
                )
            if not vehicle.on_ground:
                raise FlightError(
                    "the vehicle is in the air: parameters are set on the ground only"
                )
            self._link.request(change.request)
            self._read(change.name)  # the announcement after setting is not proof: read the value
            self._link.request(messages.ParameterRequest(change.name))
            value = self._read(change.name)
            yield change.name, value, value is not None and single(value) == change.request.value

    def _read(self, name: str) -> float | None:
        until_s = self._clock.now_s() + SET_WITHIN_S
        while self._clock.now_s() < until_s:
            self._step()
            for message in self._daemon.inputs.messages:
                if isinstance(message, messages.Parameter) and message.name == name:
                    return message.value
        return None

    def _step(self) -> None:
        self._clock.sleep_until(self._due_s)
        now_s = self._clock.now_s()
        self._due_s = max(self._due_s + PERIOD_S, now_s)
        self._daemon.step(now_s)


@contextlib.contextmanager
def checkup_of(config: Config) -> Iterator[Checkup]:
    """Open the vehicle of a configuration.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    plan = plan_of(config)
    clock = MonotonicClock()
    with contextlib.closing(World()) as world:
        open_all(config, clock, world, tapped=False)
        yield Checkup(config.name, plan, world, clock)


CYCLES: Final = 50
"""Cycles of the timing check: one second."""

LATE_CYCLE_S: Final = 0.005
"""A later start of a cycle is reported."""

FLIGHT_BYTES: Final = 240_000_000
"""An hour's record: 3.8 MB a minute (tests/bench/bench_endurance.py), rounded up."""

WARN: Final = Verdict.WARN
_TIME_ERROR: Final = 5
_USUAL_URLS: Final = (("usual", "udpin://127.0.0.1:14540"), ("usual", "udpin://127.0.0.1:14541"))


def examine(config: Config | None = None) -> Sequence[Finding]:
    """Look at this computer, for the vehicle of a file or for one at the usual ports.

    Args:
        config: The vehicle's file.
    """
    folder = Path.cwd() if config is None or config.record.folder is None else config.record.folder
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    installed = [extra for extra in EXTRAS if how_to_add(extra) is None]
    absent = ",".join(extra for extra in EXTRAS if extra not in installed)
    lacking = f"pip install 'pursuit-guidance[{absent}]'" if absent else ""
    return (
        Finding.of(
            sys.platform == "linux",
            "software",
            system,
            "Linux, Python 3.11 or later",
            "fly on Linux",
            WARN,
        ),
        _calendar(),
        _cadence(),
        _scheduling(),
        *_urls(config),
        _control(Control() if config is None else config.control),
        *_serial_ports(config),
        *_record_folder(folder),
        Finding("extras", ", ".join(installed) or "none", "as you like", Verdict.PASS, lacking),
        *_packages(),
    )


def _packages() -> Iterator[Finding]:
    """Yield a row for each object that installed packages add, and import it to see whether it works."""
    registries: Sequence[Any] = (
        AUTOPILOTS,
        LINKS,
        EVADER_KINDS,
        SPEED_SETS,
        OUTPUTS,
        SECTIONS,
    )
    for registry in registries:
        for name in sorted(registry.installed.names):
            row = f"{registry.noun} {name}"
            try:
                registry.named(name)
            except ConfigError as error:
                found, _, advice = str(error).partition(": ")[2].rpartition("; ")
                yield Finding(row, found, "can be imported", WARN, advice)
            else:
                yield Finding(row, "imported", "can be imported", Verdict.PASS)


def _calendar() -> Finding:
    """True if a time service keeps the system clock: signing and the evader's time stamps need the date."""
    try:
        synchronized = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(1024)) != _TIME_ERROR
    except (AttributeError, OSError):
        return Finding(
            "calendar", "not known", "synchronized", WARN, "see that a time service runs"
        )
    advice = "timedatectl set-ntp true, or the time from GPS"
    return Finding.of(
        synchronized,
        "calendar",
        "synchronized" if synchronized else "not synchronized",
        "synchronized",
        advice,
        WARN,
    )


def _cadence() -> Finding:
    """Largest delay of a wake-up under the present load."""
    worst_s = 0.0
    due_s = time.monotonic()
    for _ in range(CYCLES):
        due_s += PERIOD_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        worst_s = max(worst_s, time.monotonic() - due_s)
    delay = f"{1e3 * worst_s:.1f} ms late at worst in {CYCLES} cycles"
    advice = "end what else runs, or allow real-time scheduling (the next row)"
    return Finding.of(
        worst_s <= LATE_CYCLE_S,
        "cadence",
        delay,
        f"at most {1e3 * LATE_CYCLE_S:g} ms",
        advice,
        WARN,
    )


def _scheduling() -> Finding:
    name = "scheduling"
    expected = f"realtime {PRIORITY}"
    if not hasattr(os, "sched_setscheduler"):
        return Finding(name, "none on this system", expected, WARN, "fly on Linux")
    policy = os.sched_getscheduler(0)
    parameter = os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except PermissionError:
        return Finding(
            name,
            "not permitted",
            expected,
            WARN,
            "CPUSchedulingPolicy=rr, or rtprio in limits.conf",
        )
    os.sched_setscheduler(0, policy, parameter)
    return Finding(name, "permitted", expected, Verdict.PASS)


def _urls(config: Config | None) -> Iterator[Finding]:
    """Try the listening ports for the vehicle and the evader."""
    urls: Sequence[tuple[str, str | None]] = _USUAL_URLS
    if config is not None:
        urls = (("vehicle.url", config.vehicle.url), ("evader.url", config.evader.url))
    kinds = {"udpin": socket.SOCK_DGRAM, "tcpin": socket.SOCK_STREAM}
    for key, url in urls:
        if url is not None and scheme_of(url) in kinds:
            endpoint = parse(url)
            kind = kinds[endpoint.scheme]
            advice = "end what listens there, or take another"
            yield _port(f"{key} {url}", endpoint.host, endpoint.port, kind, advice)


def _control(control: Control) -> Finding:
    path = control.token_file
    if path is None:
        path = token_path(control.endpoint)
    folder = next(part for part in (path, *path.parents) if part.exists())
    if not os.access(folder, os.W_OK):
        advice = f"the token goes to {path}: set control.token_file, or run as who owns {folder}"
        return Finding(
            "orders", f"{folder} is not writable", "a folder for the token", Verdict.REFUSE, advice
        )
    host, _, port = control.endpoint.partition("/")[2].rpartition(":")
    if not (control.host and port.isdigit()):
        return Finding("orders", control.endpoint, "a folder for the token", Verdict.PASS)
    advice = "a daemon runs already? guidance ctl status says; else set control.endpoint"
    return _port(
        f"orders {control.endpoint}", host.strip("[]"), int(port), socket.SOCK_STREAM, advice
    )


def _port(name: str, host: str, port: int, kind: socket.SocketKind, advice: str) -> Finding:
    value = "free"
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with contextlib.closing(socket.socket(family, kind)) as probe:
        if kind == socket.SOCK_STREAM:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            value = str(error.strerror)
    return Finding.of(value == "free", name, value, "free", advice)


def _serial_ports(config: Config | None) -> Iterator[Finding]:
    expected = "readable and writable"
    advice = "usermod -aG dialout USER, and log in again"
    device = ""
    if config is not None and scheme_of(config.vehicle.url) == "serial":
        device = parse(config.vehicle.url).host
    if device and not Path(device).exists():
        remedy = "plug it in; ls /dev/serial/by-id lists what is"
        yield Finding(device, "not there", expected, Verdict.REFUSE, remedy)
    for port in sorted(listed.device for listed in list_ports.comports()):
        usable = os.access(port, os.R_OK | os.W_OK)
        verdict = Verdict.REFUSE if port == device else WARN
        value = expected if usable else "no rights"
        yield Finding.of(usable, port, value, expected, advice, verdict)


def _record_folder(folder: Path) -> Iterator[Finding]:
    existing = next(part for part in (folder, *folder.absolute().parents) if part.exists())
    writable = existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
    value = f"{folder.absolute()}: {'writable' if writable else 'not writable'}"
    advice = "set record.folder, or change the rights"
    yield Finding.of(writable, "record folder", value, "writable", advice)
    free_bytes = shutil.disk_usage(existing).free
    value = f"{free_bytes / 1e9:.1f} GB free"
    expected = f"{FLIGHT_BYTES / 1e6:g} MB for an hour"
    advice = "make room: a full disk ends the record, never the flight"
    yield Finding.of(free_bytes >= FLIGHT_BYTES, "disk", value, expected, advice, WARN)
