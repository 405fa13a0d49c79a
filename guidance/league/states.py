"""Random initial states of a scenario's game, and the batch of games that begin in them.

A state depends only on its seed, not on the other states of a batch or on when it is drawn. Each player is placed
uniformly in a disc about a centre: the target in TAD, the pursuer's start in PE. The disc reaches the scenario's
farthest player, and is small enough for the fence. The pursuer's height is uniform from the disc's height to that of
the scenario's start. A state whose game is over is drawn again.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.errors import ConfigError
from guidance.game import Ball, Game, StandOff
from guidance.game.arrays import NUMPY, FloatArray
from guidance.game.rollout import NANOSECOND_S, look_ahead
from guidance.sim.batch import Batch, policy_for, stack
from guidance.sim.scenario import EVADER, PURSUER, Scenario
from guidance.strategies import uniform

_STREAM: Final = 31
"""Random stream of initial states."""

DRAWS: Final = 5
"""Random numbers of a state: radius and direction of both players, and the pursuer's height."""

_TRIES: Final = 50
"""Most draws of a state, which is drawn again if its game is over."""

HOME_SOUTH_M: Final = 2.0
"""The pursuer takes off so far south of its start, as in `Scenario.home_m`."""

SeedArray = NDArray[np.int64]


class States(NamedTuple):
    """Initial states: seeds (n,), and positions (n, 3), m, above the evader's plane."""

    seed: SeedArray
    pursuer_m: FloatArray
    evader_m: FloatArray


class Arena(NamedTuple):
    """The games of a scenario, and the area of their random states.

    Attributes:
        template: The scenario's game as a batch of one.
        valued: The game whose value counts.
        centre_m: Of the disc, x and y.
        radius_m: Of the disc.
        heights_m: Lowest and greatest height of the pursuer's start, above the evader's plane.
    """

    template: Batch
    valued: Game
    centre_m: tuple[float, float]
    radius_m: float
    heights_m: tuple[float, float]

    @property
    def between_points(self) -> bool:
        """True if the game whose value counts is one between points, which a capture ends early."""
        return self.valued != self.template.game


def arena_of(scenario: Scenario, *, between_points: bool = False) -> Arena:
    """Return the arena of a scenario.

    Args:
        scenario: Of two players.
        between_points: Play the paper's game without a disc. It ends within `standoff.tolerance_m` of the evader, and
            the value of the rest counts.

    Raises:
        ConfigError: If the game is over wherever the players are placed.
    """
    template = stack([scenario])
    valued = template.game
    if between_points:
        point_game = replace(template.game, standoff=StandOff())
        valued = replace(point_game, capture_radius_m=0.0)
        template = template._replace(game=point_game, lowest_m=min(float(template.lowest_m), 0.0))
    places = [scenario.pursuer.position_m[:2], scenario.evader.position_m]
    centre_m = places[0] if scenario.target is None else scenario.target.position_m
    farthest_m = max(math.dist(centre_m, position_m) for position_m in places)
    roomy_m = 0.5 * (scenario.limits.fence_radius_m - HOME_SOUTH_M)
    radius_m = min(farthest_m, roomy_m)
    over_m = template.game.standoff.radius_m + scenario.standoff.tolerance_m
    if radius_m <= over_m:
        raise ConfigError(
            f"the players start {radius_m:g} m from the centre at most, and the disc reaches {over_m:g} m: "
            "there are no random states; place the players farther apart, or make standoff.radius_m smaller"
        )
    ground_m = scenario.evader.height_m
    low_m = scenario.standoff.height_m - ground_m
    high_m = max(low_m, scenario.pursuer.position_m[2] - ground_m)
    return Arena(template, valued, centre_m, radius_m, (low_m, high_m))


def seeds_of(seed: int, count: int, first: int = 0) -> SeedArray:
    """Return the seeds of `count` numbered states of a seed, from number `first` on.

    Raises:
        ConfigError: If the seed is negative or above 2³⁸.
    """
    if not 0 <= seed < 1 << 38:
        raise ConfigError(f"seed = {seed}: must be from 0 to {(1 << 38) - 1}")
    return np.arange(first, first + count, dtype=np.int64) + (seed << 24)


def random_states(arena: Arena, seeds: SeedArray) -> States:
    """Return a random state for each seed, (n,)."""
    states = _drawn(arena, seeds, 0)
    over_at_once = np.flatnonzero(_is_over(arena.template, states))
    for attempt in range(1, _TRIES):
        if not len(over_at_once):
            break
        others = _drawn(arena, seeds[over_at_once], attempt)
        states.pursuer_m[over_at_once] = others.pursuer_m
        states.evader_m[over_at_once] = others.evader_m
        over_at_once = over_at_once[_is_over(arena.template, others)]
    return states


def _drawn(arena: Arena, seeds: SeedArray, attempt: int) -> States:
    first = attempt * DRAWS
    draws = [uniform(seeds, _STREAM, first + number) for number in range(DRAWS)]
    low_m, high_m = arena.heights_m
    height_m = low_m + (high_m - low_m) * draws[4]
    pursuer_m = _positions_m(arena, draws[0], draws[1], height_m)
    evader_m = _positions_m(arena, draws[2], draws[3], np.zeros(len(seeds)))
    return States(seeds, pursuer_m, evader_m)


def _positions_m(
    arena: Arena, share: FloatArray, turn: FloatArray, height_m: FloatArray
) -> FloatArray:
    away_m = arena.radius_m * np.sqrt(share)
    angle_rad = 2.0 * math.pi * turn
    x, y = arena.centre_m
    return np.column_stack(
        [x + away_m * np.cos(angle_rad), y + away_m * np.sin(angle_rad), height_m]
    )


def _is_over(template: Batch, states: States) -> NDArray[np.bool_]:
    with np.errstate(all="ignore"):
        ahead = look_ahead(
            NUMPY, template.game, states.pursuer_m, states.evader_m, template.target_m
        )
    return (ahead.capture_s <= NANOSECOND_S) | (ahead.arrival_s <= NANOSECOND_S)


def batch_at(template: Batch, states: States) -> Batch:
    """Return the games of a template that begin in states; players on a course begin it there."""
    count = len(states.seed)
    kind = template.kind
    P = states.pursuer_m
    E = states.evader_m
    target_m = template.target_m
    if target_m is not None:
        target_m = np.repeat(target_m, count, axis=0)
    batch = template._replace(
        pursuer_m=P,
        evader_m=E,
        target_m=target_m,
        home_m=P[:, :2] - np.array([0.0, HOME_SOUTH_M]),
        noise=template.noise._replace(seed=states.seed),
    )
    if template.pursuer.course is not None:
        speeds = template.game.pursuer
        batch = batch._replace(pursuer=policy_for(kind, PURSUER, P, speeds, states.seed))
    if template.evader.course is not None:
        speeds = Ball(template.game.evader_speed_m_s)
        batch = batch._replace(evader=policy_for(kind, EVADER, E, speeds, states.seed))
    return batch


def scenario_at(scenario: Scenario, states: States, row: int) -> Scenario:
    """Return the scenario of one state."""
    ground_m = scenario.evader.height_m
    x, y, z = states.pursuer_m[row].tolist()
    evader_x, evader_y, _ = states.evader_m[row].tolist()
    pursuer = scenario.pursuer.model_copy(update={"position_m": (x, y, z + ground_m)})
    evader = scenario.evader.model_copy(update={"position_m": (evader_x, evader_y)})
    seed = int(states.seed[row])
    return scenario.model_copy(update={"pursuer": pursuer, "evader": evader, "seed": seed})
