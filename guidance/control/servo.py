"""Velocity servo: makes a real vehicle fly the velocity that the game asks for.

    desired ─▶ reference, within acceleration and jerk ──▶ velocity, and its acceleration fed forward
                   │ late, as the vehicle is                    ▲
                   └──▶ expected − flown ──▶ drag and trim ─────┘

What goes out is a motion that the vehicle can fly, together with the acceleration that it takes: its own, and what drag
and wind cost besides, which is learned. PX4 adds a fed acceleration to what its velocity loop asks of the tilt (mask
3079); alone, that loop stays 8 to 19 % below the setpoint for many seconds. ArduCopter adds it to its own correction,
behind the 2.5 m/s² to which it limits that one (`shape_vel_accel_xy`, total not limited in GUIDED). There it moves the
reference that ArduCopter flies, exactly, so that nothing may be learned on top.

Drag is learned as a rate, acceleration per speed: it then falls at once when the vehicle brakes, where a plain integral
would push on. A vehicle that is far from what is expected of it (tilted to its limit, say) teaches little or nothing,
and what is learned is bounded: nothing winds up.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.shaping import shape
from guidance.frames import Vector, difference

_ZERO: Vector = (0.0, 0.0, 0.0)
_LONGEST_STEP_S = 0.1
_SLOW_M_S = 1.0
"""Below this speed drag cannot be told from trim."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoGains:
    """Gains of one vehicle.

    Attributes:
        acceleration_m_s2: Largest acceleration of the reference over the ground.
        vertical_acceleration_m_s2: The same vertically.
        jerk_m_s3: Largest jerk of the reference.
        settle_per_s: Gain from the velocity still missing to the reference's acceleration, where that is little.
        lag_s: How much later than the reference the vehicle flies.
        drag_per_s: Acceleration per speed that keeping a speed is taken to cost at first.
        drag_limit_per_s: Largest drag rate that is learned.
        trim_limit_m_s2: Largest acceleration over the ground that is learned besides.
        drag_learning_per_s2: Acceleration learned per second and per velocity error, as drag.
        trim_learning_per_s2: The same, as trim.
        learning_within_m_s: Velocity error up to which all of it is learned from, beyond it less and less, and nothing
            beyond three times as much.
    """

    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    settle_per_s: float = 4.0
    lag_s: float = 0.3
    drag_per_s: float = 0.0
    drag_limit_per_s: float = 0.0
    trim_limit_m_s2: float = 0.0
    drag_learning_per_s2: float = 0.0
    trim_learning_per_s2: float = 0.0
    learning_within_m_s: float = 1.0


class ServoMemory(NamedTuple):
    """What one call leaves to the next; as it is made, it begins at the vehicle's own velocity with nothing learned.

    Attributes:
        reference_ned_m_s: The velocity sent; None before the first call.
        acceleration_ned_m_s2: The reference's.
        expected_ned_m_s: The reference as late as the vehicle.
        drag_per_s: Learned drag rate; None before the first call.
        trim_ned_m_s2: Learned acceleration besides.
    """

    reference_ned_m_s: Vector | None = None
    acceleration_ned_m_s2: Vector = _ZERO
    expected_ned_m_s: Vector = _ZERO
    drag_per_s: float | None = None
    trim_ned_m_s2: Vector = _ZERO


class Served(NamedTuple):
    """Velocity and fed acceleration to command, before the limits, and the memory for the next call."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector
    memory: ServoMemory


def serve(
    desired_ned_m_s: Vector,
    flown_ned_m_s: Vector,
    memory: ServoMemory,
    gains: ServoGains,
    *,
    dt_s: float,
    held_back: bool = False,
) -> Served:
    """Turn the desired velocity into what to command.

    Args:
        desired_ned_m_s: What game and approach ask for.
        flown_ned_m_s: What the vehicle flies, from its telemetry.
        memory: From the last call.
        gains: Of the vehicle.
        dt_s: Seconds since the last call; no more than 0.1 s of them are made up for.
        held_back: Whether a limit holds the vehicle back from what is expected of it: nothing is learned then.
    """
    dt_s = min(max(dt_s, 0.0), _LONGEST_STEP_S)
    begun = memory.reference_ned_m_s is not None
    before = memory.reference_ned_m_s if memory.reference_ned_m_s is not None else flown_ned_m_s
    reference, acceleration = shape(
        desired_ned_m_s,
        before,
        memory.acceleration_ned_m_s2,
        ground_m_s2=gains.acceleration_m_s2,
        vertical_m_s2=gains.vertical_acceleration_m_s2,
        jerk_m_s3=gains.jerk_m_s3,
        dt_s=dt_s,
        settle_per_s=gains.settle_per_s,
    )

    north, east, down = memory.expected_ned_m_s if begun else flown_ned_m_s  # as late as the vehicle
    share = 1.0 - math.exp(-dt_s / gains.lag_s)
    expected = (
        north + (reference[0] - north) * share,
        east + (reference[1] - east) * share,
        down + (reference[2] - down) * share,
    )
    error = difference(expected, flown_ned_m_s)
    drag_per_s = gains.drag_per_s if memory.drag_per_s is None else memory.drag_per_s
    trim = memory.trim_ned_m_s2
    if not held_back:
        drag_per_s, trim = _learned(drag_per_s, trim, expected, error, gains, dt_s)

    feed_forward = (
        acceleration[0] + drag_per_s * reference[0] + trim[0],
        acceleration[1] + drag_per_s * reference[1] + trim[1],
        acceleration[2],
    )
    return Served(reference, feed_forward, ServoMemory(reference, acceleration, expected, drag_per_s, trim))


def _learned(
    drag_per_s: float, trim_ned_m_s2: Vector, expected: Vector, error: Vector, gains: ServoGains, dt_s: float
) -> tuple[float, Vector]:
    """Return drag and trim with what one error teaches, within their bounds.

    A large error is more likely a vehicle at its limits than one that needs more: it counts less, or not at all.
    """
    off_m_s, within_m_s = math.hypot(error[0], error[1]), gains.learning_within_m_s
    lesson_s = dt_s
    if off_m_s > within_m_s:
        lesson_s = 0.0 if off_m_s > 3.0 * within_m_s else dt_s * (within_m_s / off_m_s) ** 2
    speed = math.hypot(expected[0], expected[1])
    if speed >= _SLOW_M_S:
        missing = (error[0] * expected[0] + error[1] * expected[1]) / speed
        drag_per_s += gains.drag_learning_per_s2 * missing * lesson_s / speed
        drag_per_s = min(gains.drag_limit_per_s, max(0.0, drag_per_s))
    gain = gains.trim_learning_per_s2 * lesson_s
    north, east = trim_ned_m_s2[0] + gain * error[0], trim_ned_m_s2[1] + gain * error[1]
    size = math.hypot(north, east)
    share = gains.trim_limit_m_s2 / size if size > gains.trim_limit_m_s2 else 1.0
    return drag_per_s, (share * north, share * east, 0.0)
