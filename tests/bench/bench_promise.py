"""Error of the promised time over random flown chases: `python -m tests.bench.bench_promise [--chases 200] [--seed 1]`.

The evader first runs on a random course for up to four seconds, and then away from the pursuer. The promise is made at
that moment, when the pursuer flies with a velocity that the game would not choose. Compared with the time flown are the
game's value and the promise of the certificate (`guidance.cycle.players.late_start`). Positive errors are captures
that came later than predicted.
"""

import argparse
import math
from random import Random
from typing import NamedTuple

import numpy as np

from guidance.flight import Event, Outputs, State
from tests.harness.chase import Chase, hover_chase
from tests.harness.copies import Flown

HOVERING_S = 6.0
HEARD_S = 2.0
LONGEST_S = 60.0
SPEEDS_M_S = ((6.0, 3.0), (8.0, 4.0), (5.0, 3.0), (6.0, 1.5))
HOVERING = Flown()


class Promise(NamedTuple):
    """Predicted times of one chase, and the time that it took, s."""

    value: float
    certificate: float
    flown: float


class _Chase(Chase):
    """A chase that is engaged on demand."""

    engaging = False

    def act(self, _orders: list[Event]) -> Outputs:
        orders = {
            State.READY: (Event.START,),
            State.STANDING_BY: (Event.ENGAGE,) if self.engaging else (),
        }
        outputs: Outputs = self.pilot.run(self.now_s, orders.get(self.state, ()))
        if outputs.certificate is not None and math.isnan(self._engaged_s):
            self._engaged_s = self.now_s
        return outputs


def begun(autopilot: str, speeds_m_s: tuple[float, float]) -> _Chase:
    """Fly to the start."""
    chase = _Chase(hover_chase(autopilot, seed=1, speeds_m_s=speeds_m_s))
    chase.runner.silent = True
    chase.run(120.0, lambda: chase.state is State.STANDING_BY)
    return chase.run(HOVERING_S)


def flown(seed: int, number: int) -> Promise | None:
    """Draw and fly one chase; None if it was not captured."""
    draw = Random(f"{seed}/{number}")
    autopilot = ("px4", "arducopter")[number % 2]
    speeds = SPEEDS_M_S[number // 2 % len(SPEEDS_M_S)]
    chase = HOVERING((autopilot, speeds), lambda: begun(autopilot, speeds), Chase.history)
    bearing = draw.uniform(-math.pi, math.pi)
    away_m = draw.uniform(20.0, 80.0)
    chase.runner.begin((away_m * math.sin(bearing), away_m * math.cos(bearing)), seed=number)
    course = draw.uniform(-math.pi, math.pi)
    dodges_s = draw.choice((0.0, draw.uniform(0.5, 4.0)))
    chase.runner.goal_m = (
        (1e4 * math.cos(course), 1e4 * math.sin(course)) if dodges_s > 0.0 else None
    )
    chase.run(HEARD_S)
    chase.engaging = True
    promise = None
    since_s = math.nan
    while not chase.since_s > LONGEST_S and chase.state in {
        State.STANDING_BY,
        State.ENTERING,
        State.ENGAGED,
    }:
        chase.cycle()
        certificate = chase.outputs.pop().certificate
        if certificate is None or certificate.no_game:
            continue
        if promise is None and chase.since_s >= dodges_s:
            chase.runner.goal_m = None
            since_s = chase.now_s
            promise = (certificate.value, certificate.time_needed_s)
        if promise is not None and certificate.captured:
            return Promise(*promise, chase.now_s - since_s)
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--chases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rows = [
        one
        for number in range(arguments.chases)
        if (one := flown(arguments.seed, number)) is not None
    ]
    table = np.array(rows)
    print(f"{len(rows)} of {arguments.chases} chases captured")
    for name, predicted in zip(Promise._fields[:2], table.T, strict=False):
        error = table[:, 2] - predicted
        size = np.percentile(np.abs(error), (50, 95))
        later = np.percentile(error, (50, 95))
        print(
            f"{name:<11} |error| median {size[0]:5.2f} s, p95 {size[1]:5.2f} s; error median {later[0]:+5.2f} s, "
            f"p95 {later[1]:+5.2f} s; later than predicted {np.mean(error > 0.0):6.1%}"
        )


if __name__ == "__main__":
    main()
