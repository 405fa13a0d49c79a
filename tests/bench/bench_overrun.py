"""An evader that stops dead, or turns on its pursuer, just before the disc: `python -m tests.bench.bench_overrun`.

To be captured, an evader that flees is followed at its own speed to the very rim of the disc; when it stops dead there,
no braking keeps the vehicle outside. So the height has to: the vehicle flies past over the evader, at the height of the
disc, and the table shows how low it came. Below that height nothing is over the evader, and the limits keep the
distance that the vehicle needs to stop in; the second table begins a chase from there. Distances are of the true
motion on the calibrated mocks, in metres; `over` is how far within the rim it flew past at height, and `below` the
least distance to the rim while more than half a metre below the disc: negative must not be, unless the evader came.
"""

import argparse
import math
from collections.abc import Callable

from rich.console import Console
from rich.table import Table

from guidance.sim.scenario import Scenario
from tests.harness.chase import chase, hover_chase

TURNS = {"stops dead": 0.0, "turns on the pursuer": -1.0}
GAPS_M = (12.0, 8.0, 5.0, 3.0, 1.5, 0.7)
AUTOPILOTS = ("px4", "arducopter")


def from_above(scenario: Scenario) -> Scenario:
    """As it is measured for the time of capture."""
    return scenario


def from_below(scenario: Scenario) -> Scenario:
    """The vehicle 6 m up and the disc 15 m above an evader near by: the rim is reached long before the height."""
    pursuer = scenario.pursuer.model_copy(update={"position_m": (0.0, 0.0, 6.0), "takeoff_height_m": 6.0})
    return scenario.model_copy(
        update={
            "pursuer": pursuer,
            "evader": scenario.evader.model_copy(update={"position_m": (0.0, 14.0)}),
            "standoff": scenario.standoff.model_copy(update={"height_m": 15.0}),
        }
    )


def overrun(console: Console, title: str, change: Callable[[Scenario], Scenario], seeds: range) -> None:
    """One table: every autopilot, every turn, every gap at which it turns; the worst of the seeds."""
    table = Table("autopilot", "evader", "at a gap of", "over", "lowest", "below", title=title)
    for autopilot in AUTOPILOTS:
        for turn, turned in TURNS.items():
            for gap_m in GAPS_M:
                rows = [
                    chase(change(hover_chase(autopilot, seed=seed)), turn_at_m=gap_m, turned=turned, station_s=5.0)
                    for seed in seeds
                ]
                over_m = max(max(0.0, -row.nearest_m) for row in rows)
                below_m = min(row.nearest_below_m for row in rows)
                lowest_m = min(row.lowest_m for row in rows)
                below = "never" if math.isinf(below_m) else f"{below_m:.2f}"
                table.add_row(autopilot, turn, f"{gap_m:g}", f"{over_m:.2f}", f"{lowest_m:.2f}", below)
        table.add_section()
    console.print(table)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=2)
    seeds = range(parser.parse_args().seeds)
    console = Console(width=110)
    overrun(console, "from above: hover at 20 m, disc of 3 m at 5 m", from_above, seeds)
    overrun(console, "from below: hover at 6 m, disc of 3 m at 15 m", from_below, seeds)


if __name__ == "__main__":
    main()
