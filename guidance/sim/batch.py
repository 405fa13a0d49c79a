"""Scenarios of one kind as arrays, one row per scenario.

A number that is equal in all rows stays a single float: faster, and the results have the same bits.
"""

from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from guidance.game import Ball, Cylinder, Game, SpeedSet, StandOff
from guidance.game.arrays import Real
from guidance.game.records import rows_of
from guidance.sim.players import evader_strategy, pursuer_strategy, target_extent
from guidance.sim.scenario import Scenario
from guidance.sim.sensor import PERFECT, Noise
from guidance.strategies import Strategy

Array = NDArray[np.float64]
G = TypeVar("G")
R = TypeVar("R")


class Batch(NamedTuple):
    """Constants of the games of a batch. Arrays have shape (n, …); a field (n,) may be one number.

    Attributes:
        kind: One scenario of the batch; everything else in it is equal in all scenarios.
        game: The games with the evaders' true speeds.
        believed_m_s: Evader speed that the pursuer assumes, (n,).
        target_m: (n, 3); None in PE.
        lowest_m: Floor above the evader's plane, (n,).
        highest_m: Ceiling above the evader's plane, (n,).
        fence_m: Fence radius about home, (n,).
        home_m: Where the pursuer takes off, (n, 2).
        limit_s: Time limit of a game, (n,).
        noise: The sensor's.
        pursuer: Strategy; its course has shape (n, …).
        evader: Strategy; its course has shape (n, …).
    """

    kind: Scenario
    game: Game
    believed_m_s: Real
    target_m: Array | None
    lowest_m: Real
    highest_m: Real
    fence_m: Real
    home_m: Array
    limit_s: Real
    noise: Noise
    pursuer: Strategy
    evader: Strategy

    @property
    def agreed(self) -> bool:
        """True if the declared speed of each evader is its true speed; equal in all scenarios of a kind."""
        return self.kind.evader.believed_speed_m_s == self.kind.evader.speed_m_s


def kind_of(scenario: Scenario) -> Hashable:
    """Return what two scenarios must share to be played in one batch."""
    pursuer, evader, sensor = scenario.pursuer, scenario.evader, scenario.sensor
    return (
        scenario.game,
        target_extent(scenario),
        pursuer.speed_set,
        any(scenario.wind.velocity_m_s),
        scenario.time_limit_s if "random_turns" in (pursuer.policy, evader.policy) else None,
        scenario.evader.believed_speed_m_s == scenario.evader.speed_m_s,
        sensor != PERFECT,
        sensor.rate_hz,
        sensor.latency_s,
        sensor.outages_s,
        pursuer.navigation_gain,
        *(
            (player.policy, player.waypoints_m, player.track, player.turn_every_s, player.turn_most_deg)
            for player in (pursuer, evader)
        ),
    )


def by_kind(games: Sequence[G], kind_of: Callable[[G], Hashable], play: Callable[[list[G]], Sequence[R]]) -> list[R]:
    """Play the games of each kind together; return the results in the order of the games."""
    kinds: dict[Hashable, list[int]] = {}
    for index, game in enumerate(games):
        kinds.setdefault(kind_of(game), []).append(index)
    played: dict[int, R] = {}
    for indices in kinds.values():
        played |= zip(indices, play([games[index] for index in indices]), strict=True)
    return [played[index] for index in range(len(games))]


def starts(scenarios: Sequence[Scenario]) -> tuple[Array, Array]:
    """Return the positions of pursuers and evaders at engagement, (n, 3) each; heights above the evader's plane."""
    P = np.array(
        [(*each.pursuer.position_m[:2], each.pursuer.position_m[2] - each.evader.height_m) for each in scenarios]
    )
    E = np.array([(*each.evader.position_m, 0.0) for each in scenarios])
    return P, E


def stack(scenarios: Sequence[Scenario]) -> Batch:
    """Stack scenarios of one kind."""
    kind = scenarios[0]

    def column(part: Callable[[Scenario], float]) -> Real:
        values = [part(each) for each in scenarios]
        same = values.count(values[0]) == len(values)
        return float(values[0]) if same else np.array(values, dtype=np.float64)

    P, E = starts(scenarios)
    speed = column(lambda each: each.pursuer.speed_m_s)
    climb, descent = column(lambda each: each.pursuer.climb_m_s), column(lambda each: each.pursuer.descent_m_s)
    ball = kind.pursuer.speed_set == "ball"
    speeds: SpeedSet = Ball(speed) if ball else Cylinder(speed, climb, descent)
    ground = column(lambda each: each.evader.height_m)
    seed = np.array([each.seed for each in scenarios], dtype=np.int64)
    evader_speed = column(lambda each: each.evader.speed_m_s)
    targets = [(*each.target.position_m, 0.0) for each in scenarios if each.target is not None]
    return Batch(
        kind=kind,
        game=Game(
            speeds,
            evader_speed,
            capture_radius_m=column(lambda each: each.standoff.tolerance_m),
            standoff=StandOff(
                column(lambda each: each.standoff.radius_m), column(lambda each: each.standoff.height_m) - ground
            ),
            wind_m_s=(column(lambda each: each.wind.velocity_m_s[0]), column(lambda each: each.wind.velocity_m_s[1])),
            target_extent=target_extent(kind),
        ),
        believed_m_s=column(lambda each: each.evader.believed_speed_m_s),
        target_m=np.array(targets) if targets else None,
        lowest_m=column(lambda each: each.limits.floor_m) - ground,
        highest_m=column(lambda each: each.limits.ceiling_m) - ground,
        fence_m=column(lambda each: each.limits.fence_radius_m),
        home_m=np.array([each.home_m for each in scenarios]),
        limit_s=column(lambda each: each.time_limit_s),
        noise=Noise(
            seed,
            column(lambda each: each.sensor.position_noise_m),
            column(lambda each: each.sensor.velocity_noise_m_s),
            column(lambda each: each.sensor.dropout),
        ),
        pursuer=pursuer_strategy(kind, P, speeds, seed),
        evader=evader_strategy(kind, E, evader_speed, seed),
    )


def keep(value: Any, rows: NDArray[np.bool_]) -> Any:  # noqa: ANN401 - a batch or a part
    """Return some rows of a batch, or of a part."""
    return rows_of(value, lambda array: array[rows])
