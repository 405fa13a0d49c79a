"""Time the record and the replay: `python tests/bench/bench_record.py [SCENARIO]`.

A mocked flight is flown once in virtual time. Its rows and frames are kept and written again with a clock around every
call. Printed are the cost per cycle (row and frames), next to `json.dumps` of the same row; the size of one flight
minute, raw and written; and the speed of the replay next to the flight core alone on the same inputs.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from guidance.clock import VirtualClock
from guidance.flight import Flight
from guidance.log import compare, cycles_of, metadata_of, scan
from guidance.log.entries import CYCLE
from guidance.log.writer import Record, Recorder
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission
from guidance.sim.scenario_file import load_scenario
from guidance.sim.stepped import SteppedWorld

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from guidance.sim.scenario import Scenario


class Kept(Record):
    """A record in memory: every call, in order."""

    def __init__(self) -> None:
        super().__init__()
        self.cycles: list[list[tuple[str, tuple[Any, ...]]]] = [[]]

    def frames(self, *call: Any) -> None:
        self.cycles[-1].append(("frames", call))

    def event(self, *call: Any) -> None:
        self.cycles[-1].append(("event", call))

    def cycle(self, *call: Any) -> None:
        self.cycles.append([("cycle", call)])


def flown(scenario: Scenario) -> Kept:
    """Fly once and keep all calls to the record."""
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    kept = Kept()
    try:
        Mission(scenario, world, clock, equipment={"pursuer": Equipment(record=kept)}).fly()
    finally:
        world.close()
    return kept


def written(kept: Kept, path: Path, metadata: Mapping[str, str]) -> list[float]:
    """Write everything; return the time of each cycle, s."""
    recorder = Recorder(path, metadata)
    costs = []
    for cycle in kept.cycles:
        begin = time.thread_time()
        for name, call in cycle:
            getattr(recorder, name)(*call)
        costs.append(time.thread_time() - begin)
    recorder.close()
    return costs


def dumped(rows: list[dict[str, Any]]) -> list[float]:
    """Return the time of `json.dumps` for each row, s."""
    costs = []
    for row in rows:
        begin = time.thread_time()
        json.dumps(row, separators=(",", ":")).encode()
        costs.append(time.thread_time() - begin)
    return costs


def percentiles(costs: list[float]) -> str:
    half, most, worst = np.percentile(np.array(costs) * 1e6, [50, 99, 100])
    return f"mean {np.mean(costs) * 1e6:5.0f} µs   p50 {half:5.0f} µs   p99 {most:5.0f} µs   worst {worst:6.0f} µs"


def main() -> None:
    scenario = load_scenario(sys.argv[1] if len(sys.argv) > 1 else "pe")[1]
    metadata = {"scenario": json.dumps(scenario.model_dump(mode="json"))}
    kept = flown(scenario)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.mcap"
        best = min(
            (written(kept, path, metadata) for _ in range(3)),
            key=lambda costs: float(np.median(costs)),
        )
        items = list(scan(path))
        rows = [json.loads(item.data) for item in items if item.topic == CYCLE.topic]
        minutes = (rows[-1]["now_s"] - rows[0]["now_s"]) / 60.0
        print(
            f"{scenario.title}: {len(rows)} cycles, {minutes * 60:.1f} s, {len(items) / len(rows):.1f} messages a cycle"
        )
        print(f"recording a cycle        {percentiles(best)}")
        print(f"json.dumps of its row    {percentiles(dumped(rows))}")
        raw = sum(len(item.data) for item in items)
        size = path.stat().st_size
        print(
            f"bytes a flight minute    {size / minutes / 1e6:.2f} MB written, {raw / minutes / 1e6:.2f} MB of messages"
        )

        settings = recorded_settings(metadata_of(path))
        begin = time.process_time()
        comparison, _ = compare(path, recorded_settings)
        replayed_s = time.process_time() - begin
        inputs = [(row.now_s, row.inputs) for row in cycles_of(path)]
        flight = Flight(settings)
        begin = time.process_time()
        for entry in inputs:
            flight.step(*entry)
        core_s = time.process_time() - begin
        count = len(inputs)
        per_s = count / replayed_s
        print(f"replay                   {per_s:7.0f} cycles/s, {per_s / 50.0:.0f} × real time")
        print(
            f"flight core alone        {count / core_s:7.0f} cycles/s, replay takes {replayed_s / core_s:.2f} × as long"
        )
        print(f"differing                {comparison.differing}")


if __name__ == "__main__":
    main()
