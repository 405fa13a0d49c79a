"""Orders of captures with deadlines: which evaders each pursuer captures, one after the other, if they run as foreseen.

An evader that keeps a slower velocity is captured by a straight flight. The sooner a pursuer is at one, the better for
all that follows, because it could also stay with it. So the best sequence over a set of evaders is found from the best
ones over its subsets (Held & Karp): of each set and its last evader only the earliest time counts. Evaders count that
are captured before their deadlines. The sets of all pursuers are disjoint, and chosen to capture the most evaders.

A pursuer may hold a promise: an evader that it alone keeps from its target. It takes another one before that only if
it is then still sooner at the target than the promised evader can be, on its shortest way. This check does not depend
on the foreseen run of that evader.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from guidance.game.arrays import NUMPY, Array, components
from guidance.game.game import NO_WIND, Game
from guidance.game.pe import take_apart, to_target
from guidance.game.policies import lead
from guidance.game.rows import for_rows
from guidance.game.tad import guard_time
from guidance.game.team.table import place_of, taken

MOST: Final = 6
"""Up to so many evaders, all sequences are compared. Of more, each pursuer in turn takes those it reaches first."""

EARLY: Final = 0.02
"""Extra worth, in captures, of an immediate capture over one at the deadline."""


class Foreseen(NamedTuple):
    """Predicted runs of the evaders: velocities (..., m, 3), m/s, and when they arrive, (..., m), s."""

    run_m_s: Array
    until_s: Array


class CaptureSequences(NamedTuple):
    """First evader of each pursuer, and the number of captures.

    Attributes:
        first: number of the first evader of each pursuer's sequence, (b, n); −1 if it captures none.
        captured: number of evaders in all sequences, (b,).
    """

    first: Array
    captured: Array


class _Stage(NamedTuple):
    """Builds the sets of one size from those with one evader less.

    Attributes:
        source: number of the smaller set and its last evader, (states, size).
        last: evader that is captured last, (states,).
        mask: the set as bits, (states,).
    """

    source: Array
    last: Array
    mask: Array


@lru_cache
def _stages(m: int) -> tuple[_Stage, ...]:
    """Return the stages for sets of 2, 3 … m evaders; those of one evader are numbered as it."""
    before = {(1 << k, k): k for k in range(m)}
    stages = []
    for size in range(2, m + 1):
        states = [
            (mask, last)
            for mask in range(1 << m)
            if mask.bit_count() == size
            for last in range(m)
            if mask >> last & 1
        ]
        source = [
            [before[mask ^ 1 << last, k] for k in range(m) if k != last and mask >> k & 1]
            for mask, last in states
        ]
        masks, lasts = zip(*states, strict=True)
        stages.append(_Stage(np.array(source), np.array(lasts), np.array(masks)))
        before = {state: number for number, state in enumerate(states)}
    return tuple(stages)


@lru_cache
def _subsets(m: int) -> tuple[Array, ...]:
    """Return the subsets of each set of m evaders, as bits."""
    return tuple(
        np.array([part for part in range(mask + 1) if part & mask == part])
        for mask in range(1 << m)
    )


class CaptureProblem(NamedTuple):
    """Input of `sequence_captures`: b games of n pursuers and m evaders.

    Attributes:
        game: of every pair; its numbers are single or (b, n, m).
        pursuers_m: positions, (b, n, 3), m.
        evaders_m: positions, (b, m, 3), m.
        target_m: position of each evader's target, (b, m, 3), m.
        foreseen: how the evaders run.
        plays: which pursuers may capture which evaders, (b, n, m).
        holds: number of the evader whose capture each pursuer has promised, (b, n); −1 for none.
        bound: which pursuers have promised another capture after that, and take nothing before it, (b, n).
        spare_s: least slack of a promise, s.
    """

    game: Game
    pursuers_m: Array
    evaders_m: Array
    target_m: Array
    foreseen: Foreseen
    plays: Array
    holds: Array
    bound: Array
    spare_s: float


def sequence_captures(scene: CaptureProblem) -> CaptureSequences:
    """Return the sequences that capture the most evaders in time, if these run as foreseen."""
    if scene.plays.shape[-1] > MOST:
        b, n, m = scene.plays.shape
        rows = np.arange(b)
        pairs_run_m_s = scene.foreseen.run_m_s[:, None]
        soonest_s, _ = lead_and_place(
            scene.game, scene.pursuers_m[:, :, None], scene.evaders_m[:, None], pairs_run_m_s
        )
        begins = np.full((b, n), -1)
        captured = np.zeros(b, dtype=int)
        # A promised evader is left to its pursuer
        is_taken = (scene.holds[..., None] == np.arange(m)).any(axis=1)
        for pursuer in range(n):
            own = scene.holds[:, pursuer, None] == np.arange(m)
            free = scene.plays[:, pursuer] & (~is_taken | own)
            score_s = np.where(own, -1.0, np.where(free, soonest_s[:, pursuer], np.inf))
            some = np.argsort(score_s, axis=-1, kind="stable")[:, :MOST]
            best, first = _sequence_of_one(scene, pursuer, some, free)
            begins[:, pursuer] = np.where(first < 0, -1, taken(some, first))
            in_sequence = (best[:, None] >> np.arange(MOST)) & 1 > 0
            is_taken[rows[:, None], some] |= in_sequence
            captured += in_sequence.sum(axis=-1)
        return CaptureSequences(begins, captured)
    return _packed(*_worth_of_sets(scene))


class _Flown(NamedTuple):
    """The best flights that capture some sets of evaders, each with a given last one: arrays (b, n, states).

    Attributes:
        time_s: when the last evader is captured; infinite if one of the set is not captured in time.
        place_m: where the pursuer is then, (b, n, states, 3).
        first: the evader that is captured first.
        worth: of the captures.
    """

    time_s: Array
    place_m: Array
    first: Array
    worth: Array


def _worth_of_sets(scene: CaptureProblem) -> tuple[Array, Array]:
    """Return the worth of every set of evaders (as bits) for each pursuer, and its first evader, (b, n, 2ᵐ)."""
    b, n, m = scene.plays.shape
    every = np.arange(m)
    worth = np.full((b, n, 1 << m), -np.inf)
    begin = np.full((b, n, 1 << m), -1)
    worth[..., 0] = 0.0
    start_m = np.broadcast_to(scene.pursuers_m[:, :, None], (b, n, m, 3))
    time_s, place_m = _fly_on(scene, np.zeros((b, n, m)), start_m, every, 1 << every)
    count = _early(time_s, scene.foreseen.until_s[:, None])
    flown = _Flown(time_s, place_m, np.broadcast_to(every, (b, n, m)), count)
    _enter(worth, begin, 1 << every, flown)
    for stage in _stages(m):
        if not np.isfinite(flown.time_s).any():
            break
        states, size = stage.source.shape
        source = stage.source.ravel()
        time_s, place_m = _fly_on(
            scene,
            flown.time_s[..., source],
            flown.place_m[..., source, :],
            np.repeat(stage.last, size),
            np.repeat(stage.mask, size),
        )
        time_s = time_s.reshape(b, n, states, size)
        best = np.argmin(time_s, axis=-1)
        came = np.take_along_axis(np.broadcast_to(stage.source, time_s.shape), best[..., None], -1)
        place_m = place_m.reshape(b, n, states, size, 3)
        soonest_s = taken(time_s, best)
        before = np.take_along_axis(flown.worth, came[..., 0], axis=-1)
        flown = _Flown(
            soonest_s,
            taken(place_m, best),
            np.take_along_axis(flown.first, came[..., 0], axis=-1),
            before + _early(soonest_s, scene.foreseen.until_s[:, None, stage.last]),
        )
        _enter(worth, begin, stage.mask, flown)
    # A pursuer's sequence contains its promise
    held = _bits(scene.holds)[..., None]
    broken = (held > 0) & ((np.arange(1 << m) & held) == 0)
    broken[..., 0] = False
    return np.where(broken, -np.inf, worth), begin


def _fly_on(
    scene: CaptureProblem, begin_s: Array, place_m: Array, last: Array, mask: Array
) -> tuple[Array, Array]:
    """Fly on to one more evader of each state; return times, (b, n, states), infinite if too late, and places then.

    Args:
        scene: the games.
        begin_s: when the flights begin, (b, n, states), s.
        place_m: where, (b, n, states, 3), m.
        last: the evaders, (states,).
        mask: evaders captured then, as bits, (states,).
    """
    run_m_s = scene.foreseen.run_m_s[:, None, last]
    since_s = np.where(np.isfinite(begin_s), begin_s, 0.0)
    there_m = scene.evaders_m[:, None, last] + since_s[..., None] * run_m_s
    game = for_rows(scene.game, lambda value: value[..., last])
    leg_s, met_m = lead_and_place(game, place_m, there_m, run_m_s)
    time_s = begin_s + leg_s
    in_time = scene.plays[..., last] & (time_s < scene.foreseen.until_s[:, None, last])
    held = _bits(scene.holds)[..., None]
    is_open = (held > 0) & ((mask & held) == 0)
    if is_open.any():
        # The promise has to hold until its evader is captured
        keeps = np.zeros(is_open.shape, dtype=bool)
        if game.target_extent.is_point and game.target_velocity_m_s == NO_WIND:
            at = place_of(scene.holds, 1)
            arrival_s = arrivals(scene.game, scene.evaders_m, scene.target_m)[at]
            guard_s = guards(game, met_m, scene.target_m[at][:, :, None])
            keeps = time_s + guard_s + scene.spare_s < arrival_s[..., None]
            keeps &= ~scene.bound[..., None]
        in_time &= keeps | ~is_open
    return np.where(in_time, time_s, np.inf), met_m


def _bits(numbers: Array) -> Array:
    """Return numbers of evaders as bits, 0 for none."""
    return np.where(numbers < 0, 0, 1 << np.maximum(numbers, 0))


def _early(time_s: Array, until_s: Array) -> Array:
    """Return the worth of captures; −∞ if they do not come in time."""
    share = np.where(np.isfinite(until_s), time_s / until_s, 0.0)
    return np.where(np.isfinite(time_s), 1.0 + EARLY * (1.0 - share), -np.inf)


def _enter(worth: Array, begin: Array, masks: Array, flown: _Flown) -> None:
    """Enter the flights of some sets where they count more than others of the same set."""
    for number, mask in enumerate(masks):
        better = flown.worth[..., number] > worth[..., mask]
        worth[..., mask] = np.where(better, flown.worth[..., number], worth[..., mask])
        begin[..., mask] = np.where(better, flown.first[..., number], begin[..., mask])


def lead_and_place(game: Game, P: Array, E: Array, run_m_s: Array) -> tuple[Array, Array]:
    """Return when a pursuer captures an evader that keeps its velocity, s, and where it is then, (..., 3), m."""
    run = components(run_m_s)
    with np.errstate(all="ignore"):
        time_s, velocity = lead(NUMPY, game, components(P), components(E), run)
        if not game.pursuer.separate:
            velocity_m_s = np.stack(np.broadcast_arrays(*velocity), axis=-1)
            return time_s, P + np.asarray(time_s)[..., None] * velocity_m_s
        # A part of the way may be done sooner, and is held then
        state = take_apart(NUMPY, game, components(P), components(E), run)
        x = state.to_evader[0] + time_s * state.hold[0]
        y = state.to_evader[1] + time_s * state.hold[1]
        far = NUMPY.norm2((x, y))
        reach = game.standoff.radius_m + game.capture_radius_m
        share = np.maximum(1.0 - reach / np.where(far > 0, far, 1.0), 0.0)
        within = np.clip(state.z, -game.capture_radius_m, game.capture_radius_m)
        return time_s, P + np.stack([share * x, share * y, within - state.z], axis=-1)


def guards(game: Game, P: Array, T: Array) -> Array:
    """Return how soon pursuers could capture an evader at a target that is a point, (...), s."""
    state = take_apart(NUMPY, game, components(P), components(T), None)
    with np.errstate(all="ignore"):
        return np.asarray(guard_time(NUMPY, game, state, (0.0, 0.0)))


def arrivals(game: Game, E: Array, T: Array) -> Array:
    """Return how soon each evader can be at its target, (..., m), s."""
    x, y, _ = to_target(NUMPY, game, components(E), components(T))
    speed_m_s = evader_speeds(game) + math.hypot(*game.target_velocity_m_s)
    return np.asarray(NUMPY.norm2((x, y)) / speed_m_s)


def evader_speeds(game: Game) -> Array:
    """Return the speed of each evader, (..., m), or one number, from the game of every pair, m/s."""
    speed_m_s = np.asarray(game.evader_speed_m_s)
    return speed_m_s[..., 0, :] if speed_m_s.ndim > 1 else speed_m_s


def _packed(worth: Array, first: Array) -> CaptureSequences:
    """Choose a set for each pursuer, all disjoint, so that they count most together."""
    b, n, sets = worth.shape
    subsets = _subsets(sets.bit_length() - 1)
    rows = np.arange(b)
    best = np.full((b, sets), -np.inf)
    best[:, 0] = 0.0
    chosen = np.zeros((n, b, sets), dtype=np.intp)
    for pursuer in range(n):
        new = np.empty_like(best)
        for mask, parts in enumerate(subsets):
            counts = best[:, mask ^ parts] + worth[:, pursuer, parts]
            which = np.argmax(counts, axis=1)
            new[:, mask] = counts[rows, which]
            chosen[pursuer, :, mask] = parts[which]
        best = new
    mask = np.argmax(best, axis=1)
    captured = np.bitwise_count(mask).astype(int)
    begins = np.empty((b, n), dtype=first.dtype)
    for pursuer in reversed(range(n)):
        part = chosen[pursuer, rows, mask]
        begins[:, pursuer] = np.where(part > 0, first[rows, pursuer, part], -1)
        mask = mask ^ part
    return CaptureSequences(begins, captured)


def _sequence_of_one(
    scene: CaptureProblem, pursuer: int, some: Array, free: Array
) -> tuple[Array, Array]:
    """Return the best set of some evaders for one pursuer, as bits, and its first evader, (b,), among these.

    Args:
        scene: the games.
        pursuer: its number.
        some: numbers of the evaders, (b, MOST), that it has promised first.
        free: which evaders it may capture, (b, m).
    """
    rows = np.arange(len(some))[:, None]

    def of_some(value: Array) -> Array:
        return value[rows, pursuer, some][:, None]

    alone = CaptureProblem(
        game=for_rows(scene.game, of_some),
        pursuers_m=scene.pursuers_m[:, pursuer : pursuer + 1],
        evaders_m=scene.evaders_m[rows, some],
        target_m=scene.target_m[rows, some],
        foreseen=Foreseen(*(part[rows, some] for part in scene.foreseen)),
        plays=free[rows, some][:, None],
        holds=np.minimum(scene.holds[:, pursuer : pursuer + 1], 0),
        bound=scene.bound[:, pursuer : pursuer + 1],
        spare_s=scene.spare_s,
    )
    worth, first = _worth_of_sets(alone)
    best = np.argmax(worth[:, 0], axis=-1)
    return best, taken(first[:, 0], best)


def foresee_runs(game: Game, E: Array, T: Array, shown_m_s: Array) -> Foreseen:
    """Return how evaders run on that have shown a mean velocity, (..., m, 3), m/s.

    One that comes closer to its target at more than half its speed is foreseen to come on as fast, straight. Another
    one keeps its velocity. It is foreseen to turn where it is closest to its target, and then to run there.
    """
    x, y, _ = to_target(NUMPY, game, components(E), components(T))
    v = evader_speeds(game)
    far_m = NUMPY.norm2((x, y))
    to = np.stack([x, y, 0.0 * x], axis=-1) / np.where(far_m > 0, far_m, 1.0)[..., None]
    closing_m_s = np.sum(shown_m_s * to, axis=-1)
    comes = closing_m_s > 0.5 * v
    comes_until_s = far_m / np.where(comes, closing_m_s, v)
    square = np.sum(shown_m_s**2, axis=-1)
    nearest_s = far_m * np.maximum(closing_m_s, 0.0) / np.where(square > 0, square, 1.0)
    passed_x = x - nearest_s * shown_m_s[..., 0]
    passed_y = y - nearest_s * shown_m_s[..., 1]
    turns_until_s = nearest_s + NUMPY.norm2((passed_x, passed_y)) / v
    run_m_s = np.where(comes[..., None], closing_m_s[..., None] * to, shown_m_s)
    return Foreseen(run_m_s, np.where(comes, comes_until_s, turns_until_s))
