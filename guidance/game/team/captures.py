"""The play of a team: orders of captures, which break no promise.

Every pursuer goes to the first evader of its order (`orders`), where that is captured if it runs as foreseen. A pursuer
that has promised a capture does so only where the promise allows it, and else plays the game against that evader, which
keeps the promise for any play. So foresight decides only about captures beyond the promises.

A promise may be of two kinds. A *distance*: the evader gets no closer to its target than the game's value. The pursuer
then always plays the game. A *capture*: the evader does not get to its target. The pursuer may then spend its distance:
it goes where it likes while it is still sooner at the target than the promised evader can be, after the step and for
any play of the evader in it. From there the value of the game is above zero, so the game's play keeps the capture.
A pursuer that has promised two captures in turn flies parallel to the first evader (`in_turn`).
"""

from typing import Any, Final, NamedTuple

import numpy as np

from guidance.game.arrays import Array
from guidance.game.game import NO_WIND, Game
from guidance.game.policies import PURSUER_POLICIES
from guidance.game.rows import for_rows
from guidance.game.team.capture_sequences import (
    CaptureProblem,
    Foreseen,
    arrivals,
    evader_speeds,
    foresee_runs,
    guards,
    sequence_captures,
)
from guidance.game.team.in_turn import parallel_policy
from guidance.game.team.matching import Matching
from guidance.game.team.rules import TeamView, chase
from guidance.game.team.table import place_of, taken

_STEPS: Final = 10
"""The orders are made anew every so many steps, and when an evader's game ends."""

SHOWN: Final = 0.25
"""Time over which an evader's velocity is averaged, as a share of the time that it needs to its target."""

_SPARE_STEPS: Final = 2.0
"""Time to spare of a promised capture, in steps, because velocities are held.

With a margin of two steps the value of the game is at least 2 u step / (u/v + 1): the pursuer could fly to the target,
and from there meet the evader. That is more than `HELD` of both players' way up to u/v = 17.
"""


class Intent(NamedTuple):
    """Memory of a team from step to step, for leading axes (...).

    Attributes:
        shown_m_s: mean velocity that each evader has shown, (..., m, 3), m/s.
        first: the first evader of each pursuer's order, (..., n); −1 for none.
        in_play: evaders in play when the orders were made, (..., m).
        steps: steps since the start.
    """

    shown_m_s: Array
    first: Array
    in_play: Array
    steps: int


class Chase(NamedTuple):
    """Velocities of the pursuers, (..., n, 3), m/s, and whom they chase, (..., n)."""

    velocity_m_s: Array
    evader_of: Array


def first_intent(view: TeamView) -> Intent:
    """Return the intent at the start: evaders are foreseen to run straight to their targets."""
    T: Array = view.target_m
    to = T - view.evaders_m
    to[..., 2] = 0.0
    far = np.sqrt(np.sum(to**2, axis=-1))
    share = evader_speeds(view.game) / np.where(far > 0.0, far, 1.0)
    nobody = np.full(view.pursuers_m.shape[:-1], -1)
    return Intent(share[..., None] * to, nobody, np.zeros(view.in_play.shape, dtype=bool), 0)


def play_sequences(  # noqa: PLR0914
    view: TeamView,
    plays: Array,
    matching: Matching,
    intent: Intent,
    step_s: float,
    spends: Array,
) -> tuple[Chase, Intent]:
    """Return the chase of the pursuers in a step, and their intent after it.

    Args:
        view: the moment; TAD.
        plays: which pursuers play against which evaders, (..., n, m).
        matching: the promises at this moment.
        intent: of the step before, or `first_intent`.
        step_s: length of the step at most, s.
        spends: which pursuers promise captures only, and may spend distance, (n,).
    """
    game = view.game
    T: Array = view.target_m
    shown_m_s = intent.shown_m_s
    if intent.steps > 0:
        window_s = SHOWN * arrivals(game, view.evaders_m, T)
        share = step_s / np.maximum(window_s, step_s)
        shown_m_s = shown_m_s + share[..., None] * (view.evader_velocity_m_s - shown_m_s)
    foreseen = foresee_runs(game, view.evaders_m, T, shown_m_s)
    holds = holders(matching, view.pursuers_m.shape[-2])
    bound = spends & (holds >= 0) & (matching.then >= 0)
    first = intent.first
    due = (intent.in_play != view.in_play).any(axis=-1) | (intent.steps % _STEPS == 0)
    if due.any():
        first = first.copy()
        rows: Any = np.nonzero(due) if due.ndim else (None,)
        scene = CaptureProblem(
            game=for_rows(game, lambda value: value[rows]),
            pursuers_m=view.pursuers_m[rows],
            evaders_m=view.evaders_m[rows],
            target_m=T[rows],
            foreseen=Foreseen(*(part[rows] for part in foreseen)),
            plays=(plays & view.in_play[..., None, :])[rows],
            holds=np.where(spends, holds, -1)[rows],
            bound=bound[rows],
            spare_s=_SPARE_STEPS * step_s,
        )
        first[rows] = sequence_captures(scene).first
    evader_of = np.where(first >= 0, first, matching.evader_of)
    foreseen_view = view._replace(evader_velocity_m_s=foreseen.run_m_s)
    to_order_m_s = chase(foreseen_view, evader_of, PURSUER_POLICIES["lead_pursuit"])
    free = holds < 0
    if spends.any() and game.target_extent.is_point and game.target_velocity_m_s == NO_WIND:
        free |= spends & _still_holds(view, holds, view.pursuers_m + step_s * to_order_m_s, step_s)
    goes = (first >= 0) & free & ~bound
    evader_of = np.where(goes | (holds < 0), evader_of, holds)
    velocity_m_s = np.where(goes[..., None], to_order_m_s, matching.pursuer_velocity_m_s)
    if bound.any():
        run_m_s = view.evader_velocity_m_s if intent.steps > 0 else shown_m_s
        seen_view = view._replace(evader_velocity_m_s=run_m_s)
        parallel_m_s = chase(seen_view, np.maximum(holds, 0), parallel_policy)
        velocity_m_s = np.where(bound[..., None], parallel_m_s, velocity_m_s)
    return Chase(velocity_m_s, evader_of), Intent(shown_m_s, first, view.in_play, intent.steps + 1)


def holders(matching: Matching, n: int) -> Array:
    """Return the evader whose capture each of n pursuers has promised, (..., n); −1 for none."""
    holds = matching.first[..., None, :] == np.arange(n)[:, None]
    return np.where(holds.any(axis=-1), np.argmax(holds, axis=-1), -1)


def _still_holds(view: TeamView, holds: Array, after_m: Array, step_s: float) -> Array:
    """Return whether pursuers can still hold their promises from other places, (..., n, 3), m, after a step."""
    T: Array = view.target_m
    at = place_of(holds, holds.ndim - 1)
    games: Game = for_rows(view.game, lambda value: taken(value, holds))
    arrival_s = arrivals(view.game, view.evaders_m, T)[at]
    guard_s = guards(games, after_m, T[at])
    return np.asarray(arrival_s - step_s - guard_s > _SPARE_STEPS * step_s)
