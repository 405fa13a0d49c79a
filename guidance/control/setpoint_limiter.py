"""The setpoint limiter, last before the wire: every command becomes a setpoint within the envelope, whatever was asked.

The order, and why:

 1. situation      A place that is not known (NaN, infinite) can be judged by no limit: stand still at once.
 2. command        Anything in it that is not a number: the whole command is refused, and a stop takes its place.
 3. clock          A late or impossible time step counts as 0.1 s or 0 s: no step is made up for.
 4. speed          Ground vector scaled, vertical cut. First, so that what follows starts from a velocity that may be.
 5. acceleration   From the last setpoint towards the velocity, within acceleration and jerk. Comfort comes before
                   safety in order, so that safety can overrule it: a wall may stop more sharply than this allows.
 6. stand-off      ┐ Walls, each takes away only what closes on it and keeps what goes along it. A later wall can bend
 7. fences         │ a velocity back into an earlier one, so all are asked again by scaling alone, which breaks none
 8. floor, ceiling ┘ of the others: in the end all hold together. Standing still always does.
 9. height         A height beside the velocity is cut to what the autopilot may make of it, by the same walls.
10. feed-forward   Within acceleration and jerk; nothing of it leans on a limit that acts, or drives past one of speed.
11. yaw            Turned at the turn rate.

Nothing is kept here: the memory goes in and comes out, and it holds what was sent, not what was wished, so that
nothing winds up behind a limit.
"""

from typing import NamedTuple

from guidance.control.envelope import Envelope, Limiter
from guidance.control.feasible_velocity import cut_height, full_speed_walls, keep_within
from guidance.control.shaping import clamp_acceleration, clamp_speed, next_acceleration, next_yaw, slew
from guidance.control.situation import Situation, is_usable, usable, without_unknowns
from guidance.control.velocity_constraints import Wall, shrink, slide
from guidance.frames import Vector, wrap_rad
from guidance.messages import Setpoint

STILL: Vector = (0.0, 0.0, 0.0)


class LimitMemory(NamedTuple):
    """What was sent last: velocity, the acceleration that led to it, the feed-forward, and the yaw."""

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector = STILL
    feed_forward_ned_m_s2: Vector = STILL
    yaw_rad: float = 0.0


def start(situation: Situation, envelope: Envelope) -> LimitMemory:
    """The memory at engagement: the vehicle's own velocity and heading, so that the first setpoint is no step."""
    if not usable(*situation.velocity_ned_m_s, situation.yaw_rad):
        return LimitMemory(STILL)
    return LimitMemory(clamp_speed(situation.velocity_ned_m_s, envelope), yaw_rad=situation.yaw_rad)


def restored(memory: LimitMemory | None, situation: Situation, envelope: Envelope) -> LimitMemory:
    """The memory handed in, or a new start where there is none or one that is no number."""
    if memory is None or not usable(*(number for part in memory[:3] for number in part), memory.yaw_rad):
        return start(situation, envelope)
    return memory


_LONGEST_STEP_S = 0.1
NOTED = 0.05
"""A limiter of the command itself is named for a change of more than this (m/s, m/s², m or rad).

Less is what a multicopter's velocity wanders by as it hovers (0.03 to 0.08 m/s), and what shaping a command a second
time that the servo has shaped already comes to. Walls are named for any change.
"""


class Limited(NamedTuple):
    """The setpoint to send, the limiters that changed the command (see `NOTED`), and the memory for the next cycle."""

    setpoint: Setpoint
    acted: tuple[Limiter, ...]
    memory: LimitMemory


def limit(
    command: Setpoint, situation: Situation, envelope: Envelope, memory: LimitMemory | None, dt_s: float
) -> Limited:
    """Turn a command into a setpoint that the envelope allows. Never raises, and never returns a NaN.

    Args:
        command: What guidance wants; any numbers at all.
        situation: Own state and the evader's; any numbers at all.
        envelope: What is allowed.
        memory: From the last call; None at the first one, which then starts at the vehicle's own velocity.
        dt_s: Time since the last call, seconds.
    """
    memory = restored(memory, situation, envelope)
    if not is_usable(situation):
        return Limited(Setpoint(STILL), (Limiter.SITUATION,), LimitMemory(STILL, yaw_rad=memory.yaw_rad))
    situation = without_unknowns(situation)
    acted: list[Limiter] = []
    command = _numbers_only(command, memory, acted)
    dt_s = _step(dt_s, acted)

    shaped, acceleration = _shape(command.velocity_ned_m_s, memory, envelope, dt_s, acted)
    velocity, leaning = keep_within(shaped, situation, envelope)
    acted.extend(dict.fromkeys(one.limiter for one in leaning))
    down_m = _height(command.down_m, velocity, situation, envelope, acted)
    forbidden = tuple(one.forbidding_all() for one in leaning)
    at_speed = full_speed_walls(velocity, situation.velocity_ned_m_s, envelope)
    feed_forward = _feed_forward(command.acceleration_ned_m_s2, memory, (*forbidden, *at_speed), envelope, dt_s, acted)
    yaw_rad = _yaw(command.yaw_rad, memory, envelope, dt_s, acted)
    sent = LimitMemory(
        velocity,
        _stripped(acceleration, (*forbidden, *(one.forbidding_all() for one in at_speed))),
        feed_forward or STILL,
        situation.yaw_rad if yaw_rad is None else yaw_rad,
    )
    return Limited(Setpoint(velocity, feed_forward, down_m, yaw_rad), tuple(acted), sent)


def _numbers_only(command: Setpoint, memory: LimitMemory, acted: list[Limiter]) -> Setpoint:
    given = (*command.velocity_ned_m_s, *(command.acceleration_ned_m_s2 or ()))
    if usable(*given, *(number for number in (command.down_m, command.yaw_rad) if number is not None)):
        return command
    acted.append(Limiter.COMMAND)
    return Setpoint(STILL, yaw_rad=memory.yaw_rad)


def _step(dt_s: float, acted: list[Limiter]) -> float:
    if 0.0 <= dt_s <= _LONGEST_STEP_S:
        return dt_s
    acted.append(Limiter.CLOCK)
    return _LONGEST_STEP_S if dt_s > _LONGEST_STEP_S else 0.0


def _shape(
    wanted: Vector, memory: LimitMemory, envelope: Envelope, dt_s: float, acted: list[Limiter]
) -> tuple[Vector, Vector]:
    allowed = clamp_speed(wanted, envelope)
    _note(acted, Limiter.SPEED, allowed[:2], wanted[:2])
    _note(acted, Limiter.VERTICAL_SPEED, allowed[2:], wanted[2:])
    before = clamp_speed(memory.velocity_ned_m_s, envelope)
    acceleration = clamp_acceleration(memory.acceleration_ned_m_s2, envelope)
    acceleration = next_acceleration(allowed, before, acceleration, envelope, dt_s)
    north, east, down = (now + rate * dt_s for now, rate in zip(before, acceleration, strict=True))
    shaped = clamp_speed((north, east, down), envelope)
    _note(acted, Limiter.ACCELERATION, shaped[:2], allowed[:2])
    _note(acted, Limiter.VERTICAL_ACCELERATION, shaped[2:], allowed[2:])
    return shaped, acceleration


def _height(
    wanted_m: float | None, velocity: Vector, situation: Situation, envelope: Envelope, acted: list[Limiter]
) -> float | None:
    if wanted_m is None:
        return None
    allowed_m = cut_height(wanted_m, velocity, situation, envelope)
    _note(acted, Limiter.HEIGHT, (allowed_m,), (wanted_m,))
    return allowed_m


def _yaw(
    wanted_rad: float | None, memory: LimitMemory, envelope: Envelope, dt_s: float, acted: list[Limiter]
) -> float | None:
    if wanted_rad is None:
        return None
    allowed_rad = next_yaw(wanted_rad, memory.yaw_rad, envelope, dt_s)
    _note(acted, Limiter.YAW, (wrap_rad(allowed_rad - wanted_rad),), (0.0,))
    return allowed_rad


def _feed_forward(
    wanted: Vector | None,
    memory: LimitMemory,
    walls: tuple[Wall, ...],
    envelope: Envelope,
    dt_s: float,
    acted: list[Limiter],
) -> Vector | None:
    if wanted is None:
        return None
    allowed = slew(clamp_acceleration(wanted, envelope), memory.feed_forward_ned_m_s2, envelope.jerk_m_s3 * dt_s)
    allowed = _stripped(clamp_acceleration(allowed, envelope), walls)
    _note(acted, Limiter.FEED_FORWARD, allowed, wanted)
    return allowed


def _stripped(acceleration: Vector, walls: tuple[Wall, ...]) -> Vector:
    for one in walls:
        acceleration = slide(acceleration, one)
    for one in walls:
        acceleration = shrink(acceleration, one)
    return acceleration


def _note(acted: list[Limiter], limiter: Limiter, got: tuple[float, ...], wanted: tuple[float, ...]) -> None:
    if any(abs(one - other) > NOTED for one, other in zip(got, wanted, strict=True)):
        acted.append(limiter)
