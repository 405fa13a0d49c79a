"""Limits on the command itself, whatever the place: speeds, accelerations, jerk and turn rate.

Over the ground a vector is always scaled and never cut by axis, so that its direction is kept; the vertical is its
own axis, because the game is played on the cylinder ‖u_xy‖ ≤ a, |u_z| ≤ b, where a climb costs no ground speed.
"""

import math

from guidance.control.envelope import Envelope
from guidance.control.stopping import approach_speed
from guidance.frames import Vector, wrap_rad


def clamp_ground(vector_ned: Vector, largest: float) -> Vector:
    """Scale the ground part down to a largest size."""
    north, east, down = vector_ned
    size = math.hypot(north, east)
    if size <= largest:
        return vector_ned
    share = largest / size
    return (north * share, east * share, down)


def clamp_vertical(vector_ned: Vector, *, up: float, down: float) -> Vector:
    """Cut the vertical part to its largest size upwards and downwards."""
    return (vector_ned[0], vector_ned[1], min(down, max(-up, vector_ned[2])))


def clamp_speed(velocity_ned: Vector, envelope: Envelope) -> Vector:
    """All three limits of speed."""
    return clamp_vertical(
        clamp_ground(velocity_ned, envelope.speed_m_s), up=envelope.climb_m_s, down=envelope.descent_m_s
    )


def clamp_acceleration(vector_ned: Vector, envelope: Envelope) -> Vector:
    """Both limits of acceleration."""
    vertical = envelope.vertical_acceleration_m_s2
    return clamp_vertical(clamp_ground(vector_ned, envelope.acceleration_m_s2), up=vertical, down=vertical)


def slew(vector_ned: Vector, previous_ned: Vector, largest_change: float) -> Vector:
    """Move from the previous vector towards a new one by no more than a change, on the ground and vertically."""
    change = tuple(new - old for new, old in zip(vector_ned, previous_ned, strict=True))
    north, east, down = clamp_vertical(
        clamp_ground((change[0], change[1], change[2]), largest_change), up=largest_change, down=largest_change
    )
    return (previous_ned[0] + north, previous_ned[1] + east, previous_ned[2] + down)


def next_acceleration(
    wanted_m_s: Vector, velocity_m_s: Vector, acceleration_m_s2: Vector, envelope: Envelope, dt_s: float
) -> Vector:
    """The acceleration over the next dt that brings the velocity to the wanted one, within acceleration and jerk.

    It is no larger than what the jerk limit can take back to nothing before the wanted velocity is reached, so that
    the velocity arrives without overshoot (Σ of a stair of jerk·dt, which a²/(2·jerk) + a·dt bounds from above).
    """
    error = tuple(wanted - now for wanted, now in zip(wanted_m_s, velocity_m_s, strict=True))
    ground = math.hypot(error[0], error[1])
    level = approach_speed(ground, envelope.jerk_m_s3, dt_s) / ground if ground > 0.0 else 0.0
    steep = math.copysign(approach_speed(abs(error[2]), envelope.jerk_m_s3, dt_s), error[2])
    ideal = clamp_acceleration((error[0] * level, error[1] * level, steep), envelope)
    return slew(ideal, acceleration_m_s2, envelope.jerk_m_s3 * dt_s)


def next_yaw(wanted_rad: float, previous_rad: float, envelope: Envelope, dt_s: float) -> float:
    """Turn towards the wanted heading, the short way round, within the turn rate."""
    largest = envelope.yaw_rate_rad_s * dt_s
    turn = wrap_rad(wanted_rad - previous_rad)
    return wrap_rad(previous_rad + min(largest, max(-largest, turn)))
