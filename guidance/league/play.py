"""Many games of one scenario at once, stepped by the velocities of one side or both: the environments' common part.

The players are those of `guidance.sim.maths`: the same game, ends, limits, sensor and policies. A velocity is held
for a period. Only the scenario's own players choose anew within it: every `CHOICE_S`, and where something happens, as a
report arrives, or the height is reached. A step ends exactly where a game ends.

The score of a game is the pursuer's result, as far as it is decided, plus the exact value of the rest: in PE minus
the time of the capture, s; in TAD the distance of the evader from its target at the capture, m, and if the evader wins,
minus the distance that the pursuer lacks for a capture. Optimal play of both does not change the score. A change is a
player's loss. A game of TAD that the pursuer could win counts 0 for an arrival, as in outcomes.
"""

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.game import End, Game, Solution, Winner, solve
from guidance.game.arrays import NUMPY, FloatArray, components, mapped
from guidance.game.pe import to_target
from guidance.game.records import rows_of
from guidance.game.rollout import Ahead, look_ahead
from guidance.league.states import Arena, SeedArray, batch_at, random_states
from guidance.sim.batch import Batch
from guidance.sim.maths import (
    BatchMoment,
    Slope,
    advance_held,
    chased,
    ends_of,
    fled,
    moment_of_engagement,
    receive_due_reports,
)
from guidance.sim.scenario import EVADER, PURSUER
from guidance.strategies import OPTIMAL
from guidance.strategies.navigation import turning

LEAST_S: Final = 1e-9
"""A shorter rest of a period is not flown."""

CHOICE_S: Final = 0.5
"""A player of the scenario keeps a velocity at most this long.

In 1,000 games with a multicopter's speeds, optimal velocities that are kept for 0.5 s lose less than 1 ms, and up to
1.9 s if they are kept for 1 s.
"""

WINNER_OF_END: Final = np.zeros(len(End), dtype=np.int8)
"""`Winner` of each `End`."""
WINNER_OF_END[End.CAPTURED] = Winner.PURSUER
WINNER_OF_END[End.ARRIVED] = Winner.EVADER


class Games:
    """Games of one scenario, each at a moment of its own.

    Args:
        arena: The scenario, with the policies of players that are not steered.
        seeds: Of the initial states, (n,).
        period_s: How long a velocity is held.

    Attributes:
        batch: Constants of the games.
        moment: Where they are.
        solution: Optimal play from there.
        score: Of each game, (n,).
        opening_score: The score at the beginning, (n,).
    """

    def __init__(self, arena: Arena, seeds: SeedArray, period_s: float) -> None:
        self._arena = arena
        self._period_s = period_s
        self.batch = _owned(batch_at(arena.template, random_states(arena, seeds)))
        self.moment = _owned(moment_of_engagement(self.batch))
        receive_due_reports(self.batch, self.moment)
        self.solution = _solved(self._arena.valued, self.batch, self.moment)
        self.score = _scores(self._arena, self.batch, self.moment, self.solution)
        self.opening_score = self.score.copy()

    @property
    def count(self) -> int:
        """Number of games."""
        return len(self.moment.row)

    @property
    def value(self) -> FloatArray:
        """Exact value of each state, (n,): s in PE; in TAD m, negative where the evader wins."""
        if self.batch.target_m is None:
            return self.solution.value
        return np.asarray(self.solution.winner * self.solution.value)

    def restart(self, rows: NDArray[np.intp], seeds: SeedArray) -> None:
        """Begin some games anew, in the states of seeds."""
        batch = batch_at(self._arena.template, random_states(self._arena, seeds))
        moment = moment_of_engagement(batch)
        receive_due_reports(batch, moment)
        solution = _solved(self._arena.valued, batch, moment)
        score = _scores(self._arena, batch, moment, solution)
        put(self.batch, batch, rows)
        put(self.moment, moment._replace(row=rows), rows)
        put(self.solution, solution, rows)
        self.score[rows] = score
        self.opening_score[rows] = score

    def step(self, pursuer_m_s: FloatArray | None, evader_m_s: FloatArray | None) -> None:
        """Hold velocities, (n, 3), for a period, or to the end of a game. None is the scenario's own policy."""
        with np.errstate(all="ignore"):
            self._fly(pursuer_m_s, evader_m_s)
        self.solution = _solved(self._arena.valued, self.batch, self.moment)
        score = _scores(self._arena, self.batch, self.moment, self.solution)
        if self.batch.target_m is not None:
            score = np.where(self.opening_score > 0.0, np.maximum(score, 0.0), score)
        self.score = np.where(np.isfinite(score), score, self.score)

    def _fly(self, pursuer_m_s: FloatArray | None, evader_m_s: FloatArray | None) -> None:
        """Fly a period, in one step where nothing happens and no player chooses within it."""
        batch = self.batch
        moment = self.moment
        steered = _Steered(pursuer_m_s, evader_m_s, self.solution)
        ahead = _look(batch, moment)
        left_s: Any = self._period_s
        rows = moment.row
        chosen = pursuer_m_s is None or evader_m_s is None
        longest_s = CHOICE_S if chosen else self._period_s
        while True:
            velocities = _velocities(batch, moment, steered)
            moment = advance_held(batch, moment, ahead, velocities, np.minimum(left_s, longest_s))
            receive_due_reports(batch, moment)
            left_s = left_s - moment.step_s
            ahead = _look(batch, moment)
            moment = moment._replace(end=ends_of(batch, moment, ahead))
            if len(rows) == self.count:
                self.moment = moment
            else:
                put(self.moment, moment, rows)
            unfinished = np.flatnonzero((moment.end == End.RUNNING) & (left_s > LEAST_S))
            if len(unfinished) == 0:
                return
            take = itemgetter(unfinished)
            rows = rows[unfinished]
            left_s = left_s[unfinished]
            batch, moment, ahead = (rows_of(part, take) for part in (batch, moment, ahead))
            steered = rows_of(steered, take)
            if chosen:
                steered = steered._replace(solution=_solved(self._arena.valued, batch, moment))


class _Steered(NamedTuple):
    """Velocities of the players that are steered, (n, 3), None of the others; and optimal play."""

    pursuer_m_s: FloatArray | None
    evader_m_s: FloatArray | None
    solution: Solution


def _velocities(batch: Batch, moment: BatchMoment, steered: _Steered) -> Slope:
    """Return the velocities of both players, and the turn of a pursuer that navigates."""
    P = moment.pursuer_m
    E = moment.evader_m
    w = steered.evader_m_s
    if w is None:
        is_optimal = batch.evader.name == OPTIMAL
        w = steered.solution.evader_velocity_m_s if is_optimal else fled(batch, moment, P, E)
    v = steered.pursuer_m_s
    if v is None:
        is_optimal = batch.pursuer.name == OPTIMAL and batch.is_agreed
        v = steered.solution.pursuer_velocity_m_s
        if not is_optimal:
            v = chased(batch, moment, P, E, w)
    if moment.turning_rad_s is None:
        return v, w
    return v, w, turning(batch.game, P, E, w, v, batch.pursuer.gain)


def _look(batch: Batch, moment: BatchMoment) -> Ahead:
    return look_ahead(NUMPY, batch.game, moment.pursuer_m, moment.evader_m, batch.target_m)


def _solved(game: Game, batch: Batch, moment: BatchMoment) -> Solution:
    return solve(
        game,
        moment.pursuer_m,
        moment.evader_m,
        batch.target_m,
        evader_velocity_m_s=moment.run_m_s,
    )


def _scores(arena: Arena, batch: Batch, moment: BatchMoment, solution: Solution) -> FloatArray:
    """Return the score of each game, (n,); NaN where the state has no value."""
    if batch.target_m is None:
        return -(moment.now_s + solution.value)
    score = solution.winner * solution.value
    captured = moment.end == End.CAPTURED
    if arena.between_points or not captured.any():
        return np.asarray(score)
    offset = to_target(NUMPY, batch.game, components(moment.evader_m), components(batch.target_m))
    return np.where(captured, NUMPY.norm2(offset[:2]), score)


class Losses(NamedTuple):
    """Of each game, (n,): the pursuer's loss since the opening, the value at the opening, and the `End`."""

    loss: FloatArray
    value: FloatArray
    end: NDArray[np.int8]


def losses_of(arena: Arena, batch: Batch, moments: Iterable[BatchMoment], player: str) -> Losses:
    """Return the losses of games that are played to their ends.

    If the player's policy has no answer, or the time limit ends the game undecided, the player also pays the
    remaining value, and no less than in a lost game. So it never pays to stop playing.

    Args:
        arena: Whose value counts.
        batch: The games.
        moments: All moments, as `guidance.sim.maths.moments` yields them.
        player: "pursuer" or "evader", whose policy is judged.
    """
    opening = moment_of_engagement(batch)
    solution = _solved(arena.valued, batch, opening)
    before = _scores(arena, batch, opening, solution)
    last = _owned(opening)
    for moment in moments:
        has_ended = moment.end != End.RUNNING
        if has_ended.any():
            rows = moment.row[has_ended]
            for name in ("now_s", "pursuer_m", "evader_m", "run_m_s", "happened", "end"):
                getattr(last, name)[rows] = getattr(moment, name)[has_ended]
    at_end = _solved(arena.valued, batch, last)
    after = _scores(arena, batch, last, at_end)
    evader_failed = last.happened[:, -1]
    unfinished = (last.end == End.NO_ANSWER) & (evader_failed == (player == EVADER))
    if batch.target_m is not None or player == PURSUER:  # else the time limit is the evader's win
        unfinished |= last.end == End.TIME_UP
    if unfinished.any():
        left = np.abs(at_end.value)
        # The score if the player stops: the evader is captured where it is, or in TAD is at its target.
        if batch.target_m is None:
            lost = np.asarray(-(batch.limit_s + left) if player == PURSUER else -last.now_s)
        else:
            E = last.evader_m
            offset = to_target(NUMPY, batch.game, components(E), components(batch.target_m))
            if player == EVADER:
                lost = np.asarray(NUMPY.norm2(offset[:2]))
            else:
                at_target_m = np.column_stack([E[:, 0] + offset[0], E[:, 1] + offset[1], E[:, 2]])
                arrived = last._replace(evader_m=at_target_m)
                lost = _scores(arena, batch, arrived, _solved(arena.valued, batch, arrived))
        paid = np.fmin(lost, after - left) if player == PURSUER else np.fmax(lost, after + left)
        after = np.where(unfinished, paid, after)
    if batch.target_m is not None:
        after = np.where(before > 0.0, np.maximum(after, 0.0), after)
    return Losses(before - after, solution.value, last.end)


def put(record: Any, part: Any, rows: NDArray[np.intp]) -> None:  # noqa: ANN401 - a record of arrays
    """Write the arrays of a record into rows of the same arrays of another, also in records in it."""
    if isinstance(record, np.ndarray):
        record[rows] = part
    elif isinstance(record, tuple):
        for field, value in zip(record, part, strict=True):
            put(field, value, rows)
    elif is_dataclass(record):
        for field in fields(record):
            put(getattr(record, field.name), getattr(part, field.name), rows)


def _owned(record: Any) -> Any:  # noqa: ANN401 - a record of arrays
    """Return a record each of whose arrays is its own, so that rows of one can be written."""
    return mapped(lambda part: part.copy() if isinstance(part, np.ndarray) else part, record)
