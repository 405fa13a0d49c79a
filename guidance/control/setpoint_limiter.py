"""The setpoint limiter, last before the wire: it turns any command into a setpoint within the envelope.

The order, and why:

 1. situation      If the vehicle's place is not a number, no limit can be checked: command zero velocity at once.
 2. command        If anything in it is not a number, it is replaced by a stop.
 3. clock          A time step outside 0 to 0.1 s is cut, so that a late cycle causes no larger step.
 4. speed          The ground vector is scaled, the vertical part cut. It is first, so that the next steps start from an
                   allowed velocity.
 5. acceleration   From the last setpoint towards the velocity, within acceleration and jerk. A velocity that the servo
                   has shaped is limited in acceleration only. It comes before the walls, because a vehicle may have to
                   stop for a wall more sharply than this allows.
 6. walls          Stand-off, fences, floor and ceiling, see `guidance.control.braking_law`.
 7. feed-forward   Within acceleration and jerk. Braking for a wall overrules the jerk. No part may push towards an
                   active wall, or beyond a speed limit that is commanded; the stand-off's wall takes it away gradually.
 8. yaw            Within the turn rate.

The limiter keeps no state. Its memory holds the setpoint sent, not the command, so nothing winds up behind a limit.
"""

import math
from typing import Final, NamedTuple

from guidance.control.braking_law import (
    DOWN,
    UP,
    Constraint,
    Situation,
    Wall,
    braked,
    constraints_of,
    measure_walls,
    obey,
)
from guidance.control.limits import Agility, Envelope, Limiter
from guidance.control.servo import LONGEST_STEP_S, shape
from guidance.frames import STILL, Ned, usable
from guidance.messages import Setpoint

_Row = tuple[float, ...]

NOTED: Final = 0.05
"""A limiter other than a wall is named for a change of more than this (m/s, m/s², or rad).

The velocity of a hovering multicopter varies by 0.03 to 0.08 m/s.
"""

EASED_M_S: Final = 1.0
"""The stand-off's wall ends the feed-forward towards it when it has taken this much speed away."""

OVER_SPEED: Final = 0.05
"""The feed-forward may not push along a speed limit from this share above the limit."""


class LimitMemory(NamedTuple):
    """The last setpoint.

    Attributes:
        velocity_ned_m_s: Velocity sent.
        acceleration_ned_m_s2: Acceleration that led to it.
        feed_forward_ned_m_s2: Acceleration sent.
        yaw_rad: Heading sent.
        held_back: Whether a wall reduced the velocity.
    """

    velocity_ned_m_s: Ned
    acceleration_ned_m_s2: Ned = STILL
    feed_forward_ned_m_s2: Ned = STILL
    yaw_rad: float = 0.0
    held_back: bool = False


class Limited(NamedTuple):
    """The setpoint to send, the limiters that changed the command (see `NOTED`), and the memory for the next cycle."""

    setpoint: Setpoint
    active: tuple[Limiter, ...]
    memory: LimitMemory


def start(situation: Situation, envelope: Envelope) -> LimitMemory:
    """Return the memory at engagement: the vehicle's own velocity and heading, so the first setpoint is no step."""
    if not usable(*situation.velocity_ned_m_s, situation.yaw_rad):
        return LimitMemory(STILL)
    speeds = envelope.speed_m_s, envelope.climb_m_s, envelope.descent_m_s
    return LimitMemory(situation.velocity_ned_m_s.clamped(*speeds), yaw_rad=situation.yaw_rad)


def limit(  # noqa: PLR0914
    command: Setpoint,
    situation: Situation,
    envelope: Envelope,
    memory: LimitMemory | None,
    dt_s: float,
    *,
    walls: tuple[Wall, ...] | None = None,
    already_shaped: bool = False,
) -> Limited:
    """Turn a command into a setpoint that the envelope allows. Never raises and never returns NaN.

    Args:
        command: Setpoint before the limits; any numbers.
        situation: State of the vehicle and the evader; any numbers.
        envelope: The limits.
        memory: From the last call; None at the first one, which starts at the vehicle's own velocity.
        dt_s: Time since the last call, s; any number.
        walls: Of this cycle; measured here if None.
        already_shaped: Whether the servo has shaped the velocity; then its jerk is not limited.
    """
    active: list[Limiter] = []
    memory = start(situation, envelope) if memory is None else memory
    gaining = situation.acceleration_ned_m_s2
    state, demands, last = _numbers(situation, command, memory)
    if not usable(*state, *gaining, *demands, *last):
        memory = memory if usable(*last) else start(situation, envelope)
        if not usable(*state):
            return Limited(
                Setpoint(STILL), (Limiter.SITUATION,), LimitMemory(STILL, yaw_rad=memory.yaw_rad)
            )
        situation = situation._replace(acceleration_ned_m_s2=gaining if usable(*gaining) else STILL)
        if not usable(*demands):
            active.append(Limiter.COMMAND)
            command = Setpoint(STILL, yaw_rad=memory.yaw_rad)
    if not 0.0 <= dt_s <= LONGEST_STEP_S:
        active.append(Limiter.CLOCK)
        dt_s = LONGEST_STEP_S if dt_s > LONGEST_STEP_S else 0.0
    walls = measure_walls(situation, envelope) if walls is None else walls

    speeds = envelope.speed_m_s, envelope.climb_m_s, envelope.descent_m_s
    vertical_m_s2 = envelope.vertical_acceleration_m_s2
    accelerations = envelope.acceleration_m_s2, vertical_m_s2, vertical_m_s2
    allowed = command.velocity_ned_m_s.clamped(*speeds)
    _note(active, Limiter.SPEED, Limiter.VERTICAL_SPEED, allowed, command.velocity_ned_m_s)
    before = memory.velocity_ned_m_s.clamped(*speeds)
    if already_shaped:
        shaped, acceleration = _accelerated(allowed, before, envelope, dt_s, active)
    else:
        gained = memory.acceleration_ned_m_s2.clamped(*accelerations)
        shaped, acceleration = shape(allowed, before, gained, envelope, dt_s, math.inf)
        shaped = shaped.clamped(*speeds)
        _note(active, Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION, shaped, allowed)
    velocity, holding = obey(shaped, constraints_of(shaped, situation, walls, envelope))
    active.extend(dict.fromkeys([constraint.limiter for constraint in holding]))
    at_speed = _at_speed_limit(velocity, situation.velocity_ned_m_s, envelope)
    closed = tuple([constraint._replace(distance_m=0.0) for constraint in (*holding, *at_speed)])

    demanded = command.acceleration_ned_m_s2
    slewed = None
    if demanded is not None:
        change = demanded.clamped(*accelerations) - memory.feed_forward_ned_m_s2
        largest = envelope.jerk_m_s3 * dt_s
        slewed = memory.feed_forward_ned_m_s2 + change.clamped(largest, largest, largest)
    feed_forward = braked(slewed, situation, walls, envelope)
    if feed_forward is not None:
        # Before the stand-off the approach is about to brake. Until then the feed-forward is still needed against drag,
        # so it shrinks as the wall takes speed away, to zero at `EASED_M_S`.
        eased_m_s2 = envelope.acceleration_m_s2 * max(
            0.0, 1.0 - math.dist(velocity, shaped) / EASED_M_S
        )
        at_walls = (
            Constraint(constraint.limiter, constraint.normal_ned, eased_m_s2)
            if constraint.limiter is Limiter.STAND_OFF
            else constraint
            for constraint in closed[: len(holding)]
        )
        feed_forward, _ = obey(feed_forward.clamped(*accelerations), (*at_walls, *at_speed))
        _note(
            active,
            Limiter.FEED_FORWARD,
            Limiter.FEED_FORWARD,
            feed_forward,
            STILL if demanded is None else demanded,
        )
    turned_rad = (
        None
        if command.yaw_rad is None
        else _turn(command.yaw_rad, memory.yaw_rad, envelope, dt_s, active)
    )
    gained, _ = obey(acceleration, closed)
    heading_rad = situation.yaw_rad if turned_rad is None else turned_rad
    sent_feed_forward = STILL if feed_forward is None else feed_forward
    sent = LimitMemory(velocity, gained, sent_feed_forward, heading_rad, bool(holding))
    return Limited(Setpoint(velocity, feed_forward, turned_rad), tuple(active), sent)


def _numbers(
    situation: Situation, command: Setpoint, memory: LimitMemory
) -> tuple[_Row, _Row, _Row]:
    """Return the numbers without which no limit can be checked, those of the command, and those of the memory."""
    state: _Row = (*situation.position_ned_m, *situation.velocity_ned_m_s, situation.yaw_rad)
    if situation.evader_position_ned_m is not None:
        state = (*state, *situation.evader_position_ned_m)
    demands: _Row = command.velocity_ned_m_s
    if command.acceleration_ned_m_s2 is not None:
        demands = (*demands, *command.acceleration_ned_m_s2)
    if command.yaw_rad is not None:
        demands = (*demands, command.yaw_rad)
    last = (*memory[0], *memory[1], *memory[2], memory.yaw_rad)
    return state, demands, last


def _accelerated(
    allowed: Ned, before: Ned, agility: Agility, dt_s: float, active: list[Limiter]
) -> tuple[Ned, Ned]:
    """Approach the allowed velocity within the acceleration alone; return the velocity and the acceleration."""
    acceleration = STILL
    reached = before
    if dt_s > 0.0:
        change = allowed - before
        vertical = agility.vertical_acceleration_m_s2 * dt_s
        step = change.clamped(agility.acceleration_m_s2 * dt_s, vertical, vertical)
        acceleration = step / dt_s
        if step == change:
            return allowed, acceleration
        reached = before + step
    _note(active, Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION, reached, allowed)
    return reached, acceleration


def _turn(
    wanted_rad: float, before_rad: float, envelope: Envelope, dt_s: float, active: list[Limiter]
) -> float:
    """Turn towards the wanted heading, the shorter way, within the turn rate."""
    largest = envelope.yaw_rate_rad_s * dt_s
    turn = math.remainder(wanted_rad - before_rad, math.tau)
    allowed = min(largest, max(-largest, turn))
    if abs(allowed - turn) > NOTED:
        active.append(Limiter.YAW)
    return math.remainder(before_rad + allowed, math.tau)


def _at_speed_limit(
    velocity_ned_m_s: Ned, flown_ned_m_s: Ned, envelope: Envelope
) -> tuple[Constraint, ...]:
    """Return constraints on the feed-forward along every speed limit that is commanded.

    The feed-forward compensates drag, which takes several m/s² at full speed. So it may push along the limit until the
    vehicle flies faster than the limit, and less and less up to `OVER_SPEED` above.
    """
    (north, east, down) = velocity_ned_m_s
    vertical_m_s2 = envelope.vertical_acceleration_m_s2
    size = math.hypot(north, east)
    along = STILL
    if size > 0.0:
        along = Ned((north / size, east / size, 0.0))
    rows = (
        (Limiter.SPEED, along, size, envelope.speed_m_s, envelope.acceleration_m_s2),
        (Limiter.VERTICAL_SPEED, DOWN, down, envelope.descent_m_s, vertical_m_s2),
        (Limiter.VERTICAL_SPEED, UP, -down, envelope.climb_m_s, vertical_m_s2),
    )
    constraints = []
    for limiter, normal, speed_m_s, limit_m_s, most_m_s2 in rows:
        if speed_m_s >= limit_m_s * (1.0 - 1e-9):
            excess = (flown_ned_m_s.dot(normal) - limit_m_s) / (OVER_SPEED * limit_m_s)
            constraints.append(Constraint(limiter, normal, most_m_s2 * max(0.0, 1.0 - excess)))
    return tuple(constraints)


def _note(
    active: list[Limiter], ground: Limiter, vertical: Limiter, limited: Ned, demanded: Ned
) -> None:
    if abs(limited[0] - demanded[0]) > NOTED or abs(limited[1] - demanded[1]) > NOTED:
        active.append(ground)
    if abs(limited[2] - demanded[2]) > NOTED and vertical not in active:
        active.append(vertical)
