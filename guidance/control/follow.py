"""From the game's velocity to the commanded velocity: drift, catching up, approach, servo.

**Drift.** Velocities over the ground are taken from positions. The velocity that an autopilot reports differs from the
rate of its reported position: the velocity error wanders slowly (PX4: 0.2 to 0.4 m/s over many seconds, on all axes),
while GPS and barometer correct the position. The autopilot controls its own velocity estimate, so a vehicle commanded
to stand still moves, and one commanded to fly 6 m/s closes on its evader 5 % too slowly. A second-order observer with
both poles at -1/settle estimates the difference. Commands are converted to the autopilot's terms with it.

**Catching up.** The game's pursuer is at full speed at once. A vehicle that starts from hover would stay some metres
behind for the rest of the game. Its along-track deficit is integrated and worked off with the part of the speed limits
above the game's speed; if there is no such part, it stays. The deficit is zero once the vehicle has flown as far as
the game's pursuer would have, so its mean speed over a game stays within the game's bound. A vehicle that flies faster
than its limits without being asked to is commanded to fly slower: ArduCopter makes up for its own lag for seconds.

**Unhurried height.** Vehicle and evader cannot meet before t = d/(a + v), however the evader flies: d is the distance
to the rim, a and v are the two largest speeds. A vehicle that needs less than t for its height may use all of t and
loses nothing, neither in PE nor in TAD, where the ground that the evader reaches within t is a part of its Apollonius
disc. A multicopter near its tilt limit flies faster while it descends more slowly, so a vehicle that is behind does so.

**Approach.** The game closes at full speed until the rim of the disc. A vehicle must stop closing there, measured
relative to the evader. It may close only as fast as it can brake (`approach_speed`):

    v · settle + v² / (2 · braking) = gap − margin − lag · (closing speed now)

An evader that flees is followed at its own speed to the rim. If it stops dead, the vehicle flies past above it at the
disc's height; below that height the stand-off's wall keeps the braking distance. The velocity across the line of
sight is reduced by the same factor as the closing speed, so at the rim the velocity equals the evader's. Inside the
disc the vehicle backs off slowly. The height is approached by the same law.

An evader that runs at the vehicle is waited for until it is `RETREAT_M` from the rim. A vehicle that retreated at the
evader's speed from further away would keep the gap open, and the evader would reach its target uncaptured. The distance
that the evader covers while the vehicle brakes is subtracted.

**Servo.** `guidance.control.servo` makes the vehicle fly the resulting velocity.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.braking_law import Situation, approach_speed
from guidance.control.limits import Acceleration, Dynamics
from guidance.control.servo import LONGEST_STEP_S, ServoGains, ServoMemory, serve
from guidance.frames import STILL, Ned
from guidance.game import StandOff

RETREAT_M = 2.0
"""Gap below which the vehicle retreats from an evader that comes towards it; at the rim it retreats at its speed."""
BELOW_M = 0.5
ABOVE_M = 1.0
"""Further below or above the disc, the vehicle retreats from any distance: below, the evader must not pass under it;
above, it could not capture an evader that passes."""

SETTLE_S = 1.2
LARGEST_CORRECTION_M_S = 0.6
JUMP_M = 1.0
_TOUCH_M = 1e-3

RECOVERY_PER_S = 0.5
"""Speed added per metre of along-track deficit."""
LARGEST_DEFICIT_M = 15.0
"""So that a vehicle that cannot keep up does not race for long afterwards."""
UNHURRIED_M = 1.0
"""Deficit above which the height may take all the remaining time."""
EASE = 1.5
"""A vehicle that exceeds the speed limit is slowed down by this many times the excess."""


class Drift(NamedTuple):
    """Reported velocity less rate of the reported position, and the position by the two; None before the first call."""

    velocity_ned_m_s: Ned = STILL
    position_ned_m: Ned | None = None


def observe_drift(
    drift: Drift, position_ned_m: Ned, velocity_ned_m_s: Ned, *, dt_s: float
) -> Drift:
    """Update the drift with a report of position and velocity.

    After a jump of more than `JUMP_M` (the estimator was reset), the drift keeps its velocity and takes the
    reported position.

    Args:
        drift: So far.
        position_ned_m: Reported position.
        velocity_ned_m_s: Reported velocity.
        dt_s: Time since the last report.
    """
    if drift.position_ned_m is None:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    dt_s = min(max(dt_s, 0.0), LONGEST_STEP_S)
    expected = drift.position_ned_m + (velocity_ned_m_s - drift.velocity_ned_m_s) * dt_s
    off = position_ned_m - expected
    learned = drift.velocity_ned_m_s - off * dt_s / SETTLE_S**2
    position = expected + 2.0 * off * dt_s / SETTLE_S
    if math.dist(position_ned_m, position) > JUMP_M:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    bounded = Ned(
        [max(-LARGEST_CORRECTION_M_S, min(LARGEST_CORRECTION_M_S, part)) for part in learned]
    )
    return Drift(bounded, position)


class Pace(NamedTuple):
    """Speeds of one cycle.

    Attributes:
        dt_s: Seconds since the last cycle.
        max_speed_ratio: Speed limit over the game's speed.
        meeting_m_s: Sum of the largest speeds of vehicle and evader.
        hurried: Whether the game's full speed is desired. A vehicle that waits for its height catches nothing up over
            the ground, and uses its whole vertical speed.
        held_back: Whether a limit reduced the last command; the servo learns nothing then.
    """

    dt_s: float
    max_speed_ratio: float
    meeting_m_s: float
    hurried: bool = True
    held_back: bool = False


class Gaps(NamedTuple):
    """Level distance to the disc's rim (negative inside), height above the disc, level unit vector to the evader."""

    ground_m: float
    height_m: float
    towards_ned: Ned


def catch_up(
    desired_ned_m_s: Ned, flown_ned_m_s: Ned, deficit_m: float, gaps: Gaps, pace: Pace
) -> tuple[Ned, float]:
    """Increase a velocity to work off the along-track deficit over the ground; return it and the deficit, m.

    The vertical speed of a vehicle that is behind is reduced to the least that reaches the disc's height before any
    meeting.

    Args:
        desired_ned_m_s: Velocity of the game's solution.
        flown_ned_m_s: Velocity of the vehicle.
        deficit_m: From the last call; 0 at engagement.
        gaps: To the disc.
        pace: Of this cycle, with a speed limit of at least the game's speed.
    """
    velocity = desired_ned_m_s
    speed = math.hypot(velocity.north, velocity.east)
    if speed > 0.0:
        along = velocity.level_dot(flown_ned_m_s) / speed
        deficit_m = min(LARGEST_DEFICIT_M, max(0.0, deficit_m + (speed - along) * pace.dt_s))
        over = max(0.0, along / speed - pace.max_speed_ratio)
        recovering = min(pace.max_speed_ratio, 1.0 + RECOVERY_PER_S * deficit_m / speed)
        velocity *= max(0.0, recovering - EASE * over)
    enough_m_s = abs(gaps.height_m) * pace.meeting_m_s / max(gaps.ground_m, _TOUCH_M)
    spare_m_s = min(1.0, deficit_m / UNHURRIED_M) * max(0.0, abs(velocity.down) - enough_m_s)
    down = velocity.down - math.copysign(spare_m_s, velocity.down)
    return Ned((velocity.north, velocity.east, down)), deficit_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Parameters of a vehicle's arrival at the disc.

    Attributes:
        braking_m_s2: Planned deceleration over the ground.
        vertical_braking_m_s2: Planned vertical deceleration.
        lag_s: Dead time of the vehicle.
        settle_s: Time constant near the rim; it damps position noise.
        vertical_settle_s: Time constant near the disc's height.
        margin_m: Distance from the rim to the point of rest.
        backing_m_s: Largest speed for backing off from inside.
    """

    braking_m_s2: float
    vertical_braking_m_s2: float
    lag_s: float = 0.3
    settle_s: float = 0.3
    vertical_settle_s: float = 0.6
    margin_m: float = 0.15
    backing_m_s: float = 1.0


def gaps_to_disc(position_ned_m: Ned, evader_ned_m: Ned, standoff: StandOff) -> Gaps:
    """Return the distances from a position to the stand-off disc of an evader."""
    offset_m = evader_ned_m - position_ned_m
    distance_m = math.hypot(offset_m.north, offset_m.east)
    scale = 1.0 / distance_m if distance_m > 0.0 else 0.0
    towards = Ned((offset_m.north * scale, offset_m.east * scale, 0.0))
    return Gaps(distance_m - standoff.radius_m, offset_m.down - standoff.height_m, towards)


def approach(
    desired_ned_m_s: Ned,
    flown_ned_m_s: Ned,
    evader_ned_m_s: Ned,
    gaps: Gaps,
    settings: Approach,
) -> tuple[Ned, bool]:
    """Slow a velocity down near the disc; return it, and whether the closing speed is reduced.

    Args:
        desired_ned_m_s: Velocity desired without regard to braking.
        flown_ned_m_s: Velocity of the vehicle.
        evader_ned_m_s: Estimated velocity of the evader.
        gaps: To the disc.
        settings: Of the vehicle.
    """
    towards = gaps.towards_ned
    # Slow a vertical velocity down near the disc's height.
    left_m = abs(gaps.height_m) - settings.lag_s * math.copysign(
        flown_ned_m_s.down, gaps.height_m * flown_ned_m_s.down
    )
    allowed = approach_speed(left_m, settings.vertical_braking_m_s2, settings.vertical_settle_s)
    down = max(-allowed, min(allowed, desired_ned_m_s.down))
    coming = max(0.0, -evader_ned_m_s.level_dot(towards))
    wait = 0.0
    if -BELOW_M < gaps.height_m < ABOVE_M:
        wait = coming * min(1.0, max(0.0, gaps.ground_m / RETREAT_M))
    awaited = evader_ned_m_s + wait * towards
    relative = desired_ned_m_s - awaited
    closing = relative.level_dot(towards)
    closing_now = (flown_ned_m_s - awaited).level_dot(towards)
    left_m = gaps.ground_m - settings.margin_m - settings.lag_s * (closing_now + wait)
    settle_s = settings.settle_s + wait / settings.braking_m_s2
    allowed = max(-settings.backing_m_s, 0.5 * left_m / settle_s)  # inside, it backs off
    if left_m > 0.0:
        allowed = approach_speed(left_m, settings.braking_m_s2, settle_s)
    if closing <= allowed:
        return Ned((desired_ned_m_s.north, desired_ned_m_s.east, down)), False
    share = max(0.0, allowed / closing) if closing > 0.0 else 0.0
    across = relative - closing * towards
    return (awaited + share * across + allowed * towards).level_with(down), True


@dataclass(frozen=True, slots=True, kw_only=True)
class Handling:
    """Flight behaviour at the autopilot's default parameters.

    Attributes:
        servo: How the guidance makes it follow a velocity; None sends the game's velocity unchanged.
        approach: How it arrives at the disc.
        acceleration: Acceleration it surely achieves: the autopilot's own parameters (PX4's MPC_ACC_HOR and
            MPC_ACC_DOWN_MAX, ArduCopter's WPNAV_ACCEL and WPNAV_ACCEL_Z). Used to compute `time_needed_s`.
        dynamics: The part of the envelope that is the vehicle's.
    """

    servo: ServoGains | None
    approach: Approach
    acceleration: Acceleration
    dynamics: Dynamics


class FollowMemory(NamedTuple):
    """Memory between calls: the servo's, the along-track deficit (m), and the drift."""

    servo: ServoMemory | None = None
    deficit_m: float = 0.0
    drift: Drift = Drift()


class Followed(NamedTuple):
    """Command before the limits, velocity desired after the approach, and memory for the next call.

    `flown_ned_m_s`: the vehicle's velocity over the ground. `unslowed`: the approach does not reduce the speed.
    """

    velocity_ned_m_s: Ned
    acceleration_ned_m_s2: Ned | None
    desired_ned_m_s: Ned
    memory: FollowMemory
    flown_ned_m_s: Ned
    unslowed: bool = False


def follow(
    desired_ned_m_s: Ned,
    here: Situation,
    gaps: Gaps,
    handling: Handling,
    memory: FollowMemory,
    pace: Pace,
) -> Followed:
    """Follow the game's velocity for one cycle.

    Args:
        desired_ned_m_s: Velocity of the game's solution.
        here: Position and velocity of the vehicle, velocity of the evader.
        gaps: To the disc.
        handling: Of the vehicle.
        memory: From the last call.
        pace: Of this cycle.
    """
    if handling.servo is None:
        flown = here.velocity_ned_m_s - memory.drift.velocity_ned_m_s
        return Followed(desired_ned_m_s, None, desired_ned_m_s, memory, flown)
    drift = observe_drift(memory.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=pace.dt_s)
    flown = here.velocity_ned_m_s - drift.velocity_ned_m_s
    if pace.hurried:
        wanted, deficit_m = catch_up(desired_ned_m_s, flown, memory.deficit_m, gaps, pace)
    else:
        wanted = desired_ned_m_s.level_with(desired_ned_m_s.down * pace.max_speed_ratio)
        deficit_m = 0.0
    evader_ned_m_s = here.evader_velocity_ned_m_s
    if evader_ned_m_s is None:
        evader_ned_m_s = STILL
    desired, braking = approach(wanted, flown, evader_ned_m_s, gaps, handling.approach)
    if braking:
        deficit_m = memory.deficit_m  # braking at the disc adds nothing to it
    fed, servo = serve(
        desired, flown, memory.servo, handling.servo, dt_s=pace.dt_s, held_back=pace.held_back
    )
    sent = servo.reference_ned_m_s + drift.velocity_ned_m_s
    kept = FollowMemory(servo, deficit_m, drift)
    return Followed(sent, fed, desired, kept, flown, not braking)
