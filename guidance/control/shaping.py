"""Shape a velocity: numbers, speeds, accelerations and jerk within limits, whatever the place.

Over the ground a vector is always scaled and never cut by axis, so that its direction is kept; the vertical is its
own axis, because the game is played on the cylinder ‖u_xy‖ ≤ a, |u_z| ≤ b, where a climb costs no ground speed.
"""

import math
from typing import NamedTuple

from guidance.control.envelope import Bounds
from guidance.frames import Vector

_LARGEST = 1e8


def usable(*numbers: float) -> bool:
    """Whether every number is finite and of a size that something in flight can have."""
    return all(abs(number) <= _LARGEST for number in numbers)


def approach_speed(distance: float, deceleration: float, lag_s: float) -> float:
    """The largest v with v · lag + v²/(2 · deceleration) ≤ distance; 0 where the distance is none or negative."""
    reserve = deceleration * lag_s
    return math.sqrt(reserve * reserve + 2.0 * deceleration * max(distance, 0.0)) - reserve


def clamp(vector_ned: Vector, bounds: Bounds) -> Vector:
    """Scale the ground part down to its largest size, and cut the vertical part to its own, upwards and downwards.

    Args:
        vector_ned: A velocity (m/s), an acceleration (m/s²), or a step of one.
        bounds: In the vector's unit.
    """
    north, east, vertical = vector_ned
    size = math.hypot(north, east)
    vertical = min(bounds.down, max(-bounds.up, vertical))
    if size <= bounds.ground:
        return (north, east, vertical)
    share = bounds.ground / size
    return (north * share, east * share, vertical)


def slew(vector_ned: Vector, previous_ned: Vector, largest_change: float) -> Vector:
    """Move from the previous vector towards a new one by no more than a change, on the ground and vertically."""
    change = (vector_ned[0] - previous_ned[0], vector_ned[1] - previous_ned[1], vector_ned[2] - previous_ned[2])
    north, east, down = clamp(change, Bounds(largest_change, largest_change, largest_change))
    return (previous_ned[0] + north, previous_ned[1] + east, previous_ned[2] + down)


class Shaped(NamedTuple):
    """A velocity after one step, and the acceleration of that step."""

    velocity_m_s: Vector
    acceleration_m_s2: Vector


def shape(
    desired_m_s: Vector,
    velocity_m_s: Vector,
    acceleration_m_s2: Vector,
    *,
    ground_m_s2: float,
    vertical_m_s2: float,
    jerk_m_s3: float,
    dt_s: float,
    settle_per_s: float | None = None,
) -> Shaped:
    """Bring a velocity towards the desired one over the next dt, within acceleration and jerk.

    The acceleration is no larger than what the jerk limit can take back to nothing before the desired velocity is
    reached, so that the velocity arrives without overshoot (Σ of a stair of jerk·dt, which a²/(2·jerk) + a·dt bounds
    from above).

    Args:
        desired_m_s: Where to.
        velocity_m_s: The velocity now.
        acceleration_m_s2: Of the last dt.
        ground_m_s2: Largest acceleration over the ground.
        vertical_m_s2: Largest acceleration upwards and downwards.
        jerk_m_s3: Largest jerk.
        dt_s: Seconds.
        settle_per_s: Largest gain from the velocity still missing to the acceleration; None for no such limit.
    """
    now_north, now_east, now_down = velocity_m_s
    north, east, down = desired_m_s[0] - now_north, desired_m_s[1] - now_east, desired_m_s[2] - now_down
    ground = math.hypot(north, east)
    eased = approach_speed(ground, jerk_m_s3, dt_s), approach_speed(abs(down), jerk_m_s3, dt_s)
    if settle_per_s is not None:
        eased = min(eased[0], settle_per_s * ground), min(eased[1], settle_per_s * abs(down))
    level = min(eased[0], ground_m_s2) / ground if ground > 0.0 else 0.0
    steep = math.copysign(min(eased[1], vertical_m_s2), down)
    shaped = slew((north * level, east * level, steep), acceleration_m_s2, jerk_m_s3 * dt_s)
    return Shaped((now_north + shaped[0] * dt_s, now_east + shaped[1] * dt_s, now_down + shaped[2] * dt_s), shaped)
