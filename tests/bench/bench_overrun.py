"""An evader that stops or turns on its pursuer just before the disc: `python -m tests.bench.bench_overrun`.

The vehicle follows a fleeing evader to the rim of the disc at the evader's speed. If the evader then stops, braking
cannot keep the vehicle outside the rim, so only the height separates the two: the vehicle passes over the evader at the
disc's height. The first table shows the lowest height. Below the disc's height the limits keep the stopping distance to
the rim; the second table starts chases from there. Distances are in metres, of the true motion on calibrated mocks.
`over` is the depth inside the rim when passing over the evader. `below` is the least distance to the rim while more
than half a metre below the disc; it must not be negative, except if the evader approached.
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
    """Return the scenario unchanged, as in `bench_capture`."""
    return scenario


def from_below(scenario: Scenario) -> Scenario:
    """Start at 6 m with the disc at 15 m and the evader near, so that the vehicle reaches the rim before the height."""
    pursuer = scenario.pursuer.model_copy(
        update={"position_m": (0.0, 0.0, 6.0), "takeoff_height_m": 6.0}
    )
    return scenario.model_copy(
        update={
            "pursuer": pursuer,
            "evader": scenario.evader.model_copy(update={"position_m": (0.0, 14.0)}),
            "standoff": scenario.standoff.model_copy(update={"height_m": 15.0}),
        }
    )


def overrun(
    console: Console, title: str, change: Callable[[Scenario], Scenario], seeds: range
) -> None:
    """Print one table: the worst of all seeds for each autopilot, turn and gap."""
    table = Table("autopilot", "evader", "at a gap of", "over", "lowest", "below", title=title)
    for autopilot in AUTOPILOTS:
        for turn, turned in TURNS.items():
            for gap_m in GAPS_M:
                rows = [
                    chase(
                        change(hover_chase(autopilot, seed=seed)),
                        turn_at_m=gap_m,
                        turned=turned,
                        station_s=5.0,
                    )
                    for seed in seeds
                ]
                over_m = max(max(0.0, -row.nearest_m) for row in rows)
                below_m = min(row.nearest_below_m for row in rows)
                lowest_m = min(row.lowest_m for row in rows)
                below = "never" if math.isinf(below_m) else f"{below_m:.2f}"
                table.add_row(
                    autopilot, turn, f"{gap_m:g}", f"{over_m:.2f}", f"{lowest_m:.2f}", below
                )
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
