"""The cost of a live view for the daemon: `python -m tests.bench.bench_view [--seconds 12]`.

A mock PX4 and a rover run in their own process; `guidance run` over Zenoh is engaged and follows the rover. The same
daemon flies without a view, with `guidance view --live`, with that process stopped (SIGSTOP, so that it no longer
reads), and after it was killed. The lateness and duration of the cycles are taken from the daemon's record.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from statistics import median

import numpy as np

from guidance.errors import GuidanceError
from guidance.log import cycles_of, survey_of
from sitl_mock.child import RunningFleet, running
from tests.harness.bus import ask
from tests.harness.vehicle import mocked, write_file

PROGRAM = [sys.executable, "-c", "from guidance.cli import main; main()"]
VEHICLES = [
    mocked("bench", parameters={"GF_MAX_HOR_DIST": 210.0, "GF_MAX_VER_DIST": 70.0}),
    mocked("evader", "rover", start_ned_m=[30.0, 0.0, 0.0]),
]


@contextlib.contextmanager
def daemon(folder: Path, fleet: RunningFleet) -> Iterator[tuple[int, str]]:
    """Bring `guidance run` up and engage; yield its process id and its control endpoint."""
    path, control = write_file(
        folder,
        fleet,
        "bench",
        vehicle={"link": "pymavlink"},
        flight={"takeoff_height_m": 15.0, "after_capture": "shadow"},
        log={"level": "error"},
    )
    with subprocess.Popen([*PROGRAM, "run", str(path)]) as flying:
        try:
            for order, state in (("start", "standing by"), ("engage", "on station")):
                insist(order, "accepted", True, control)
                insist("status", "state", state, control)
            yield flying.pid, control
        finally:
            flying.send_signal(signal.SIGTERM)
            flying.wait(30.0)


def insist(order: str, key: str, value: object, control: str) -> None:
    """Ask until the answer is the one that is wanted."""
    for _ in range(120):
        with contextlib.suppress(GuidanceError):
            if ask(order, endpoint=control, name="bench")[key] == value:
                return
        time.sleep(0.5)
    raise SystemExit(f"{order}: {key} was not {value} within a minute")


def memory_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def phases(seconds: float, pid: int, control: str) -> Iterator[tuple[str, float, float, float]]:
    """Yield each phase's name, its begin and end (Unix seconds), and the daemon's memory at its end."""

    def phase(name: str) -> tuple[str, float, float, float]:
        begun_s = time.time()
        time.sleep(seconds)
        return name, begun_s, time.time(), memory_mb(pid)

    yield phase("nobody looks on")
    look = [*PROGRAM, "view", "--live", "--endpoint", control, "--port", "0", "--web-port", "0"]
    with subprocess.Popen(look, stdout=subprocess.PIPE, text=True) as viewer:
        assert viewer.stdout is not None
        viewer.stdout.readline()
        time.sleep(1.0)
        yield phase("a live view")
        viewer.send_signal(signal.SIGSTOP)
        yield phase("the view hangs")
        viewer.kill()
    yield phase("the view was killed")


def show(record: Path, taken: list[tuple[str, float, float, float]]) -> None:
    """Print the cycle times of each phase from the record, and their ratio to the first."""
    began_s = datetime.fromisoformat(survey_of(record).metadata["started_utc"]).timestamp()
    timings = [
        (began_s + row.now_s, row.json["timing"])
        for row in cycles_of(record)
        if "timing" in row.json
    ]
    print("                        cycle began late, ms      worked, ms")
    print(
        "                         p50    p99   most      p50    p99   (× first)   cycles   memory MB"
    )
    first: dict[str, float] = {}
    for name, begun_s, ended_s, resident_mb in taken:
        within = [timing for now_s, timing in timings if begun_s < now_s < ended_s]
        late, worked = (
            1e3 * np.array([timing[key] for timing in within]) for key in ("late_s", "worked_s")
        )
        first.setdefault("worked", median(worked))
        lates = " ".join(f"{value:6.2f}" for value in np.percentile(late, [50, 99, 100]))
        works = " ".join(f"{value:6.2f}" for value in np.percentile(worked, [50, 99]))
        ratio = median(worked) / first["worked"]
        print(
            f"{name:20} {lates}   {works}   ({ratio:4.2f})   {len(within):8d}   {resident_mb:9.1f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=12.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with running(VEHICLES, over=["zenoh"]) as fleet, daemon(folder, fleet) as (pid, control):
            taken = list(phases(arguments.seconds, pid, control))
        (record,) = folder.glob("*.mcap")
        show(record, taken)


if __name__ == "__main__":
    main()
