"""Fly random TAD games and compare what was claimed with how they ended: `python -m tests.bench.bench_verdict`.

A verdict that has lasted for 1.5 s and the barrier event must never be followed by an arrival of the evader. A
captured game in which the verdict was not "pursuer" for 0.4 s before the capture is a missed win; fewer than 10 %
may be. Ends with 1 otherwise. `--shape` chooses the target: a point, a disc, a segment, a polygon, a point or a disc
that moves. `--pursuer` lets the vehicle play a rule on the mock instead: how many games near the barrier does it win?
`--evader each` flies the evaders that try to break the verdict on the mock, too.

`--referee` plays without the mock: a vehicle with just the guaranteed acceleration, a delay and a lag. There, the
games are played in turn by the drawn course and by evaders that try to break the verdict (`tests.harness.evaders`);
`worst` is searched from the lasting claim on. A capture without a verdict is a win only if the vehicle could have
been certain of it (`tests.harness.trials`). The others, in which the evader ran into its capture, are printed as
lucky. With `--others`, the referee also tries other evaders from each lasting claim and counts the claims that they
break; these do not end it with 1. With `--cycles`, a step is a cycle of 20 ms, and the largest fall of the margin is
that between cycles.
"""

import argparse
import math
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from random import Random
from statistics import median
from typing import Final, NamedTuple

from guidance.cycle.monitor import GUARDED_S, LASTING_S
from guidance.session.fly.loop import PERIOD_S
from tests.harness.evaders import KINDS, draw_evader, searched_worst
from tests.harness.guarded import SHAPES, Drawn, Guarded, cycle_settings, draw_game, fly
from tests.harness.referee import STEP_S, referee
from tests.harness.trials import claimed_state, is_broken, was_certain

MISSED: Final = 0.1
CLOSE_S: Final = 2.0
COURSE: Final = "course"
WORST: Final = "worst"
EVADERS: Final = (COURSE, *KINDS, WORST)
EACH: Final = "each"
RULES: Final = (
    "optimal",
    "pure_pursuit",
    "lead_pursuit",
    "proportional_navigation",
    "task_oriented",
)


class Judged(NamedTuple):
    """One game, and what only the referee measures: largest fall of the margin and processor time of a certificate."""

    drawn: Drawn
    evader: str
    game: Guarded
    fall_s: float = math.nan
    certify_s: float = math.nan


def judged(arguments: argparse.Namespace, number: int) -> Judged:
    """Draw and fly one game."""
    drawn = draw_game(arguments.seed, number, arguments.shape)
    drawn = drawn._replace(setup=drawn.setup._replace(policy=arguments.pursuer))
    kind = arguments.evaders[number % len(arguments.evaders)]
    settings = cycle_settings(drawn.setup)
    draw = Random(f"{arguments.shape}/{arguments.seed}/{number}/{kind}")
    evader = draw_evader(kind, draw, settings) if kind in KINDS else None
    if not arguments.by_referee:
        return Judged(drawn, kind, fly(drawn, evader))
    played = referee(drawn, evader, PERIOD_S if arguments.cycles else STEP_S)
    result = played.result
    if kind == WORST and not math.isnan(result.sustained_s):
        worst = searched_worst(claimed_state(played), settings, draw).result
        result = result._replace(end=worst.end, end_s=worst.end_s)
    if result.end == "captured" and not result.claimed_s < result.end_s:
        result = result._replace(was_certain=was_certain(drawn, played))
    if arguments.others and not math.isnan(result.sustained_s):
        result = result._replace(is_broken=is_broken(drawn, played))
    return Judged(drawn, kind, result, played.largest_fall_s, played.certify_s)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--games", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--referee", action="store_true", help="without autopilot, links and noise; much faster"
    )
    parser.add_argument(
        "--others",
        action="store_true",
        help="by the referee; other evaders are also tried against each lasting claim",
    )
    parser.add_argument(
        "--evader",
        choices=(*EVADERS, EACH),
        help="default: by the referee all in turn, on the mock the drawn course",
    )
    parser.add_argument("--cycles", action="store_true", help="by the referee, in steps of 20 ms")
    parser.add_argument("--pursuer", choices=RULES, default=RULES[0], help="on the mock")
    parser.add_argument("--shape", choices=tuple(SHAPES), default="point")
    arguments = parser.parse_args()
    arguments.by_referee = arguments.referee or arguments.others
    if arguments.evader == WORST and not arguments.by_referee:
        parser.error(f"--evader {WORST} is searched by the referee; add --referee")
    chosen = arguments.evader or (EACH if arguments.by_referee else COURSE)
    arguments.evaders = (chosen,)
    if chosen == EACH:
        arguments.evaders = EVADERS if arguments.by_referee else (COURSE, *KINDS)
    return arguments


def main() -> None:
    """Fly, and print the counts."""
    arguments = _arguments()
    ends = Counter[str]()
    wrong = Counter[str]()
    events = 0
    claims = 0
    lucky = 0
    broken = 0
    falls_s = [0.0]
    certify_s = [math.nan]
    near = Counter[bool]()
    won = Counter[bool]()
    known_s = []
    lasted_s = []
    wins = Counter[bool]()
    missed = Counter[bool]()
    with ProcessPoolExecutor(arguments.jobs) as pool:
        games = pool.map(partial(judged, arguments), range(arguments.games), chunksize=10)
        for drawn, evader, game, fall_s, cost_s in games:
            ends[game.end] += 1
            events += not math.isnan(game.reported_s)
            sustained = not (math.isnan(game.sustained_s) and math.isnan(game.reported_s))
            claims += sustained
            broken += game.is_broken
            if abs(game.margin_s) <= CLOSE_S:
                near[game.margin_s > 0.0] += 1
                won[game.margin_s > 0.0] += game.end == "captured"
            if game.end == "captured" and game.claimed_s < game.end_s:
                known_s.append(game.end_s - game.claimed_s)
                lasted_s.append(game.end_s)
            falls_s.append(fall_s)
            certify_s.append(cost_s)
            if game.is_broken:
                print(f"claim broken by another evader: {drawn}: {game}", flush=True)
            if game.end == "captured" and not game.was_certain:
                lucky += 1
            elif game.end == "captured":
                wins[game.margin_s > CLOSE_S] += 1
                missed[game.margin_s > CLOSE_S] += not game.claimed_s < game.end_s
            elif sustained or not math.isnan(game.claimed_s):
                wrong["sustained" if sustained else "brief"] += game.end == "arrived"
                print(f"claimed, then {game.end}: {evader}: {drawn}: {game}", flush=True)
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
    print(
        f"within {CLOSE_S:g} s of the barrier at engagement: captured {won[True]} of {near[True]} that the game's "
        f"pursuer wins, and {won[False]} of {near[False]} others"
    )
    if known_s:
        print(
            f"a verdict that lasted {LASTING_S:g} s came {median(known_s):.1f} s before the capture, median of "
            f"{len(known_s)} captures that took {median(lasted_s):.1f} s"
        )
    if arguments.by_referee:
        step_s = PERIOD_S if arguments.cycles else STEP_S
        costs_s = sorted(certify_s[1:])
        print(
            f"largest fall of the margin within {step_s:g} s: {max(falls_s):.2f} s; "
            f"processor time of a certificate: median {1e3 * costs_s[len(costs_s) // 2]:.2f} ms"
        )
    sys.exit(int(wrong["sustained"] > 0 or share >= MISSED))


if __name__ == "__main__":
    main()
