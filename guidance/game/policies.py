"""The strategies of either player by name: the paper's optimum, its baselines, lead pursuit, and standing still.

A policy is a function of a game and of arrays (..., 3), with no memory; those with one, and courses laid out
beforehand, are in `guidance.strategies`. Every baseline moves at full speed, as in section V of the paper.
"""
# ruff: noqa: ARG001 - every strategy takes the same arguments, whether or not it looks at them

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

from guidance.errors import ConfigError
from guidance.game.arrays import Array, component, norm2, pack, select, unit2, vectors
from guidance.game.game import Game
from guidance.game.reach import catch_time, steer, take_apart
from guidance.game.solution import leading_shape, quiet, solve
from guidance.game.tad import guard_time


class Policy(Protocol):
    """A feedback strategy of one player."""

    def __call__(
        self,
        game: Game,
        pursuer: Array,
        evader: Array,
        target: Array | None = None,
        evader_velocity_m_s: Array | None = None,
    ) -> Array:
        """Return the player's velocity over the ground, (..., 3), m/s."""


def optimal_pursuer(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Play the pursuer's part of `solve`: eq. (20) of the paper in PE, eq. (49) in TAD, straight to T where E wins."""
    return solve(game, pursuer, evader, target, evader_velocity_m_s=evader_velocity_m_s).pursuer_velocity_m_s


def optimal_evader(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Play the evader's part of `solve`: eq. (20) of the paper in PE, eq. (44) in TAD, straight to T where it wins."""
    return solve(game, pursuer, evader, target, evader_velocity_m_s=evader_velocity_m_s).evader_velocity_m_s


def pure_pursuit(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Fly straight at the evader, to the stand-off disc around it."""
    return _fly_straight(game, pursuer, evader, evader, evader_velocity_m_s)


def lead_pursuit(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Fly to where the evader is caught if it keeps its velocity (the collision course).

    Without an observed velocity it is pure pursuit.
    """
    seen = {} if evader_velocity_m_s is None else {"evader_velocity_m_s": evader_velocity_m_s}
    xp, given = vectors({"pursuer": pursuer, "evader": evader} | seen)
    shape, pursuer = leading_shape(game, given), given["pursuer"]
    with quiet(xp):
        state = take_apart(xp, game, pursuer, given["evader"], given.get("evader_velocity_m_s", 0.0 * given["evader"]))
        run, wind = state.hold, game.wind_m_s
        t = catch_time(xp, game, state.to_evader, (run[0] - wind[0], run[1] - wind[1]), state.z)
        to = (state.to_evader[0] + run[0] * t, state.to_evader[1] + run[1] * t)
        gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
        return pack(xp, shape, pursuer, steer(xp, game, to, gap, t, state.z, state.hold))


def pursuer_to_target(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Task-oriented: fly straight to the target, to the stand-off disc around it."""
    return _fly_straight(game, pursuer, evader, _needed(target), None)


def pure_evade(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Run straight away from the pursuer, in the plane."""
    return _run(game, evader, pursuer, away=True)


def evader_to_target(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Task-oriented: run straight to the target, and stay there."""
    return _run(game, evader, _needed(target), away=False)


def hold(
    game: Game, pursuer: Array, evader: Array, target: Array | None = None, evader_velocity_m_s: Array | None = None
) -> Array:
    """Stay where you are."""
    _, given = vectors({"pursuer": pursuer, "evader": evader})
    return 0.0 * (given["pursuer"] + given["evader"])


PURSUER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {
        "optimal": optimal_pursuer,
        "pure_pursuit": pure_pursuit,
        "task_oriented": pursuer_to_target,
        "hold": hold,
        "lead_pursuit": lead_pursuit,
    }
)
"""Every strategy of the pursuer without a memory, by name."""

EVADER_POLICIES: Mapping[str, Policy] = MappingProxyType(
    {"optimal": optimal_evader, "pure_evade": pure_evade, "task_oriented": evader_to_target, "hold": hold}
)
"""Every strategy of the evader without a memory, by name."""


def _needed(target: Array | None) -> Array:
    if target is None:
        raise ConfigError("target = None: the strategy 'task_oriented' needs a target")
    return target


def _fly_straight(game: Game, pursuer: Array, evader: Array, aim: Array, seen: Array | None) -> Array:
    """Fly the pursuer to the disc around `aim` as if that stood still; hold, or follow `seen`, once it is there."""
    observed = {} if seen is None else {"evader_velocity_m_s": seen}
    xp, given = vectors({"pursuer": pursuer, "evader": evader, "aim": aim} | observed)
    shape, aim = leading_shape(game, given), given["aim"]
    with quiet(xp):
        state = take_apart(xp, game, given["pursuer"], given["evader"], given.get("evader_velocity_m_s"))
        goal = (component(aim, 0) - state.evader[0], component(aim, 1) - state.evader[1])
        to = (state.to_evader[0] + goal[0], state.to_evader[1] + goal[1])
        gap = norm2(xp, to) - game.standoff.radius_m - game.capture_radius_m
        flown = steer(xp, game, to, gap, guard_time(xp, game, state, goal), state.z, state.hold)
        return pack(xp, shape, aim, flown)


def _run(game: Game, evader: Array, point: Array, *, away: bool) -> Array:
    """Run the evader from or to a point: from right below it along the x axis, and no further than to it."""
    xp, given = vectors({"evader": evader, "point": point})
    shape, evader, point = leading_shape(game, given), given["evader"], given["point"]
    with quiet(xp):
        way = (component(point, 0) - component(evader, 0), component(point, 1) - component(evader, 1))
        length = norm2(xp, way)
        direction = unit2(xp, way, length)
        pace = -game.evader_speed_m_s if away else select(xp, length > 0, game.evader_speed_m_s, 0.0)
        return pack(xp, shape, evader, (pace * direction[0], pace * direction[1], 0.0))
