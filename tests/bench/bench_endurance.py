"""Flights that do not end: does memory, do descriptors or threads grow, and can every record of it be read?

    python tests/bench/bench_endurance.py virtual [--hours 24]      # every cycle of it, faster than real time
    python tests/bench/bench_endurance.py real [--minutes 30]       # `guidance run`, MAVSDK over Zenoh, real time

In virtual time one daemon flies a mock PX4 by whole MAVLink frames at its fifty cycles a second, with preflight,
orders, shadowing of an evader that flies in circles, metrics, the operator's page and a record in files of
`--rotate-s`. The page's hub gets every event and ten cycles a second, and makes a message for pages of them; a new page
opens and the metrics are scraped every minute. Every hour a person orders hold and engages again. Each file is read by
itself, by the MCAP library, as soon as the next one has begun, and is then deleted. The first two are kept and replayed
as one: across the seam every setpoint must be equal bit for bit. A flight that `--within` cuts off is reported. In real
time the daemon is a process of its own, seen from outside.

Growth counts from the first hour on, or from a third or a sixth of a shorter flight: then caches are full and a second
file has begun. An allocator takes memory in steps, so the judge is not a fitted line: the median slope between any two
looks must be below 2 MB an hour, and so must the growth of any one hour; the median numbers of descriptors and threads
must not be higher in the second half. The exit code is 0 if all that holds and every file is whole, else 1.
"""

import argparse
import gc
import math
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from socket import SOCK_DGRAM, SOCK_STREAM

from bench_daemon import CONFIG, LASTING_MAH, Beacon, daemon, free_port
from footprint import Footprint, footprint, growth_mb_h, is_flat, told
from mcap.exceptions import McapError
from mcap.reader import make_reader
from prometheus_client import generate_latest

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.flight import State
from guidance.links import MemoryWire
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.wires.base import TappedWire
from guidance.log import compare
from guidance.log.broadcast import FoundFlight
from guidance.log.entries import CONFIG as CONFIG_KEY
from guidance.log.entries import CYCLE, EVENT, CycleEntry, EventEntry, Item
from guidance.log.sink import Sink
from guidance.log.writer import Recorder, part_path
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.loop import run
from guidance.session.observe.metrics import Metrics
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.stepped import SteppedMock
from guidance.viz.panel.hub import Hub, News
from sitl_mock import MockVehicle
from sitl_mock.faults import Faulted, FaultScript

LOOK_EVERY_S = 600.0
ORDERS_EVERY_S = 3600.0
SCRAPE_EVERY_S = 60.0
WARM_S = 3600.0
"""Growth is counted from here: caches are full, and a second file has been begun."""


class VirtualWorld:
    """A mock PX4 and an evader's reports at 10 Hz, both by frames."""

    real_time = False

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.players: dict[str, object] = {}
        parameters = {"GF_MAX_HOR_DIST": 210.0, "GF_MAX_VER_DIST": 70.0}
        vehicle = MockVehicle("px4", ready_after_s=1.0, parameters=parameters, seed=1)
        battery = vehicle.autopilot.state.battery
        battery.pack = battery.pack._replace(capacity_mah=LASTING_MAH)
        self._mock = SteppedMock(Faulted(vehicle, "bench", FaultScript()), clock)
        self._tap = TappedWire(self._mock.wire(), clock.now_s, "bench")
        link = PymavlinkLink(self._tap, clock.now_s, system_id=1)
        ours, self._radio = MemoryWire.pair(clock.now_s)
        evader = MavlinkEvader(ours, GLOBAL_POSITION, system_id=2)
        self.links = {"bench": link}
        self.evaders = {"bench": {"evader": evader}}
        self._beacon = Beacon(0)
        self._next_s = 0.0

    def advance(self) -> None:
        now_s = self._clock.now_s()
        self._mock.advance(now_s)
        if now_s >= self._next_s:
            self._next_s = now_s + 0.1
            self._radio.send(self._beacon.frame(now_s))
        self._radio.receive()  # without an answer

    def engage(self, _vehicle: str) -> None:
        """Do nothing: this world has no faults that begin then."""

    def drain(self) -> Sequence[tuple[float, str, bytes]]:
        return self._tap.drain()

    def close(self) -> None:
        self.links["bench"].close()
        self.evaders["bench"]["evader"].close()
        self._beacon.socket.close()


def cycles_in(path: Path) -> int:
    """Count the cycles of one file by itself, as the MCAP library reads it; 0 where it is not finished properly."""
    with path.open("rb") as file:
        try:
            summary = make_reader(file, validate_crcs=True).get_summary()
        except McapError:
            return 0
    if summary is None or summary.statistics is None:
        return 0
    counts = summary.statistics.channel_message_counts
    return sum(
        counts[number]
        for number, channel in summary.channels.items()
        if channel.topic == CYCLE.topic
    )


class Page(Sink):
    """The operator's page without a browser: the daemon's broadcasts go to the panel's hub.

    It is the daemon's output in place of a broadcast, and the hub's bus. The hub gets every fifth cycle, as often as it
    makes messages.
    """

    endpoint = "virtual"
    reason = ""

    def __init__(self, name: str, clock: VirtualClock, metadata: dict[str, str]) -> None:
        self._name = name
        self._clock = clock
        self._waiting: list[News] = [News(name, clock.now_s(), FoundFlight(name, metadata, ()))]
        self._hub = Hub([self], clock)
        self._cycles = self.messages = self.sent_mb = 0

    def cycle(self, entry: CycleEntry) -> None:
        self._cycles += 1
        if self._cycles % 5 == 0:
            self._add(CYCLE.topic, entry.now_s, CYCLE.encode(entry))
            self.open(whole=False)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        self._add(EVENT.topic, now_s, EVENT.encode(EventEntry(now_s, event, detail)))

    def news(self) -> list[News]:
        news = self._waiting
        self._waiting = []
        return news

    def open(self, *, whole: bool) -> None:
        self._hub.receive()
        self.messages += 1
        self.sent_mb += len(self._hub.message(whole=whole)) / 1e6

    def _add(self, topic: str, now_s: float, data: bytes) -> None:
        self._waiting.append(
            News(self._name, self._clock.now_s(), Item(now_s, topic, "json", data))
        )


class Person:
    """Gives a person's orders between cycles and measures the process."""

    def __init__(
        self,
        daemon: Daemon,
        metrics: Metrics,
        page: Page,
        record: Path,
        hours: float,
        within_s: float,
    ) -> None:
        self._metrics = metrics
        self._page = page
        self._scrape_s = SCRAPE_EVERY_S
        self.scrapes = 0
        self._daemon = daemon
        self._record = record
        self._end_s = 3600.0 * hours
        self._within_s = within_s
        self.hours: list[float] = []
        self.taken: list[Footprint] = []
        self.parts: list[int] = []
        self.written_mb = 0.0
        self.cycles = self.setpoints = self.engagements = 0
        self._every_s = min(LOOK_EVERY_S, self._end_s / 12.0)
        self._look_s = self._every_s
        self._order_s = ORDERS_EVERY_S
        self._began_s = time.monotonic()
        self.finished = False

    def before(self, now_s: float) -> None:
        state = self._daemon.flight.state
        mailbox = self._daemon.mailbox
        if state is State.READY:
            mailbox.ask("start")
        elif state in {State.STANDING_BY, State.HOLDING}:
            mailbox.ask("engage")
        elif state is State.ON_STATION and now_s >= self._order_s:
            self._order_s += ORDERS_EVERY_S
            mailbox.ask("hold")

    def after(self, now_s: float, late_s: float) -> None:
        outputs = self._daemon.outputs
        self.cycles += 1
        self.setpoints += outputs.setpoint is not None
        self.engagements += any(
            transition.after is State.ENTERING for transition in outputs.transitions
        )
        if self._daemon.flight.state in {
            State.YIELDED,
            State.FAILED,
            State.LANDED,
            State.RETURNING,
        }:
            raise SystemExit(f"{now_s:.1f} s: {self._daemon.flight.state}: {outputs.transitions}")
        if now_s >= self._scrape_s:
            self._scrape_s += SCRAPE_EVERY_S
            self.scrapes += b"guidance_cycles_total" in generate_latest(self._metrics.registry)
            self._page.open(whole=True)
        if now_s >= self._look_s:
            self._look_s += self._every_s
            self._look(now_s)
        self.finished = now_s >= self._end_s or time.monotonic() - self._began_s > self._within_s

    def _look(self, now_s: float) -> None:
        while part_path(self._record, len(self.parts) + 2).exists():
            self.read_part()
        gc.collect()
        self.hours.append(now_s / 3600.0)
        self.taken.append(footprint())
        fast = now_s / (time.monotonic() - self._began_s)
        print(
            f"{now_s / 3600.0:6.2f} h, {fast:.1f} x real time, {self.taken[-1]}",
            file=sys.stderr,
            flush=True,
        )

    def read_part(self) -> None:
        number = len(self.parts) + 1
        path = part_path(self._record, number)
        self.parts.append(cycles_in(path))
        self.written_mb += path.stat().st_size / 1e6
        if number > 2:
            path.unlink()


def virtual(hours: float, within_s: float, rotate_s: float) -> bool:
    clock = VirtualClock()
    text = CONFIG.format(
        link="pymavlink", url="udpin://127.0.0.1:14540", evader_port=14541, control_port=7448
    )
    config = parse_document(Config, tomllib.loads(text), source="bench")
    world = VirtualWorld(clock)
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        record = Recorder(path, {CONFIG_KEY: config.model_dump_json()}, rotate_s=rotate_s)
        page = Page(config.name, clock, {CONFIG_KEY: config.model_dump_json()})
        metrics = Metrics(config.name)
        link = world.links["bench"]
        evader = world.evaders["bench"]["evader"]
        equipment = Equipment(record=record, sinks=[metrics, page])
        daemon = Daemon(config.name, plan_of(config), link, {"evader": evader}, equipment)
        person = Person(daemon, metrics, page, path, hours, within_s)
        run([daemon], world, clock, mission=person)
        record.close()
        world.close()
        took_s = time.monotonic() - began_s
        while part_path(path, len(person.parts) + 1).exists():
            person.read_part()
        flown_h = clock.now_s() / 3600.0
        looks = [
            number
            for number, hour in enumerate(person.hours)
            if 3600.0 * hour >= min(WARM_S, 1200.0 * flown_h)
        ]
        at = [person.hours[look] for look in looks]
        taken = [person.taken[look] for look in looks]
        parts_with_cycles = sum(count > 0 for count in person.parts)
        kept_cycles = sum(person.parts)
        print(f"flown in virtual time  {flown_h:.2f} h in {took_s / 60.0:.1f} min of real time")
        print(
            f"cycles, setpoints      {person.cycles}, {person.setpoints}; engaged {person.engagements} times"
        )
        print(f"the process            {told(at, taken)} ({len(at)} looks from {at[0]:.2f} h on)")
        print(
            f"page and metrics       {page.messages} messages, {page.sent_mb:.0f} MB; {person.scrapes} scrapes"
        )
        if flown_h < hours:
            more_mb = growth_mb_h(at, taken) * (hours - flown_h)
            print(
                f"not flown              {hours - flown_h:.2f} h of {hours:g}; on the same line {more_mb:+.1f} MB more"
            )
        print(
            f"files of the record    {len(person.parts)}, {person.written_mb:.0f} MB, each read by itself: "
            f"{parts_with_cycles} whole; cycles in them {kept_cycles} of {person.cycles}; "
            f"{person.written_mb / (60.0 * flown_h):.2f} MB a minute"
        )
        comparison, survey = compare(path, recorded_settings)
        print(
            f"replay across a seam   {comparison.cycles} cycles of the first files, {comparison.differing} differ, "
            f"{survey.missing} messages missing"
        )
    lost = (
        kept_cycles != person.cycles
        or parts_with_cycles != len(person.parts)
        or survey.missing
        or comparison.differing
    )
    return is_flat(at, taken) and not lost


def real(minutes: float, rotate_s: float) -> bool:
    port = free_port(SOCK_STREAM)
    evader_port = free_port(SOCK_DGRAM)
    vehicle_command = [
        sys.executable,
        str(Path(__file__).with_name("bench_daemon.py")),
        "--as-vehicle",
        "zenoh",
    ]
    hours = []
    taken = []
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            [*vehicle_command, str(port), str(evader_port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as flying,
    ):
        assert flying.stdin is not None
        assert flying.stdout is not None
        flying.stdout.readline()
        recorded = f'[record]\nfolder = "{folder}"\nrotate_s = {rotate_s}\n'
        with daemon("mavsdk", "zenoh", port, evader_port, recorded) as pid:
            began_s = time.monotonic()
            while (passed_s := time.monotonic() - began_s) < 60.0 * minutes:
                hours.append(passed_s / 3600.0)
                taken.append(footprint(pid))
                time.sleep(10.0)
        flying.stdin.close()
        files = sorted(Path(folder).glob("*.mcap"))
        cycles = [cycles_in(file) for file in files]
    warm = len(hours) // 6
    print(f"flown in real time     {minutes:g} min, `guidance run` with MAVSDK over Zenoh")
    print(f"the process            {told(hours[warm:], taken[warm:])} ({len(hours) - warm} looks)")
    whole = sum(count > 0 for count in cycles)
    print(
        f"files of the record    {len(files)}, each read by itself: {whole} whole; cycles in them {sum(cycles)}"
    )
    return is_flat(hours[warm:], taken[warm:]) and whole == len(files)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("way", choices=("virtual", "real"))
    parser.add_argument("--hours", type=float, default=24.0, help="virtual time")
    parser.add_argument(
        "--within",
        type=float,
        default=math.inf,
        help="minutes of real time that a virtual flight may take",
    )
    parser.add_argument("--minutes", type=float, default=30.0, help="real time")
    parser.add_argument(
        "--rotate-s", type=float, default=300.0, help="length of a file; the daemon's is 600"
    )
    arguments = parser.parse_args()
    passed = (
        virtual(arguments.hours, 60.0 * arguments.within, arguments.rotate_s)
        if arguments.way == "virtual"
        else real(arguments.minutes, arguments.rotate_s)
    )
    print("flat and whole" if passed else "NOT flat, or not whole")
    sys.exit(0 if passed else 1)


if __name__ == "__main__":
    main()
