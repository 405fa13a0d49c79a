"""Strategies without memory by name: the paper's optimum, its baselines, lead pursuit, and standing still.

A policy is a function of a game and of arrays (..., 3). Strategies with memory, and courses, are in
`guidance.strategies`. Every baseline moves at full speed, as in section V of the paper.
"""
# ruff: noqa: ARG001, ARG005 - every policy takes the arguments of `Policy`

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from guidance.errors import ConfigError
from guidance.game.arrays import (
    Array,
    component,
    components,
    components_or_none,
    norm2,
    pack,
    quiet,
    select,
    unit2,
    vectors,
)
from guidance.game.extent import POINT
from guidance.game.pe import steer, take_apart, to_target
from guidance.game.rows import leading_shape
from guidance.game.solution import solve
from guidance.game.tad import catch_time, guard_time

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike

    from guidance.game.game import Game
    from guidance.game.solution import Solution

    _Move = Callable[[Game, ArrayLike, ArrayLike, ArrayLike | None, ArrayLike | None], Array]


class Policy(Protocol):
    """A feedback strategy of one player."""

    def __call__(
        self,
        game: Game,
        pursuer: ArrayLike,
        evader: ArrayLike,
        target: ArrayLike | None = None,
        evader_velocity_m_s: ArrayLike | None = None,
    ) -> Array:
        """Return the player's velocity over the ground, (..., 3), m/s.

        Args:
            game: the game.
            pursuer: position P, (..., 3), m.
            evader: position E, (..., 3), m.
            target: position T, (..., 3), m; None in PE.
            evader_velocity_m_s: the evader's velocity as observed, (..., 3), if known.
        """


def _policy(move: _Move) -> Policy:
    """Return a policy of a function that gets every argument by position."""

    def play(
        game: Game,
        pursuer: ArrayLike,
        evader: ArrayLike,
        target: ArrayLike | None = None,
        evader_velocity_m_s: ArrayLike | None = None,
    ) -> Array:
        return move(game, pursuer, evader, target, evader_velocity_m_s)

    return play


def _solved(game: Game, P: ArrayLike, E: ArrayLike, T: ArrayLike | None, seen: ArrayLike | None) -> Solution:
    return solve(game, P, E, T, evader_velocity_m_s=seen)


def _stay(game: Game, P: ArrayLike, E: ArrayLike, T: ArrayLike | None, seen: ArrayLike | None) -> Array:
    _, given = vectors({"pursuer": P, "evader": E})
    return 0.0 * (given["pursuer"] + given["evader"])


def _goal(game: Game, evader: ArrayLike, target: ArrayLike | None) -> ArrayLike:
    """Return the target's point that is nearest to the evader."""
    if target is None:
        raise ConfigError("target = None: the strategy 'task_oriented' needs a target")
    if game.target_extent == POINT:
        return target
    xp, given = vectors({"evader": evader, "target": target})
    shape, E = leading_shape(game, given), given["evader"]
    with quiet(xp):
        way = to_target(xp, game, components(E), components(given["target"]))
        return pack(xp, shape, E, (component(E, 0) + way[0], component(E, 1) + way[1], component(given["target"], 2)))


def _fly_straight(game: Game, pursuer: ArrayLike, evader: ArrayLike, aim: ArrayLike, seen: ArrayLike | None) -> Array:
    """Fly the pursuer straight to the disc around `aim`; there hold, or follow `seen`."""
    observed = {} if seen is None else {"evader_velocity_m_s": seen}
    xp, given = vectors({"pursuer": pursuer, "evader": evader, "aim": aim} | observed)
    shape, at = leading_shape(game, given), given["aim"]
    with quiet(xp):
        moving = components_or_none(given.get("evader_velocity_m_s"))
        state = take_apart(xp, game, components(given["pursuer"]), components(given["evader"]), moving)
        goal = (component(at, 0) - state.evader[0], component(at, 1) - state.evader[1])
        to = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
        gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
        flown = steer(xp, game, to, gap, guard_time(xp, game, state, goal), state.z, state.hold)
        return pack(xp, shape, at, flown)


def _run(game: Game, evader: ArrayLike, point: ArrayLike, *, away: bool) -> Array:
    """Run the evader away from a point, or to it; along the x axis if it is there and runs away."""
    xp, given = vectors({"evader": evader, "point": point})
    shape, E, at = leading_shape(game, given), given["evader"], given["point"]
    with quiet(xp):
        way = (component(at, 0) - component(E, 0), component(at, 1) - component(E, 1))
        length = norm2(xp, way)
        direction = unit2(xp, way, length)
        pace = -game.evader_speed_m_s if away else select(xp, length > 0, game.evader_speed_m_s, 0.0)
        return pack(xp, shape, E, (pace * direction[0], pace * direction[1], 0.0))


def _lead(game: Game, pursuer: ArrayLike, evader: ArrayLike, seen: ArrayLike | None) -> Array:
    """Fly the pursuer to the point of capture of an evader that keeps its velocity."""
    observed = {} if seen is None else {"evader_velocity_m_s": seen}
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | observed)
    shape, P, E = leading_shape(game, given), given["pursuer"], given["evader"]
    with quiet(xp):
        moving = components(given.get("evader_velocity_m_s", 0.0 * E))
        state = take_apart(xp, game, components(P), components(E), moving)
        run, wind = state.hold, game.wind_m_s
        t = catch_time(xp, game, state.to_evader, (run[0] - wind[0], run[1] - wind[1]), state.z)
        to = (state.to_evader[0] + run[0] * t, state.to_evader[1] + run[1] * t)
        gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
        return pack(xp, shape, P, steer(xp, game, to, gap, t, state.z, state.hold))


PURSUER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        # The pursuer's part of `solve`: eq. (20) of the paper in PE, eq. (49) in TAD, straight to T if E wins.
        "optimal": _policy(lambda *state: _solved(*state).pursuer_velocity_m_s),
        # Straight at the evader, to the stand-off disc around it.
        "pure_pursuit": _policy(lambda game, P, E, T, seen: _fly_straight(game, P, E, E, seen)),
        # Straight to the target, to the stand-off disc around it.
        "task_oriented": _policy(lambda game, P, E, T, seen: _fly_straight(game, P, E, _goal(game, E, T), None)),
        "hold": _policy(_stay),
        # To where an evader that keeps its velocity is captured; pure pursuit if its velocity is unknown.
        "lead_pursuit": _policy(lambda game, P, E, T, seen: _lead(game, P, E, seen)),
    }
)
"""Every strategy of the pursuer without a memory, by name."""

EVADER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        # The evader's part of `solve`: eq. (20) of the paper in PE, eq. (44) in TAD, straight to T if it wins.
        "optimal": _policy(lambda *state: _solved(*state).evader_velocity_m_s),
        # Straight away from the pursuer, in the plane.
        "pure_evade": _policy(lambda game, P, E, T, seen: _run(game, E, P, away=True)),
        # Straight to the target, and stay there.
        "task_oriented": _policy(lambda game, P, E, T, seen: _run(game, E, _goal(game, E, T), away=False)),
        "hold": _policy(_stay),
    }
)
"""Every strategy of the evader without a memory, by name."""
