"""Fly random TAD games and compare what was claimed with how they ended: `python -m tests.bench.bench_verdict`.

The vehicle's verdict and the barrier event must never be followed by an arrival of the evader. A captured game in which
the verdict was not "pursuer" before the capture is a missed win; fewer than 10 % may be. Ends with 1 otherwise.
"""

import argparse
import math
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Final

from tests.harness.guarded import Drawn, Guarded, draw_game, fly

MISSED: Final = 0.1
CLOSE_S: Final = 2.0


def flown(seed: int, number: int) -> tuple[Drawn, Guarded]:
    """Draw and fly one game."""
    drawn = draw_game(seed, number)
    return drawn, fly(drawn)


def main() -> None:
    """Fly, and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--games", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    ends = Counter[str]()
    wrong = 0
    events = 0
    wins = Counter[bool]()
    missed = Counter[bool]()
    with ProcessPoolExecutor(given.jobs) as pool:
        for drawn, game in pool.map(partial(flown, given.seed), range(given.games)):
            ends[game.end] += 1
            events += not math.isnan(game.reported_s)
            claimed = not (math.isnan(game.claimed_s) and math.isnan(game.reported_s))
            if game.end == "captured":
                wins[game.margin_s > CLOSE_S] += 1
                missed[game.margin_s > CLOSE_S] += not game.claimed_s < game.end_s
            elif claimed:
                wrong += game.end == "arrived"
                print(f"claimed, then {game.end}: {drawn}: {game}", flush=True)
            if drawn.number % 50 == 49:
                so_far = f"claimed wrongly {wrong}, missed {missed.total()} of {wins.total()}"
                print(f"{drawn.number + 1} games: {dict(ends)}, {so_far}", flush=True)
    print(f"{given.games} games: {dict(ends)}; barrier events: {events}")
    clear = f"with an ideal margin above {CLOSE_S:g} s at engagement {missed[True]} of {wins[True]}"
    share = missed.total() / max(wins.total(), 1)
    print(f"claims followed by an arrival: {wrong}")
    print(f"wins missed: {missed.total()} of {wins.total()} ({share:.1%}); {clear}")
    sys.exit(int(wrong > 0 or share >= MISSED))


if __name__ == "__main__":
    main()
