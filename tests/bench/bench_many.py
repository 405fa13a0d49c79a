"""Repeat flights, orders and reloads in one process and check for leaks.

    python tests/bench/bench_many.py [--flights 200] [--orders 2000] [--reloads 500] [--within MINUTES]

Whole mock flights in virtual time, each with its own daemon, world and record; orders to one daemon over its control
bus, a tenth of them from a new session as in `guidance ctl`; and reloads of its configuration file on the ground.
Memory, descriptors, threads and objects known to the garbage collector are sampled forty times and at the end. Growth
counts from the second sample and is printed per repetition.

Exit code 1 if descriptors grow, memory by more than 2 MB in total, or threads by one per hundred repetitions.
"""

import argparse
import gc
import math
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench_daemon import CONFIG, free_port
from footprint import footprint

from guidance.clock import VirtualClock
from guidance.flight import State
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Daemon, Equipment
from guidance.session.fly.mission import Mission
from guidance.session.orders.control_client import answers, join_session
from guidance.session.orders_section import Control
from guidance.session.plan import plan_of
from guidance.session.service import reload
from guidance.session.vehicle_file import load_vehicle
from guidance.sim.scenario_file import load_scenario
from guidance.sim.stepped import SteppedWorld
from tests.harness.bus import ControlBus, ask

SHORT = Path(__file__).parents[1] / "data" / "short_chase.toml"
MOST_MB = 2.0


class Looks:
    """Samples of the process, as plain numbers, which the garbage collector does not count."""

    def __init__(self) -> None:
        self.counts: list[int] = []
        self.memory_mb: list[float] = []
        self.descriptors: list[int] = []
        self.threads: list[int] = []
        self.objects: list[int] = []

    def look(self, count: int) -> None:
        gc.collect()
        taken = footprint()
        self.counts.append(count)
        self.memory_mb.append(taken.memory_mb)
        self.descriptors.append(taken.descriptors)
        self.threads.append(taken.threads)
        del taken
        self.objects.append(len(gc.get_objects()))

    def told(self, what: str, wanted: int) -> bool:
        """Print a row; return whether nothing grew."""
        times = self.counts[-1] - self.counts[1]
        objects = self.objects[-1] - self.objects[1]
        grown_mb = self.memory_mb[-1] - self.memory_mb[1]
        each = f"{grown_mb / times * 1e3:+.1f} kB and {objects / times:+.2f} objects a time"
        memory = f"{self.memory_mb[1]:6.1f} to {self.memory_mb[-1]:6.1f} MB"
        print(
            f"{what:8} {self.counts[-1]:5} of {wanted:5}   memory {memory}, {each:40}   "
            f"descriptors {grown(self.descriptors):+d}   threads {grown(self.threads):+d}",
            flush=True,
        )
        return (
            grown_mb < MOST_MB
            and grown(self.descriptors) <= 0
            and 100 * grown(self.threads) < times
        )


def grown(seen: Sequence[int]) -> int:
    """Return how much more the most of the second half is than that of the first: some come and go."""
    half = len(seen) // 2
    return max(seen[half:]) - max(seen[1 : max(half, 2)])


def over_and_over(what: str, wanted: int, once: Callable[[int], None], within_s: float) -> bool:
    looks = Looks()
    every = max(1, wanted // 40)
    began_s = time.monotonic()
    looks.look(0)
    for number in range(1, wanted + 1):
        once(number)
        if number % every == 0 or number == wanted:
            looks.look(number)
            if time.monotonic() - began_s > within_s and len(looks.counts) > 2:
                break
    return looks.told(what, wanted)


def flights(wanted: int, within_s: float) -> bool:
    scenario = load_scenario(str(SHORT))[1]

    def once(number: int) -> None:
        clock = VirtualClock()
        world = SteppedWorld(scenario.model_copy(update={"seed": number}), clock)
        with tempfile.TemporaryDirectory() as folder:
            record = Recorder(Path(folder) / "record.mcap", {})
            result = (
                Mission(scenario, world, clock, equipment={"pursuer": Equipment(record=record)})
                .fly()
                .vehicles["pursuer"]
            )
            record.close()
        world.close()
        if result.ended is not State.LANDED or record.failed is not None:
            raise SystemExit(f"flight {number}: {result.ended}, record {record.failed}")

    return over_and_over("flights", wanted, once, within_s)


class Silent:
    """A link, or an evader's reports, without a vehicle."""

    def receive(self) -> tuple[()]:
        return ()

    def send_heartbeat(self) -> None:
        """Do nothing."""

    def request(self, _request: object) -> None:
        """Ignore the request."""

    def counters(self) -> dict[str, int]:
        return {}


@contextmanager
def daemon_on_the_ground() -> Iterator[tuple[Daemon, Path, str]]:
    with tempfile.TemporaryDirectory() as folder:
        port = free_port(socket.SOCK_STREAM)
        path = Path(folder) / "bench.toml"
        text = CONFIG.format(
            link="pymavlink", url="udpin://127.0.0.1:1", evader_port=2, control_port=port
        )
        path.write_text(text)
        yield (
            Daemon(
                "bench", plan_of(load_vehicle(path)), Silent(), {"evader": Silent()}, Equipment()
            ),
            path,
            str(port),
        )


def orders(wanted: int, within_s: float) -> bool:
    with daemon_on_the_ground() as (daemon, _, port):
        at = f"tcp/127.0.0.1:{port}"
        daemon.mailbox.meanwhile = lambda order: {"accepted": True, "order": order, "name": "bench"}
        bus = ControlBus("bench", daemon.mailbox, Control(endpoint=at, host=True))
        session = join_session(at)
        words = ("status", "hold", "land")

        def once(number: int) -> None:
            word = words[number % len(words)]
            if number % 10 == 0:
                answered = ask(word, endpoint=at, name="bench")
            else:
                answered = answers(session, "bench", word, 5.0)[0]
            assert answered["order"] == word

        try:
            return over_and_over("orders", wanted, once, within_s)
        finally:
            session.close()
            bus.close()


def reloads(wanted: int, within_s: float) -> bool:
    with daemon_on_the_ground() as (daemon, path, _):
        config = load_vehicle(path)

        def once(number: int) -> None:
            daemon.exchange(lambda: reload(path, config), 0.02 * number)
            daemon.step(0.02 * number)

        return over_and_over("reloads", wanted, once, within_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--orders", type=int, default=2000)
    parser.add_argument("--reloads", type=int, default=500)
    parser.add_argument(
        "--within", type=float, default=math.inf, help="minutes that each of them may take"
    )
    arguments = parser.parse_args()
    within_s = 60.0 * arguments.within
    held = [
        reloads(arguments.reloads, within_s),
        orders(arguments.orders, within_s),
        flights(arguments.flights, within_s),
    ]
    print("nothing grows" if all(held) else "something GROWS")
    sys.exit(0 if all(held) else 1)


if __name__ == "__main__":
    main()
