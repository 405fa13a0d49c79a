"""Age of a setpoint when PX4 gets it, by wire: `python -m tests.bench.bench_px4_latency NAME=RECORD,ULOG ...`.

The record of a flight says on which position each setpoint was computed, with PX4's stamp of it. The ulog of the same
flight says when each setpoint arrived, on the same clock. The two are matched by the velocity, bit for bit in single
precision. The difference is the whole way: telemetry to guidance, waiting for the cycle, computing, and back to PX4.
PX4 logs a setpoint about every 0.1 s.
"""

import argparse
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pyulog import ULog
from rich.console import Console
from rich.table import Table

from guidance.log import cycles_of
from guidance.messages import LocalPosition

MOST_MS = 500.0


def computed_on(record: Path) -> dict[tuple[float, ...], list[float]]:
    """Return by velocity the stamps, s, of the positions on which setpoints with it were computed."""
    stamps: dict[tuple[float, ...], list[float]] = {}
    boot_s = float("nan")
    for cycle in cycles_of(record):
        for message in cycle.inputs.messages:
            if isinstance(message, LocalPosition):
                boot_s = message.time_boot_s
        if cycle.setpoint is not None:
            velocity = tuple(np.float32(part).item() for part in cycle.setpoint.velocity_ned_m_s)
            stamps.setdefault(velocity, []).append(boot_s)
    return stamps


def ages_ms(record: Path, ulog: Path) -> Iterator[float]:
    """Yield for each logged setpoint of the flight the age of its position on arrival, ms."""
    stamps = computed_on(record)
    (arrived,) = [
        one.data for one in ULog(str(ulog)).data_list if one.name == "trajectory_setpoint"
    ]
    for index, at_us in enumerate(arrived["timestamp"]):
        velocity = tuple(float(arrived[f"velocity[{axis}]"][index]) for axis in range(3))
        ages = [1e-3 * at_us - 1e3 * boot_s for boot_s in stamps.get(velocity, ())]
        plausible = [age for age in ages if 0.0 <= age <= MOST_MS]
        if plausible:
            yield min(plausible)


def main(arguments: list[str]) -> int:
    """Print a row for each flight; the exit code is 1 if one has no setpoint in both files."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.bench_px4_latency")
    parser.add_argument("flights", nargs="+", metavar="NAME=RECORD,ULOG")
    table = Table("flight", "setpoints", "median ms", "p90 ms", "largest ms", box=None)
    missing = False
    for flight in parser.parse_args(arguments).flights:
        name, _, files = flight.partition("=")
        record, _, ulog = files.partition(",")
        ages = sorted(ages_ms(Path(record), Path(ulog)))
        missing |= not ages
        if ages:
            numbers = (statistics.median(ages), ages[int(0.9 * len(ages))], ages[-1])
            table.add_row(name, str(len(ages)), *(f"{number:.1f}" for number in numbers))
        else:
            table.add_row(name, "0")
    Console().print(table)
    return int(missing)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
