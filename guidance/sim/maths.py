"""Scenarios played as mathematics: point masses that fly the velocities of their policies, one game or a batch.

Every game has its own clock. Far from its end, a step is a Runge-Kutta step of fourth order (Kutta, 1901), at most half
as long as the least time until an end or a change. Elsewhere velocities are held for a cycle, as in a
flight. No step passes the end of a game, and a game has the same bits alone and in a batch.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from operator import itemgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from guidance.flight import Event, State
from guidance.flight.settings import LIMITS_S
from guidance.game import Game, Solution, Winner, solve
from guidance.game.arrays import NUMPY, FloatArray, Real, components, pair_length
from guidance.game.pe import to_target
from guidance.game.records import rows_of
from guidance.game.rollout import NANOSECOND_S, Ahead, End, look_ahead
from guidance.game.team.rollout import HELD
from guidance.sim.batch import Batch, by_kind, kind_of, stack
from guidance.sim.outcome import Outcome, distances_of, outcome_of, winner_name
from guidance.sim.scenario import Scenario
from guidance.sim.sensor import (
    PERFECT,
    REPORT_TIMEOUT_S,
    Received,
    extrapolated,
    first_knowledge,
    next_event_s,
    receive_reports,
)
from guidance.strategies import COURSES, OPTIMAL, StrategyMemory, evade, pursue
from guidance.strategies.catalogue import PROPORTIONAL
from guidance.strategies.navigation import turning
from guidance.strategies.own import is_own

CYCLE_S = 0.02
"""A velocity is held for the cycle of a flight."""

_SMOOTH_POLICIES = ("optimal", "pure_pursuit", "lead_pursuit", "hold", *COURSES)
_SHARES = dict.fromkeys(_SMOOTH_POLICIES, 0.8) | {PROPORTIONAL: 0.5}
"""Length of a step, as a share of the least time until a change, by the pursuer's policy.

These policies are smooth functions of the state until the pursuer is beside the evader. Others may change abruptly:
they keep the cycle. Times of capture of tests/bench/bench_sweep.py's games differ from those with cycles of 4 ms by
11 ms at most, with proportional navigation by 22 ms; held velocities of 20 ms differ by 17 ms.
"""

_SHARE_LEFT = 0.75
"""Finished games are removed from the arrays when this share or less is still running."""

_STRAIGHT = 1e-9
"""Change of velocity over the last step, as a share of the speed, below which players count as flying straight."""

_NAMES = {end: end.name.lower() for end in End} | {End.NO_ANSWER: "failed"}
LIMITS = ("fence", "floor", "ceiling")
_EVENTS = (
    *(Event.EVADER_LOST, Event.NO_GAME, Event.CAPTURED, Event.ESCAPED),
    Event.POLICY_FAILED,
)


Slope: TypeAlias = tuple[FloatArray, ...]
"""Rates of change, (n, 3) each: velocities of both players, and the rate of turn of a pursuer that navigates."""


class BatchMoment(NamedTuple):
    """A batch of games, each at one moment of its own; arrays (n, …).

    Attributes:
        row: Number of the game.
        now_s: Time since engagement.
        pursuer_m: Position.
        evader_m: Position.
        flown_m_s: Pursuer velocity at the begin of the last step.
        run_m_s: Evader velocity at the begin of the last step.
        step_s: Length of the last step.
        turning_rad_s: Mean rate of turn of the last step, for proportional navigation of a pursuer that sees the
            evader; else None.
        received: Reports that the pursuer received; None if it sees the evader.
        lost_s: Waiting time for a report.
        standoff_m: Least horizontal distance so far.
        altitude_m: Least height above the evader's plane so far.
        happened: Which of `LIMITS` have held the pursuer back, whether the evader was ever lost, whether the pursuer
            had no velocity, because the evader is too fast for a game or a user's policy has no answer, and whether the
            evader's policy had none, (n, 6).
        end: `End`; NO_ANSWER is a failure.
    """

    row: NDArray[np.intp]
    now_s: FloatArray
    pursuer_m: FloatArray
    evader_m: FloatArray
    flown_m_s: FloatArray
    run_m_s: FloatArray
    step_s: FloatArray
    turning_rad_s: FloatArray | None
    received: Received | None
    lost_s: FloatArray
    standoff_m: FloatArray
    altitude_m: FloatArray
    happened: NDArray[np.bool_]
    end: NDArray[np.int8]


def play_scenarios(scenarios: Sequence[Scenario]) -> list[Outcome]:
    """Play scenarios of any kinds to their ends; outcomes in their order. Faults need an autopilot and are ignored."""
    return by_kind(scenarios, kind_of, _play_kind)


def moments(batch: Batch) -> Iterator[BatchMoment]:
    """Play the games of a batch; yield every moment, also of games that have just ended."""
    moment = moment_of_engagement(batch)
    with np.errstate(all="ignore"):
        while len(moment.row):
            ahead = look_ahead(NUMPY, batch.game, moment.pursuer_m, moment.evader_m, batch.target_m)
            moment = moment._replace(end=ends_of(batch, moment, ahead))
            yield moment
            running = moment.end == End.RUNNING
            if np.count_nonzero(running) <= _SHARE_LEFT * len(running):
                running_rows = itemgetter(running)
                batch = rows_of(batch, running_rows)
                moment = rows_of(moment, running_rows)
                ahead = rows_of(ahead, running_rows)
            if len(moment.row):
                moment = _advance(batch, moment, ahead)


def opening(batch: Batch) -> Solution:
    """Solve the games of a batch at engagement, with the evader speeds that the pursuers assume."""
    return solve(batch.believed, batch.pursuer_m, batch.evader_m, batch.target_m)


def moment_of_engagement(batch: Batch) -> BatchMoment:
    """Return the moment of engagement."""
    P = batch.pursuer_m
    E = batch.evader_m
    count = len(batch.pursuer_m)
    sensor = batch.kind.sensor
    zero_s = np.zeros(count)
    zero_m_s = np.zeros_like(P)
    turning_rad_s = None
    knowledge = None
    if sensor != PERFECT:
        knowledge = first_knowledge(sensor, E)
    elif batch.pursuer.name == PROPORTIONAL:
        turning_rad_s = np.zeros_like(P)
    nothing_happened = np.zeros((count, len(LIMITS) + 3), dtype=bool)
    still_running = np.zeros(count, dtype=np.int8)
    return BatchMoment(
        now_s=zero_s,
        step_s=zero_s,
        lost_s=zero_s,
        flown_m_s=zero_m_s,
        run_m_s=zero_m_s,
        row=np.arange(count),
        pursuer_m=P,
        evader_m=E,
        turning_rad_s=turning_rad_s,
        received=knowledge,
        standoff_m=_level(P - E),
        altitude_m=P[:, 2],
        happened=nothing_happened,
        end=still_running,
    )


def _level(vector: FloatArray) -> FloatArray:
    """Return the horizontal lengths, (n,), of vectors."""
    x = vector[:, 0]
    y = vector[:, 1]
    return np.asarray(np.sqrt(x**2 + y**2))


def _play_kind(scenarios: Sequence[Scenario]) -> list[Outcome]:
    batch = stack(scenarios)
    first = list(_one_by_one(opening(batch)))
    outcomes = dict[int, Outcome]()
    finished = np.zeros(len(scenarios), dtype=bool)
    for moment in moments(batch):
        has_ended = moment.end != End.RUNNING
        newly_ended = has_ended & ~finished[moment.row]
        if newly_ended.any():
            finished[moment.row[newly_ended]] = True
            for last in _one_by_one(rows_of(moment, itemgetter(newly_ended))):
                number = last.row
                outcomes[number] = _outcome(scenarios[number], first[number], last)
    return [outcomes[number] for number in range(len(scenarios))]


def _one_by_one(arrays: Any) -> Iterator[Any]:  # noqa: ANN401 - a named tuple
    """Yield the rows of a named tuple of arrays, with Python's numbers, which are faster then."""
    columns = (
        part.tolist() if isinstance(part, np.ndarray) else itertools.repeat(part) for part in arrays
    )
    return map(type(arrays)._make, zip(*columns, strict=False))


def ends_of(batch: Batch, moment: BatchMoment, ahead: Ahead) -> NDArray[np.int8]:
    """Return the end of each game; a capture counts before an arrival at the same time."""
    now = np.where(moment.now_s >= batch.limit_s, End.TIME_UP, End.RUNNING)
    has_no_answer = moment.happened[:, -2:].any(axis=1)
    lost_too_long = moment.lost_s >= LIMITS_S[State.PAUSED]
    now = np.where(has_no_answer | lost_too_long, End.NO_ANSWER, now)
    now = np.where(ahead.arrival_s <= NANOSECOND_S, End.ARRIVED, now)
    now = np.where(ahead.capture_s <= NANOSECOND_S, End.CAPTURED, now)
    was_running = moment.end == End.RUNNING
    return np.where(was_running, now, moment.end).astype(np.int8)


def _advance(batch: Batch, moment: BatchMoment, ahead: Ahead) -> BatchMoment:
    """Ask both players for velocities and move both by one step; finished games stay where they are."""
    waiting = receive_due_reports(batch, moment)
    slope = first = _slope(batch, moment, moment.pursuer_m, moment.evader_m)
    v, w = first[:2]
    no_game = ~np.isfinite(v[:, 0])
    v[no_game | waiting] = 0.0
    no_run = ~np.isfinite(w[:, 0])
    if no_run.any():
        w[no_run] = 0.0
    captured_s = _captured_s(batch, moment, v - w)
    smooth_s = _smooth_s(batch, moment, ahead, first, captured_s)
    longest_s = np.maximum(CYCLE_S, smooth_s)
    h = _step_s(batch, moment, ahead, captured_s, longest_s)
    is_long = h > CYCLE_S
    if is_long.any():
        mean = _mean_slope(batch, moment, h, first)
        # A policy without an answer within the step is asked again after a cycle
        has_answers = np.isfinite(mean[0] + mean[1]).all(axis=1)
        is_long &= has_answers
        h = np.where(has_answers, h, np.minimum(h, CYCLE_S))
        slope = tuple(
            np.where(is_long[:, None], average, before)
            for average, before in zip(mean, first, strict=True)
        )
    moved = _moved(batch, moment, h, slope, (waiting, no_game, no_run))
    return moved._replace(flown_m_s=v, run_m_s=w)


def receive_due_reports(batch: Batch, moment: BatchMoment) -> NDArray[np.bool_]:
    """Make the measurements and receive the reports that are due; return who has waited too long for one, (n,)."""
    knowledge = moment.received
    if knowledge is None:
        return np.zeros(len(moment.row), dtype=bool)
    sensor = batch.kind.sensor
    receive_reports(sensor, batch.noise, knowledge, moment.now_s, moment.evader_m, moment.run_m_s)
    return np.asarray(moment.now_s - knowledge.measured_s > REPORT_TIMEOUT_S)


def advance_held(
    batch: Batch, moment: BatchMoment, ahead: Ahead, velocities: Slope, longest_s: Real
) -> BatchMoment:
    """Fly velocities of both players for one step, no longer than to the next event of a game.

    Args:
        batch: The games.
        moment: The present one, after `receive_due_reports`. A pursuer without reports waits.
        ahead: Of the present moment.
        velocities: Velocities over the ground, (n, 3), m/s, and where the moment has one, the rate of turn.
        longest_s: Longest step, one number or (n,).
    """
    v, w, *turn = velocities
    no_game = ~np.isfinite(v[:, 0])
    waiting = np.zeros(len(v), dtype=bool)
    if moment.received is not None:
        waiting = moment.now_s - moment.received.measured_s > REPORT_TIMEOUT_S
    stopped = no_game | waiting
    if stopped.any():
        v = np.where(stopped[:, None], 0.0, v)
    no_run = ~np.isfinite(w[:, 0])
    if no_run.any():
        w = np.where(no_run[:, None], 0.0, w)
    arrival_s: Real = math.inf
    if batch.target_m is not None:
        # A lower bound of the time until a straight run is at the target, as `_captured_s` has it.
        evader = components(moment.evader_m)
        x, y, _ = to_target(NUMPY, batch.game, evader, components(batch.target_m))
        away_m = np.sqrt(x**2 + y**2)
        closing = x * w[:, 0] + y * w[:, 1]
        divisor_m = np.where(away_m > 0.0, away_m, 1.0)
        arrival_s = _zero_s(away_m, -closing / divisor_m)
    ahead = ahead._replace(arrival_s=arrival_s)
    captured_s = _captured_s(batch, moment, v - w)
    h = _step_s(batch, moment, ahead, captured_s, longest_s)
    slope = (v, w, *turn)
    moved = _moved(batch, moment, h, slope, (waiting, no_game, no_run))
    return moved._replace(flown_m_s=v, run_m_s=w)


def _step_s(
    batch: Batch, moment: BatchMoment, ahead: Ahead, captured_s: FloatArray, longest_s: Real
) -> FloatArray:
    """Return the next step, (n,): to the next end, change or event, at most `longest_s`; 0 of a finished game."""
    time_left_s = batch.limit_s - moment.now_s
    limits_s = [longest_s, time_left_s, captured_s, ahead.arrival_s, ahead.turn_s]
    # When a course turns, and when a report is measured or arrives.
    limits_s.extend(
        policy.course.corner_s(moment.now_s) - moment.now_s
        for policy in (batch.pursuer, batch.evader)
        if policy.course is not None
    )
    if moment.received is not None:
        limits_s.append(next_event_s(batch.kind.sensor, moment.received) - moment.now_s)
    step_s = reduce(np.minimum, limits_s)
    return np.where(moment.end == End.RUNNING, step_s, 0.0)


def _moved(
    batch: Batch,
    moment: BatchMoment,
    step_s: FloatArray,
    slope: Slope,
    troubles: tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]],
) -> BatchMoment:
    """Return the moment after a step, inside the limits.

    `troubles` is which pursuers wait for a report, which have no velocity, and which evaders have none, (n,) each.
    """
    pursuer_m_s, evader_m_s, *turn_rad_s = slope
    steps_s = step_s[:, None]
    P, at_limits = _held_back(batch, moment.pursuer_m + steps_s * pursuer_m_s)
    E = moment.evader_m + steps_s * evader_m_s
    waiting, no_game, no_run = troubles
    lost_s = np.where(waiting, moment.lost_s + step_s, 0.0)
    standoff_m = np.minimum(moment.standoff_m, _level(P - E))
    altitude_m = np.minimum(moment.altitude_m, P[:, 2])
    now_true = np.stack([*at_limits, waiting, no_game, no_run], axis=-1)
    return moment._replace(
        now_s=moment.now_s + step_s,
        pursuer_m=P,
        evader_m=E,
        step_s=step_s,
        turning_rad_s=turn_rad_s[0] if turn_rad_s else None,
        lost_s=lost_s,
        standoff_m=standoff_m,
        altitude_m=altitude_m,
        happened=moment.happened | now_true,
    )


def _smooth_s(
    batch: Batch, moment: BatchMoment, ahead: Ahead, slope: Slope, captured_s: FloatArray
) -> Real:
    """Return how long a step may be, (n,): a share of the least time until the pursuer is beside the evader or at a
    limit, or the evader at its target. While both players fly straight on, the time to the capture itself counts.
    """  # noqa: D205 - one sentence needs two lines
    share = _SHARES.get(batch.pursuer.name)
    if share is None or batch.kind.sensor != PERFECT:
        return 0.0
    P = moment.pursuer_m
    game = batch.game
    (v, w) = slope[:2]
    speeds = game.pursuer
    level_m_s = game.pursuer.horizontal_m_s + pair_length(game.wind_m_s)
    apart = _level(P - moment.evader_m)
    if speeds.separate:  # it holds its place when it is beside the evader
        apart = apart - game.standoff.radius_m - game.capture_radius_m
    pursuer_bend_m_s = np.abs(v - moment.flown_m_s).max(axis=-1)
    evader_bend_m_s = np.abs(w - moment.run_m_s).max(axis=-1)
    straight = pursuer_bend_m_s + evader_bend_m_s <= _STRAIGHT * level_m_s
    beside_s = np.minimum(apart / (level_m_s + game.evader_speed_m_s), ahead.capture_s)
    meeting_s = np.where(straight, captured_s, beside_s)
    # Fence, floor and ceiling
    out_m, outwards_m_s = _stretched(P[:, :2] - batch.home_m, v)
    climb_m_s = v[:, 2]
    room_m = np.stack([batch.fence_m - out_m, P[:, 2] - batch.lowest_m, batch.highest_m - P[:, 2]])
    fastest_m_s = speeds.top_speed_m_s(NUMPY, level_m_s)
    rate_m_s = np.where(straight, [-outwards_m_s, climb_m_s, -climb_m_s], -fastest_m_s)
    least_s = np.minimum(meeting_s, _zero_s(room_m, rate_m_s).min(axis=0))
    return np.asarray(share * np.minimum(least_s, ahead.arrival_s))


def _captured_s(batch: Batch, moment: BatchMoment, closing_m_s: FloatArray) -> FloatArray:
    """Return a lower bound, (n,), of the time until straight tracks end in capture; exact as it goes to zero.

    The distance from the disc is a convex function of the relative position. Its tangent is below it, so a step of
    Newton's method does not pass the capture.
    """
    game = batch.game
    z = moment.pursuer_m[:, 2] - game.standoff.height_m
    apart, rate = _stretched(moment.pursuer_m - moment.evader_m, closing_m_s)
    beside = (apart - game.standoff.radius_m, rate)
    height = (z, closing_m_s[:, 2])
    distances = game.pursuer.distances(NUMPY, game.capture_radius_m, beside, height)
    times_s = [_zero_s(distance_m, rate_m_s) for distance_m, rate_m_s in distances]
    return np.asarray(np.max(times_s, axis=0))


def _stretched(way_m: FloatArray, rate_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the horizontal lengths, (n,), of vectors that change at a rate, and the rate of change of the lengths."""
    length_m = _level(way_m)
    x_part = way_m[:, 0] * rate_m_s[:, 0]
    y_part = way_m[:, 1] * rate_m_s[:, 1]
    divisor_m = np.where(length_m > 0.0, length_m, 1.0)
    return length_m, (x_part + y_part) / divisor_m


def _zero_s(distance_m: Real, rate_m_s: Real) -> FloatArray:
    """Return when a distance is zero that changes at a constant rate; infinite if it does not shrink."""
    left_s = np.where(rate_m_s < 0.0, distance_m / -rate_m_s, np.inf)
    return np.where(distance_m <= 0.0, 0.0, left_s)


def _mean_slope(batch: Batch, moment: BatchMoment, step_s: FloatArray, first: Slope) -> Slope:
    """Return the mean slope over a step by Runge-Kutta; a player on a course keeps its velocity."""
    slopes = [first]
    for share in (0.5, 0.5, 1.0):
        v, w, *turn = slopes[-1]
        passed = share * step_s
        P = moment.pursuer_m + passed[:, None] * v
        E = moment.evader_m + passed[:, None] * w
        turning_rad_s = turn[0] if turn else None
        then = moment._replace(flown_m_s=first[0], turning_rad_s=turning_rad_s, step_s=passed)
        slopes.append(_slope(batch, then, P, E, first))
    parts = zip(*slopes, strict=True)
    return tuple((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in parts)


def _slope(
    batch: Batch, moment: BatchMoment, P: FloatArray, E: FloatArray, first: Slope | None = None
) -> Slope:
    """Return the players' velocities, and the turn; the pursuer sees the evader, or has its reports.

    Args:
        batch: The games.
        moment: For the clocks and the memory of the pursuer's policy.
        P: Positions of the pursuers, (n, 3).
        E: Positions of the evaders, (n, 3).
        first: Velocities at the begin of the step, kept by players on a course; None at the begin.
    """
    if batch.is_agreed and batch.pursuer.name == batch.evader.name == OPTIMAL:
        solution = solve(batch.game, P, E, batch.target_m, evader_velocity_m_s=moment.run_m_s)
        return solution.pursuer_velocity_m_s, solution.evader_velocity_m_s
    if first is None or batch.evader.course is None:
        w = fled(batch, moment, P, E)
    else:
        w = first[1]
    if first is not None and batch.pursuer.course is not None:
        return first[0], w
    v = chased(batch, moment, P, E, w)
    if moment.turning_rad_s is None:
        return v, w
    turn_rad_s = turning(batch.game, P, E, w, v, batch.pursuer.gain)
    return v, w, turn_rad_s


def fled(batch: Batch, moment: BatchMoment, P: FloatArray, E: FloatArray) -> FloatArray:
    """Return the velocities, (n, 3), that the evaders' policy asks for at positions (n, 3)."""
    memory = _memory(moment)
    return evade(batch.evader, batch.game, P, E, batch.target_m, memory, last_m_s=moment.run_m_s)


def chased(
    batch: Batch, moment: BatchMoment, P: FloatArray, E: FloatArray, run_m_s: FloatArray
) -> FloatArray:
    """Return the velocities, (n, 3), that the pursuers' policy asks for at positions (n, 3).

    Args:
        batch: The games.
        moment: For the clocks, the memory of the policy, and the reports that were received.
        P: Positions of the pursuers.
        E: Positions of the evaders.
        run_m_s: Velocities of the evaders, (n, 3).
    """
    view = view_of(batch, moment, E, run_m_s)
    memory = _memory(moment)
    return pursue(
        batch.pursuer,
        view.game,
        P,
        view.evader_m,
        batch.target_m,
        view.evader_m_s,
        memory,
        dt_s=moment.step_s,
    )


class View(NamedTuple):
    """Knowledge of the pursuers: the games that they play, and position and velocity of the evaders, (n, 3)."""

    game: Game
    evader_m: FloatArray
    evader_m_s: FloatArray


def view_of(batch: Batch, moment: BatchMoment, E: FloatArray, run_m_s: FloatArray) -> View:
    """Return the pursuers' knowledge of evaders at E that run; late and noisy where the scenario has a sensor."""
    if moment.received is not None:
        knowledge = moment.received
        known_m, bound_m_s, age_s = extrapolated(
            batch.noise, knowledge, batch.believed_m_s, moment.now_s
        )
        information_age_s = np.minimum(age_s, REPORT_TIMEOUT_S)
        aged = replace(batch.game, evader_speed_m_s=bound_m_s, information_age_s=information_age_s)
        return View(aged, known_m, knowledge.velocity_m_s)
    if batch.is_agreed:
        return View(batch.game, E, run_m_s)
    fastest_m_s = np.maximum(batch.believed_m_s, _level(run_m_s))
    return View(replace(batch.game, evader_speed_m_s=fastest_m_s), E, run_m_s)


def _memory(moment: BatchMoment) -> StrategyMemory:
    return StrategyMemory(moment.flown_m_s, moment.now_s, moment.turning_rad_s)


def _held_back(batch: Batch, P: FloatArray) -> tuple[FloatArray, Sequence[NDArray[np.bool_]]]:
    """Return the pursuer's position inside fence, floor and ceiling, and for each whether it had left it, (n,)."""
    away_m = P[:, :2] - batch.home_m
    out = _level(away_m)
    beyond = out > batch.fence_m
    divisor_m = np.where(beyond, out, 1.0)
    back_share = np.where(beyond, 1.0 - batch.fence_m / divisor_m, 0.0)
    level_m = P[:, :2] - back_share[:, None] * away_m
    low = P[:, 2] < batch.lowest_m
    high = P[:, 2] > batch.highest_m
    height_m = np.clip(P[:, 2], batch.lowest_m, batch.highest_m)
    return np.column_stack([level_m, height_m]), (beyond, low, high)


def _outcome(scenario: Scenario, first: Any, last: Any) -> Outcome:  # noqa: ANN401 - one row each
    """Return the outcome of one game, from its solution at engagement and its last moment."""
    end = _NAMES[last.end]
    *limits_met, lost, no_velocity, no_run = last.happened
    has_failed_policy = no_run or (no_velocity and is_own(scenario.pursuer.policy))
    has_no_game = no_velocity and not has_failed_policy
    failure = Event.EVADER_LOST
    if has_failed_policy:
        failure = Event.POLICY_FAILED
    elif has_no_game:
        failure = Event.NO_GAME
    happened = (lost, has_no_game, end == "captured", end == "arrived", has_failed_policy)
    limits = itertools.compress(LIMITS, limits_met)
    events = itertools.compress(_EVENTS, happened)
    final_distances = distances_of(scenario, last.pursuer_m, last.evader_m)
    # None where a cycle of held velocities could cost the win.
    both_m_s = scenario.pursuer.speed_m_s + scenario.evader.believed_speed_m_s
    least_margin_m = HELD * CYCLE_S * both_m_s
    if scenario.game == "tad" and first.winner > 0 and first.value < least_margin_m:
        promised = winner_name(Winner.UNDECIDED)
    else:
        promised = winner_name(first.winner)
    return outcome_of(
        scenario,
        "maths",
        end=end,
        game_time_s=last.now_s,
        **final_distances,
        predicted=first.value,
        predicted_winner=promised,
        time_needed_s=first.meeting_time_s,
        min_standoff_m=last.standoff_m,
        min_altitude_m=last.altitude_m + scenario.evader.height_m,
        duration_s=last.now_s,
        limits=tuple(limits),
        events=tuple(map(str, events)),
        reason=str(failure) if end == "failed" else "",
    )
