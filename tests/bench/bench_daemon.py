"""The whole daemon in flight: telemetry in to setpoint on the wire, jitter of its cycles, processor share and memory.

    python tests/bench/bench_daemon.py [--seconds 20] [--only mavsdk/zenoh] [--busy] [--flood frames]

`guidance run` flies a mock PX4, stepped in real time in its own process, through each link and wire, against an evader
that runs in circles. The vehicle's side measures the time from each LOCAL_POSITION_NED to the first setpoint after it,
and the time between setpoints. For comparison the minimal MAVSDK script of `bench_links.py` flies the same vehicle; it
forwards a constant velocity from a callback. `zenoh/topics` flies it as a flight mode over PX4's own topics, with
MAVLink by UDP beside them. The daemon shifts its 20 ms grid of cycles so that a position is 2 ms old
when a cycle begins; this wait is part of its latency by design. The daemon itself reports the lateness of
its cycles and the longest processor time. The measuring process gets a higher priority if permitted, so that it adds no
jitter. `--busy` runs another process that keeps a processor busy; `--flood` sends a flood to the daemon's UDP port (see
`FLOODS`). The full measurement of the jitter is `--seconds 600 --busy --only mavsdk/zenoh`.
"""

import argparse
import atexit
import contextlib
import itertools
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from bench_links import SETPOINT, Stopwatch, open_wire, processor_s, url_of
from footprint import footprint

if TYPE_CHECKING:
    from guidance.clock import Timing

LOCAL_POSITION = 32
REQUEST_ID = 12
"""Place of its number in an arming check and in the answer."""

PERIOD_S = 0.02
LATE_S = 0.01
"""A cycle that begins later than this is a late one, whatever is sent meanwhile."""

CASES = (
    "script/udp",
    "mavsdk/udp",
    "pymavlink/udp",
    "script/zenoh",
    "mavsdk/zenoh",
    "pymavlink/zenoh",
    "zenoh/topics",
)
FLOODS = {
    "starts": (17, 1, lambda: b"\xfe" * 65_000),
    "frames": (20_000, 1, lambda: foreign_heartbeat(7)),
    "impostors": (20_000, 12, lambda: foreign_heartbeat(1)),
    "bytes": (20_000, 12, lambda: b"\xfd"),
}
"""Floods by name: datagrams per second, number of source ports, and a function that makes the datagram."""
LASTING_MAH = 1e6
"""A charge that lasts for days: how long it flies is not the battery's to say."""

CONFIG = """
name = "bench"
[vehicle]
autopilot = "px4"
link = "{link}"
{urls}
[evader]
kind = "global_position"
url = "udpin://127.0.0.1:{evader_port}"
system_id = 2
[game]
speed_m_s = 6.0
evader_speed_m_s = 3.0
[flight]
takeoff_height_m = 15.0
after_capture = "shadow"
[control]
endpoint = "tcp/127.0.0.1:{control_port}"
[metrics]
[log]
level = "error"
"""


class Watch(Stopwatch):
    """Times setpoints among themselves as well."""

    def restart(self) -> None:
        super().restart()
        self.arrivals: list[float] = []
        self.answers: list[float] = []

    def on_frame(self, data: bytes) -> None:
        if len(data) > 9 and int.from_bytes(data[7:10], "little") == SETPOINT:
            self.arrivals.append(time.perf_counter())
        super().on_frame(data)

    def on_setpoint(self) -> None:
        """Take a setpoint that is no MAVLink frame."""
        now_s = time.perf_counter()
        self.arrivals.append(now_s)
        if self.asked_s is not None:
            self.latencies.append(now_s - self.asked_s)
            self.asked_s = None

    def obey(self, order: str) -> None:
        """Restart the measurement on `measure`; print its result on `report`."""
        if order == "measure":
            self.restart()
        elif order == "report":
            gaps = [later - earlier for earlier, later in itertools.pairwise(self.arrivals)]
            found = {"latencies": self.latencies, "gaps": gaps, "answers": self.answers}
            print(json.dumps(found), flush=True)


def vehicle(wire: str, port: int, evader_port: int) -> None:
    """Step the mock in real time; `measure` and `report` come on standard input, whose end is ours."""
    from guidance.session.fly.loop import claim
    from sitl_mock import MockVehicle

    parameters = {"GF_MAX_HOR_DIST": 210.0, "GF_MAX_VER_DIST": 70.0}
    over_topics = wire == "topics"
    links = {"onboard": "onboard", **({"topics": "topics"} if over_topics else {})}
    mock = MockVehicle("px4", ready_after_s=1.0, parameters=parameters, links=links, seed=1)
    battery = mock.autopilot.state.battery
    battery.pack = battery.pack._replace(capacity_mah=LASTING_MAH)
    watch = Watch()
    inbox = deque()
    orders = deque()

    def on_frame(data: bytes) -> None:
        watch.on_frame(data)
        inbox.append(data)

    def listen() -> None:
        orders.append(sys.stdin.readline().strip())
        orders.append(sys.stdin.readline().strip())
        sys.stdin.read()
        orders.append("end")

    threading.Thread(target=listen, daemon=True).start()
    send, close = open_wire("udp" if over_topics else wire, port, on_frame)
    topics = Topics(port, watch) if over_topics else None
    beacon = Beacon(evader_port)
    claim()
    print("ready", flush=True)
    start_s = time.perf_counter()
    now_s = 0.0
    while (order := orders.popleft() if orders else "") != "end":
        time.sleep(max(0.0, start_s + now_s - time.perf_counter()))
        taken = {"onboard": [inbox.popleft() for _ in range(len(inbox))]}
        if topics is not None:
            taken["topics"] = topics.receive()
        out = mock.step_links(now_s, taken)
        for frame in out["onboard"]:
            if topics is None and int.from_bytes(frame[7:10], "little") == LOCAL_POSITION:
                watch.ask()
            send(frame)
        if topics is not None:
            topics.send(out["topics"])
        beacon.tell(now_s)
        now_s += 0.01
        watch.obey(order)
    close()
    if topics is not None:
        topics.close()


class Topics:
    """PX4's topics of the mock, and the Zenoh router that they go by."""

    def __init__(self, port: int, watch: Watch) -> None:
        import zenoh

        from sitl_mock.transports.px4_zenoh import LINK, Px4ZenohEndpoint
        from sitl_mock.transports.zenoh_session import configuration

        at = f"tcp/127.0.0.1:{port}"
        self.watch = watch
        self.link = LINK
        self.router = zenoh.open(configuration("router", at, connect=False))
        self.asked: dict[int, float] = {}
        self.heard = [
            self.router.declare_subscriber("0/fmu/*/arming_check_$*/**", self.on_check),
            self.router.declare_subscriber(
                "0/fmu/in/trajectory_setpoint/**", lambda _sample: watch.on_setpoint()
            ),
        ]
        self.endpoint = Px4ZenohEndpoint({"uav1": 0}, at)

    def on_check(self, sample: object) -> None:
        now_s = time.perf_counter()
        number = bytes(sample.payload)[REQUEST_ID]
        if "/out/" in str(sample.key_expr):
            self.asked[number] = now_s
        elif number in self.asked:
            self.watch.answers.append(now_s - self.asked.pop(number))

    def receive(self) -> list[bytes]:
        return [arrival.data for arrival in self.endpoint.receive()]

    def send(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            if frame.startswith(b"vehicle_local_position\0"):
                self.watch.ask()
        self.endpoint.send("uav1", self.link, frames)

    def close(self) -> None:
        self.endpoint.close()
        for subscriber in self.heard:
            subscriber.undeclare()
        self.router.close()


class Beacon:
    """An evader at 2 m/s on a circle of 25 m, 60 m north of the mock's home, that says so ten times a second."""

    def __init__(self, port: int) -> None:
        from pymavlink.dialects.v20 import common

        self.dialect = common
        self.mavlink = common.MAVLink(None, 2, 1)
        self.to = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.next_s = 0.0

    def tell(self, now_s: float) -> None:
        if now_s < self.next_s:
            return
        self.next_s = now_s + 0.1
        self.socket.sendto(self.frame(now_s), self.to)

    def frame(self, now_s: float) -> bytes:
        angle = 2.0 * now_s / 25.0
        north_m = 60.0 + 25.0 * math.cos(angle)
        east_m = 25.0 * math.sin(angle)
        lat = 47.397742 + math.degrees(north_m / 6371000.0)
        lon = 8.545594 + math.degrees(east_m / (6371000.0 * math.cos(math.radians(47.397742))))
        velocity = round(-200.0 * math.sin(angle)), round(200.0 * math.cos(angle)), 0
        place = round(lat * 1e7), round(lon * 1e7), 488000, 0
        message = self.dialect.MAVLink_global_position_int_message(
            round(now_s * 1e3), *place, *velocity, 0
        )
        return bytes(message.pack(self.mavlink))


def foreign_heartbeat(system_id: int) -> bytes:
    from pymavlink.dialects.v20 import common

    return bytes(
        common.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(common.MAVLink(None, system_id, 1))
    )


def flood(kind: str, port: int, seconds: float) -> None:
    """Send until the time is over, evenly over each hundredth of a second; print how many went out a second."""
    rate_hz, ports, make = FLOODS[kind]
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(ports)]
    data = make()
    sent = 0
    start_s = time.monotonic()
    while (passed_s := time.monotonic() - start_s) < seconds:
        for _ in range(round(rate_hz * passed_s) - sent):
            sockets[sent % ports].sendto(data, ("127.0.0.1", port))
            sent += 1
        time.sleep(0.01)
    print(round(sent / seconds), flush=True)


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def script(wire: str, port: int, _evader_port: int) -> Iterator[int]:
    vehicle_command = [
        sys.executable,
        str(Path(__file__).with_name("bench_links.py")),
        "--as-end",
        "script",
        wire,
    ]
    with subprocess.Popen(
        [*vehicle_command, "--port", str(port)], stdin=subprocess.PIPE
    ) as running:
        time.sleep(3.0)
        yield running.pid
        assert running.stdin is not None
        running.stdin.close()


@contextlib.contextmanager
def daemon(
    link: str, wire: str, port: int, evader_port: int, more: str = "", *, cycles: Path | None = None
) -> Iterator[int]:
    """`guidance run`, brought up and engaged; `more` is added to its configuration, `cycles` get a row for each."""
    from tests.harness.bus import ask

    control_port = free_port(socket.SOCK_STREAM)
    urls = f'url = "{url_of(wire, port)}"'
    if wire == "topics":
        mavlink = url_of("udp", port)
        urls = f'url = "zenoh+tcp://127.0.0.1:{port}"\nparameters = "{mavlink}"'
    config = CONFIG.format(link=link, urls=urls, evader_port=evader_port, control_port=control_port)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(config + more)
        begin = "from guidance.cli import main; main()"
        if cycles is not None:
            begin = (
                f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from bench_daemon import "
                + (f"timing_cycles; timing_cycles({str(cycles)!r}); {begin}")
            )
        command = [sys.executable, "-c", begin, "run", str(path)]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
            try:
                at = f"tcp/127.0.0.1:{control_port}"
                for order, state in (("start", "standing by"), ("engage", "engaged")):
                    insist(
                        lambda order=order: ask(order, endpoint=at, name="bench"),
                        lambda a: a["accepted"],
                        order,
                    )
                    status = lambda: ask("status", endpoint=at, name="bench")  # noqa: E731
                    insist(status, lambda reply, state=state: reply["state"] == state, state)
                yield running.pid
            finally:
                for _ in range(2):  # asked twice it ends at once
                    running.send_signal(signal.SIGTERM)
                    time.sleep(0.2)
                running.wait(20.0)


class Cycle(NamedTuple):
    """One cycle: start, lateness, duration, and processor time of the loop's thread and of the whole process."""

    at_s: float
    late_s: float
    took_s: float
    thread_s: float
    process_s: float


def timing_cycles(path: str) -> None:
    """Have this process write a `Cycle` of each of its cycles, once it ends."""
    from guidance.session.fly.daemon import Daemon

    step = Daemon.step
    rows = array("d")

    def timed(daemon: "Daemon", now_s: float, timing: "Timing") -> None:
        thread_s = time.thread_time()
        process_s = time.process_time()
        at_s = time.monotonic()
        step(daemon, now_s, timing)
        took_s = time.monotonic() - at_s
        rows.extend(
            (
                at_s,
                timing.late_s,
                took_s,
                time.thread_time() - thread_s,
                time.process_time() - process_s,
            )
        )

    Daemon.step = timed
    atexit.register(lambda: Path(path).write_bytes(rows.tobytes()))


def cycles_of(path: Path, began_s: float, ended_s: float) -> list[Cycle]:
    """Read what `timing_cycles` wrote of a time."""
    numbers = iter(array("d", path.read_bytes()))
    rows = itertools.starmap(Cycle, zip(*[numbers] * len(Cycle._fields), strict=True))
    return [row for row in rows if began_s <= row.at_s <= ended_s]


def insist(
    ask: Callable[[], Mapping],
    wanted: Callable[[Mapping], bool],
    what: str,
    *,
    limit_s: float = 60.0,
) -> None:
    """Ask until it is so."""
    from guidance.errors import GuidanceError

    deadline_s = time.monotonic() + limit_s
    answer: object = None
    while time.monotonic() < deadline_s:
        with contextlib.suppress(GuidanceError):
            answer = ask()
            if wanted(answer):
                return
        time.sleep(0.5)
    raise SystemExit(f"{what}: not within {limit_s:g} s; the daemon says {answer}")


def one_case(case: str, seconds: float, flooded: str | None) -> dict[str, float]:
    link, wire = case.split("/")
    port = free_port(socket.SOCK_DGRAM if wire == "udp" else socket.SOCK_STREAM)
    evader_port = free_port(socket.SOCK_DGRAM)
    vehicle_command = [sys.executable, __file__, "--as-vehicle", wire, str(port), str(evader_port)]
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            vehicle_command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as flying,
    ):
        assert flying.stdin is not None
        assert flying.stdout is not None
        flying.stdout.readline()
        timed = Path(folder) / "cycles"
        flown_by = (
            script(wire, port, evader_port)
            if link == "script"
            else daemon(link, wire, port, evader_port, cycles=timed)
        )
        sender = None
        flooded_hz = 0.0
        with flown_by as pid, contextlib.ExitStack() as stack:
            if flooded is not None:
                sending = [
                    sys.executable,
                    __file__,
                    "--as-flood",
                    flooded,
                    str(port),
                    str(seconds + 1.0),
                ]
                sender = stack.enter_context(
                    subprocess.Popen(sending, stdout=subprocess.PIPE, text=True)
                )
            flying.stdin.write("measure\n")
            flying.stdin.flush()
            before_s = processor_s(pid)
            began_s = time.monotonic()
            time.sleep(seconds)
            share = 100.0 * (processor_s(pid) - before_s) / (time.monotonic() - began_s)
            ended_s = time.monotonic()
            resident_mb = footprint(pid).memory_mb
            flying.stdin.write("report\n")
            flying.stdin.flush()
            measured = json.loads(flying.stdout.readline())
            if sender is not None and sender.stdout is not None:
                flooded_hz = float(sender.stdout.readline())
        flying.stdin.close()
        cycles = cycles_of(timed, began_s, ended_s) if timed.exists() else []
    latencies = sorted(measured["latencies"])
    answers = sorted(measured.get("answers", []))
    gaps = measured["gaps"]
    jitter = sorted(abs(gap - PERIOD_S) for gap in gaps)
    return {
        **most_of(cycles),
        "p50_ms": 1e3 * median(latencies),
        "p99_ms": 1e3 * at(latencies, 0.99),
        "p999_ms": 1e3 * at(latencies, 0.999),
        "most_ms": 1e3 * latencies[-1],
        "jitter_p50_ms": 1e3 * median(jitter),
        "jitter_p99_ms": 1e3 * at(jitter, 0.99),
        "jitter_p999_ms": 1e3 * at(jitter, 0.999),
        "jitter_most_ms": 1e3 * jitter[-1],
        "rate_hz": len(gaps) / sum(gaps),
        "flooded_hz": flooded_hz,
        "answers": float(len(answers)),
        "answer_p50_ms": 1e3 * median(answers) if answers else math.nan,
        "answer_most_ms": 1e3 * answers[-1] if answers else math.nan,
        "cpu_percent": share,
        "memory_mb": resident_mb,
        "load": os.getloadavg()[0],
    }


def most_of(cycles: Sequence[Cycle]) -> dict[str, float]:
    """Return how many cycles began late, the latest, and the longest by each of the clocks; none of a script's."""
    most = lambda name: 1e3 * max((getattr(cycle, name) for cycle in cycles), default=math.nan)  # noqa: E731
    return {
        "late": float(sum(cycle.late_s > LATE_S for cycle in cycles)),
        "late_most_ms": most("late_s"),
        "cycle_most_ms": most("took_s"),
        "cycle_most_thread_ms": most("thread_s"),
        "cycle_most_process_ms": most("process_s"),
    }


def told(got: Mapping[str, float]) -> str:
    """Say what `most_of` found; of the processor, so that a busy machine takes no part in it."""
    return (
        f"cycles begun later than {1e3 * LATE_S:g} ms: {got['late']:.0f} (latest {got['late_most_ms']:.1f} ms); the "
        f"longest {got['cycle_most_ms']:.1f} ms, of the processor {got['cycle_most_thread_ms']:.1f} ms "
        f"({got['cycle_most_process_ms']:.1f} ms with all threads)"
    )


def at(ordered: list[float], share: float) -> float:
    return ordered[int(share * (len(ordered) - 1))]


def compare(cases: tuple[str, ...], seconds: float, flooded: str | None) -> None:
    print(
        "latency: position to setpoint; jitter: of the 20 ms between setpoints, as the vehicle sees them"
    )
    print("                 latency, ms                     jitter, ms                      ")
    print(
        "case                 p50    p99  p99.9   most |    p50    p99  p99.9   most | rate Hz  cpu %   MB  load"
    )
    base: dict[str, dict[str, float]] = {}
    for case in cases:
        got = one_case(case, seconds, flooded)
        first = base.setdefault(case.split("/")[1], got)
        shares = ("p50_ms", "p99_ms", "p999_ms", "most_ms")
        took, jitter = (
            " ".join(f"{got[kind + share]:6.2f}" for share in shares) for kind in ("", "jitter_")
        )
        used = f"{got['rate_hz']:7.1f} {got['cpu_percent']:6.1f} {got['memory_mb']:4.0f} {got['load']:5.1f}"
        print(f"{case:16} {took} | {jitter} | {used}", flush=True)
        if got["late_most_ms"] >= 0.0:
            print(f"{'':16} {told(got)}")
        if got["answers"]:
            answered = (
                f"median {got['answer_p50_ms']:.1f} ms, latest {got['answer_most_ms']:.1f} ms"
            )
            print(f"{'':16} {got['answers']:.0f} arming checks answered: {answered}")
        if flooded is not None:
            print(f"{'':16} flooded with {got['flooded_hz']:.0f} datagrams a second", flush=True)
        ratios = f"{got['p50_ms'] / first['p50_ms']:.2f} (p50), {got['p99_ms'] / first['p99_ms']:.2f} (p99)"
        print(f"{'':16} latency to that of {case.split('/')[1]}'s first: {ratios}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--only", choices=CASES, action="append")
    parser.add_argument(
        "--busy", action="store_true", help="keep another process spinning meanwhile"
    )
    parser.add_argument("--flood", choices=FLOODS, help="flood the daemon's UDP port meanwhile")
    parser.add_argument("--as-flood", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--as-vehicle", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.as_vehicle:
        wire, port, evader_port = arguments.as_vehicle
        vehicle(wire, int(port), int(evader_port))
        return
    if arguments.as_flood:
        kind, port, seconds = arguments.as_flood
        flood(kind, int(port), float(seconds))
        return
    with contextlib.ExitStack() as stack:
        if arguments.busy:
            spinning = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(spinning.wait)
            stack.callback(spinning.kill)
        compare(tuple(arguments.only or CASES), arguments.seconds, arguments.flood)


if __name__ == "__main__":
    main()
