"""A course: a table of places and times, with straight legs at constant speed.

Waypoints, random turns, circles and recorded tracks are courses with tables from different sources.

Random numbers have no state: the k-th draw of a stream is a function of the seed and of k, for arrays of either. So a
game draws the same numbers alone and in a batch, on one worker or eight, in simulation and in flight. The generator is
SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number generators", 2014).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guidance.game.arrays import FloatArray
from guidance.game.records import rows_of
from guidance.game.speed_sets import SpeedSet

COURSES: Final = ("waypoints", "random_turns", "circle", "recorded")
"""Strategies that follow a course: they depend on the time and not on the other player."""

_BACK_S: Final = 2.0
"""Time constant of a player's return to its course."""

_ARC_S: Final = 0.1
"""Time between two corners of a circle."""

_GOLDEN: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)


@dataclass(frozen=True, slots=True)
class Course:
    """A player's place at any time. It does not move before the first time and after the last.

    Attributes:
        times_s: Rising, (..., k), from the start of the game.
        places_m: Game frame, (..., k, 3).
    """

    times_s: FloatArray
    places_m: FloatArray

    def velocity_m_s(self, played_s: ArrayLike, position_m: FloatArray) -> FloatArray:
        """Return the velocity (..., 3) that follows the course, and returns to it, from a position (..., 3)."""
        t = np.asarray(played_s, dtype=np.float64)
        passed = np.sum(self.times_s <= t[..., None], axis=-1) - 1
        leg = np.clip(passed, 0, self.times_s.shape[-1] - 2)
        # Times and places of both ends of the leg.
        corners = (*leg.shape, self.times_s.shape[-1])
        ends = np.stack([leg, leg + 1], axis=-1)
        all_times_s = np.broadcast_to(self.times_s, corners)
        all_places_m = np.broadcast_to(self.places_m, (*corners, 3))
        times_s = np.take_along_axis(all_times_s, ends, -1)
        places_m = np.take_along_axis(all_places_m, ends[..., None], -2)
        begin_m = places_m[..., 0, :]
        lasts_s = np.maximum(times_s[..., 1] - times_s[..., 0], 1e-9)[..., None]
        leg_m = places_m[..., 1, :] - begin_m
        leg_m_s = leg_m / lasts_s
        share = np.clip((t - times_s[..., 0])[..., None] / lasts_s, 0.0, 1.0)
        place_m = begin_m + share * leg_m
        is_underway = passed == leg
        along_m_s = np.where(is_underway[..., None], leg_m_s, 0.0)
        back_m_s = (place_m - position_m) / _BACK_S
        return np.asarray(along_m_s + back_m_s)

    def corner_s(self, played_s: ArrayLike) -> FloatArray:
        """Return the time of the next change of the velocity, (...); infinite after the last time."""
        t = np.asarray(played_s, dtype=np.float64)[..., None]
        coming_s = np.where(self.times_s > t, self.times_s, np.inf)
        return np.asarray(np.min(coming_s, axis=-1))


def waypoints(start_m: FloatArray, points_m: ArrayLike, speeds: SpeedSet) -> Course:
    """Go from a start (..., 3) through points (k, 3) as fast as the speeds (...) allow, and stay at the last."""
    points = np.asarray(points_m, dtype=np.float64)
    points_of_rows = np.broadcast_to(points, (*start_m.shape[:-1], *points.shape))
    places = np.concatenate([start_m[..., None, :], points_of_rows], axis=-2)
    legs_m = np.diff(places, axis=-2)
    # The least duration of each leg.
    level_squares = legs_m[..., :2] ** 2
    level_m = np.sqrt(np.sum(level_squares, axis=-1))
    for_legs: SpeedSet = rows_of(speeds, lambda numbers: numbers[..., None])
    arrivals_s = np.cumsum(for_legs.duration_s(level_m, legs_m[..., 2]), axis=-1)
    start_s = 0.0 * arrivals_s[..., :1]
    times_s = np.concatenate([start_s, arrivals_s], axis=-1)
    return Course(times_s, places)


def random_turns(
    start_m: FloatArray,
    speed_m_s: ArrayLike,
    seed: ArrayLike,
    *,
    stream: int,
    every_s: float,
    max_turn_rad: float,
    duration_s: float,
) -> Course:
    """Go at `speed_m_s` (...) in the plane of a start (..., 3) and turn at random every `every_s`.

    The first heading is random; each later one differs from the one before by up to `max_turn_rad`, evenly distributed.

    Args:
        start_m: (..., 3), m.
        speed_m_s: (...).
        seed: (...).
        stream: Number of the random stream, different for each player of a seed.
        every_s: Time between two turns.
        max_turn_rad: The largest turn to either side.
        duration_s: The least duration of the course.
    """
    count = int(np.ceil(duration_s / every_s)) + 1
    turns_of_row = np.arange(count)
    draws = uniform(np.asarray(seed)[..., None], stream, turns_of_row)
    largest_rad = np.where(turns_of_row == 0, np.pi, max_turn_rad)
    heading = np.cumsum((2.0 * draws - 1.0) * largest_rad, axis=-1)
    speed = np.asarray(speed_m_s, dtype=np.float64)
    leg_m = speed[..., None] * every_s
    x = leg_m * np.cos(heading)
    y = leg_m * np.sin(heading)
    legs_m = np.stack([x, y, np.zeros_like(heading)], axis=-1)
    start = start_m[..., None, :]
    corners = start + np.cumsum(legs_m, axis=-2)
    return _course_of_table(
        every_s * np.arange(count + 1, dtype=np.float64),
        np.concatenate([start, corners], axis=-2),
    )


def circle(
    start_m: FloatArray, speed_m_s: ArrayLike, *, radius_m: float, duration_s: float
) -> Course:
    """Go round a circle in the plane of a start (..., 3), north first and then to the east, m and m/s.

    The course is a polygon with a corner every `_ARC_S`.

    Args:
        start_m: (..., 3), m.
        speed_m_s: (...).
        radius_m: Radius of the circle through the corners.
        duration_s: The least duration of the course.
    """
    times_s = np.arange(0.0, duration_s + _ARC_S, _ARC_S)
    speed = np.asarray(speed_m_s, dtype=np.float64)
    turned_rad = speed[..., None] / radius_m * times_s
    east_m = radius_m * (1.0 - np.cos(turned_rad))
    north_m = radius_m * np.sin(turned_rad)
    ways_m = np.stack([east_m, north_m, np.zeros_like(turned_rad)], axis=-1)
    return _course_of_table(times_s, start_m[..., None, :] + ways_m)


def recorded(start_m: FloatArray, track: Sequence[Sequence[float]]) -> Course:
    """Go along a recorded track, rows of (time s, x, y, z m), moved so that it begins at a start (..., 3) at time 0."""
    table = np.asarray(track, dtype=np.float64)
    from_first = table - table[0]
    places = start_m[..., None, :] + from_first[:, 1:]
    return _course_of_table(from_first[:, 0], places)


def _course_of_table(times_s: FloatArray, places_m: FloatArray) -> Course:
    """Return the course with the same times (k,) in every row of places (..., k, 3)."""
    return Course(np.broadcast_to(times_s, places_m.shape[:-1]), places_m)


def uniform(seed: ArrayLike, stream: int, index: ArrayLike) -> FloatArray:
    """Draw from [0, 1).

    Args:
        seed: Non-negative integers, (...).
        stream: Which of the independent sequences of a seed.
        index: Number of the draw, (...); broadcast against `seed`.
    """
    number = np.asarray(index).astype(np.uint64)
    with np.errstate(over="ignore"):  # the arithmetic is modulo 2^64
        state = _mix(np.asarray(seed).astype(np.uint64) + _GOLDEN)
        state = _mix(state + np.uint64(stream) * _GOLDEN)
        state = _mix(state + number * _GOLDEN)
    leading_bits = state >> np.uint64(11)
    return leading_bits.astype(np.float64) * 2.0**-53


def normal(seed: ArrayLike, stream: int, index: ArrayLike) -> FloatArray:
    """Draw from the standard normal distribution (Box & Muller); arguments as of `uniform`."""
    k = 2 * np.asarray(index, dtype=np.int64)
    first = uniform(seed, stream, k)
    second = uniform(seed, stream, k + 1)
    radius = np.sqrt(-2.0 * np.log1p(-first))
    angle = 2.0 * np.pi * second
    return np.asarray(radius * np.cos(angle))


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return state ^ (state >> np.uint64(31))
