"""Cost and latency of the operator's page: `python -m tests.bench.bench_panel [--seconds 12] [--minutes 0]`.

A mock PX4 and a rover run in their own process; `guidance run` over Zenoh is engaged and follows the rover. The same
daemon flies without a panel, with a panel but no page, with one page in Chromium, with nineteen more sockets, with the
panel stopped (SIGSTOP), and after the panel was killed. For each phase the script prints the lateness and duration of
the cycles, taken from the daemon's record; the processor time of the daemon and the panel; and the latency from the
start of a cycle to the display frame after its drawing. At the end the whole record is replayed, and every setpoint is
compared bit for bit.

`--minutes 10` keeps the page open for ten minutes and prints the memory of the page and the panel every minute.
"""

import argparse
import asyncio
import contextlib
import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import aiohttp
import numpy as np
import yarl
from playwright.sync_api import Page, sync_playwright

from guidance.log import cycles_of
from guidance.log.broadcast import broadcast_key
from guidance.log.replay import compare
from guidance.session.flight_files import recorded_settings
from guidance.session.orders.control_client import join_session
from sitl_mock.child import running
from tests.bench.bench_view import PROGRAM, VEHICLES, daemon, memory_mb

QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
]
SOCKETS = 19


class Phase(NamedTuple):
    """Measurements of one phase: time span, processor shares (1 is one processor), and latencies, s."""

    name: str
    first_s: float
    last_s: float
    daemon_share: float
    panel_share: float
    latencies_s: list[float]


def used_s(pid: int) -> float:
    """Return the processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Bench:
    """One daemon and its measurements."""

    def __init__(self, seconds: float, pid: int, control: str) -> None:
        self.seconds = seconds
        self.pid = pid
        self.zero_s = zero_s(control)
        self.phases: list[Phase] = []

    def phase(self, name: str, panel: int | None = None, page: Page | None = None) -> None:
        """Measure one phase of `seconds`."""
        pids = [self.pid] if panel is None else [self.pid, panel]
        begun_s = time.time()
        before = [used_s(pid) for pid in pids]
        if page is not None:
            page.evaluate("() => { panel.timed.length = 0; }")
            page.wait_for_timeout(1e3 * self.seconds)  # its callbacks run meanwhile
        else:
            time.sleep(self.seconds)
        ended_s = time.time()
        shares = [
            (used_s(pid) - was) / (ended_s - begun_s) for pid, was in zip(pids, before, strict=True)
        ]
        timed = [] if page is None else page.evaluate("() => panel.timed")
        late = [1e-3 * seen_ms - (self.zero_s + cycle_s) for cycle_s, seen_ms in timed]
        bounds = begun_s - self.zero_s, ended_s - self.zero_s
        self.phases.append(
            Phase(name, *bounds, shares[0], shares[1] if len(shares) > 1 else 0.0, late)
        )


def zero_s(control: str) -> float:
    """Return the Unix time of the daemon clock's zero, s: the smallest difference of arrival time and cycle time."""
    seen: list[float] = []

    def hear(sample: Any) -> None:
        seen.append(time.time() - json.loads(sample.payload.to_bytes())["now_s"])

    session = join_session(control)
    session.declare_subscriber(broadcast_key("bench", "cycle"), hear)
    time.sleep(6.0)
    session.close()
    return min(seen)


@contextlib.contextmanager
def panel_of(control: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start `guidance panel`; yield its process and its address."""
    command = [*PROGRAM, "panel", "--endpoint", control, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        try:
            yield child, child.stdout.readline().split()[1]
        finally:
            child.kill()


@contextlib.contextmanager
def sockets(url: str) -> Iterator[None]:
    """Keep nineteen more sockets open that receive everything and draw nothing."""
    ended = threading.Event()

    async def one(session: aiohttp.ClientSession, page: yarl.URL) -> None:
        headers = {"Origin": str(page.origin())}
        async with session.ws_connect(page / "live", headers=headers, max_msg_size=0) as socket:
            while not ended.is_set():
                await socket.receive()

    async def all_of_them() -> None:
        async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
            answer = await session.get(url)
            await asyncio.gather(*(one(session, answer.url) for _ in range(SOCKETS)))

    thread = threading.Thread(target=lambda: asyncio.run(all_of_them()))
    thread.start()
    yield
    ended.set()
    thread.join()


def measure(bench: Bench, control: str, minutes: float) -> None:
    """Fly with and without pages."""
    bench.phase("no panel")
    with panel_of(control) as (panel, url), sync_playwright() as playwright:
        time.sleep(2.0)
        bench.phase("a panel, no page", panel.pid)
        chromium = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=QUIET)
        page = chromium.new_page(viewport={"width": 1024, "height": 768})
        page.goto(url)
        page.wait_for_timeout(2000)
        bench.phase("one page", panel.pid, page)
        assert panel.stdout is not None
        with sockets(panel.stdout.readline().split()[1]):  # each address works once
            page.wait_for_timeout(1000)
            bench.phase("twenty pages", panel.pid, page)
        if minutes:
            stay(page, panel.pid, minutes)
        chromium.close()
        panel.send_signal(signal.SIGSTOP)
        bench.phase("the panel hangs", panel.pid)
    bench.phase("it was killed")


def stay(page: Page, pid: int, minutes: float) -> None:
    """Keep the page open; print the memory of the page and the panel every minute."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    print("minute   page's heap MB   its elements   panel's memory MB", flush=True)
    for minute in range(round(minutes) + 1):
        session.send("HeapProfiler.collectGarbage")
        metrics = {
            metric["name"]: metric["value"]
            for metric in session.send("Performance.getMetrics")["metrics"]
        }
        heap_mb = metrics["JSHeapUsedSize"] / 1e6
        print(
            f"{minute:6d} {heap_mb:16.2f} {metrics['Nodes']:14.0f} {memory_mb(pid):19.1f}",
            flush=True,
        )
        page.wait_for_timeout(60_000 if minute < round(minutes) else 0)


def show(record: Path, phases: list[Phase]) -> None:
    """Print the measurements of each phase, and its ratio to the first."""
    timings = [(row.now_s, row.timing) for row in cycles_of(record) if row.timing is not None]
    print(
        "                     cycle began late, ms    worked, ms            processor, %     cycle to pixel, ms"
    )
    print(
        "                      p50    p99    most     p50   p99  (× first)  daemon  panel    p50    p95    most"
    )
    first = None
    for phase in phases:
        within = [timing for now_s, timing in timings if phase.first_s < now_s < phase.last_s]
        late, worked = (
            1e3 * np.array([getattr(one, key) for one in within]) for key in ("late_s", "worked_s")
        )
        first = first or median(worked)
        lates = " ".join(f"{value:6.2f}" for value in np.percentile(late, [50, 99, 100]))
        works = " ".join(f"{value:5.2f}" for value in np.percentile(worked, [50, 99]))
        seen = "     -      -       -"
        if phase.latencies_s:
            seen = " ".join(
                f"{1e3 * value:6.0f}" for value in np.percentile(phase.latencies_s, [50, 95, 100])
            )
        print(
            f"{phase.name:18} {lates}   {works}  ({median(worked) / first:4.2f})  "
            f"{100 * phase.daemon_share:6.1f} {100 * phase.panel_share:6.1f}  {seen}"
        )
    comparison, _ = compare(record, recorded_settings)
    print(
        f"replayed: {comparison.setpoints} setpoints in {comparison.cycles} cycles, {comparison.differing} differ"
    )


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--minutes", type=float, default=0.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with running(VEHICLES, over=["zenoh"]) as fleet, daemon(folder, fleet) as (pid, control):
            bench = Bench(arguments.seconds, pid, control)
            measure(bench, control, arguments.minutes)
        (record,) = folder.glob("*.mcap")
        show(record, bench.phases)


if __name__ == "__main__":
    main()
