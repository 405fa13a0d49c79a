"""Capture from hover against an evader at full speed: `python tests/bench/bench_capture.py [--seeds 3] [--vary]`.

Flown time (until within 0.5 m of the stand-off disc, horizontally and vertically) over the value of the game, beside
a plain loop (the game's velocity goes out as it is) and pure pursuit, in the same run. Virtual time, calibrated mock,
estimator errors on. Overshoot is true: how far into the stand-off radius, and below the disc's height. With `--vary`
the mock's drag, lag and estimator errors are 30 % more and less, and at last the fed acceleration is kept from it.
"""

import argparse
import statistics
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from chase import Chased, altered, chase, hover_chase
from rich.console import Console
from rich.table import Table

from guidance.flight import FlightSettings
from guidance.strategies import Strategy
from guidance.telemetry import Setpoint

Change = Callable[[FlightSettings], FlightSettings]

WANTED = {"px4": 1.10, "arducopter": 1.13}
COLUMNS = ("seed", "value s", "flown s", "ratio", "inside m", "below m", "fastest m/s", "station m", "slip m/s")

VARIED: Mapping[str, Mapping[str, float]] = {
    "as measured": {},
    "drag +30 %": {"drag": 1.3},
    "drag -30 %": {"drag": 0.7},
    "lag +30 %": {"lag": 1.3},
    "lag -30 %": {"lag": 0.7},
    "errors +30 %": {"noise": 1.3},
    "errors -30 %": {"noise": 0.7},
    "all +30 %": {"drag": 1.3, "lag": 1.3, "noise": 1.3},
    "all -30 %": {"drag": 0.7, "lag": 0.7, "noise": 0.7},
}


def ours(settings: FlightSettings) -> FlightSettings:
    """As it is flown."""
    return settings


def strict(settings: FlightSettings) -> FlightSettings:
    """As it is flown, with limits equal to the game's speeds: nothing is left to catch up with."""
    game = settings.tick.speed_set
    limits = replace(
        settings.tick.envelope, speed_m_s=game.horizontal_m_s, climb_m_s=game.climb_m_s, descent_m_s=game.descent_m_s
    )
    return replace(settings, tick=replace(settings.tick, envelope=limits))


def plain(settings: FlightSettings) -> FlightSettings:
    """The game's velocity goes out as it is; only the limits see it."""
    return replace(settings, tick=replace(settings.tick, following=None))


def pure_pursuit(settings: FlightSettings) -> FlightSettings:
    """The plain loop, pure pursuit for a strategy."""
    settings = plain(settings)
    return replace(settings, tick=replace(settings.tick, strategy=Strategy("pure_pursuit")))


FLOWN: Mapping[str, Change] = {
    "optimal / servo": ours,
    "optimal / servo, no catch-up": strict,
    "optimal / plain": plain,
    "pure pursuit / plain": pure_pursuit,
}


def without_acceleration(setpoint: Setpoint) -> Setpoint:
    """For an autopilot that does not take what is fed forward."""
    return setpoint._replace(acceleration_ned_m_s2=None)


def add(table: Table, name: str, seed: str, rows: list[Chased]) -> None:
    """One row of the table: a chase, or the mean of several and the worst overshoot."""

    def mean(values: list[float]) -> float:
        return statistics.fmean(values)

    table.add_row(
        name,
        seed,
        f"{mean([row.value_s for row in rows]):.2f}",
        f"{mean([row.flown_s for row in rows]):.2f}",
        f"{mean([row.ratio for row in rows]):.3f}",
        f"{max(max(0.0, -row.nearest_m) for row in rows):.2f}",
        f"{max(max(0.0, -row.lowest_m) for row in rows):.2f}",
        f"{max(row.fastest_m_s for row in rows):.2f}",
        f"{max(row.worst_station_m for row in rows):.2f}",
        f"{mean([row.slip_rms_m_s for row in rows]):.2f}",
    )


def compare(console: Console, autopilot: str, seeds: range) -> None:
    """Every policy and servo beside the others."""
    table = Table("policy / servo", *COLUMNS, title=f"{autopilot}: wanted is at most {WANTED[autopilot]:.2f}")
    for name, change in FLOWN.items():
        rows = [chase(hover_chase(autopilot, seed=seed), change=change) for seed in seeds]
        for seed, row in zip(seeds, rows, strict=True):
            add(table, name, str(seed), [row])
        add(table, name, "mean, worst", rows)
        table.add_section()
    console.print(table)


def vary(console: Console, autopilot: str, seeds: range) -> None:
    """The same flown on mocks that are not as measured."""
    table = Table("mock", *COLUMNS, title=f"{autopilot}, optimal / servo: mean and worst of {len(seeds)} seeds")
    for name, factors in VARIED.items():
        rows = [chase(hover_chase(autopilot, seed=seed), alter=altered(**factors)) for seed in seeds]
        add(table, name, "", rows)
    rows = [chase(hover_chase(autopilot, seed=seed), send=without_acceleration) for seed in seeds]
    add(table, "deaf to acceleration", "", rows)
    console.print(table)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--vary", action="store_true")
    arguments = parser.parse_args()
    console = Console(width=130)
    for autopilot in WANTED:
        compare(console, autopilot, range(arguments.seeds))
        if arguments.vary:
            vary(console, autopilot, range(arguments.seeds))


if __name__ == "__main__":
    main()
