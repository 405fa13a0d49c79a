"""Simulate two policies with point masses to the end of the game, for one game or a batch.

A step of `Exact` is never longer than a share of the least time to the end: the distance to the capture, or from the
evader to its target, divided by the largest closing speed. So no end is missed, however short the encounter, and the
steps shorten until the end is a nanosecond away; "the first sample below ε" would have the error of a whole step. A
Runge-Kutta step of fourth order follows the curve of a pure pursuit.

`Paper` is the stepping behind the published tables: explicit Euler at 0.01 s, capture at the first sample with
‖P − E‖ < 0.01 m, time counted in samples (one more than the steps), the final distance read at the pursuer.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple, TypeAlias

from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, component, components, vectors
from guidance.game.game import Ball, Game, wind_speed
from guidance.game.pe import TOUCH_M, take_apart, to_target, vertical_speed
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy
from guidance.game.records import is_zero, require
from guidance.game.rows import leading_shape
from guidance.game.solution import solve

SHARE = {1: 1.0, 4: 0.5}
"""Longest step as a share of the least time to the end, by order; Runge-Kutta must not look past the end."""

NANOSECOND_S = 1e-9

SPARE_STEPS = 10_000
"""Steps that a game may take beyond those of its duration, to close in on its end."""


class End(IntEnum):
    """The end of a game."""

    RUNNING = 0
    CAPTURED = 1
    ARRIVED = 2
    TIME_UP = 3
    NO_ANSWER = 4
    """A state or a velocity is not finite."""


@dataclass(frozen=True, slots=True)
class Exact:
    """Adaptive steps of at most `step_s`, by Runge-Kutta (order 4) or with the velocity kept over the step (order 1).

    Raises:
        ConfigError: the step is not positive, or the order neither 1 nor 4.
    """

    step_s: float = 0.01
    order: Literal[1, 4] = 4

    def __post_init__(self) -> None:
        require("step_s", self.step_s)
        if self.order not in (1, 4):
            raise ConfigError(f"order = {self.order!r}: must be 1 or 4")


@dataclass(frozen=True, slots=True)
class Paper:
    """The stepping of the published tables.

    Raises:
        ConfigError: a number is not positive.
    """

    step_s: float = 0.01
    capture_m: float = 0.01

    def __post_init__(self) -> None:
        require("step_s", self.step_s)
        require("capture_m", self.capture_m)


class Sample(NamedTuple):
    """A moment of a batch of games: time (...), positions (..., 3) of P, E and T, and each game's end."""

    time_s: Array
    pursuer_m: Array
    evader_m: Array
    target_m: Array | None
    end: Array


EXACT = Exact()

Velocities: TypeAlias = Callable[[Array, Array, Array | None, Array], tuple[Array, Array]]


class Rollout(NamedTuple):
    """The end of a game, or of each game of a batch.

    Attributes:
        end: `End`, (...).
        time_s: time of the end, (...).
        pursuer_m: final position of the pursuer, (..., 3).
        evader_m: final position of the evader, (..., 3).
        distance_m: final distance of the evader from its target, (...), NaN without one; of the pursuer with `Paper`.
        path: every sample with `keep_path`, else empty; the players of an ended game do not move.
    """

    end: Array
    time_s: Array
    pursuer_m: Array
    evader_m: Array
    distance_m: Array
    path: tuple[Sample, ...]


def rollout(
    game: Game,
    pursuer: ArrayLike,
    evader: ArrayLike,
    target: ArrayLike | None = None,
    *,
    pursuer_policy: str | Policy = "optimal",
    evader_policy: str | Policy = "optimal",
    stepping: Exact | Paper = EXACT,
    duration_s: float = 600.0,
    keep_path: bool = False,
) -> Rollout:
    """Play a game to its end.

    Args:
        game: the game, without information age (τ = 0).
        pursuer: initial position P, (..., 3), m.
        evader: initial position E, (..., 3), m.
        target: initial position T, (..., 3), m, or None for PE; it moves as the game says.
        pursuer_policy: a name in `PURSUER_POLICIES`, or a policy.
        evader_policy: a name in `EVADER_POLICIES`, or a policy.
        stepping: how time advances.
        duration_s: when to stop at the latest.
        keep_path: whether to keep every sample.

    Raises:
        ConfigError: as `solve`; an unknown policy; or an information age.
    """
    require("duration_s", duration_s)
    if not is_zero(game.information_age_s):
        raise ConfigError(
            f"information_age_s = {game.information_age_s!r}: must be 0, because a rollout keeps no past positions"
        )
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | ({} if target is None else {"target": target}))
    P, E, T = given["pursuer"], given["evader"], given.get("target")
    shape = leading_shape(game, given)
    velocities = _velocities(game, pursuer_policy, evader_policy)
    zero = xp.pack(shape, P, 0.0)
    start = Sample(
        zero,
        P + zero[..., None],
        E + zero[..., None],
        None if T is None else T + zero[..., None],
        xp.where(zero == 0, int(End.RUNNING), int(End.NO_ANSWER)),
    )
    path = []
    with xp.quiet():
        samples = (
            _exact_samples(xp, game, start, velocities, stepping, duration_s)
            if isinstance(stepping, Exact)
            else _published_samples(xp, game, start, velocities, stepping, duration_s)
        )
        for last in samples:
            if keep_path:
                path.append(last)
        place = last.evader_m if isinstance(stepping, Exact) else last.pursuer_m
        distance = zero * math.nan if last.target_m is None else _distance(xp, game, last.target_m, place)
    return Rollout(last.end, last.time_s, last.pursuer_m, last.evader_m, distance, tuple(path))


def _distance(xp: Library, game: Game, target: Array, place: Array) -> Array:
    x, y, _ = to_target(xp, game, components(place), components(target))
    z = component(target, 2) - component(place, 2)
    return xp.sqrt(x * x + y * y + z * z)


def _velocities(game: Game, pursuer_policy: str | Policy, evader_policy: str | Policy) -> Velocities:
    """Return both players' velocities as one function; two optimal players are solved once."""
    if pursuer_policy == "optimal" and evader_policy == "optimal":

        def both(P: Array, E: Array, T: Array | None, seen: Array) -> tuple[Array, Array]:
            solution = solve(game, P, E, T, evader_velocity_m_s=seen)
            return solution.pursuer_velocity_m_s, solution.evader_velocity_m_s

        return both
    chase = _policy("pursuer_policy", pursuer_policy, PURSUER_POLICIES)
    flee = _policy("evader_policy", evader_policy, EVADER_POLICIES)

    def each(P: Array, E: Array, T: Array | None, seen: Array) -> tuple[Array, Array]:
        return chase(game, P, E, T, seen), flee(game, P, E, T, seen)

    return each


def _policy(name: str, policy: str | Policy, catalogue: Mapping[str, Policy]) -> Policy:
    if not isinstance(policy, str):
        return policy
    if policy not in catalogue:
        raise ConfigError(
            f"{name} = {policy!r}: must be one of {', '.join(catalogue)}, or a function "
            "`Policy`; strategies with a memory and courses are played by scenarios"
        )
    return catalogue[policy]


def _exact_samples(
    xp: Library, game: Game, sample: Sample, velocities: Velocities, stepping: Exact, duration_s: float
) -> Iterator[Sample]:
    """Step up to the end and no further."""
    seen, share = 0.0 * sample.evader_m, SHARE[stepping.order]
    for _ in range(math.ceil(duration_s / stepping.step_s) + SPARE_STEPS):
        ahead = look_ahead(xp, game, sample.pursuer_m, sample.evader_m, sample.target_m)
        sample = sample._replace(end=_judge(xp, sample, ahead.capture_s, ahead.arrival_s, duration_s))
        yield sample
        running = sample.end == End.RUNNING
        if not bool(xp.any(running)):
            return
        h = duration_s - sample.time_s
        for limit in (share * ahead.capture_s, share * ahead.arrival_s, ahead.turn_s):
            h = xp.where(limit < h, limit, h)
        h = xp.where(running, xp.where(h < stepping.step_s, h, stepping.step_s), 0.0)
        sample, seen = _advance(xp, game, sample, velocities, h, seen, stepping.order)
    yield sample._replace(end=xp.where(sample.end == End.RUNNING, int(End.TIME_UP), sample.end))


def _judge(xp: Library, sample: Sample, capture_s: Array, arrival_s: Array, duration_s: float) -> Array:
    """Return the end of each game; capture counts before arrival at the same instant."""
    now = xp.where(sample.time_s >= duration_s, int(End.TIME_UP), int(End.RUNNING))
    now = xp.where(arrival_s <= NANOSECOND_S, int(End.ARRIVED), now)
    now = xp.where(capture_s <= NANOSECOND_S, int(End.CAPTURED), now)
    now = xp.where(capture_s - capture_s == 0, now, int(End.NO_ANSWER))
    return xp.where(sample.end == End.RUNNING, now, sample.end)


def _published_samples(
    xp: Library, game: Game, sample: Sample, velocities: Velocities, stepping: Paper, duration_s: float
) -> Iterator[Sample]:
    """Step, then check, as the published simulation does."""
    seen = 0.0 * sample.evader_m
    count = math.ceil(duration_s / stepping.step_s)
    index = 0
    while True:
        index += 1
        near = xp.norm3(components(sample.pursuer_m - sample.evader_m)) < stepping.capture_m
        now = xp.where(near, int(End.CAPTURED), int(End.TIME_UP if index >= count else End.RUNNING))
        running = sample.end == End.RUNNING
        time = xp.where(running, index * stepping.step_s, sample.time_s)
        sample = sample._replace(end=xp.where(running, now, sample.end), time_s=time)
        yield sample
        running = sample.end == End.RUNNING
        if not bool(xp.any(running)):
            return
        h = xp.where(running, stepping.step_s, 0.0)
        sample, seen = _advance(xp, game, sample, velocities, h, seen, 1)


def _advance(
    xp: Library, game: Game, sample: Sample, velocities: Velocities, h: Array, seen: Array, order: int
) -> tuple[Sample, Array]:
    """Advance every game by its own h; return also the evader's velocity."""
    drift = xp.constant(sample.pursuer_m, (*game.target_velocity_m_s, 0.0))
    step = h[..., None] if hasattr(h, "shape") else h
    P, E, T = sample.pursuer_m, sample.evader_m, sample.target_m

    def at(share: float, slope: tuple[Array, Array]) -> tuple[Array, Array]:
        then = None if T is None else T + share * step * drift
        return velocities(P + share * step * slope[0], E + share * step * slope[1], then, seen)

    first = velocities(P, E, T, seen)
    mean: tuple[Array, ...] = first
    if order != 1:
        second = at(0.5, first)
        third = at(0.5, second)
        last = at(1.0, third)
        mean = tuple((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(first, second, third, last, strict=True))
    moved = sample._replace(
        time_s=sample.time_s + h,
        pursuer_m=P + step * mean[0],
        evader_m=E + step * mean[1],
        target_m=None if T is None else T + step * drift,
    )
    return moved, first[1]


class Ahead(NamedTuple):
    """Least times, s, to events.

    Attributes:
        capture_s: until the evader can be captured.
        arrival_s: until the evader can be at its target; infinite without a target.
        turn_s: until a Cylinder reaches the height of its disc and holds it; infinite for a Ball.
    """

    capture_s: Array
    arrival_s: Array
    turn_s: Array


def look_ahead(xp: Library, game: Game, pursuer: Array, evader: Array, target: Array | None) -> Ahead:
    """Return the least times to the ends of a game, from positions (..., 3).

    A Cylinder is captured slightly outside the distance at which it holds, so that it gets there.

    Args:
        xp: array library.
        game: speeds, capture radius, stand-off, wind and drift.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
    """
    state = take_apart(xp, game, components(pursuer), components(evader), None)
    closing = game.pursuer.horizontal_m_s + game.evader_speed_m_s + wind_speed(game)
    capture, turn = game.capture_radius_m, math.inf
    beside = xp.norm2(state.to_evader) - game.standoff.radius_m
    if isinstance(game.pursuer, Ball):
        ahead = xp.maximum(xp.norm2((xp.maximum(beside, 0.0), state.z)) - capture, 0.0) / closing
    else:
        met = capture + 2.0 * TOUCH_M
        above = (abs(state.z) - met) / vertical_speed(xp, game.pursuer, state.z)
        ahead = xp.maximum(xp.maximum((beside - met) / closing, above), 0.0)
        over = abs(state.z) - capture
        inside = (over - 0.5 * TOUCH_M) / vertical_speed(xp, game.pursuer, state.z)
        turn = xp.select(over > TOUCH_M, inside, math.inf)
    if target is None:
        return Ahead(ahead, math.inf, turn)
    x, y, z = to_target(xp, game, components(evader), components(target))
    speed = game.evader_speed_m_s + math.hypot(*game.target_velocity_m_s)
    return Ahead(ahead, xp.sqrt(x * x + y * y + z * z) / speed, turn)
