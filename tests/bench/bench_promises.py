"""Prints one table: results under load, with faults and with bad inputs, and what PX4 and ArduPilot promise for each.

    python tests/bench/bench_promises.py [--seconds 20] [--flights 60] [--inputs 20000] [--only load faults inputs]

Load: the whole daemon flies with MAVSDK over UDP under each flood of `bench_daemon.py`, 20,000 datagrams per second.
Missing setpoints and cycles that begin more than 10 ms late count as lost. The table also gives the processor time of
the longest cycle, because a busy machine affects it less. Telemetry and evader reports are then read as fast as
possible, and the metrics page is requested repeatedly. Faults: flights of `python -m tests faults`, checked against the
mock's true state. Bad inputs: frames, reports, vehicle files and records, cut, flipped and spliced at random. Each must
be accepted or refused with a defined error; other exceptions count as lost. The exit code is 1 if anything was lost.

The promises of the autopilots assume default parameters: PX4 v1.17 (commander_params, failsafe, offboardCheck,
TargetEstimator) and ArduCopter 4.5 (mode_guided, AP_Follow). "(measured)" marks measurements on their simulators.
"""

import argparse
import http.client
import random
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from bench_daemon import FLOODS, Beacon, free_port, one_case, told
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # tests/faults

from guidance.config import load as load_file  # noqa: E402
from guidance.errors import GuidanceError  # noqa: E402
from guidance.frames import Amsl, LocalFrame  # noqa: E402
from guidance.links import MemoryWire  # noqa: E402
from guidance.links.evaders.carriers import GLOBAL_POSITION, RefusedReport  # noqa: E402
from guidance.links.evaders.mavlink import MavlinkEvader  # noqa: E402
from guidance.links.evaders.zenoh import report_of_json  # noqa: E402
from guidance.links.mavlink.pymavlink_link import PymavlinkLink  # noqa: E402
from guidance.log import record_errors, survey_of  # noqa: E402
from guidance.session.observe.metrics import Metrics, MetricsServer  # noqa: E402
from guidance.session.vehicle_file import Config  # noqa: E402
from sitl_mock import MockVehicle  # noqa: E402
from tests.faults.drawing import draw_case  # noqa: E402
from tests.faults.flying import fly  # noqa: E402

BATCH = 100
REPORT = (
    b'{"sent_s": 12.5, "latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 600.0, "altitude_datum": "amsl", '
    b'"velocity_ned_m_s": [1.0, 0.0, 0.0]}'
)
FRAME = LocalFrame(47.3977418, 8.5455939, Amsl(488.0))


class Row(NamedTuple):
    """One trial: its size, the result, the number of losses, and the autopilots' promises."""

    what: str
    tried: str
    held: str
    lost: int
    px4: str
    ardupilot: str


STREAM_PX4 = "leaves OFFBOARD 1 s after the last setpoint (COM_OF_LOSS_T), for Position or, without a radio, Return"
STREAM_ARDUPILOT = "stays in GUIDED; velocity to zero 3 s after the last (GUID_TIMEOUT), stopped at 5.7 s (measured)"


def load(seconds: float) -> Iterator[Row]:
    for kind, (_, ports, make) in FLOODS.items():
        got = one_case("mavsdk/udp", seconds, kind)
        gap_ms = 20.0 + got["jitter_most_ms"]
        yield Row(
            f"flood: {kind}",
            f"{got['flooded_hz']:.0f} datagrams a second, {len(make())} bytes each, senders: {ports}; {seconds:g} s",
            f"setpoints at {got['rate_hz']:.2f} Hz, longest gap {gap_ms:.1f} ms; {told(got)}; load {got['load']:.1f}",
            max(0, round(seconds * (50.0 - got["rate_hz"]))) + round(got["late"]),
            STREAM_PX4,
            STREAM_ARDUPILOT,
        )
    yield _telemetry()
    yield _reports()
    yield _pages()


def _telemetry() -> Row:
    vehicle = MockVehicle("px4", ready_after_s=0.5, seed=1)
    batches = [vehicle.step(0.02 * number) for number in range(1500)]
    ours, theirs = MemoryWire.pair(time.perf_counter)
    link = PymavlinkLink(ours, time.perf_counter, system_id=1)
    sent = 0
    began_s = time.process_time()
    for batch in batches:
        for frame in batch:
            theirs.send(frame)
        sent += len(batch)
        link.receive()
    took_s = time.process_time() - began_s
    counters = link.counters()
    lost = sum(
        count
        for name, count in counters.items()
        if "lost" in name or "dropped" in name or "bad" in name
    )
    return Row(
        "telemetry read",
        f"{sent} frames of a PX4's streams",
        f"{sent / took_s:.0f} frames a second of processor",
        lost,
        "no promise: frames are dropped where the link is full",
        "the same",
    )


def _reports(count: int = 20_000) -> Row:
    ours, theirs = MemoryWire.pair(time.perf_counter)
    source = MavlinkEvader(ours, GLOBAL_POSITION, system_id=2)
    beacon = Beacon(0)
    frames = [beacon.frame(0.1 * number) for number in range(count)]
    beacon.socket.close()
    read = 0
    began_s = time.process_time()
    for first in range(0, count, BATCH):
        for frame in frames[first : first + BATCH]:
            theirs.send(frame)
        read += len(source.receive())
    took_s = time.process_time() - began_s
    source.close()
    return Row(
        "reports of the evader",
        f"{count} GLOBAL_POSITION_INT",
        f"{read} read, {count / took_s:.0f} a second of processor",
        count - read,
        "Follow Me: positions fused every 0.5 s at most; silent for 3 s, the target stands still",
        "Follow: silent for 3 s (FOLL_TIMEOUT), it is lost",
    )


def _pages(count: int = 500) -> Row:
    port = free_port(socket.SOCK_STREAM)
    server = MetricsServer(Metrics("bench"), port)
    good = 0
    began_s = time.perf_counter()
    for _ in range(count):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
        connection.request("GET", "/metrics")
        answer = connection.getresponse()
        good += answer.status == http.client.OK and len(answer.read()) > 100
        connection.close()
    took_s = time.perf_counter() - began_s
    server.close()
    return Row(
        "pages of metrics",
        f"{count} asked",
        f"{good} came, {good / took_s:.0f} a second",
        count - good,
        "-",
        "-",
    )


def faults(flights: int, seed: int) -> Iterator[Row]:
    console = Console(stderr=True)
    kinds = Counter[str]()
    broken = []
    for number in range(flights):
        row = fly(draw_case(seed, number))
        kinds.update(row.case.kinds)
        broken += [f"flight {number}: {violation}" for violation in row.violations]
        if number % 10 == 9:
            console.print(
                f"{number + 1} of {flights} flights, {len(broken)} broken", highlight=False
            )
    for finding in broken:
        console.print(finding, highlight=False)
    bad = len({finding.split(":")[0] for finding in broken})
    yield Row(
        "flights with faults",
        f"{flights} flights, {sum(kinds.values())} faults of {len(kinds)} kinds",
        f"{flights - bad} within fence, floor, ceiling, stand-off; silent after yielding",
        bad,
        "at a lost stream its fallback at once; battery, radio, GCS: Hold for 5 s (COM_FAIL_ACT_T), then the action",
        "battery, radio, EKF: Land or RTL by FS_*; GCS: nothing by default (FS_GCS_ENABLE 0)",
    )


def spoiled(data: bytes, draw: random.Random) -> bytes:
    """Return the data with one to four random changes: a byte replaced, or bytes removed, repeated or inserted."""
    changed = bytearray(data)
    for _ in range(draw.randint(1, 4)):
        at = draw.randrange(len(changed) or 1)
        way = draw.randrange(4)
        if way == 0 and changed:
            changed[at] = draw.randrange(256)
        elif way == 1:
            del changed[at : at + draw.randint(1, 8)]
        elif way == 2:
            changed[at:at] = changed[at : at + draw.randint(1, 32)]
        else:
            changed[at:at] = draw.randbytes(draw.randint(1, 8))
    return bytes(changed)


def tried(
    give: Callable[[bytes], object], good: list[bytes], count: int
) -> tuple[int, int, list[str]]:
    """Pass spoiled inputs to a reader; return how many it accepted and refused, and its other exceptions."""
    draw = random.Random(1)
    taken = 0
    refused = 0
    errors = []
    for number in range(count):
        data = spoiled(good[number % len(good)], draw)
        try:
            give(data)
            taken += 1
        except (GuidanceError, RefusedReport):
            refused += 1
        except Exception as error:
            errors.append(f"{data[:40]!r}: {type(error).__name__}: {error}")
    return taken, refused, errors


def inputs(count: int) -> Iterator[Row]:
    vehicle = MockVehicle("px4", ready_after_s=0.5, seed=1)
    frames = [frame for number in range(200) for frame in vehicle.step(0.02 * number)]
    ours, theirs = MemoryWire.pair(time.perf_counter)
    link = PymavlinkLink(ours, time.perf_counter, system_id=1)

    def hear(data: bytes) -> None:
        theirs.send(data)
        if not link.receive():
            raise RefusedReport("dropped")  # the link has counted the reason

    record = (ROOT / "tests" / "data" / "short_chase.mcap").read_bytes()
    shipped = (ROOT / "config" / "vehicles" / "px4.toml").read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spoiled"

        def configure(data: bytes) -> None:
            path.write_bytes(data)
            load_file(Config, path)

        def look(data: bytes) -> None:
            path.write_bytes(data)
            with record_errors(path):
                survey_of(path)

        kinds = {
            "frames": (hear, frames, count, "checksums; NaN leaves an axis out; unknown frames: refused with a text"),
            "reports as JSON": (
                lambda data: report_of_json(data, 0.0, frame=FRAME, source="evader"), [REPORT], count, "-",
            ),
            "vehicle files": (configure, [shipped], count // 20, "-"),
            "records": (look, [record], count // 400, "-"),
        }  # fmt: skip
        for name, (give, good, times, px4) in kinds.items():
            taken, refused, errors = tried(give, good, times)
            for error in errors[:5]:
                print(f"{name}: {error}", file=sys.stderr)
            how = (
                "dropped and counted, or not a message we use"
                if name == "frames"
                else "refused with a message"
            )
            held = f"{taken} read, {refused} {how}"
            yield Row(
                f"bad {name}",
                f"{times} spoiled",
                held,
                len(errors),
                px4,
                "checksums" if name == "frames" else "-",
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of each flood")
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1, help="seed of the flights with faults")
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=("load", "faults", "inputs"),
        default=("load", "faults", "inputs"),
    )
    arguments = parser.parse_args()
    table = Table(show_lines=True)
    for heading in ("trial", "size", "result", "lost", "PX4 promises", "ArduCopter promises"):
        table.add_column(heading, justify="right" if heading == "lost" else "left", overflow="fold")
    lost = 0
    for part, rows in (
        ("load", lambda: load(arguments.seconds)),
        ("faults", lambda: faults(arguments.flights, arguments.seed)),
        ("inputs", lambda: inputs(arguments.inputs)),
    ):
        for row in rows() if part in arguments.only else ():
            lost += row.lost
            table.add_row(*map(str, row))
    Console(width=None if sys.stdout.isatty() else 150).print(table)
    print("nothing was lost" if lost == 0 else f"{lost} LOST")
    sys.exit(0 if lost == 0 else 1)


if __name__ == "__main__":
    main()
