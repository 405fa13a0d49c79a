"""The game and the policies of a scenario, and scenarios of one kind as arrays, one row per scenario.

A number that is equal in all rows stays a single float: faster, and the results have the same bits.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from guidance.frames import Amsl, Enu
from guidance.game import Ball, Extent, Game, SpeedSet
from guidance.game.arrays import FloatArray, Real
from guidance.game.game import NO_WIND
from guidance.game.rules import Rules, game_by
from guidance.sim.scenario import (
    EVADER,
    MATHS_SPEED_SET,
    PURSUER,
    AnyScenario,
    Player,
    Scenario,
)
from guidance.sim.sensor import PERFECT, Noise
from guidance.strategies import Strategy, circle, random_turns, recorded, waypoints

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
    pursuer_m: FloatArray
    evader_m: FloatArray
    believed_m_s: Real
    target_m: FloatArray | None
    lowest_m: Real
    highest_m: Real
    fence_m: Real
    home_m: FloatArray
    limit_s: Real
    noise: Noise
    pursuer: Strategy
    evader: Strategy

    @property
    def believed(self) -> Game:
        """The games with the evader speeds that the pursuers assume."""
        return replace(self.game, evader_speed_m_s=self.believed_m_s)

    @property
    def is_agreed(self) -> bool:
        """True if the pursuers see the evaders and know their true speeds, the same in all games of a kind."""
        evader = self.kind.evader
        agreed = evader.believed_speed_m_s == evader.speed_m_s
        return self.kind.sensor == PERFECT and agreed


_ALIKE: Final = attrgetter(
    *("game", "pursuer.speed_set", "pursuer.navigation_gain"),
    *("sensor.rate_hz", "sensor.latency_s", "sensor.outages_s"),
    *(f"{PURSUER}.{key}" for key in Player.model_fields),
    *(f"{EVADER}.{key}" for key in Player.model_fields),
)


_TIMED: Final = frozenset({"random_turns", "circle"})
"""Courses that are as long as the game."""


def kind_of(scenario: Scenario) -> Hashable:
    """Return the properties that two scenarios must share to be played in one batch."""
    evader = scenario.evader
    policies = (scenario.pursuer.policy, evader.policy)
    course_duration_s = scenario.time_limit_s if _TIMED.intersection(policies) else None
    has_wind = any(scenario.wind.velocity_m_s)
    speed_is_known = evader.believed_speed_m_s == evader.speed_m_s
    has_sensor = scenario.sensor != PERFECT
    return (
        *_ALIKE(scenario),
        target_extent(scenario),
        has_wind,
        course_duration_s,
        speed_is_known,
        has_sensor,
    )


def by_kind(
    games: Sequence[G], kind_of: Callable[[G], Hashable], play: Callable[[list[G]], Sequence[R]]
) -> list[R]:
    """Play the games of each kind together; return the results in the order of the games."""
    kinds: dict[Hashable, list[int]] = {}
    for index, game in enumerate(games):
        kinds.setdefault(kind_of(game), []).append(index)
    results: dict[int, R] = {}
    for indices in kinds.values():
        outcomes = play([games[index] for index in indices])
        results |= zip(indices, outcomes, strict=True)
    return [results[index] for index in range(len(games))]


def true_rules(scenarios: Sequence[Scenario]) -> Rules:
    """Return the rules of scenarios of one kind, with the evaders' true speeds, as mathematics plays them."""
    kind = scenarios[0]
    pursuer = kind.pursuer
    speed_set = MATHS_SPEED_SET if pursuer.speed_set is None else pursuer.speed_set
    level_m_s = column(scenarios, "pursuer.speed_m_s")
    climb_m_s = column(scenarios, "pursuer.climb_m_s")
    descent_m_s = column(scenarios, "pursuer.descent_m_s")
    wind_east_m_s = column(scenarios, "wind.velocity_m_s", axis=0)
    wind_north_m_s = column(scenarios, "wind.velocity_m_s", axis=1)
    heights_m = column(scenarios, "standoff.height_m") - column(scenarios, "evader.height_m")
    return Rules(
        speed_set=speed_set,
        speeds_m_s=(level_m_s, climb_m_s, descent_m_s),
        evader_speed_m_s=column(scenarios, "evader.speed_m_s"),
        capture_radius_m=column(scenarios, "standoff.tolerance_m"),
        standoff_radius_m=column(scenarios, "standoff.radius_m"),
        standoff_height_m=heights_m,
        wind_m_s=(wind_east_m_s, wind_north_m_s),
        target_velocity_m_s=NO_WIND,
        target_extent=target_extent(kind),
    )


def column(scenarios: Sequence[Scenario], key: str, axis: int | None = None) -> Real:
    """Return a number of each scenario, (n,); a float if all are equal.

    Args:
        scenarios: The scenarios.
        key: Of the number, with dots; or of a vector.
        axis: Of the vector.
    """
    values = list(map(attrgetter(key), scenarios))
    if axis is not None:
        values = [vector[axis] for vector in values]
    if values.count(values[0]) == len(values):
        return float(values[0])
    return np.array(values, dtype=np.float64)


def stack(scenarios: Sequence[Scenario]) -> Batch:
    """Stack scenarios of one kind."""
    kind = scenarios[0]
    rules = true_rules(scenarios)
    ground_m = column(scenarios, "evader.height_m")
    P = np.array([scenario.pursuer.position_m for scenario in scenarios])
    P[:, 2] -= ground_m
    E = np.array([(*scenario.evader.position_m, 0.0) for scenario in scenarios])
    seed = np.array([scenario.seed for scenario in scenarios], dtype=np.int64)
    targets_m = [target_game_m(scenario) for scenario in scenarios]
    noise = Noise(
        seed,
        column(scenarios, "sensor.position_noise_m"),
        column(scenarios, "sensor.velocity_noise_m_s"),
        column(scenarios, "sensor.dropout"),
    )
    evader_speeds = Ball(rules.evader_speed_m_s)
    return Batch(
        kind=kind,
        game=game_by(rules),
        pursuer_m=P,
        evader_m=E,
        believed_m_s=column(scenarios, "evader.believed_speed_m_s"),
        target_m=None if kind.target is None else np.array(targets_m),
        lowest_m=column(scenarios, "limits.floor_m") - ground_m,
        highest_m=column(scenarios, "limits.ceiling_m") - ground_m,
        fence_m=column(scenarios, "limits.fence_radius_m"),
        home_m=np.array([scenario.home_m for scenario in scenarios]),
        limit_s=column(scenarios, "time_limit_s"),
        noise=noise,
        pursuer=policy_for(kind, PURSUER, P, rules.pursuer, seed),
        evader=policy_for(kind, EVADER, E, evader_speeds, seed),
    )


def game(scenario: Scenario) -> Game:
    """Return the game with the evader's true speed, as the evader plays it in flight: to the disc."""
    return replace(stack([scenario.as_flown()]).game, capture_radius_m=0.0)


def target_game_m(scenario: AnyScenario) -> Enu | None:
    """Return the evader's target in the game frame, None in the PE game."""
    if scenario.target is None:
        return None
    return Enu((*scenario.target.position_m, 0.0))


def target_extent(scenario: AnyScenario) -> Extent:
    """Return the target's shape, a point in the PE game."""
    return Extent() if scenario.target is None else scenario.target.extent


def site(scenario: Scenario) -> tuple[float, float, Amsl]:
    """Return the origin of the game frame, on the evader's plane."""
    site = scenario.site
    plane_amsl_m = Amsl(site.altitude_amsl_m + scenario.evader.height_m)
    return site.latitude_deg, site.longitude_deg, plane_amsl_m


def policy_for(
    scenario: Scenario, name: str, start_m: FloatArray, speeds: SpeedSet, seed: ArrayLike
) -> Strategy:
    """Return the policy of a player.

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
            points_m = np.array([(*point, 0.0)[:3] for point in player.waypoints_m])
            course = waypoints(start_m, points_m, speeds)
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
        case "circle":
            course = circle(
                start_m,
                speeds.horizontal_m_s,
                radius_m=player.circle_radius_m,
                duration_s=scenario.time_limit_s,
            )
        case "recorded":
            course = recorded(start_m, player.track)
    return Strategy(player.policy, course, scenario.pursuer.navigation_gain)
