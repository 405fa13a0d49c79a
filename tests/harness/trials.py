"""Whether a vehicle that captured its evader could have been certain of it: other evaders are tried from its states.

A capture alone does not show that: the evader may have run to where it was captured. The vehicle could be certain of it
if it captures every evader that is tried from one of the states before: one that plays the game, some that run straight
to points of the target, and some that feint first.
"""

import math
from collections.abc import Iterator
from random import Random
from typing import Final

from guidance.cycle.guarding import outline
from tests.harness.guarded import LONGEST_S, Drawn, Point, cycle_settings
from tests.harness.referee import STEP_S, Played, Referee, runs

BEFORE_S: Final = (0.5, 1.0, 2.0, 3.5, 5.0, 8.0)
"""Times before the capture whose states are tried; a verdict has to last for 0.4 s before it."""

STRAIGHT: Final = 8
FEINTS: Final = 8


def was_certain(drawn: Drawn, played: Played) -> bool:
    """Return whether all trials end with a capture, from one of the states before the capture."""
    for before_s in BEFORE_S:
        steps = round(before_s / STEP_S)
        if steps < len(played.states) and _captures_all(drawn, played.states[-1 - steps]):
            return True
    return False


def is_broken(drawn: Drawn, played: Played) -> bool:
    """Return whether one of the other evaders is not captured from the state in which the claim had lasted 1.5 s."""
    claimed = played.states[round(played.result.sustained_s / STEP_S)]
    return not _captures_all(drawn, claimed)


def _captures_all(drawn: Drawn, state: Referee) -> bool:
    return all(_captures(drawn, state.copy(), course) for course in _courses(drawn, state))


def _captures(drawn: Drawn, game: Referee, course: list[Point]) -> bool:
    """Return whether the vehicle captures an evader on this course."""
    speed_m_s = float(cycle_settings(drawn.setup).game.evader_speed_m_s)
    until_s = game.now_s + LONGEST_S
    while game.now_s < until_s:
        certified = game.certify()
        if certified.certificate.captured:
            return True
        if certified.certificate.evader_arrived:
            return False
        game.step(runs(game.state, course, certified, speed_m_s, drawn.setup.aim.velocity_m_s))
    return False


def _courses(drawn: Drawn, state: Referee) -> Iterator[list[Point]]:
    """Return the trials: an empty course plays the game, the last place of others is a point of the target."""
    draw = Random(f"trials/{drawn.number}")
    settings = cycle_settings(drawn.setup)
    speed_m_s = float(settings.game.evader_speed_m_s)
    target_m = state.state.target_m or (math.nan, math.nan, math.nan)
    x_m, y_m, _ = state.state.evader_m
    points = outline(settings.game.target_extent)
    thinned = points[:: max(1, len(points) // (2 * STRAIGHT))]
    nearest = sorted(
        thinned,
        key=lambda point: math.hypot(target_m[0] + point[0] - x_m, target_m[1] + point[1] - y_m),
    )[:STRAIGHT]
    yield []
    for point in nearest:
        yield [point]
    for _ in range(FEINTS):
        run_m = speed_m_s * draw.uniform(0.3, 2.5)
        heading = draw.uniform(-math.pi, math.pi)
        feint_m = (x_m + run_m * math.sin(heading), y_m + run_m * math.cos(heading))
        yield [feint_m, draw.choice(nearest)]
