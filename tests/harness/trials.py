"""Whether a vehicle that captured its evader could have been certain of it: other evaders are tried from its states.

A capture alone does not show that: the evader may have run to where it was captured. The vehicle could be certain of it
if it captures every evader that is tried from one of the states before: one that plays the game, some that run straight
to points of the target, some that feint first, and some of each kind of `tests.harness.evaders`.
"""

import math
from collections.abc import Iterator
from random import Random
from typing import Final

from tests.harness.evaders import KINDS, draw_evader, outline
from tests.harness.guarded import Drawn, Evader, cycle_settings
from tests.harness.referee import Played, Referee, on_course, play_out

BEFORE_S: Final = (0.5, 1.0, 2.0, 3.5, 5.0, 8.0)
"""Times before the capture whose states are tried; a verdict has to last for 0.4 s before it."""

STRAIGHT: Final = 8
FEINTS: Final = 8
OF_EACH_KIND: Final = 2


def was_certain(drawn: Drawn, played: Played) -> bool:
    """Return whether all trials end with a capture, from one of the states before the capture."""
    for before_s in BEFORE_S:
        steps = round(before_s / played.states[0].step_s)
        if steps < len(played.states) and _captures_all(drawn, played.states[-1 - steps]):
            return True
    return False


def claimed_state(played: Played) -> Referee:
    """Return the state in which a claim had lasted."""
    return played.states[round(played.result.sustained_s / played.states[0].step_s)]


def is_broken(drawn: Drawn, played: Played) -> bool:
    """Return whether one of the other evaders is not captured from the state in which the claim had lasted 1.5 s."""
    claimed = claimed_state(played)
    return not _captures_all(drawn, claimed)


def _captures_all(drawn: Drawn, state: Referee) -> bool:
    return all(
        play_out(state.copy(), evader).result.end == "captured" for evader in _evaders(drawn, state)
    )


def _evaders(drawn: Drawn, state: Referee) -> Iterator[Evader]:
    """Return the trials; those that break a claim most often come first."""
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
    for _ in range(FEINTS):
        run_m = speed_m_s * draw.uniform(0.3, 2.5)
        heading = draw.uniform(-math.pi, math.pi)
        feint_m = (x_m + run_m * math.sin(heading), y_m + run_m * math.cos(heading))
        yield on_course(drawn, [feint_m, draw.choice(nearest)], state.step_s)
    for kind in KINDS:
        for _ in range(OF_EACH_KIND):
            yield draw_evader(kind, draw, settings, state.now_s)
    yield on_course(drawn, [], state.step_s)
    for point in nearest:
        yield on_course(drawn, [point], state.step_s)
