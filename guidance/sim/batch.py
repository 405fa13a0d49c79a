"""The game and the strategies of a scenario, and scenarios of one kind as arrays, one row per scenario.

A number that is equal in all rows stays a single float: faster, and the results have the same bits.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guidance.frames import Amsl, Vector
from guidance.game import Ball, Cylinder, Extent, Game, SpeedSet, StandOff
from guidance.game.arrays import Real
from guidance.sim.scenario import EVADER, PURSUER, Player, Scenario, Wind
from guidance.sim.sensor import PERFECT, Noise
from guidance.strategies import Strategy, random_turns, recorded, waypoints

Array = NDArray[np.float64]

_STREAMS: Final = {PURSUER: 1, EVADER: 2}
"""Random streams of the players. They differ, so both players turn independently with one seed."""

G = TypeVar("G")
R = TypeVar("R")


class Batch(NamedTuple):
    """Constants of the games of a batch. Arrays have shape (n, …); a field (n,) may be one number.

    Attributes:
        kind: One scenario of the batch; everything else in it is equal in all scenarios.
        game: The games with the evaders' true speeds.
        pursuer_m: Positions of the pursuers at engagement, (n, 3); heights above the evader's plane.
        evader_m: Positions of the evaders at engagement, (n, 3).
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
    pursuer_m: Array
    evader_m: Array
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
    def believed(self) -> Game:
        """The games with the evader speeds that the pursuers assume."""
        return replace(self.game, evader_speed_m_s=self.believed_m_s)


_ALIKE: Final = attrgetter(
    *("game", "pursuer.speed_set", "pursuer.navigation_gain"),
    *(f"sensor.{key}" for key in ("rate_hz", "latency_s", "outages_s")),
    *(f"{player}.{key}" for player in (PURSUER, EVADER) for key in Player.model_fields),
)


def kind_of(scenario: Scenario) -> Hashable:
    """Return what two scenarios must share to be played in one batch."""
    evader = scenario.evader
    turns = "random_turns" in (scenario.pursuer.policy, scenario.evader.policy)
    return (
        *_ALIKE(scenario),
        target_extent(scenario),
        any(scenario.wind.velocity_m_s),
        scenario.time_limit_s if turns else None,
        evader.believed_speed_m_s == evader.speed_m_s,
        scenario.sensor != PERFECT,
    )


def by_kind(
    games: Sequence[G], kind_of: Callable[[G], Hashable], play: Callable[[list[G]], Sequence[R]]
) -> list[R]:
    """Play the games of each kind together; return the results in the order of the games."""
    kinds: dict[Hashable, list[int]] = {}
    for index, game in enumerate(games):
        kinds.setdefault(kind_of(game), []).append(index)
    played: dict[int, R] = {}
    for indices in kinds.values():
        played |= zip(indices, play([games[index] for index in indices]), strict=True)
    return [played[index] for index in range(len(games))]


def stack(scenarios: Sequence[Scenario]) -> Batch:
    """Stack scenarios of one kind."""
    kind = scenarios[0]

    def column(key: str, axis: int | None = None) -> Real:
        values = [
            value if axis is None else value[axis] for value in map(attrgetter(key), scenarios)
        ]
        return (
            float(values[0])
            if values.count(values[0]) == len(values)
            else np.array(values, dtype=np.float64)
        )

    ground = column("evader.height_m")
    P = np.array([each.pursuer.position_m for each in scenarios])
    P[:, 2] -= ground
    E = np.array([(*each.evader.position_m, 0.0) for each in scenarios])
    speeds: SpeedSet = Ball(column("pursuer.speed_m_s"))
    if kind.pursuer.speed_set == "cylinder":
        speeds = Cylinder(
            *map(column, ("pursuer.speed_m_s", "pursuer.climb_m_s", "pursuer.descent_m_s"))
        )
    seed = np.array([each.seed for each in scenarios], dtype=np.int64)
    evader_speed = column("evader.speed_m_s")
    targets = [(*each.target.position_m, 0.0) for each in scenarios if each.target is not None]
    return Batch(
        kind=kind,
        game=Game(
            speeds,
            evader_speed,
            capture_radius_m=column("standoff.tolerance_m"),
            standoff=StandOff(column("standoff.radius_m"), column("standoff.height_m") - ground),
            wind_m_s=(column("wind.velocity_m_s", 0), column("wind.velocity_m_s", 1)),
            target_extent=target_extent(kind),
        ),
        pursuer_m=P,
        evader_m=E,
        believed_m_s=column("evader.believed_speed_m_s"),
        target_m=np.array(targets) if targets else None,
        lowest_m=column("limits.floor_m") - ground,
        highest_m=column("limits.ceiling_m") - ground,
        fence_m=column("limits.fence_radius_m"),
        home_m=np.array([each.home_m for each in scenarios]),
        limit_s=column("time_limit_s"),
        noise=Noise(
            seed,
            *map(
                column, ("sensor.position_noise_m", "sensor.velocity_noise_m_s", "sensor.dropout")
            ),
        ),
        pursuer=strategy_of(kind, PURSUER, P, speeds, seed),
        evader=strategy_of(kind, EVADER, E, Ball(evader_speed), seed),
    )


def game(scenario: Scenario) -> Game:
    """Return the game with the evader's true speed, as the evader plays it in flight: in still air, to the disc."""
    # With the wind there may be no game at all
    still = scenario.model_copy(update={"wind": Wind()})
    return replace(stack([still]).game, capture_radius_m=0.0)


def target_game_m(scenario: Scenario) -> Vector | None:
    """Return the evader's target in the game frame, None in the PE game."""
    return None if scenario.target is None else (*scenario.target.position_m, 0.0)


def target_extent(scenario: Scenario) -> Extent:
    """Return the target's shape, a point in the PE game."""
    return Extent() if scenario.target is None else scenario.target.extent


def site(scenario: Scenario) -> tuple[float, float, Amsl]:
    """Return the origin of the game frame, on the evader's plane."""
    where = scenario.site
    return (
        where.latitude_deg,
        where.longitude_deg,
        Amsl(where.altitude_amsl_m + scenario.evader.height_m),
    )


def strategy_of(
    scenario: Scenario, name: str, start_m: Array, speeds: SpeedSet, seed: ArrayLike
) -> Strategy:
    """Return the strategy of a player.

    Args:
        scenario: Policy, course and gain.
        name: "pursuer" or "evader".
        start_m: Starts, (..., 3), m.
        speeds: Speed set with numbers of shape (...), m/s.
        seed: Shape (...), one for each row.
    """
    player: Player = getattr(scenario, name)
    course = None
    match player.policy:
        case "waypoints":
            course = waypoints(
                start_m, np.array([(*point, 0.0)[:3] for point in player.waypoints_m]), speeds
            )
        case "random_turns":
            turns = {
                "max_turn_rad": np.deg2rad(player.turn_most_deg),
                "every_s": player.turn_every_s,
            }
            until_s = scenario.time_limit_s
            stream = _STREAMS[name]
            course = random_turns(
                start_m, speeds.horizontal_m_s, seed, stream=stream, duration_s=until_s, **turns
            )
        case "recorded":
            course = recorded(start_m, player.track)
    return Strategy(player.policy, course, scenario.pursuer.navigation_gain)
