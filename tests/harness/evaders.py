"""Evaders that try to break a verdict: they circle the target, cross and turn late, stop, copy the vehicle, or charge.

Each first does something that the vehicle has to answer, and then runs straight to the point of the target's outline
where it has the largest lead. It runs after a drawn time, or as soon as its lead is large enough.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from random import Random
from typing import Final

from guidance.cycle import CycleSettings
from guidance.frames import Enu
from guidance.game import Extent
from tests.harness.guarded import Evader, GameState, Point
from tests.harness.referee import Played, Referee, play_out, towards

_SPACING_M: Final = 3.0
_FEWEST: Final = 8
_ABOUT_S: Final = 0.6
"""The vehicle is where it flies to in this time, as the evader sees it."""

_BEGINNINGS: Final = 3
_SEARCH_ROUNDS: Final = 2

Heading = Callable[[GameState, float], Point]
"""What an evader does before it runs: its velocity over its speed, from the state and the time."""


def evader_that(
    settings: CycleSettings, before: Heading, runs_at_s: float, lead_s: float = math.inf
) -> Evader:
    """Return an evader that does something for a while and then runs straight to the point where its lead is largest.

    Args:
        settings: Of the cycle.
        before: What it does before it runs.
        runs_at_s: When it runs at the latest.
        lead_s: Lead at a point of the outline with which it runs at once.
    """
    speed_m_s = float(settings.game.evader_speed_m_s)
    goals_m: list[Point] = []

    def velocity(state: GameState, now_s: float, _meeting_m: Enu) -> Point:
        if not goals_m:
            largest_s, goal_m = best_goal(state, settings)
            if largest_s >= lead_s or now_s >= runs_at_s:
                goals_m.append(goal_m)
            else:
                x, y = before(state, now_s)
                pace = speed_m_s / max(1.0, math.hypot(x, y))
                return (pace * x, pace * y)
        return towards(state, goals_m[0], speed_m_s, settings.game.target_velocity_m_s)

    return velocity


def best_goal(state: GameState, settings: CycleSettings) -> tuple[float, Point]:
    """Return the largest lead of the evader over the vehicle at a point of the outline, s, and that point."""
    game = settings.game
    u = float(game.pursuer.horizontal_m_s)
    v = float(game.evader_speed_m_s)
    radius_m = float(game.standoff.radius_m)
    ahead_m = state.pursuer_m + state.pursuer_m_s * _ABOUT_S
    height_m = state.pursuer_m[2] - float(game.standoff.height_m)
    level_s = max(0.0, height_m) / float(game.pursuer.descent_m_s)
    x_m, y_m, _ = state.target_m or (math.nan, math.nan, math.nan)
    best = (-math.inf, (0.0, 0.0))
    for point in outline(game.target_extent):
        here = (x_m + point[0], y_m + point[1])
        vehicle_s = max((math.dist(here, ahead_m[:2]) - radius_m) / u, level_s)
        lead_s = vehicle_s - math.dist(here, state.evader_m[:2]) / v
        if lead_s > best[0]:
            best = (lead_s, point)
    return best


def _circling(draw: Random, settings: CycleSettings) -> Heading:
    """Circle the target's centre, in either sense, at 0.5 to 2 times its radius; 1 m outside of a disc at the least."""
    extent = settings.game.target_extent
    corners = extent.corners_m
    centre = tuple(sum(part) / len(corners) for part in zip(*corners, strict=True))
    size_m = max(math.dist(centre, corner) for corner in corners) + extent.radius_m
    radius_m = draw.uniform(0.5, 2.0) * max(size_m, 8.0)
    if extent.radius_m > 0.0:
        radius_m = max(radius_m, size_m + 1.0)
    sense = draw.choice((-1.0, 1.0))

    def heading(state: GameState, _now_s: float) -> Point:
        target_m = state.target_m or (math.nan, math.nan, math.nan)
        x = state.evader_m[0] - target_m[0] - centre[0]
        y = state.evader_m[1] - target_m[1] - centre[1]
        away_m = max(math.hypot(x, y), 1e-6)
        inwards = min(1.0, max(-1.0, 0.3 * (away_m - radius_m)))
        along = math.sqrt(1.0 - inwards * inwards)
        return (
            (-inwards * x - sense * along * y) / away_m,
            (-inwards * y + sense * along * x) / away_m,
        )

    return heading


def _crossing(draw: Random, settings: CycleSettings) -> Heading:
    """Run to a drawn point of the outline; the late turn is the run after it."""
    goal_m = draw.choice(outline(settings.game.target_extent))

    def heading(state: GameState, _now_s: float) -> Point:
        return towards(state, goal_m, 1.0, (0.0, 0.0))

    return heading


def _stopping(draw: Random, settings: CycleSettings) -> Heading:
    """Run to the best point and stand, in turn."""
    go_s = draw.uniform(0.5, 3.0)
    stand_s = draw.uniform(0.3, 3.0)

    def heading(state: GameState, now_s: float) -> Point:
        if now_s % (go_s + stand_s) > go_s:
            return (0.0, 0.0)
        return towards(state, best_goal(state, settings)[1], 1.0, (0.0, 0.0))

    return heading


def _copying(draw: Random, _settings: CycleSettings) -> Heading:
    """Fly the vehicle's heading, or the opposite one."""
    sign = draw.choice((1.0, 1.0, -1.0))

    def heading(state: GameState, _now_s: float) -> Point:
        x, y, _ = state.pursuer_m_s
        size = math.hypot(x, y)
        return (sign * x / size, sign * y / size) if size > 0.3 else (0.0, 0.0)

    return heading


def _charging(draw: Random, _settings: CycleSettings) -> Heading:
    """Run at the vehicle, up to 0.6 rad beside it."""
    off = draw.uniform(-0.6, 0.6)

    def heading(state: GameState, _now_s: float) -> Point:
        x = state.pursuer_m[0] - state.evader_m[0]
        y = state.pursuer_m[1] - state.evader_m[1]
        bearing = math.atan2(y, x) + off
        return (math.cos(bearing), math.sin(bearing))

    return heading


KINDS: Final[Mapping[str, Callable[[Random, CycleSettings], Heading]]] = {
    "circles": _circling,
    "crosses": _crossing,
    "stops": _stopping,
    "copies": _copying,
    "charges": _charging,
}


def draw_evader(kind: str, draw: Random, settings: CycleSettings, now_s: float = 0.0) -> Evader:
    """Draw an evader of a kind that begins now."""
    before = KINDS[kind](draw, settings)
    lead_s = draw.choice((-0.5, 0.0, 0.3, math.inf))
    return evader_that(settings, before, now_s + draw.uniform(1.0, 25.0), lead_s)


def searched_worst(claimed: Referee, settings: CycleSettings, draw: Random) -> Played:
    """Search the evader that comes nearest to the target from a state, and return its game.

    It runs in one direction, then in another, and then to the target. The directions and the times of both turns are
    changed one after the other, and what brings it nearer is kept.
    """

    def played(plan: Sequence[float]) -> Played:
        first, first_s, second, second_s = plan
        begins_s = claimed.now_s

        def heading(_state: GameState, now_s: float) -> Point:
            bearing = first if now_s < begins_s + first_s else second
            return (math.cos(bearing), math.sin(bearing))

        evader = evader_that(settings, heading, begins_s + first_s + second_s)
        return play_out(claimed.copy(), evader)

    worst = None
    for _ in range(_BEGINNINGS):
        plan = [draw.uniform(-math.pi, math.pi), draw.uniform(0.0, 6.0)] * 2
        best = played(plan)
        for _ in range(_SEARCH_ROUNDS):
            for number, largest in enumerate((1.0, 2.0, 1.0, 2.0)):
                changed = list(plan)
                changed[number] += draw.uniform(-largest, largest)
                changed[1] = max(0.0, changed[1])
                changed[3] = max(0.0, changed[3])
                tried = played(changed)
                if tried.result.end != "captured":
                    return tried
                if tried.final_m < best.final_m:
                    best = tried
                    plan = changed
        if worst is None or best.final_m < worst.final_m:
            worst = best
    assert worst is not None
    return worst


@lru_cache
def outline(extent: Extent) -> Sequence[Point]:
    """Return points of a target's edge, from its position, at most 3 m apart; of a point, itself."""
    corners = extent.corners_m
    radius_m = extent.radius_m
    points: list[Point] = []
    if len(corners) > 1:
        for begin, end in zip(corners, (*corners[1:], corners[0]), strict=True):
            length_m = math.dist(begin, end)
            out_x = radius_m * (end[1] - begin[1]) / length_m
            out_y = -radius_m * (end[0] - begin[0]) / length_m
            steps = max(1, math.ceil(length_m / _SPACING_M))
            for step in range(steps + 1):
                share = step / steps
                x = begin[0] + share * (end[0] - begin[0]) + out_x
                y = begin[1] + share * (end[1] - begin[1]) + out_y
                points.append((x, y))
    if radius_m == 0.0:
        return tuple(dict.fromkeys((*points, *corners)))
    steps = max(_FEWEST, math.ceil(math.tau * radius_m / _SPACING_M))
    for step in range(steps):
        x = math.cos(math.tau * step / steps)
        y = math.sin(math.tau * step / steps)
        corner = max(corners, key=lambda corner: corner[0] * x + corner[1] * y)
        points.append((corner[0] + radius_m * x, corner[1] + radius_m * y))
    return tuple(points)
