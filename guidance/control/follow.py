"""From the velocity that the game asks for to what is commanded: drift ▸ catching up ▸ the approach ▸ the servo.

**Drift.** All of it works with the velocity over the ground as positions tell it; the command is given in the
autopilot's own terms, whose velocity differs by the drift: reported velocity less the rate of the reported position. An
estimator's velocity carries an error that wanders slowly (PX4: 0.2 to 0.4 m/s over many seconds, north, east and down),
its position is drawn back by GPS and barometer. The autopilot flies the velocity it believes in, so that a vehicle told
to stand still moves, and one told to fly at 6 m/s gains on its evader by 5 % too little. The game is played in
positions: what counts is how they change. An observer of second order, with both poles at -1/settle, tells the
difference from the two, and is no slower than the error itself.

**Catching up.** The game's pursuer is at full speed at once; a vehicle that starts from hover is some metres behind for
the rest of the game, and would be later by just that. So its along-track deficit is kept account of, and worked off
with what the speed limits leave above the game's speed; where they leave nothing, nothing is made good. The deficit is
gone when the vehicle has flown as far as the game's pursuer would have: over any game its mean speed stays within the
game's bound, and its value is never beaten in this way. A vehicle that flies faster than the limits, though no command
says so, is told to fly slower: ArduCopter makes good by itself what it has lagged behind its setpoints, for seconds.

**The approach.** The game closes at full speed to the very rim of the disc. A vehicle has to stop closing there, and
what counts is the motion seen from the evader. Of the distance left, the vehicle uses up some before it answers; over
the rest it may close only as fast as it can surely brake (`approach_speed`):

    v · settle + v² / (2 · braking) = gap − margin − lag · (closing speed now)

An evader that flees is thus followed at its own speed to the rim, as it has to be if it is to be captured at all. One
that stops dead there is flown past, above it at the height of the disc: `stand_off_constraints` sees to it that a
vehicle below that height keeps the distance in which it could stop. An evader that runs at the vehicle is waited for
until it is `RETREAT_M` from the rim. A vehicle that retreated at the evader's speed from further away would keep the
gap open, and the evader would reach its target uncaptured. The distance that the evader covers while the vehicle brakes
is taken off. What the game wants across the line of sight fades
as the closing does, so that at the rim the velocity is the evader's, and inside it the vehicle backs off gently. The
height is approached by the same law.

**The servo** (`guidance.control.servo`) makes the vehicle fly what comes of that.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from guidance.control.envelope import Situation
from guidance.control.servo import ServoGains, ServoMemory, serve
from guidance.control.shaping import approach_speed
from guidance.frames import Vector
from guidance.game import StandOff

_STILL: Vector = (0.0, 0.0, 0.0)

RETREAT_M = 2.0
"""Gap below which the vehicle gives way to an evader that comes towards it; at the rim it moves as fast as that."""
BELOW_M, ABOVE_M = 0.5, 1.0
"""It gives way from any distance while it is lower or higher than this about the disc: lower, it must not be passed
under; higher, it could not capture the evader that passes."""

SETTLE_S = 1.2
LARGEST_M_S = 0.6
JUMP_M = 1.0
_LONGEST_STEP_S = 0.1

OVER = 0.02
"""Share of the limit by which a vehicle may be faster before it is told to fly slower: what estimates scatter by."""
EASE = 1.5


class Drift(NamedTuple):
    """Reported velocity less rate of the reported position, and the position by the two; None before the first call."""

    velocity_ned_m_s: Vector = (0.0, 0.0, 0.0)
    position_ned_m: Vector | None = None


def observe_drift(drift: Drift, position_ned_m: Vector, velocity_ned_m_s: Vector, *, dt_s: float) -> Drift:
    """Take in one report of position and velocity, `dt_s` after the last.

    A position that is further off than any drift could have it (`JUMP_M`: the estimator was reset) is taken as it is,
    and nothing is learned from it.

    Args:
        drift: What is known so far.
        position_ned_m: As reported now.
        velocity_ned_m_s: As reported now.
        dt_s: Since the last report.
    """
    if drift.position_ned_m is None:
        return Drift(drift.velocity_ned_m_s, position_ned_m)
    dt_s = min(max(dt_s, 0.0), _LONGEST_STEP_S)
    places, drifts = [], []
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
    (north, east, down), (drift_north, drift_east, drift_down) = places, drifts
    return Drift((drift_north, drift_east, drift_down), (north, east, down))


def with_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a velocity over the ground in the autopilot's own terms."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north + by_north, east + by_east, down + by_down)


def less_drift(velocity_ned_m_s: Vector, drift: Drift) -> Vector:
    """Return a reported velocity as one over the ground."""
    (north, east, down), (by_north, by_east, by_down) = velocity_ned_m_s, drift.velocity_ned_m_s
    return (north - by_north, east - by_east, down - by_down)


@dataclass(frozen=True, slots=True, kw_only=True)
class CatchUp:
    """How the along-track deficit is worked off.

    Attributes:
        gain_per_s: Speed added per metre of deficit, where it is small.
        limit_m: The deficit is never more than this: a vehicle that cannot keep up at all does not race for ever after.
    """

    gain_per_s: float = 0.5
    limit_m: float = 15.0


class CaughtUp(NamedTuple):
    """The velocity with what catching up adds to it, and the along-track deficit now, in metres."""

    velocity_ned_m_s: Vector
    deficit_m: float


def catch_up(
    desired_ned_m_s: Vector,
    flown_ned_m_s: Vector,
    deficit_m: float,
    settings: CatchUp,
    *,
    most: float,
    dt_s: float,
) -> CaughtUp:
    """Add to a velocity what makes up for the along-track deficit over the ground.

    Args:
        desired_ned_m_s: What the game asks for.
        flown_ned_m_s: What the vehicle flies.
        deficit_m: From the last call; 0 at engagement.
        settings: How fast it is worked off.
        most: The largest multiple of the velocity, which is what the speed limits are of the game's speeds; at least 1.
        dt_s: Seconds since the last call.
    """
    speed = math.hypot(*desired_ned_m_s[:2])
    if speed <= 0.0:
        return CaughtUp(desired_ned_m_s, deficit_m)
    along = sum(w * f for w, f in zip(desired_ned_m_s[:2], flown_ned_m_s[:2], strict=True)) / speed
    deficit_m = min(settings.limit_m, max(0.0, deficit_m + (speed - along) * dt_s))
    over = max(0.0, along / speed - (1.0 + OVER) * most)
    scale = max(0.0, min(most, 1.0 + settings.gain_per_s * deficit_m / speed) - EASE * over)
    north, east, down = desired_ned_m_s
    return CaughtUp((scale * north, scale * east, scale * down), deficit_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """How one vehicle arrives at the disc.

    Attributes:
        braking_m_s2: Deceleration over the ground that is planned with.
        vertical_braking_m_s2: The same vertically.
        lag_s: How long the vehicle goes on as it does before it answers.
        settle_s: Time constant of the last part, horizontally; it damps what is noise in the positions.
        vertical_settle_s: The same vertically.
        margin_m: How far outside the rim it comes to rest.
        backing_m_s: Largest speed at which it backs off from inside.
    """

    braking_m_s2: float
    vertical_braking_m_s2: float
    lag_s: float = 0.3
    settle_s: float = 0.3
    vertical_settle_s: float = 0.6
    margin_m: float = 0.15
    backing_m_s: float = 1.0


class Gaps(NamedTuple):
    """To the stand-off disc: horizontally to its rim (negative inside), and the height above it; unit vector to E."""

    ground_m: float
    height_m: float
    towards_north: float
    towards_east: float


def gaps_to_disc(position_ned_m: Vector, evader_ned_m: Vector, standoff: StandOff) -> Gaps:
    """Return how far a place is from the stand-off disc of an evader."""
    north, east = evader_ned_m[0] - position_ned_m[0], evader_ned_m[1] - position_ned_m[1]
    distance_m = math.hypot(north, east)
    scale = 1.0 / distance_m if distance_m > 0.0 else 0.0
    height_m = evader_ned_m[2] - position_ned_m[2] - standoff.height_m
    return Gaps(distance_m - standoff.radius_m, height_m, north * scale, east * scale)


class Approached(NamedTuple):
    """The velocity to fly, and whether the approach has slowed the closing down."""

    velocity_ned_m_s: Vector
    braking: bool


def closing_allowed(left_m: float, braking_m_s2: float, settle_s: float, backing_m_s: float) -> float:
    """Return the speed, m/s, at which a distance may be closed; negative, backing off, where none is left.

    Args:
        left_m: The distance that is left; negative inside of what may be closed on.
        braking_m_s2: What brakes, m/s².
        settle_s: The time constant of the last stretch.
        backing_m_s: The most that is backed off with.
    """
    if left_m > 0.0:
        return approach_speed(left_m, braking_m_s2, settle_s)
    return max(-backing_m_s, 0.5 * left_m / settle_s)


def approach(
    desired_ned_m_s: Vector, flown_ned_m_s: Vector, evader_ned_m_s: Vector, gaps: Gaps, settings: Approach
) -> Approached:
    """Slow a velocity down near the disc.

    Args:
        desired_ned_m_s: What is desired without regard to braking.
        flown_ned_m_s: What the vehicle flies.
        evader_ned_m_s: What the evader does, as estimated.
        gaps: To the disc.
        settings: How the vehicle brakes.
    """
    down = _vertical(desired_ned_m_s[2], flown_ned_m_s[2], gaps.height_m, settings)
    (north, east, _), (evader_north, evader_east, _) = desired_ned_m_s, evader_ned_m_s
    to_north, to_east = gaps.towards_north, gaps.towards_east
    coming = max(0.0, -evader_north * to_north - evader_east * to_east)
    wait = coming * min(1.0, max(0.0, gaps.ground_m / RETREAT_M)) if -BELOW_M < gaps.height_m < ABOVE_M else 0.0
    evader_north, evader_east = evader_north + wait * to_north, evader_east + wait * to_east
    relative_north, relative_east = north - evader_north, east - evader_east
    closing = relative_north * to_north + relative_east * to_east
    closing_now = (flown_ned_m_s[0] - evader_north) * to_north + (flown_ned_m_s[1] - evader_east) * to_east
    left_m = gaps.ground_m - settings.margin_m - settings.lag_s * (closing_now + wait)
    settle_s = settings.settle_s + wait / settings.braking_m_s2
    allowed = closing_allowed(left_m, settings.braking_m_s2, settle_s, settings.backing_m_s)
    if closing <= allowed:
        return Approached((north, east, down), braking=False)
    across = max(0.0, allowed / closing) if closing > 0.0 else 0.0
    north = evader_north + across * (relative_north - closing * to_north) + allowed * to_north
    east = evader_east + across * (relative_east - closing * to_east) + allowed * to_east
    return Approached((north, east, down), braking=True)


def _vertical(desired_m_s: float, flown_m_s: float, height_m: float, settings: Approach) -> float:
    """Return the vertical speed (down positive), slowed down near the height of the disc; never away from it."""
    closing_now = math.copysign(flown_m_s, height_m * flown_m_s)
    left_m = max(0.0, abs(height_m) - settings.lag_s * closing_now)
    allowed = approach_speed(left_m, settings.vertical_braking_m_s2, settings.vertical_settle_s)
    return max(-allowed, min(allowed, desired_m_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """How one vehicle is made to fly what the game asks for."""

    servo: ServoGains
    approach: Approach
    catch_up: CatchUp


class FollowMemory(NamedTuple):
    """What one call leaves to the next: the servo's memory, the along-track deficit (m), and the drift."""

    servo: ServoMemory = ServoMemory()
    deficit_m: float = 0.0
    drift: Drift = Drift()


class Followed(NamedTuple):
    """What to command, before the limits; the velocity desired after the approach; the memory for the next call.

    `unslowed` says that the approach leaves the game's whole speed over the ground.
    """

    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector | None
    desired_ned_m_s: Vector
    memory: FollowMemory
    unslowed: bool = False


def follow(
    desired_ned_m_s: Vector,
    here: Situation,
    gaps: Gaps,
    following: Following | None,
    memory: FollowMemory,
    *,
    most: float,
    dt_s: float,
    held_back: bool = False,
) -> Followed:
    """Follow the game's velocity for one cycle; None for `following` sends it as it is.

    Args:
        desired_ned_m_s: What the game asks for.
        here: Where the vehicle is and how it moves, and the evader's velocity.
        gaps: To the disc.
        following: How this vehicle is made to.
        memory: From the last call.
        most: The largest multiple of the game's velocity with which the along-track deficit is worked off.
        dt_s: Seconds since the last call.
        held_back: Whether a limit holds the vehicle back from what is asked here.
    """
    if following is None:
        return Followed(desired_ned_m_s, None, desired_ned_m_s, memory)
    drift = observe_drift(memory.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=dt_s)
    flown = less_drift(here.velocity_ned_m_s, drift)
    caught_up = catch_up(desired_ned_m_s, flown, memory.deficit_m, following.catch_up, most=most, dt_s=dt_s)
    desired, braking = approach(
        caught_up.velocity_ned_m_s, flown, here.evader_velocity_ned_m_s or _STILL, gaps, following.approach
    )
    # Braking at the disc adds nothing to the deficit.
    deficit_m = memory.deficit_m if braking else caught_up.deficit_m
    served = serve(desired, flown, memory.servo, following.servo, dt_s=dt_s, held_back=held_back)
    return Followed(
        with_drift(served.velocity_ned_m_s, drift),
        served.acceleration_ned_m_s2,
        desired,
        FollowMemory(served.memory, deficit_m, drift),
        not braking,
    )
