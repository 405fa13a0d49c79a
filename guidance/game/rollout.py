"""Simulate two policies with point masses to the end of the game, for one game or a batch.

A step of `Exact` is never longer than a share of the least time to the end: the distance to the capture, or from the
evader to its target, divided by the largest closing speed. So no end is missed, however short the encounter, and the
steps shorten until the end is a nanosecond away; "the first sample below ε" would have the error of a whole step. A
Runge-Kutta step of fourth order follows the curve of a pure pursuit.

`Paper` is the stepping behind the published tables: explicit Euler at 0.01 s, capture at the first sample with
‖P − E‖ < 0.01 m, time counted in samples (one more than the steps), the final distance read at the pursuer.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, component, components, pair_length, vectors
from guidance.game.game import Game
from guidance.game.pe import take_apart, to_target
from guidance.game.policies import EVADER_POLICIES, PURSUER_POLICIES, Policy, policy_of
from guidance.game.records import is_zero, require
from guidance.game.rows import leading_shape, varying
from guidance.game.solution import solve

SHARE = {1: 1.0, 4: 0.5}
"""Longest step as a share of the least time to the end, by order; Runge-Kutta must not look past the end."""

STAGES = (0.5, 0.5, 1.0)
"""Places within a Runge-Kutta step of fourth order, as a share of it, behind its begin."""

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

PolicyPair: TypeAlias = tuple[Policy, Policy]
"""The policies of pursuer and evader."""

OPTIMAL_PAIR: PolicyPair = (PURSUER_POLICIES["optimal"], EVADER_POLICIES["optimal"])


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
        allowed = "must be 0, because a rollout keeps no past positions"
        raise ConfigError(f"information_age_s = {game.information_age_s!r}: {allowed}")
    xp, named = vectors(
        {"pursuer": pursuer, "evader": evader} | ({} if target is None else {"target": target}),
        varying(game),
    )
    P = named["pursuer"]
    E = named["evader"]
    T = named.get("target")
    shape = leading_shape(game, named)
    chase = policy_of("pursuer_policy", pursuer_policy, PURSUER_POLICIES)
    flee = policy_of("evader_policy", evader_policy, EVADER_POLICIES)
    zero = xp.pack(shape, P, 0.0)
    wide = zero[..., None]
    end = xp.where(zero == 0, int(End.RUNNING), int(End.NO_ANSWER))
    start = Sample(zero, P + wide, E + wide, None if T is None else T + wide, end)
    path = []
    with np.errstate(all="ignore"):
        for last in _samples(xp, game, start, (chase, flee), stepping, duration_s):
            if keep_path:
                path.append(last)
        distance = zero * math.nan
        if last.target_m is not None:
            player_m = last.evader_m if isinstance(stepping, Exact) else last.pursuer_m
            x, y, _ = to_target(xp, game, components(player_m), components(last.target_m))
            distance = xp.norm3((x, y, component(last.target_m, 2) - component(player_m, 2)))
    return Rollout(last.end, last.time_s, last.pursuer_m, last.evader_m, distance, tuple(path))


def _samples(
    xp: Library,
    game: Game,
    sample: Sample,
    policies: PolicyPair,
    stepping: Exact | Paper,
    duration_s: float,
) -> Iterator[Sample]:
    """Yield every sample until all games have ended: `Exact` steps up to the end, `Paper` steps and then checks."""
    observed = 0.0 * sample.evader_m
    last = math.ceil(duration_s / stepping.step_s)
    if isinstance(stepping, Exact):
        last += SPARE_STEPS + 1
    for index in range(1, last + 1):
        running = sample.end == End.RUNNING
        if isinstance(stepping, Exact):
            order = stepping.order
            # The end of each game and its next step; capture counts before arrival at the same instant.
            ahead = look_ahead(xp, game, sample.pursuer_m, sample.evader_m, sample.target_m)
            now = xp.where(sample.time_s >= duration_s, int(End.TIME_UP), int(End.RUNNING))
            if sample.target_m is not None:
                now = xp.where(ahead.arrival_s <= NANOSECOND_S, int(End.ARRIVED), now)
            now = xp.where(ahead.capture_s <= NANOSECOND_S, int(End.CAPTURED), now)
            now = xp.where(ahead.capture_s - ahead.capture_s == 0, now, int(End.NO_ANSWER))
            h = duration_s - sample.time_s
            share = SHARE[stepping.order]
            for limit in (
                share * ahead.capture_s,
                share * ahead.arrival_s,
                ahead.turn_s,
                stepping.step_s,
            ):
                h = xp.where(limit < h, limit, h)
        else:
            order = 1
            h = stepping.step_s
            sample = sample._replace(time_s=xp.where(running, index * h, sample.time_s))
            near = xp.norm3(components(sample.pursuer_m - sample.evader_m)) < stepping.capture_m
            now = xp.where(near, int(End.CAPTURED), int(End.RUNNING))
        if index == last:
            now = xp.where(now == End.RUNNING, int(End.TIME_UP), now)
        sample = sample._replace(end=xp.where(running, now, sample.end))
        yield sample
        running = sample.end == End.RUNNING
        # Not `xp.any`, which is always true for a library that traces
        if not bool(running.any()):
            return
        sample, observed = _advance(
            xp, game, sample, policies, xp.where(running, h, 0.0), observed, order
        )


def _advance(
    xp: Library,
    game: Game,
    sample: Sample,
    policies: PolicyPair,
    h: Array,
    observed: Array,
    order: int,
) -> tuple[Sample, Array]:
    """Advance every game by its own h; return also the evader's velocity."""
    time, P, E, T, end = sample
    drift = xp.constant(P, (*game.target_velocity_m_s, 0.0))
    step = h[..., None]
    slopes = [_velocities(game, policies, P, E, T, observed)]
    for share in STAGES[: order - 1]:
        v, w = slopes[-1]
        then = None if T is None else T + share * step * drift
        slopes.append(
            _velocities(game, policies, P + share * step * v, E + share * step * w, then, observed)
        )
    v, w = slopes[0]
    if order != 1:
        v, w = ((a + 2.0 * b + 2.0 * c + d) / 6.0 for a, b, c, d in zip(*slopes, strict=True))
    return Sample(
        time + h, P + step * v, E + step * w, None if T is None else T + step * drift, end
    ), slopes[0][1]


def _velocities(
    game: Game, policies: PolicyPair, P: Array, E: Array, T: Array | None, observed: Array
) -> tuple[Array, Array]:
    """Return both players' velocities; two optimal players are solved once."""
    if policies == OPTIMAL_PAIR:
        answer = solve(game, P, E, T, evader_velocity_m_s=observed)
        return answer.pursuer_velocity_m_s, answer.evader_velocity_m_s
    chase, flee = policies
    return chase(game, P, E, T, observed), flee(game, P, E, T, observed)


class Ahead(NamedTuple):
    """Least times, s, to events.

    Attributes:
        capture_s: until the evader can be captured.
        arrival_s: until the evader can be at its target; infinite without a target.
        turn_s: until a separate speed set reaches the height of its disc and holds it; else infinite.
    """

    capture_s: Array
    arrival_s: Array
    turn_s: Array


def look_ahead(
    xp: Library, game: Game, pursuer: Array, evader: Array, target: Array | None
) -> Ahead:
    """Return the least times to the ends of a game, from positions (..., 3).

    Args:
        xp: array library.
        game: speeds, capture radius, stand-off, wind and drift.
        pursuer: position P, (..., 3), m.
        evader: position E, (..., 3), m.
        target: position T, (..., 3), m, or None for PE.
    """
    state = take_apart(xp, game, components(pursuer), components(evader), None)
    closing = game.pursuer.horizontal_m_s + game.evader_speed_m_s + pair_length(game.wind_m_s)
    capture = game.capture_radius_m
    beside = xp.norm2(state.to_evader) - game.standoff.radius_m
    capture_s, turn_s = game.pursuer.soonest(xp, capture, beside, state.z, closing)
    if target is None:
        return Ahead(capture_s, math.inf, turn_s)
    speed = game.evader_speed_m_s + math.hypot(*game.target_velocity_m_s)
    return Ahead(
        capture_s,
        xp.norm3(to_target(xp, game, components(evader), components(target))) / speed,
        turn_s,
    )
