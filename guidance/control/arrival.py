"""Time to arrive at a place, for a vehicle that approaches as fast as it can brake; over arrays of places."""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

Reals: TypeAlias = Any
"""One number or an array of them; functions of this module return the same."""

_SLOWEST_M_S = 0.1
"""Lower bound of the arrival speed: without it, the time to the point of rest would be infinite."""


class Stop(NamedTuple):
    """A vehicle's stop before a place.

    Attributes:
        braking_m_s2: Planned deceleration.
        lag_s: Time constant of the last part.
        short_m: Distance from the place to the point of rest.
        arrived_m: Distance from the point of rest that counts as an arrival.
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
        """Return the speed at distances, at least the arrival speed."""
        arriving_m_s = max(self.allowed_m_s(self.arrived_m), _SLOWEST_M_S)
        return np.minimum(np.maximum(self.allowed_m_s(left_m), arriving_m_s), fastest_m_s)


def closing_s(left_m: Reals, fastest_m_s: Reals, stop: Stop) -> Reals:
    """Return the time to an arrival, continuous in all arguments.

    Args:
        left_m: Distance to the point of rest.
        fastest_m_s: Its speed before it brakes.
        stop: Its stop.
    """
    fast_m_s = stop.closing_m_s(left_m, fastest_m_s)
    arriving_m_s = stop.closing_m_s(stop.arrived_m, fastest_m_s)
    braking_s = (fast_m_s - arriving_m_s) / stop.braking_m_s2
    braking_s = braking_s + stop.lag_s * np.log(fast_m_s / arriving_m_s)
    slow_m = fast_m_s * stop.lag_s + fast_m_s**2 / (2.0 * stop.braking_m_s2)
    full_speed_m = left_m - np.maximum(slow_m, stop.arrived_m)
    return braking_s + np.maximum(0.0, full_speed_m) / fastest_m_s


def meeting_s(left_m: Reals, fastest_m_s: Reals, fleeing_m_s: Reals, stop: Stop) -> Reals:
    """Return the time until the vehicle meets a fleeing evader at a place, braking to its speed.

    The vehicle closes the gap as in `closing_s`. The gap is smaller than the way to the place, because the evader
    reaches the place only at the meeting. Two steps of Newton's method find the gap.

    Args:
        left_m: Distance to the point of rest before the place.
        fastest_m_s: Its speed before it brakes.
        fleeing_m_s: The evader's speed along the way; less than `fastest_m_s`.
        stop: The vehicle's stop, relative to the evader.
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
