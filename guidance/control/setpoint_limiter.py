"""The setpoint limiter, last before the wire: every command becomes a setpoint within the envelope, whatever was asked.

The order, and why:

 1. situation      A place that is not known (NaN, infinite) can be judged by no limit: stand still at once.
 2. command        Anything in it that is not a number: the whole command is refused, and a stop takes its place.
 3. clock          A late or impossible time step counts as 0.1 s or 0 s: no step is made up for.
 4. speed          Ground vector scaled, vertical cut. First, so that what follows starts from a velocity that may be.
 5. acceleration   From the last setpoint towards the velocity, within acceleration and jerk; within acceleration alone
                   where the servo has led it there already. Comfort comes before safety in order, so that safety can
                   overrule it: a constraint may stop more sharply than this allows.
 6. stand-off      ┐ Constraints, each takes away only what closes on it and keeps what goes along. A later one can bend
 7. fences         │ a velocity back into an earlier one, so all are asked again by scaling alone, which breaks none
 8. floor, ceiling ┘ of the others: in the end all hold together. Standing still always does.
 9. feed-forward   Within acceleration and jerk; it brakes before walls (`braking`), however sharply that comes; nothing
                   of it pushes where a limit is active, or drives past a speed's.
10. yaw            Turned at the turn rate.

Nothing is kept here: the memory goes in and comes out, and it holds what was sent, not what was wished, so that
nothing winds up behind a limit.
"""

import math
from typing import NamedTuple

from guidance.control.braking import braked
from guidance.control.envelope import Bounds, Envelope, Limiter, Situation
from guidance.control.fence import FenceGeometry, measure_fence
from guidance.control.shaping import Shaped, clamp, shape, slew, usable
from guidance.control.velocity_constraints import VelocityConstraint, feasible_velocity, shrink, slide
from guidance.frames import Vector, difference, wrap_rad
from guidance.messages import Setpoint

STILL: Vector = (0.0, 0.0, 0.0)
_LONGEST_STEP_S = 0.1
NOTED = 0.05
"""A limiter of the command itself is named for a change of more than this (m/s, m/s², m or rad).

Less is what a multicopter's velocity wanders by as it hovers (0.03 to 0.08 m/s). Constraints are named for any change.
"""


OVER_SPEED = 0.05
"""Share of a speed limit over which what a feed-forward may push along it fades away, once the vehicle flies faster."""


class LimitMemory(NamedTuple):
    """What was sent last: velocity, the acceleration that led to it, the feed-forward, and the yaw.

    `held_back` says that a fence, floor, ceiling or stand-off took something of the velocity away.
    """

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector = STILL
    feed_forward_ned_m_s2: Vector = STILL
    yaw_rad: float = 0.0
    held_back: bool = False


class Limited(NamedTuple):
    """The setpoint to send, the limiters that changed the command (see `NOTED`), and the memory for the next cycle."""

    setpoint: Setpoint
    active: tuple[Limiter, ...]
    memory: LimitMemory


def start(situation: Situation, envelope: Envelope) -> LimitMemory:
    """The memory at engagement: the vehicle's own velocity and heading, so that the first setpoint is no step."""
    if not usable(*situation.velocity_ned_m_s, situation.yaw_rad):
        return LimitMemory(STILL)
    return LimitMemory(clamp(situation.velocity_ned_m_s, envelope.speeds), yaw_rad=situation.yaw_rad)


def limit(
    command: Setpoint,
    situation: Situation,
    envelope: Envelope,
    memory: LimitMemory | None,
    dt_s: float,
    *,
    fence: FenceGeometry | None = None,
    already_shaped: bool = False,
) -> Limited:
    """Turn a command into a setpoint that the envelope allows. Never raises, and never returns a NaN.

    Args:
        command: What guidance asks for; any numbers at all.
        situation: Own state and the evader's; any numbers at all.
        envelope: What is allowed.
        memory: From the last call; None at the first one, which then starts at the vehicle's own velocity.
        dt_s: Time since the last call, seconds.
        fence: Where the vehicle is to the fences, where that is measured already.
        already_shaped: Whether the servo has shaped the velocity; then only its acceleration is limited, not its jerk.
    """
    active: list[Limiter] = []
    here: Situation | None = situation
    if memory is None or not _all_usable(command, situation, memory):
        if memory is None or not usable(*(number for part in memory[:3] for number in part), memory.yaw_rad):
            memory = start(situation, envelope)
        here, command = _known(situation), _numbers_only(command, memory, active)
    if here is None:
        return Limited(Setpoint(STILL), (Limiter.SITUATION,), LimitMemory(STILL, yaw_rad=memory.yaw_rad))
    if not 0.0 <= dt_s <= _LONGEST_STEP_S:
        active.append(Limiter.CLOCK)
        dt_s = _LONGEST_STEP_S if dt_s > _LONGEST_STEP_S else 0.0

    allowed = clamp(command.velocity_ned_m_s, envelope.speeds)
    _note_vector(active, Limiter.SPEED, Limiter.VERTICAL_SPEED, allowed, command.velocity_ned_m_s)
    shaped, acceleration = (_accelerate if already_shaped else _shape)(allowed, memory, envelope, dt_s)
    _note_vector(active, Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION, shaped, allowed)
    fence = measure_fence(here.position_ned_m, envelope) if fence is None else fence
    velocity, constraints = feasible_velocity(shaped, here, fence, envelope)
    active.extend(dict.fromkeys(one.limiter for one in constraints))
    closed = tuple(one.closed() for one in constraints)
    at_speed = _full_speed_constraints(velocity, here.velocity_ned_m_s, envelope)
    eased = _eased(command.acceleration_ned_m_s2, memory, envelope, dt_s)
    feed_forward = braked(eased, here, fence, envelope)
    if feed_forward is not None:
        feed_forward = _without_pushing(clamp(feed_forward, envelope.accelerations), (*closed, *at_speed))
        wanted = command.acceleration_ned_m_s2 or STILL
        _note_vector(active, Limiter.FEED_FORWARD, Limiter.FEED_FORWARD, feed_forward, wanted)
    yaw_rad = _yaw(command.yaw_rad, memory, envelope, dt_s, active)
    sent = LimitMemory(
        velocity,
        _without_pushing(acceleration, (*closed, *(one.closed() for one in at_speed))),
        feed_forward or STILL,
        here.yaw_rad if yaw_rad is None else yaw_rad,
        bool(constraints),
    )
    return Limited(Setpoint(velocity, feed_forward, yaw_rad), tuple(active), sent)


def _all_usable(command: Setpoint, situation: Situation, memory: LimitMemory) -> bool:
    place, velocity, yaw_rad, evader, moving, acceleration = situation
    asked = (*command.velocity_ned_m_s, *(command.acceleration_ned_m_s2 or ()), command.yaw_rad or 0.0)
    sent, led_to_it, fed, turned, _ = memory
    seen = (*place, *velocity, yaw_rad, *acceleration, *(evader or ()), *(moving or ()))
    return usable(*asked, *seen, *sent, *led_to_it, *fed, turned)


def _known(situation: Situation) -> Situation | None:
    """The situation with an evader velocity that is a number or None; None where it cannot be judged."""
    place, velocity, yaw_rad, evader, moving, acceleration = situation
    if not usable(*place, *velocity, yaw_rad, *(evader or ())):
        return None
    return situation._replace(
        acceleration_ned_m_s2=acceleration if usable(*acceleration) else (0.0, 0.0, 0.0),
        evader_velocity_ned_m_s=moving if usable(*(moving or ())) else None,
    )


def _numbers_only(command: Setpoint, memory: LimitMemory, active: list[Limiter]) -> Setpoint:
    if usable(*command.velocity_ned_m_s, *(command.acceleration_ned_m_s2 or ()), command.yaw_rad or 0.0):
        return command
    active.append(Limiter.COMMAND)
    return Setpoint(STILL, yaw_rad=memory.yaw_rad)


def _shape(allowed: Vector, memory: LimitMemory, envelope: Envelope, dt_s: float) -> Shaped:
    """Bring the velocity sent last towards what is allowed, within acceleration and jerk."""
    velocity, acceleration = shape(
        allowed,
        clamp(memory.velocity_ned_m_s, envelope.speeds),
        clamp(memory.acceleration_ned_m_s2, envelope.accelerations),
        ground_m_s2=envelope.acceleration_m_s2,
        vertical_m_s2=envelope.vertical_acceleration_m_s2,
        jerk_m_s3=envelope.jerk_m_s3,
        dt_s=dt_s,
    )
    return Shaped(clamp(velocity, envelope.speeds), acceleration)


def _accelerate(allowed: Vector, memory: LimitMemory, envelope: Envelope, dt_s: float) -> Shaped:
    """The same within the acceleration alone."""
    before, most = clamp(memory.velocity_ned_m_s, envelope.speeds), envelope.accelerations
    if dt_s <= 0.0:
        return Shaped(before, STILL)
    change = difference(allowed, before)
    north, east, down = step = clamp(change, Bounds(most.ground * dt_s, most.up * dt_s, most.down * dt_s))
    reached = allowed if step == change else (before[0] + north, before[1] + east, before[2] + down)
    return Shaped(reached, (north / dt_s, east / dt_s, down / dt_s))


def _yaw(
    desired_rad: float | None, memory: LimitMemory, envelope: Envelope, dt_s: float, active: list[Limiter]
) -> float | None:
    """Turn towards the desired heading, the short way round, within the turn rate."""
    if desired_rad is None:
        return None
    largest, turn = envelope.yaw_rate_rad_s * dt_s, wrap_rad(desired_rad - memory.yaw_rad)
    allowed = min(largest, max(-largest, turn))
    if abs(allowed - turn) > NOTED:
        active.append(Limiter.YAW)
    return wrap_rad(memory.yaw_rad + allowed)


def _eased(desired: Vector | None, memory: LimitMemory, envelope: Envelope, dt_s: float) -> Vector | None:
    """Bring the feed-forward towards the desired one, within acceleration and jerk."""
    if desired is None:
        return None
    return slew(clamp(desired, envelope.accelerations), memory.feed_forward_ned_m_s2, envelope.jerk_m_s3 * dt_s)


def _full_speed_constraints(
    velocity_ned_m_s: Vector, flown_ned_m_s: Vector, envelope: Envelope
) -> tuple[VelocityConstraint, ...]:
    """Where a speed limit is commanded, it constrains the feed-forward as well, of m/s² for a distance.

    A feed-forward may turn the velocity, and hold it against drag, which takes several m/s² at full speed: along a
    limit it may push as long as the vehicle itself flies no faster, and not at all from `OVER_SPEED` above it on.
    """
    (north, east, down), flown = velocity_ned_m_s, flown_ned_m_s
    ground_m_s = math.hypot(north, east)
    found = []
    if ground_m_s >= envelope.speed_m_s * (1.0 - 1e-9):
        along = (north / ground_m_s, east / ground_m_s, 0.0)
        push = _push(flown[0] * along[0] + flown[1] * along[1], envelope.speed_m_s, envelope.acceleration_m_s2)
        found.append(VelocityConstraint(Limiter.SPEED, along, push))
    vertical_m_s2 = envelope.vertical_acceleration_m_s2
    if down >= envelope.descent_m_s * (1.0 - 1e-9):
        push = _push(flown[2], envelope.descent_m_s, vertical_m_s2)
        found.append(VelocityConstraint(Limiter.VERTICAL_SPEED, (0.0, 0.0, 1.0), push))
    if -down >= envelope.climb_m_s * (1.0 - 1e-9):
        push = _push(-flown[2], envelope.climb_m_s, vertical_m_s2)
        found.append(VelocityConstraint(Limiter.VERTICAL_SPEED, (0.0, 0.0, -1.0), push))
    return tuple(found)


def _push(flown_m_s: float, limit_m_s: float, most_m_s2: float) -> float:
    """Return the acceleration that a vehicle at this speed may still be given along a speed limit."""
    over = (flown_m_s - limit_m_s) / (OVER_SPEED * limit_m_s)
    return most_m_s2 * min(1.0, max(0.0, 1.0 - over))


def _without_pushing(acceleration: Vector, constraints: tuple[VelocityConstraint, ...]) -> Vector:
    for one in constraints:
        acceleration = slide(acceleration, one)
    for one in constraints:
        acceleration = shrink(acceleration, one)
    return acceleration


def _note_vector(active: list[Limiter], ground: Limiter, vertical: Limiter, got: Vector, desired: Vector) -> None:
    if abs(got[0] - desired[0]) > NOTED or abs(got[1] - desired[1]) > NOTED:
        active.append(ground)
    if abs(got[2] - desired[2]) > NOTED and vertical not in active:
        active.append(vertical)
