"""When a vehicle arrives at a place that it approaches as fast as it can brake before it; over arrays of places."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

Reals: TypeAlias = Any
"""One number or an array of them; functions of this module return the same."""

_SLOWEST_M_S = 0.1
"""A vehicle that arrives at the very point where it comes to rest would take for ever."""


class Stop(NamedTuple):
    """How a vehicle comes to rest before a place.

    Attributes:
        braking_m_s2: Planned deceleration.
        lag_s: Time constant of the last part.
        short_m: Distance from the place at which it comes to rest.
        arrived_m: Distance from there that counts as an arrival.
    """

    braking_m_s2: float
    lag_s: float
    short_m: float
    arrived_m: float

    def allowed_m_s(self, left_m: Reals) -> Reals:
        """Return the speed allowed at distances, see `guidance.control.braking_law.approach_speed`."""
        reserve_m_s = self.braking_m_s2 * self.lag_s
        reached_m_s = np.sqrt(reserve_m_s**2 + 2.0 * self.braking_m_s2 * np.maximum(left_m, 0.0))
        return reached_m_s - reserve_m_s

    def closing_m_s(self, left_m: Reals, fastest_m_s: Reals) -> Reals:
        """Return the speed that is flown at distances, which is that of the arrival at the least."""
        arriving_m_s = max(self.allowed_m_s(self.arrived_m), _SLOWEST_M_S)
        return np.minimum(np.maximum(self.allowed_m_s(left_m), arriving_m_s), fastest_m_s)


def closing_s(left_m: Reals, fastest_m_s: Reals, stop: Stop) -> Reals:
    """Return the time to an arrival, continuous in all arguments.

    Args:
        left_m: Distance to where the vehicle comes to rest.
        fastest_m_s: Its speed before it brakes.
        stop: How it comes to rest.
    """
    fast_m_s = stop.closing_m_s(left_m, fastest_m_s)
    arriving_m_s = stop.closing_m_s(stop.arrived_m, fastest_m_s)
    braking_s = (fast_m_s - arriving_m_s) / stop.braking_m_s2
    braking_s = braking_s + stop.lag_s * np.log(fast_m_s / arriving_m_s)
    slow_m = fast_m_s * stop.lag_s + fast_m_s**2 / (2.0 * stop.braking_m_s2)
    full_speed_m = left_m - np.maximum(slow_m, stop.arrived_m)
    return braking_s + np.maximum(0.0, full_speed_m) / fastest_m_s


def meeting_s(left_m: Reals, fastest_m_s: Reals, fleeing_m_s: Reals, stop: Stop) -> Reals:
    """Return the time to a place where the vehicle meets what flees from it, and brakes to its speed.

    The vehicle closes on it as `closing_s` says, from a gap on that is smaller than the way to the place, because that
    which flees is at the place only at the meeting. Two steps of Newton's method find the gap.

    Args:
        left_m: Distance to where the vehicle would come to rest before the place.
        fastest_m_s: Its speed before it brakes.
        fleeing_m_s: Speed of what flees, along the way; less than the fastest one.
        stop: How it comes to rest, relative to that.
    """
    relative_m_s = fastest_m_s - fleeing_m_s
    gap_m = left_m * relative_m_s / fastest_m_s
    for _ in range(2):
        time_s = closing_s(gap_m, relative_m_s, stop)
        pace_m_s = stop.closing_m_s(gap_m, relative_m_s)
        too_far_m = gap_m + fleeing_m_s * time_s - left_m
        nearer_m = too_far_m * pace_m_s / (pace_m_s + fleeing_m_s)
        gap_m = np.maximum(gap_m - nearer_m, stop.arrived_m)
    # Along the tangent from the last gap.
    return np.maximum(0.0, time_s - nearer_m / pace_m_s)
