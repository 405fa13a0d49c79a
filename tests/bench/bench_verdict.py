"""Fly random TAD games and compare what was claimed with how they ended: `python -m tests.bench.bench_verdict`.

A verdict that has lasted for 1.5 s and the barrier event must never be followed by an arrival of the evader. A captured
game in which the verdict was not "pursuer" for 0.4 s before the capture is a missed win; fewer than 10 % may be. Ends
with 1 otherwise. `--shape` chooses the target: a point, a disc, a segment, a polygon, or a point that moves.
`--referee` plays without the mock: a vehicle with just the guaranteed acceleration, a delay and a lag. There, a capture
without a verdict is a win only if the vehicle could have been certain of it (`tests.harness.trials`). The others, in
which the evader ran into its capture, are printed as lucky. With `--others`, the referee also tries
other evaders from each lasting claim and counts the claims that they break; these do not end it with 1.
"""

import argparse
import math
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Final

from guidance.cycle.monitor import GUARDED_S, LASTING_S
from tests.harness.guarded import SHAPES, Drawn, Guarded, draw_game, fly
from tests.harness.referee import referee
from tests.harness.trials import is_broken, was_certain

MISSED: Final = 0.1
CLOSE_S: Final = 2.0


def flown(
    seed: int, shape: str, by_referee: bool, by_others: bool, number: int
) -> tuple[Drawn, Guarded]:
    """Draw and fly one game."""
    drawn = draw_game(seed, number, shape)
    if not by_referee:
        return drawn, fly(drawn)
    endings = referee(drawn)
    result = endings.result
    if result.end == "captured" and not result.claimed_s < result.end_s:
        result = result._replace(was_certain=was_certain(drawn, endings))
    if by_others and not math.isnan(result.sustained_s):
        result = result._replace(is_broken=is_broken(drawn, endings))
    return drawn, result


def main() -> None:
    """Fly, and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--games", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--referee",
        action="store_true",
        help="without autopilot, links and noise; fifty times faster",
    )
    parser.add_argument(
        "--others",
        action="store_true",
        help="by the referee; other evaders are also tried against each lasting claim",
    )
    parser.add_argument("--shape", choices=tuple(SHAPES), default="point")
    arguments = parser.parse_args()
    by_referee = arguments.referee or arguments.others
    ends = Counter[str]()
    wrong = Counter[str]()
    events = 0
    claims = 0
    lucky = 0
    broken = 0
    wins = Counter[bool]()
    missed = Counter[bool]()
    with ProcessPoolExecutor(arguments.jobs) as pool:
        play = partial(flown, arguments.seed, arguments.shape, by_referee, arguments.others)
        for drawn, game in pool.map(play, range(arguments.games), chunksize=10):
            ends[game.end] += 1
            events += not math.isnan(game.reported_s)
            sustained = not (math.isnan(game.sustained_s) and math.isnan(game.reported_s))
            claims += sustained
            broken += game.is_broken
            if game.is_broken:
                print(f"claim broken by another evader: {drawn}: {game}", flush=True)
            if game.end == "captured" and not game.was_certain:
                lucky += 1
            elif game.end == "captured":
                wins[game.margin_s > CLOSE_S] += 1
                missed[game.margin_s > CLOSE_S] += not game.claimed_s < game.end_s
            elif sustained or not math.isnan(game.claimed_s):
                wrong["sustained" if sustained else "brief"] += game.end == "arrived"
                print(f"claimed, then {game.end}: {drawn}: {game}", flush=True)
            if drawn.number % 50 == 49:
                so_far = f"claimed wrongly {dict(wrong)}, missed {missed.total()} of {wins.total()}"
                print(f"{drawn.number + 1} games: {dict(ends)}, {so_far}", flush=True)
    print(f"{arguments.games} games, {arguments.shape}: {dict(ends)}; barrier events: {events}")
    clear = f"with an ideal margin above {CLOSE_S:g} s at engagement {missed[True]} of {wins[True]}"
    share = missed.total() / max(wins.total(), 1)
    print(
        f"claims of {GUARDED_S:g} s or more, or events: {claims}, followed by an arrival: {wrong['sustained']}; "
        f"of {LASTING_S:g} to {GUARDED_S:g} s followed by an arrival: {wrong['brief']}"
    )
    if arguments.others:
        print(f"claims that one of the other evaders broke: {broken} of {claims}")
    print(f"wins missed: {missed.total()} of {wins.total()} ({share:.1%}); {clear}")
    unforeseen = missed.total() + lucky
    captured = wins.total() + lucky
    print(
        f"with the lucky captures: {unforeseen} of {captured} ({unforeseen / max(captured, 1):.1%})"
    )
    sys.exit(int(wrong["sustained"] > 0 or share >= MISSED))


if __name__ == "__main__":
    main()
