"""Time a flight in virtual time, with its record: `python tests/bench/bench_fast_flight.py [SCENARIO]`.

Printed are the processor time of the whole flight, its multiple of real time, and the shares: mock (both simulated
vehicles and the evader's pilot), links (decoding, encoding and the taps of the raw frames), flight (`Flight.step`),
record, and loop (daemon, mission and everything else). The total comes from flights that are not instrumented, the
shares from one that is.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

from guidance.clock import VirtualClock
from guidance.flight import Flight
from guidance.log.writer import Recorder
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import Mission
from guidance.sim.scenario_file import load_scenario
from guidance.sim.stepped import SteppedWorld

if TYPE_CHECKING:
    from collections.abc import Callable

    from guidance.sim.scenario import Scenario

FLIGHTS = 3
PARTS = ("mock", "links", "flight", "record", "loop")


class Stopwatch:
    """Counts time for the innermost part that is running."""

    def __init__(self) -> None:
        self.spent_s = dict.fromkeys(PARTS, 0.0)
        self._part = "loop"
        self._since_s = time.perf_counter()

    def switch(self, part: str) -> str:
        """Begin to count for `part`; return the previous part."""
        now_s = time.perf_counter()
        self.spent_s[self._part] += now_s - self._since_s
        before = self._part
        self._part = part
        self._since_s = now_s
        return before

    def timed(self, part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return `call`, counted for a part."""

        def counted(*args: Any, **kwargs: Any) -> Any:
            before = self.switch(part)
            try:
                return call(*args, **kwargs)
            finally:
                self.switch(before)

        return counted

    def time(self, part: str, thing: object, *methods: str) -> None:
        """Count methods of an object for a part."""
        for name in methods:
            setattr(thing, name, self.timed(part, getattr(thing, name)))


def flown_s(scenario: Scenario, path: Path, watch: Stopwatch | None = None) -> tuple[float, float]:
    """Fly once; return processor time and flight time, s."""
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    recorder = Recorder(path, {"scenario": json.dumps(scenario.model_dump(mode="json"))})
    step = Flight.step
    if watch is not None:
        watch.time("mock", world, "advance")
        watch.time("mock", world.players["evader"], "step")
        for link in (world.links["pursuer"], world.players["evader"].link):
            watch.time("links", link, "receive", "send_heartbeat", "send_setpoint", "request")
        watch.time("links", world.evaders["pursuer"]["evader"], "receive")
        watch.time("links", world, "drain")
        watch.time("record", recorder, "frames", "cycle", "event", "close")
        step = watch.timed("flight", Flight.step)
    begin_s = time.process_time()
    try:
        with mock.patch.object(Flight, "step", step):
            if watch is not None:
                watch.switch("loop")
            Mission(scenario, world, clock, equipment={"pursuer": Equipment(record=recorder)}).fly()
    finally:
        recorder.close()
        if watch is not None:
            watch.switch("loop")
        world.close()
    return time.process_time() - begin_s, clock.now_s()


def main() -> None:
    scenario = load_scenario(sys.argv[1] if len(sys.argv) > 1 else "pe")[1]
    with tempfile.TemporaryDirectory() as folder:
        spent_s, flight_s = min(
            flown_s(scenario, Path(folder) / f"{number}.mcap") for number in range(FLIGHTS)
        )
        watch = Stopwatch()
        flown_s(scenario, Path(folder) / "timed.mcap", watch)
    cycles = flight_s * 50.0
    timed_s = sum(watch.spent_s.values())
    print(
        f"{scenario.title}: {flight_s:.1f} s flown in {spent_s:.2f} s, {flight_s / spent_s:.0f} × real time"
    )
    for part in PARTS:
        share = watch.spent_s[part] / timed_s
        print(
            f"{part:<8} {100.0 * share:5.1f} %   {1e6 * share * spent_s / cycles:6.0f} µs a cycle"
        )


if __name__ == "__main__":
    main()
