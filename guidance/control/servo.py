"""The control loops of one vehicle: velocity servo, altitude hold and station keeping; and the speed that it reaches.

**Velocity servo** (`serve`). It makes a real vehicle fly the desired velocity.

    desired ─▶ reference, within acceleration and jerk ──▶ velocity, and its acceleration as feed-forward
                   │ delayed like the vehicle                   ▲
                   └──▶ expected − flown ──▶ drag and trim ─────┘

The setpoint is a motion that the vehicle can fly, with the acceleration that it needs: its own, plus the learned part
that drag and wind cost. PX4 adds a feed-forward to the output of its velocity controller (type mask 3079); alone, that
controller stays 8 to 19 % below the setpoint for many seconds. ArduCopter adds it to its own correction, after it has
limited that one to 2.5 m/s² (`shape_vel_accel_xy`; the sum is not limited in GUIDED). It then moves ArduCopter's
reference exactly, so nothing may be learned on top.

Drag is learned as a rate, acceleration per speed. The feed-forward then decreases at once when the vehicle brakes; a
plain integral would keep pushing. A vehicle with a large velocity error (at its tilt limit, for example) teaches
little or nothing, and drag and trim are bounded, so nothing winds up.

**Hover** (`hold_altitude`, `keep_station`). Zero velocity does not stop a vehicle. The autopilot controls its own
velocity estimate and drifts with that error (PX4: 0.2 m/s, and it sinks 6.5 m in 75 s of level flight). The caller
takes the drift out, and these loops keep height and place.

**Speed** (`observe_speed`). A vehicle may be slower than its file says: tilt limit, drag, wind. The game's speed is
compared with the mean speed flown over `RESPONSE_S` or longer. The ratio of the two is the share that it reaches. While
it gains speed or brakes, this share can only rise. A time counts only once a HEARTBEAT in the guided mode has come
after it: until then a pilot may have taken over. A vehicle that climbs or descends is often a little slower than a
level one, and will be level before the meeting. So level flight is compared by itself, and other flight counts only if
more is missing than the vertical motion explains.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.control.braking_law import approach_speed
from guidance.control.limits import Agility, Envelope
from guidance.control.polygon import Point
from guidance.frames import STILL, Ned, usable

LONGEST_STEP_S: Final = 0.1
_SLOW_M_S: Final = 1.0
"""Below this speed, drag cannot be distinguished from trim."""


def shape(
    desired_m_s: Ned,
    velocity_m_s: Ned,
    acceleration_m_s2: Ned,
    most: Agility,
    dt_s: float,
    gain_per_s: float,
) -> tuple[Ned, Ned]:
    """Move a velocity towards the desired one for one step; return it and the acceleration of that step.

    The acceleration is small enough for the jerk to reduce it to zero before the desired velocity is reached, so the
    velocity arrives without overshoot: a²/(2·jerk) + a·dt bounds the velocity gained meanwhile.

    Args:
        desired_m_s: Desired velocity.
        velocity_m_s: Present velocity.
        acceleration_m_s2: Of the last step.
        most: Largest acceleration and jerk.
        dt_s: Duration of the step.
        gain_per_s: Largest gain from the missing velocity to the acceleration; infinite for none.
    """
    missing = desired_m_s - velocity_m_s
    size = math.hypot(missing.north, missing.east)
    height = abs(missing.down)
    level = min(approach_speed(size, most.jerk_m_s3, dt_s), most.acceleration_m_s2)
    steep = min(approach_speed(height, most.jerk_m_s3, dt_s), most.vertical_acceleration_m_s2)
    if gain_per_s < math.inf:
        level = min(level, gain_per_s * size)
        steep = min(steep, gain_per_s * height)
    share = level / size if size > 0.0 else 0.0
    down = math.copysign(steep, missing.down)
    wanted = Ned((missing.north * share, missing.east * share, down))
    change = wanted - acceleration_m_s2
    largest = most.jerk_m_s3 * dt_s
    acceleration = acceleration_m_s2 + change.clamped(largest, largest, largest)
    return velocity_m_s + acceleration * dt_s, acceleration


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoGains(Agility):
    """Gains of one vehicle, and the largest accelerations and jerk of the reference.

    Attributes:
        settle_per_s: Largest gain from the missing velocity to the reference's acceleration.
        lag_s: Delay of the vehicle behind the reference.
        drag_per_s: Initial drag rate.
        drag_limit_per_s: Largest learned drag rate.
        trim_limit_m_s2: Largest learned acceleration without drag, over the ground.
        drag_learning_per_s2: Acceleration learned per second and velocity error, as drag.
        trim_learning_per_s2: The same, as trim.
        learning_within_m_s: Velocity errors up to this count fully, larger ones less, and those above three times this
            not.
    """

    settle_per_s: float = 4.0
    lag_s: float = 0.3
    drag_per_s: float = 0.0
    drag_limit_per_s: float = 0.0
    trim_limit_m_s2: float = 0.0
    drag_learning_per_s2: float = 0.0
    trim_learning_per_s2: float = 0.0
    learning_within_m_s: float = 1.0


class ServoMemory(NamedTuple):
    """Memory between calls.

    Attributes:
        reference_ned_m_s: Velocity to command, before the limits.
        acceleration_ned_m_s2: Of the reference.
        expected_ned_m_s: The reference, delayed like the vehicle.
        drag_per_s: Learned drag rate.
        trim_ned_m_s2: Learned acceleration without drag.
    """

    reference_ned_m_s: Ned
    acceleration_ned_m_s2: Ned
    expected_ned_m_s: Ned
    drag_per_s: float
    trim_ned_m_s2: Ned


def serve(
    desired_ned_m_s: Ned,
    flown_ned_m_s: Ned,
    memory: ServoMemory | None,
    gains: ServoGains,
    *,
    dt_s: float,
    held_back: bool = False,
) -> tuple[Ned, ServoMemory]:
    """Return the acceleration to feed forward, and the memory, which has the velocity to command.

    Args:
        desired_ned_m_s: Desired velocity, after the approach.
        flown_ned_m_s: Velocity of the vehicle.
        memory: From the last call; None at first, which starts at the vehicle's own velocity with nothing learned.
        gains: Of the vehicle.
        dt_s: Time since the last call, s; at most 0.1 s counts.
        held_back: Whether a wall reduced the last command; the servo then learns nothing.
    """
    dt_s = min(max(dt_s, 0.0), LONGEST_STEP_S)
    if memory is None:
        memory = ServoMemory(flown_ned_m_s, STILL, flown_ned_m_s, gains.drag_per_s, STILL)
    before, gained_m_s2, delayed, drag_per_s, trim = memory
    reference, acceleration = shape(
        desired_ned_m_s, before, gained_m_s2, gains, dt_s, gains.settle_per_s
    )
    expected = delayed + (1.0 - math.exp(-dt_s / gains.lag_s)) * (reference - delayed)
    if not held_back:
        # Learn drag and trim, within their bounds. A large velocity error usually means that the vehicle is at its
        # limits, so it counts less.
        error = expected - flown_ned_m_s
        off_m_s = math.hypot(error.north, error.east)
        within_m_s = gains.learning_within_m_s
        lesson_s = dt_s
        if off_m_s > within_m_s:
            lesson_s = 0.0 if off_m_s > 3.0 * within_m_s else dt_s * (within_m_s / off_m_s) ** 2
        speed = math.hypot(expected.north, expected.east)
        if speed >= _SLOW_M_S:
            missing = error.level_dot(expected) / speed
            drag_per_s += gains.drag_learning_per_s2 * missing * lesson_s / speed
            drag_per_s = min(gains.drag_limit_per_s, max(0.0, drag_per_s))
        gain = gains.trim_learning_per_s2 * lesson_s
        trim = (trim + gain * error).clamped(gains.trim_limit_m_s2, 0.0, 0.0)
    fed = acceleration + drag_per_s * reference + trim
    fed_level_only = Ned((fed.north, fed.east, acceleration.down))
    kept = ServoMemory(reference, acceleration, expected, drag_per_s, trim)
    return fed_level_only, kept


GAIN_PER_S: Final = 0.8
LARGEST_INTEGRAL_M_S: Final = 0.5
AT_REST_M_S: Final = 0.5
AWAY_M: Final = 1.5
_INTEGRAL_PER_S2: Final = 0.08


class AltitudeHold(NamedTuple):
    """Memory: the height to keep (down, m), and the vertical speed that keeping it costs."""

    down_m: float
    trim_m_s: float


def hold_altitude(
    memory: AltitudeHold | None, *, down_m: float, envelope: Envelope, dt_s: float
) -> tuple[float, AltitudeHold | None]:
    """Return the vertical speed that keeps a height (m/s, positive down), and the memory for the next cycle.

    Far from the height the speed follows a braking curve. A slow, bounded integral compensates a steady sink; it stops
    while the error is large. The height is the one at the first call, moved between floor and ceiling, so a vehicle
    outside them comes back.

    Args:
        memory: None at the first cycle of a hold.
        down_m: Present height in the local frame (down, m). If it is not a number, the speed is 0.
        envelope: Floor, ceiling, speeds and vertical braking.
        dt_s: Time since the last cycle, s.
    """
    if not usable(down_m):
        return 0.0, memory
    held_m, trim_m_s = (
        memory if memory is not None and usable(*memory) else AltitudeHold(down_m, 0.0)
    )
    home_down_m = envelope.home_ned_m.down
    held_m = min(home_down_m - envelope.floor_m, max(home_down_m - envelope.ceiling_m, held_m))
    error_m = held_m - down_m
    if abs(error_m) < AWAY_M:
        trim_m_s += _INTEGRAL_PER_S2 * error_m * min(LONGEST_STEP_S, max(0.0, dt_s))
        trim_m_s = min(LARGEST_INTEGRAL_M_S, max(-LARGEST_INTEGRAL_M_S, trim_m_s))
    reach_m_s = approach_speed(abs(error_m), envelope.vertical_braking_m_s2, 1.0 / GAIN_PER_S)
    wanted_m_s = math.copysign(reach_m_s, error_m) + trim_m_s
    return min(envelope.descent_m_s, max(-envelope.climb_m_s, wanted_m_s)), AltitudeHold(
        held_m, trim_m_s
    )


def keep_station(
    place: Point | None, position_ned_m: Ned, flown_ned_m_s: Ned
) -> tuple[Point, Point | None]:
    """Return the velocity over the ground that stops and stays, (north, east) in m/s, and the place for the next call.

    Args:
        place: From the last call; None at first.
        position_ned_m: Position of the vehicle.
        flown_ned_m_s: Velocity of the vehicle, without drift.
    """
    here = position_ned_m[:2]
    if place is None and flown_ned_m_s.level_length() > AT_REST_M_S:
        return (0.0, 0.0), None
    if place is None or math.dist(place, here) > AWAY_M:
        # Blown away, or the estimate was reset: do not return to the old place.
        return (0.0, 0.0), here
    north, east = (GAIN_PER_S * (held - now) for held, now in zip(place, here, strict=True))
    speed = math.hypot(north, east)
    share = LARGEST_INTEGRAL_M_S / speed if speed > LARGEST_INTEGRAL_M_S else 1.0
    return (share * north, share * east), place


RESPONSE_S: Final = 2.0
"""Shortest time of the mean; estimates of the speed wander by some per cent within a second."""

SHORT: Final = 0.02
"""Share of the speed asked for that may be missing in level flight; the mean scatters by about as much."""

SHORT_NOT_LEVEL: Final = 0.1
"""The same in a climb or descent. PX4 at its full rate of descent flies 5 % below the commanded speed of 8 m/s."""

_LEVEL_M_S: Final = 0.3
"""Largest vertical speed of level flight."""

_SMOOTHED_S: Final = 0.5
_STEADY_M_S2: Final = 0.3
"""Mean acceleration above which a vehicle is gaining speed or braking."""

_ALIGNED: Final = 0.9
"""Least share of the velocity along the desired one; below it the vehicle is turning."""

_LEAST_ASKED_M_S: Final = 1.0


class SpeedMemory(NamedTuple):
    """Speeds that a vehicle has flown.

    Attributes:
        shown_m_s: Largest speed flown over the ground, smoothed.
        share: Share of the game's speed over the ground that it reaches, 1 at first.
        flown_ned_m_s: Mean velocity of the last half second or so.
        compared_s: Time of commanded full speed without a turn, either all in level flight or all not.
        covered_s: The same, weighted by the share of that speed that it flew.
        began_m_s: Its speed at the beginning of that time.
    """

    shown_m_s: float = 0.0
    share: float = 1.0
    flown_ned_m_s: Ned = STILL
    compared_s: float = 0.0
    covered_s: float = 0.0
    began_m_s: float = 0.0


def observe_speed(
    memory: SpeedMemory,
    asked_ned_m_s: Ned,
    flown_ned_m_s: Ned,
    *,
    unslowed: bool,
    guided: bool,
    dt_s: float,
) -> SpeedMemory:
    """Compare the velocity that the game asks for with the one flown, for one cycle.

    Args:
        memory: From the last call.
        asked_ned_m_s: Velocity of the game at the vehicle's nominal speed.
        flown_ned_m_s: Velocity of the vehicle over the ground.
        unslowed: Whether the whole speed is commanded, not reduced by the approach or a limit.
        guided: Whether a HEARTBEAT of this cycle shows the guided mode.
        dt_s: Seconds since the last call.
    """
    weight = min(1.0, dt_s / _SMOOTHED_S)
    mean = memory.flown_ned_m_s + weight * (flown_ned_m_s - memory.flown_ned_m_s)
    speed = math.hypot(mean.north, mean.east)
    shown_m_s = max(memory.shown_m_s, speed)
    asked = math.hypot(asked_ned_m_s.north, asked_ned_m_s.east)
    along = mean.level_dot(asked_ned_m_s) / max(asked, _LEAST_ASKED_M_S)
    if not (unslowed and asked >= _LEAST_ASKED_M_S and along >= _ALIGNED * speed):
        return SpeedMemory(shown_m_s, memory.share, mean)
    level = abs(mean.down) <= _LEVEL_M_S
    was_level = abs(memory.flown_ned_m_s.down) <= _LEVEL_M_S
    if memory.compared_s == 0.0 or level != was_level:
        memory = memory._replace(compared_s=0.0, covered_s=0.0, began_m_s=along)
    began_m_s = memory.began_m_s
    compared_s = memory.compared_s + dt_s
    covered_s = memory.covered_s + dt_s * along / asked
    if not (guided and compared_s >= RESPONSE_S):
        return SpeedMemory(shown_m_s, memory.share, mean, compared_s, covered_s, began_m_s)
    steady = abs(along - began_m_s) < _STEADY_M_S2 * compared_s
    reached = covered_s / compared_s
    share = reached if steady else max(memory.share, reached)
    short = SHORT if level else SHORT_NOT_LEVEL
    return SpeedMemory(shown_m_s, 1.0 if share > 1.0 - short else share, mean)
