"""ROS 2 beside a flight: lateness of the cycles and share of a core, without [ros], with it, and with its subscribers.

    python -m tests.bench.bench_ros [--seconds 15]

`guidance run` flies a mock PX4 in a process of its own against a rover, twice: first without `[ros]`, then with it. The
second flight has periods without subscribers between those with a subscriber of all topics, one that is slow, one that
is frozen, and a router that is killed and started again. Lateness is what the record says of each cycle.

The last lines feed the cycles of a recorded game to the output alone, 50 a second, and measure what it uses itself.
"""

import argparse
import itertools
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from guidance.clock import MonotonicClock
from guidance.config import parse_document
from guidance.log import CycleEntry, cycles_of, metadata_of
from guidance.log.sink import Sink
from guidance.session.observe.ros import open_ros
from guidance.session.orders.mailbox import Mailbox
from guidance.session.vehicle_file import Config
from sitl_mock.child import running
from tests.bench.bench_links import processor_s
from tests.harness.bus import ask
from tests.harness.flights import NEAR, flown
from tests.harness.vehicle import FENCED, document, mocked, write_file
from tests.links.rigs import free_port

GUIDANCE = Path(sys.executable).parent / "guidance"
NAME = "uav1"

ROUTER = """
import signal, sys, zenoh
from tests.links.rigs import router_config
with zenoh.open(router_config(int(sys.argv[1]))):
    print("ready", flush=True)
    signal.pause()
"""
SUBSCRIBER = """
import sys, time
from guidance.links.zenoh.session import open_session
heard = 0
def hear(sample):
    global heard
    heard += 1
    time.sleep(float(sys.argv[2]))
session = open_session(sys.argv[1])
subscriber = session.declare_subscriber("0/**", hear)
print("ready", flush=True)
sys.stdin.read()
print(heard, flush=True)
session.close()
"""


class Period(NamedTuple):
    """A part of a flight: what was there, its Unix times, and the share of a core that the daemon used."""

    name: str
    begin_s: float
    end_s: float
    share: float


def child(code: str, *arguments: object) -> subprocess.Popen[str]:
    """Start a program and wait until it is ready."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    program = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert program.stdout.readline() == "ready\n"
    return program


class Flight:
    """A daemon in its game, and the periods that were measured."""

    def __init__(self, folder: Path, stack: ExitStack, **sections: object) -> None:
        vehicles = [
            mocked(NAME, parameters=FENCED),
            mocked("evader", "rover", start_ned_m=(40.0, 0.0, 0.0)),
        ]
        fleet = stack.enter_context(running(vehicles, over=["zenoh"]))
        path, self._endpoint = write_file(
            folder,
            fleet,
            flight={"on_terminate": "land", "after_capture": "shadow"},
            log={"level": "error"},
            **sections,
        )
        self._folder = folder
        self.daemon = stack.enter_context(subprocess.Popen([str(GUIDANCE), "run", str(path)]))
        stack.callback(self.daemon.terminate)
        self.periods: list[Period] = []
        self._until("ready")
        self._order("start", "standing by")
        self._order("engage", "engaged")

    def _until(self, *states: str) -> None:
        deadline_s = time.monotonic() + 60.0
        while time.monotonic() < deadline_s:
            try:
                if ask("status", endpoint=self._endpoint, name=NAME).get("state") in states:
                    return
            except Exception:
                pass
            time.sleep(0.2)
        raise SystemExit(f"never {states}")

    def _order(self, order: str, state: str) -> None:
        answer = ask(order, endpoint=self._endpoint, name=NAME)
        assert answer["accepted"], answer
        self._until(state, "on station")

    def measure(
        self, name: str, seconds: float, meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        """Measure a period."""
        begin_s = time.time()
        used_s = processor_s(self.daemon.pid)
        meanwhile()
        time.sleep(max(0.0, seconds - (time.time() - begin_s)))
        end_s = time.time()
        share = (processor_s(self.daemon.pid) - used_s) / (end_s - begin_s)
        self.periods.append(Period(name, begin_s, end_s, share))

    def finish(self) -> None:
        """End the daemon, and print a line for each name of a period."""
        self.daemon.terminate()
        self.daemon.wait()
        (record,) = self._folder.glob(f"{NAME}-*Z-*[0-9].mcap")
        started_s = datetime.fromisoformat(metadata_of(record)["started_utc"]).timestamp()
        cycles = [(started_s + entry.now_s, entry.timing.late_s) for entry in cycles_of(record)]
        for name in dict.fromkeys(period.name for period in self.periods):
            same = [period for period in self.periods if period.name == name]
            show(name, same, cycles)


def show(name: str, periods: Sequence[Period], cycles: Sequence[tuple[float, float]]) -> None:
    """Print the lateness of the cycles in some periods, and their share of a core."""
    late_ms = np.array(
        [
            1e3 * late_s
            for at_s, late_s in cycles
            if any(period.begin_s <= at_s < period.end_s for period in periods)
        ]
    )
    share = np.mean([period.share for period in periods])
    half, most, worst = np.percentile(late_ms, (50, 99, 100))
    print(
        f"{name:28} {len(late_ms):6} cycles   late p50 {half:6.3f} ms   p99 {most:6.3f} ms   "
        f"most {worst:7.3f} ms   {100 * share:5.1f} % of a core",
        flush=True,
    )


def subscribed(router: str, pause_s: float, seconds: float, *, frozen: bool = False) -> None:
    """Subscribe to everything for some seconds; frozen, the program stops at once."""
    program = child(SUBSCRIBER, router, pause_s)
    if frozen:
        program.send_signal(signal.SIGSTOP)
    time.sleep(seconds)
    if frozen:
        program.kill()
        program.wait()
        return
    heard, _ = program.communicate(timeout=60.0 + seconds)
    print(f"  a subscriber that waits {pause_s:g} s heard {heard.strip()} messages", flush=True)


def output_share(seconds: float, folder: Path) -> None:
    """Print which share of a core the output uses by itself."""
    record = folder / "record.mcap"
    flown(NEAR, record)
    entries = list(cycles_of(record))
    game = [entry for entry in entries if entry.certificate is not None]
    before = entries[: entries.index(game[0])]
    port = free_port(socket.SOCK_STREAM)
    router = child(ROUTER, port)
    config = parse_document(
        Config, document(ros={"endpoint": f"tcp/127.0.0.1:{port}"}), source="bench"
    )
    mailbox = Mailbox()
    sink = open_ros(NAME, metadata_of(record), MonotonicClock(), mailbox, config.ros)
    nothing = Sink()
    try:
        for entry in before:
            sink.cycle(entry)
            time.sleep(0.002)
        idle = fed(nothing, game, seconds)
        print(
            f"[ros] alone, no subscriber   {100 * (fed(sink, game, seconds) - idle):5.1f} % of a core"
        )
        program = child(SUBSCRIBER, f"tcp/127.0.0.1:{port}", 0)
        time.sleep(0.5)
        print(
            f"[ros] alone, all subscribed  {100 * (fed(sink, game, seconds) - idle):5.1f} % of a core"
        )
        program.communicate(timeout=60.0)
    finally:
        sink.close()
        router.kill()


def fed(sink: Sink, game: Sequence[CycleEntry], seconds: float) -> float:
    """Give cycles to an output as a flight does; return the share of a core that this process used."""
    used_s = time.process_time()
    begun_s = time.monotonic()
    for number, entry in enumerate(itertools.islice(itertools.cycle(game), round(50 * seconds))):
        sink.cycle(entry._replace(now_s=game[0].now_s + begun_s + 0.02 * number))
        time.sleep(max(0.0, begun_s + 0.02 * (number + 1) - time.monotonic()))
    return (time.process_time() - used_s) / (time.monotonic() - begun_s)


def main(seconds: float) -> None:
    """Fly both flights, and feed the output alone."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        flight = Flight(Path(folder), stack)
        flight.measure("without [ros]", 2.0 * seconds)
        flight.finish()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        port = free_port(socket.SOCK_STREAM)
        router = f"tcp/127.0.0.1:{port}"
        routers = [child(ROUTER, port)]

        def end() -> None:
            routers[-1].kill()

        stack.callback(end)
        flight = Flight(Path(folder), stack, ros={"endpoint": router})

        def restart() -> None:
            time.sleep(0.25 * seconds)
            routers[-1].kill()
            routers[-1].wait()
            time.sleep(0.25 * seconds)
            routers.append(child(ROUTER, port))

        alone = "[ros], no subscriber"
        everything = "[ros], a late subscriber"
        for _ in range(2):
            flight.measure(alone, 0.5 * seconds)
            flight.measure(everything, seconds, lambda: subscribed(router, 0.0, 0.9 * seconds))
        flight.measure(alone, 0.5 * seconds)
        flight.measure(
            "[ros], a slow subscriber", seconds, lambda: subscribed(router, 0.05, 0.8 * seconds)
        )
        flight.measure(
            "[ros], a frozen subscriber",
            seconds,
            lambda: subscribed(router, 0.0, 0.9 * seconds, frozen=True),
        )
        flight.measure("[ros], the router restarts", seconds, restart)
        flight.finish()
    with tempfile.TemporaryDirectory() as folder:
        output_share(seconds, Path(folder))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=15.0, help="of each period")
    main(parser.parse_args().seconds)
