"""Policies without memory by name: the paper's optimum, its baselines, lead pursuit, and standing still.

A policy is a function of a game and of arrays (..., 3). Policies with memory, and courses, are in
`guidance.strategies`. Every baseline moves at full speed, as in section V of the paper.
"""
# ruff: noqa: ARG001, ARG005 - every policy takes the arguments of `Policy`

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

from numpy.typing import ArrayLike

from guidance.errors import ConfigError
from guidance.game.arrays import Array, Library, Plane, Real, Space, plus2
from guidance.game.extent import POINT
from guidance.game.game import Game
from guidance.game.pe import fly_to, take_apart, to_target
from guidance.game.rows import vector_of
from guidance.game.solution import solve
from guidance.game.tad import guard_time

Known: TypeAlias = ArrayLike | None


class Policy(Protocol):
    """A feedback policy of one player."""

    def __call__(
        self,
        game: Game,
        pursuer: ArrayLike,
        evader: ArrayLike,
        target: Known = None,
        evader_velocity_m_s: Known = None,
    ) -> Array:
        """Return the player's velocity over the ground, (..., 3), m/s.

        Args:
            game: the game.
            pursuer: position P, (..., 3), m.
            evader: position E, (..., 3), m.
            target: position T, (..., 3), m; None in PE.
            evader_velocity_m_s: the evader's velocity as observed, (..., 3), if known.
        """


def _policy(move: Callable[[Game, dict[str, Any]], Array]) -> Policy:
    """Return a policy of a function of a game and of the other arguments by name."""

    def play(
        game: Game,
        pursuer: ArrayLike,
        evader: ArrayLike,
        target: Known = None,
        evader_velocity_m_s: Known = None,
    ) -> Array:
        state = {
            "pursuer": pursuer,
            "evader": evader,
            "target": target,
            "evader_velocity_m_s": evader_velocity_m_s,
        }
        return move(game, state)

    return play


def _moving(
    kernel: Callable[[Library, Game, Space, Space, Space | None, Space | None], Space],
) -> Policy:
    """Return the policy of a kernel: a function of the components of P, E, T and the evader's velocity."""
    return _policy(lambda game, state: vector_of(kernel, game, state))


def _goal(xp: Library, game: Game, E: Space, T: Space | None) -> Plane:
    """Return the target's point that is nearest to the evader."""
    if T is None:
        raise ConfigError("target = None: the policy 'task_oriented' needs a target")
    if game.target_extent == POINT:
        return T[:2]
    offset = to_target(xp, game, E, T)
    return E[0] + offset[0], E[1] + offset[1]


def _fly(xp: Library, game: Game, P: Space, E: Space, aim: Plane, observed: Space | None) -> Space:
    """Fly the pursuer straight to the disc around `aim`; there hold, or follow `observed`."""
    state = take_apart(xp, game, P, E, observed)
    goal = plus2(aim, -1.0, state.evader)
    to = plus2(state.to_evader, 1.0, goal)
    time_s = guard_time(xp, game, state, goal)
    return fly_to(xp, game, state, to, time_s)


def _run(xp: Library, game: Game, E: Space, point: Plane, *, away: bool) -> Space:
    """Run the evader away from a point, or to it; along the x axis if it is there and runs away."""
    offset = (point[0] - E[0], point[1] - E[1])
    length = xp.norm2(offset)
    direction = xp.unit2(offset, length)
    speed_m_s = game.evader_speed_m_s
    pace: Real = -speed_m_s
    if not away:
        pace = xp.select(length > 0, speed_m_s, 0.0)
    return pace * direction[0], pace * direction[1], 0.0


def _lead(
    xp: Library, game: Game, P: Space, E: Space, T: Space | None, observed: Space | None
) -> Space:
    """Fly the pursuer to the point of capture of an evader that keeps its velocity."""
    if observed is None:
        raise ConfigError("evader_velocity_m_s = None: the policy 'lead_pursuit' needs it")
    return lead(xp, game, P, E, observed)[1]


def lead(xp: Library, game: Game, P: Space, E: Space, observed: Space) -> tuple[Real, Space]:
    """Return when a pursuer captures an evader that keeps its velocity, s, and the pursuer's velocity for it, m/s."""
    state = take_apart(xp, game, P, E, observed)
    in_air = plus2(state.hold, -1.0, game.wind_m_s)
    radius = game.standoff.radius_m
    capture = game.capture_radius_m
    t = game.pursuer.catch_time(xp, radius, capture, state.to_evader, in_air, state.z)
    to = plus2(state.to_evader, t, state.hold)
    return t, fly_to(xp, game, state, to, t)


def _stay(
    xp: Library, game: Game, P: Space, E: Space, T: Space | None, observed: Space | None
) -> Space:
    return 0.0 * (P[0] + E[0]), 0.0 * (P[1] + E[1]), 0.0 * (P[2] + E[2])


PURSUER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        # The pursuer's part of `solve`: eq. (20) of the paper in PE, eq. (49) in TAD, straight to T if E wins.
        "optimal": _policy(lambda game, state: solve(game, **state).pursuer_velocity_m_s),
        # Straight at the evader, to the stand-off disc around it.
        "pure_pursuit": _moving(
            lambda xp, game, P, E, T, observed: _fly(xp, game, P, E, E[:2], observed)
        ),
        # Straight to the target, to the stand-off disc around it.
        "task_oriented": _moving(
            lambda xp, game, P, E, T, observed: _fly(xp, game, P, E, _goal(xp, game, E, T), None)
        ),
        "hold": _moving(_stay),
        # To where an evader that keeps its velocity is captured; an error if its velocity is not given.
        "lead_pursuit": _moving(_lead),
    }
)
"""Every policy of the pursuer without a memory, by name."""

EVADER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        # The evader's part of `solve`: eq. (20) of the paper in PE, eq. (44) in TAD, straight to T if it wins.
        "optimal": _policy(lambda game, state: solve(game, **state).evader_velocity_m_s),
        # Straight away from the pursuer, in the plane.
        "pure_evade": _moving(
            lambda xp, game, P, E, T, observed: _run(xp, game, E, P[:2], away=True)
        ),
        # Straight to the target, and stay there.
        "task_oriented": _moving(
            lambda xp, game, P, E, T, observed: _run(xp, game, E, _goal(xp, game, E, T), away=False)
        ),
        "hold": _moving(_stay),
    }
)
"""Every policy of the evader without a memory, by name."""


def policy_of(name: str, policy: str | Policy, catalogue: Mapping[str, Policy]) -> Policy:
    """Return a policy that is given by its name or as a function.

    Raises:
        ConfigError: the catalogue has no policy of this name.
    """
    if not isinstance(policy, str):
        return policy
    if policy not in catalogue:
        allowed = f"must be one of {', '.join(catalogue)}, or a function `Policy`"
        others = "strategies with a memory and courses are played by scenarios"
        raise ConfigError(f"{name} = {policy!r}: {allowed}; {others}")
    return catalogue[policy]
