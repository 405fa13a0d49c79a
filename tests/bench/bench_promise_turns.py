"""Zigzags and feints against the promised time of capture: `python -m tests.bench.bench_promise_turns [--plays 1000]`.

The evader zigzags, feints, or runs at the vehicle and below it, and then runs away from it until it is captured. From
that moment on, the promise must hold: capture within `time_needed_s` and the certificate's `allowance`, and the time
that braking before the disc takes. The vehicle has just the guaranteed acceleration (`tests.harness.referee`). The
longest delays by which turns after a promise broke it are printed too. Ends with 1 if a promise was broken.
"""

import argparse
import math
import sys
from dataclasses import replace
from random import Random
from typing import Final, NamedTuple

import numpy as np

from guidance.control.braking_law import approach_speed
from guidance.cycle import CycleSettings
from guidance.frames import Enu
from tests.harness.guarded import SETUPS, cycle_settings
from tests.harness.referee import STEP_S, Referee

LONGEST_S: Final = 120.0
KINDS: Final = ("zigzag", "feint", "below")


class Play(NamedTuple):
    """One play: kind of turns, delay of the promise made at the last turn, and of the one made at the beginning, s."""

    kind: str
    late_s: float
    turned_late_s: float


def braking_s(settings: CycleSettings) -> float:
    """Return the time that the approach to the disc may cost against a flight at full speed to its rim, s."""
    approach = settings.handling.approach
    closing_m_s = float(settings.game.pursuer.horizontal_m_s - settings.game.evader_speed_m_s)
    lag_s = approach.lag_s + approach.settle_s
    captured_m = settings.tolerance_m - approach.margin_m
    rim_m_s = min(closing_m_s, approach_speed(captured_m, approach.braking_m_s2, lag_s))
    slower_m_s = closing_m_s - rim_m_s
    lost_s = slower_m_s**2 / (2.0 * approach.braking_m_s2 * closing_m_s)
    lags = math.log(closing_m_s / rim_m_s) - 1.0 + rim_m_s / closing_m_s
    return lost_s + lag_s * lags + lag_s


def played(seed: int, number: int) -> Play | None:
    """Draw and play a chase; None if it was over before the last turn."""
    draw = Random(f"turns/{seed}/{number}")
    settings = cycle_settings(SETUPS[number % len(SETUPS)])
    settings = replace(settings, target_game_m=None)
    bearing = draw.uniform(-math.pi, math.pi)
    away_m = draw.uniform(15.0, 60.0)
    height_m = draw.uniform(6.0, 20.0)
    game = Referee(
        settings,
        Enu((0.0, 0.0, height_m)),
        (away_m * math.sin(bearing), away_m * math.cos(bearing)),
    )
    kind = KINDS[number % len(KINDS)]
    turns_until_s = draw.uniform(1.0, 12.0)
    period_s = draw.uniform(0.6, 4.0)
    first_s = math.nan
    promised_s = math.nan
    while game.now_s < LONGEST_S:
        certificate = game.certify().certificate
        if certificate.captured:
            break
        if math.isnan(first_s):
            first_s = certificate.time_needed_s + certificate.allowance
        turns = game.now_s < turns_until_s
        if not turns and math.isnan(promised_s):
            promised_s = game.now_s + certificate.time_needed_s + certificate.allowance
        heading = _away(game)
        if turns:
            swings = int(game.now_s / period_s) % 2 * 2 - 1
            heading += {"zigzag": 0.4, "feint": 0.5, "below": 1.0}[kind] * math.pi * swings
            heading = _away(game) + math.pi if kind == "below" else heading
        speed_m_s = float(settings.game.evader_speed_m_s)
        game.step((speed_m_s * math.sin(heading), speed_m_s * math.cos(heading)))
    if math.isnan(promised_s):
        return None
    allowed_s = braking_s(settings) + STEP_S
    return Play(kind, game.now_s - promised_s - allowed_s, game.now_s - first_s - allowed_s)


def _away(game: Referee) -> float:
    """Return the heading straight away from the vehicle, from north."""
    x_m = game.state.evader_m[0] - game.state.pursuer_m[0]
    y_m = game.state.evader_m[1] - game.state.pursuer_m[1]
    return math.atan2(x_m, y_m)


def main() -> None:
    """Play, and print the delays."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--plays", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    plays = [play for number in range(arguments.plays) if (play := played(arguments.seed, number))]
    broken = 0
    for kind in KINDS:
        late_s = np.array([play.late_s for play in plays if play.kind == kind])
        turned_s = np.array([play.turned_late_s for play in plays if play.kind == kind])
        broken += int(np.sum(late_s > 0.0))
        print(
            f"{kind:<7} {len(late_s)} plays; runs away from the promise on: {np.sum(late_s > 0.0)} later, "
            f"latest {late_s.max():+.2f} s; turned after it: {np.sum(turned_s > 0.0)} later, "
            f"latest {turned_s.max():+.2f} s"
        )
    sys.exit(int(broken > 0))


if __name__ == "__main__":
    main()
