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

from guidance.control.braking_law import STILL, Situation, approach_speed
from guidance.control.limits import Acceleration, Dynamics
from guidance.control.servo import LONGEST_STEP_S, ServoGains, ServoMemory, serve
from guidance.frames import Vector, difference, total
from guidance.game import StandOff

RETREAT_M = 2.0
"""Gap below which the vehicle retreats from an evader that comes towards it; at the rim it retreats at its speed."""
BELOW_M = 0.5
ABOVE_M = 1.0
"""Further below or above the disc, the vehicle retreats from any distance: below, the evader must not pass under it;
above, it could not capture an evader that passes."""

SETTLE_S = 1.2
LARGEST_M_S = 0.6
JUMP_M = 1.0
_TOUCH_M = 1e-3

RECOVERY_PER_S = 0.5
"""Speed added per metre of along-track deficit."""
LARGEST_DEFICIT_M = 15.0
"""So that a vehicle that cannot keep up does not race for long afterwards."""
UNHURRIED_M = 1.0
"""Deficit from which the height may take all the time there is."""
EASE = 1.5
"""A vehicle that exceeds the speed limit is slowed down by this many times the excess."""


class Drift(NamedTuple):
    """Reported velocity less rate of the reported position, and the position by the two; None before the first call."""

    velocity_ned_m_s: Vector = (0.0, 0.0, 0.0)
    position_ned_m: Vector | None = None


def observe_drift(
    drift: Drift, position_ned_m: Vector, velocity_ned_m_s: Vector, *, dt_s: float
) -> Drift:
    """Update the drift with a report of position and velocity.

    After a jump of more than `JUMP_M` (the estimator was reset), the new position is taken over and nothing is learned.

    Args:
        drift: So far.
        position_ned_m: Reported position.
        velocity_ned_m_s: Reported velocity.
        dt_s: Time since the last report.
    """
    if drift.position_ned_m is None:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    dt_s = min(max(dt_s, 0.0), LONGEST_STEP_S)
    places = []
    drifts = []
    for place_m, drift_m_s, reported_m, velocity_m_s in zip(
        drift.position_ned_m, drift.velocity_ned_m_s, position_ned_m, velocity_ned_m_s, strict=True
    ):
        expected_m = place_m + (velocity_m_s - drift_m_s) * dt_s
        off_m = reported_m - expected_m
        learned_m_s = drift_m_s - off_m * dt_s / SETTLE_S**2
        places.append(expected_m + 2.0 * off_m * dt_s / SETTLE_S)
        drifts.append(max(-LARGEST_M_S, min(LARGEST_M_S, learned_m_s)))
    if math.dist(position_ned_m, places) > JUMP_M:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    (north, east, down) = places
    (drift_north, drift_east, drift_down) = drifts
    return Drift((drift_north, drift_east, drift_down), (north, east, down))


class Pace(NamedTuple):
    """What speeds are about in one cycle.

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
    """Horizontal distance to the disc's rim (negative inside), height above the disc, unit vector to the evader."""

    ground_m: float
    height_m: float
    towards_north: float
    towards_east: float


def catch_up(
    desired_ned_m_s: Vector, flown_ned_m_s: Vector, deficit_m: float, gaps: Gaps, pace: Pace
) -> tuple[Vector, float]:
    """Increase a velocity to work off the along-track deficit over the ground; return it and the deficit, m.

    The vertical speed of a vehicle that is behind is reduced to what reaches the disc's height before any meeting.

    Args:
        desired_ned_m_s: Velocity that the game asks for.
        flown_ned_m_s: Velocity of the vehicle.
        deficit_m: From the last call; 0 at engagement.
        gaps: To the disc.
        pace: Of this cycle, with a speed limit of at least the game's speed.
    """
    north, east, down = desired_ned_m_s
    speed = math.hypot(north, east)
    if speed > 0.0:
        along = (north * flown_ned_m_s[0] + east * flown_ned_m_s[1]) / speed
        deficit_m = min(LARGEST_DEFICIT_M, max(0.0, deficit_m + (speed - along) * pace.dt_s))
        over = max(0.0, along / speed - pace.max_speed_ratio)
        scale = max(
            0.0, min(pace.max_speed_ratio, 1.0 + RECOVERY_PER_S * deficit_m / speed) - EASE * over
        )
        north = scale * north
        east = scale * east
        down = scale * down
    enough_m_s = abs(gaps.height_m) * pace.meeting_m_s / max(gaps.ground_m, _TOUCH_M)
    spare_m_s = min(1.0, deficit_m / UNHURRIED_M) * max(0.0, abs(down) - enough_m_s)
    return (north, east, down - math.copysign(spare_m_s, down)), deficit_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Parameters of a vehicle's arrival at the disc.

    Attributes:
        braking_m_s2: Planned deceleration over the ground.
        vertical_braking_m_s2: Planned vertical deceleration.
        lag_s: Dead time of the vehicle.
        settle_s: Time constant near the rim; it damps position noise.
        vertical_settle_s: Time constant near the disc's height.
        margin_m: Distance outside the rim at which it comes to rest.
        backing_m_s: Largest speed for backing off from inside.
    """

    braking_m_s2: float
    vertical_braking_m_s2: float
    lag_s: float = 0.3
    settle_s: float = 0.3
    vertical_settle_s: float = 0.6
    margin_m: float = 0.15
    backing_m_s: float = 1.0


def gaps_to_disc(position_ned_m: Vector, evader_ned_m: Vector, standoff: StandOff) -> Gaps:
    """Return the distances from a position to the stand-off disc of an evader."""
    north = evader_ned_m[0] - position_ned_m[0]
    east = evader_ned_m[1] - position_ned_m[1]
    distance_m = math.hypot(north, east)
    scale = 1.0 / distance_m if distance_m > 0.0 else 0.0
    height_m = evader_ned_m[2] - position_ned_m[2] - standoff.height_m
    return Gaps(distance_m - standoff.radius_m, height_m, north * scale, east * scale)


def approach(  # noqa: PLR0914
    desired_ned_m_s: Vector,
    flown_ned_m_s: Vector,
    evader_ned_m_s: Vector,
    gaps: Gaps,
    settings: Approach,
) -> tuple[Vector, bool]:
    """Slow a velocity down near the disc; return it, and whether the closing speed is reduced.

    Args:
        desired_ned_m_s: Velocity desired without regard to braking.
        flown_ned_m_s: Velocity of the vehicle.
        evader_ned_m_s: Estimated velocity of the evader.
        gaps: To the disc.
        settings: Of the vehicle.
    """
    (north, east, down) = desired_ned_m_s
    (evader_north, evader_east, _) = evader_ned_m_s
    left_m = abs(gaps.height_m) - settings.lag_s * math.copysign(
        flown_ned_m_s[2], gaps.height_m * flown_ned_m_s[2]
    )
    allowed = approach_speed(left_m, settings.vertical_braking_m_s2, settings.vertical_settle_s)
    down = max(-allowed, min(allowed, down))
    to_north = gaps.towards_north
    to_east = gaps.towards_east
    coming = max(0.0, -evader_north * to_north - evader_east * to_east)
    wait = (
        coming * min(1.0, max(0.0, gaps.ground_m / RETREAT_M))
        if -BELOW_M < gaps.height_m < ABOVE_M
        else 0.0
    )
    evader_north = evader_north + wait * to_north
    evader_east = evader_east + wait * to_east
    relative_north = north - evader_north
    relative_east = east - evader_east
    closing = relative_north * to_north + relative_east * to_east
    closing_now = (flown_ned_m_s[0] - evader_north) * to_north + (
        flown_ned_m_s[1] - evader_east
    ) * to_east
    left_m = gaps.ground_m - settings.margin_m - settings.lag_s * (closing_now + wait)
    settle_s = settings.settle_s + wait / settings.braking_m_s2
    allowed = max(-settings.backing_m_s, 0.5 * left_m / settle_s)  # inside, it backs off
    if left_m > 0.0:
        allowed = approach_speed(left_m, settings.braking_m_s2, settle_s)
    if closing <= allowed:
        return (north, east, down), False
    across = max(0.0, allowed / closing) if closing > 0.0 else 0.0
    north = evader_north + across * (relative_north - closing * to_north) + allowed * to_north
    east = evader_east + across * (relative_east - closing * to_east) + allowed * to_east
    return (north, east, down), True


@dataclass(frozen=True, slots=True, kw_only=True)
class Handling:
    """How a vehicle flies at its autopilot's default parameters.

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

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector | None
    desired_ned_m_s: Vector
    memory: FollowMemory
    flown_ned_m_s: Vector
    unslowed: bool = False


def follow(
    desired_ned_m_s: Vector,
    here: Situation,
    gaps: Gaps,
    handling: Handling,
    memory: FollowMemory,
    pace: Pace,
) -> Followed:
    """Follow the game's velocity for one cycle.

    Args:
        desired_ned_m_s: Velocity that the game asks for.
        here: Position and velocity of the vehicle, velocity of the evader.
        gaps: To the disc.
        handling: Of the vehicle.
        memory: From the last call.
        pace: Of this cycle.
    """
    if handling.servo is None:
        flown = difference(here.velocity_ned_m_s, memory.drift.velocity_ned_m_s)
        return Followed(desired_ned_m_s, None, desired_ned_m_s, memory, flown)
    drift = observe_drift(memory.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=pace.dt_s)
    flown = difference(here.velocity_ned_m_s, drift.velocity_ned_m_s)
    north, east, down = desired_ned_m_s
    wanted = (north, east, down * pace.max_speed_ratio)
    deficit_m = 0.0
    if pace.hurried:
        wanted, deficit_m = catch_up(desired_ned_m_s, flown, memory.deficit_m, gaps, pace)
    desired, braking = approach(
        wanted, flown, here.evader_velocity_ned_m_s or STILL, gaps, handling.approach
    )
    if braking:
        deficit_m = memory.deficit_m  # braking at the disc adds nothing to it
    fed, servo = serve(
        desired, flown, memory.servo, handling.servo, dt_s=pace.dt_s, held_back=pace.held_back
    )
    sent = total(servo.reference_ned_m_s, drift.velocity_ned_m_s)
    kept = FollowMemory(servo, deficit_m, drift)
    return Followed(sent, fed, desired, kept, flown, not braking)
