"""One guidance cycle on one page: where both are ▸ the game ▸ the strategy ▸ the approach ▸ the servo ▸ the limits.

Pure: the same inputs, settings and memory give the same setpoint, bit for bit: in flight, in virtual time, in replay.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from guidance.control import AltitudeHold, Envelope, Limited, LimitMemory, Situation, hold_altitude, limit
from guidance.control.approach import Gaps
from guidance.control.fence import keep_inside
from guidance.control.follow import Following, FollowMemory, Motion, follow, less_drift, observe_drift, with_drift
from guidance.control.hold import NorthEast, keep_station
from guidance.control.late_start import Acceleration, late_start
from guidance.errors import ConfigError
from guidance.frames import Amsl, GameFrame, Vector, game_from_ned, ned_from_game
from guidance.game import Game, Reason, Solution, SpeedSet, StandOff, Winner, guaranteed_age_s, solve
from guidance.game.game import horizontal_speed
from guidance.messages import Setpoint
from guidance.strategies import OPTIMAL, Strategy, StrategyMemory, pursue


@dataclass(frozen=True, slots=True)
class CycleSettings:
    """What every cycle of a flight needs.

    Attributes:
        speed_set: The pursuer's speeds in the game.
        strategy: What the pursuer plays; one of `guidance.strategies.PURSUER_STRATEGIES`.
        declared_evader_speed_m_s: What the evader says it never exceeds.
        speed_sigmas: k of the evader's speed bound max(declared, estimate + kσ). Too fast a bound costs time too:
            the pursuer leads an evader that is not there.
        standoff: The terminal disc: radius around the evader, height above its plane.
        tolerance_m: How near to the disc, horizontally and vertically each, counts as reached.
        envelope: The limits.
        following: How the vehicle is made to fly the game's velocity; None sends that as it is.
        acceleration: What the vehicle surely achieves, by which the time that it needs is told.
        target_game_m: The place the evader wants to reach, in the game frame (TAD); None in the PE game.
        target_velocity_m_s: Velocity of that place, x and y of the game frame, from the begin of play on.
        site: Latitude and longitude in degrees and altitude of the game frame's zero; None puts it at home.
        evader_timeout_s: Age of the evader's last report from which it counts as lost.
    """

    speed_set: SpeedSet
    strategy: Strategy
    declared_evader_speed_m_s: float
    standoff: StandOff
    tolerance_m: float
    envelope: Envelope
    following: Following | None
    acceleration: Acceleration
    target_game_m: Vector | None = None
    site: tuple[float, float, Amsl] | None = None
    evader_timeout_s: float = 1.5
    target_velocity_m_s: tuple[float, float] = (0.0, 0.0)
    speed_sigmas: float = 0.5


class EvaderEstimate(NamedTuple):
    """The evader as estimated for now: NED metres and m/s, a bound on its speed, and the age of what that rests on."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    speed_bound_m_s: float
    age_s: float


class CycleInputs(NamedTuple):
    """One cycle's view of the world, read once."""

    dt_s: float
    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_rad: float
    evader: EvaderEstimate | None
    game_frame: GameFrame | None


class CycleMemory(NamedTuple):
    """What one cycle leaves to the next."""

    follow: FollowMemory = FollowMemory()
    limits: LimitMemory | None = None
    height: AltitudeHold | None = None
    yaw_rad: float | None = None
    place: NorthEast | None = None
    strategy: StrategyMemory = StrategyMemory()
    optimal_game_m_s: Vector | None = None


class Certificate(NamedTuple):
    """What the game says at this cycle, and what became of it.

    `value` is the time to capture in s (PE), or the evader's final distance from its target in m (TAD), of the game's
    pursuer, which is at full speed at once. What this vehicle can promise, from the velocity and with the acceleration
    that it has (`guidance.control.late_start`), is a capture in `time_needed_s` (TAD: the meeting) and, in TAD, to
    keep the evader `assured_distance_m` from its target: negative by what it comes short where the evader gets there,
    NaN in PE. `margin_s` is zero on the barrier. `gap_m` is the horizontal distance to the disc's rim and
    `height_gap_m` the height above the disc. `command_ned_m_s` left the limits that are named in `acted`. `reason` is
    the `guidance.game.Reason` of the game's answer: with TOO_OLD nothing here is guaranteed.
    """

    winner: int
    value: float
    margin_s: float
    meeting_point_game_m: Vector
    meeting_time_s: float
    speed_ratio: float
    evader_age_s: float
    pursuer_game_m: Vector
    evader_game_m: Vector
    gap_m: float
    height_gap_m: float
    wanted_ned_m_s: Vector
    command_ned_m_s: Vector
    acted: tuple[str, ...]
    captured: bool
    strayed: bool
    evader_arrived: bool
    no_game: bool
    outside_fence: bool
    time_needed_s: float = math.nan
    assured_distance_m: float = math.nan
    reason: int | None = None


class Promise(NamedTuple):
    """What this vehicle can do; see `Certificate`."""

    time_needed_s: float
    assured_distance_m: float


class CycleOutput(NamedTuple):
    """The setpoint to send, the certificate (None for a hover), and the memory for the next cycle."""

    setpoint: Setpoint
    certificate: Certificate | None
    memory: CycleMemory


def play(inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> CycleOutput:
    """Play the game for one cycle.

    Raises:
        ValueError: If there is no evader or no game frame; the flight hovers then instead.
    """
    estimate, frame = inputs.evader, inputs.game_frame
    if estimate is None or frame is None:
        raise ValueError("play needs an evader and a game frame; hover without them")
    settings = _target_now(settings, memory.strategy.played_s)
    pursuer, evader = frame.position_from_ned(inputs.position_ned_m), frame.position_from_ned(estimate.position_ned_m)
    gaps = _gaps(inputs.position_ned_m, estimate.position_ned_m, settings.standoff)
    try:
        # The position is the estimate for now; its age says how long the evader may have been running elsewhere.
        game = Game(
            settings.speed_set,
            estimate.speed_bound_m_s,
            standoff=settings.standoff,
            information_age_s=min(max(estimate.age_s, 0.0), settings.evader_timeout_s),
            target_velocity_m_s=settings.target_velocity_m_s,
        )
    except ConfigError:  # the evader is too fast for this vehicle: no game, and no extrapolation of one
        output = hover(inputs, settings, memory)
        return output._replace(certificate=_no_game(inputs, settings, pursuer, evader, gaps, output.setpoint))
    too_old = game.information_age_s > guaranteed_age_s(game)
    if too_old:
        # No law is guaranteed then. Of those that tests/bench/bench_game_age.py sets against a worst evader, the one
        # that takes the estimate for new loses least: answering all that the evader may have done answers nothing.
        game = replace(game, information_age_s=0.0)
    seen = game_from_ned(estimate.velocity_ned_m_s)
    flown = game_from_ned(inputs.velocity_ned_m_s)
    solution, promise = _solve(game, settings, pursuer, evader, seen, flown, memory.optimal_game_m_s)
    optimal = _vector(solution.pursuer_velocity_m_s)
    wanted_game = _strategy(game, settings, pursuer, evader, seen, optimal, memory.strategy, inputs.dt_s)
    motion = Motion(inputs.position_ned_m, inputs.velocity_ned_m_s, estimate.velocity_ned_m_s)
    wanted = keep_inside(ned_from_game(wanted_game), inputs.position_ned_m, settings.envelope)
    most = settings.envelope.speed_m_s / float(horizontal_speed(settings.speed_set))
    followed = follow(wanted, motion, gaps, settings.following, memory.follow, most=most, dt_s=inputs.dt_s)
    yaw_rad = inputs.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    command = Setpoint(followed.velocity_ned_m_s, followed.acceleration_ned_m_s2, yaw_rad=yaw_rad)
    limited = _limit(command, inputs, settings, memory)
    certificate = _certify(
        inputs, settings, game, solution, promise, pursuer, evader, gaps, followed.wanted_ned_m_s, limited
    )
    return CycleOutput(
        limited.setpoint,
        certificate._replace(reason=int(Reason.TOO_OLD)) if too_old else certificate,
        CycleMemory(
            followed.memory,
            limited.memory,
            None,
            yaw_rad,
            strategy=StrategyMemory(np.array(wanted_game), memory.strategy.played_s + inputs.dt_s),
            optimal_game_m_s=optimal,
        ),
    )


def hover(inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> CycleOutput:
    """Stop and keep the place, the height and the heading, within the limits."""
    yaw_rad = inputs.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    held = hold_altitude(
        memory.height,
        down_m=inputs.position_ned_m[2],
        wanted_down_m=None,
        envelope=settings.envelope,
        dt_s=inputs.dt_s,
    )
    drift = observe_drift(memory.follow.drift, inputs.position_ned_m, inputs.velocity_ned_m_s, dt_s=inputs.dt_s)
    (north, east), place = keep_station(memory.place, inputs.position_ned_m, less_drift(inputs.velocity_ned_m_s, drift))
    still = with_drift((north, east, held.velocity_down_m_s), drift)
    limited = _limit(Setpoint(still, yaw_rad=yaw_rad), inputs, settings, memory)
    begun = memory.strategy.velocity_m_s is not None
    paused = StrategyMemory(np.zeros(3), memory.strategy.played_s + inputs.dt_s) if begun else StrategyMemory()
    kept = CycleMemory(FollowMemory(drift=drift), limited.memory, held.memory, yaw_rad, place, paused)
    return CycleOutput(limited.setpoint, None, kept)


def _target_now(settings: CycleSettings, played_s: float) -> CycleSettings:
    """Return the settings with the evader's target where it is after so long a play."""
    place, (x_m_s, y_m_s) = settings.target_game_m, settings.target_velocity_m_s
    if place is None or (x_m_s == 0.0 and y_m_s == 0.0):
        return settings
    return replace(settings, target_game_m=(place[0] + x_m_s * played_s, place[1] + y_m_s * played_s, place[2]))


def _solve(
    game: Game,
    settings: CycleSettings,
    pursuer: Vector,
    evader: Vector,
    evader_velocity: Vector,
    flown: Vector,
    optimal: Vector | None,
) -> tuple[Solution, Promise]:
    """Solve the game, and once more from where a pursuer would begin that does as well as this vehicle.

    Both at once, which takes no longer than one: with the optimal velocity of the last cycle.
    """
    E, seen = np.array(evader), np.array(evader_velocity)
    T = None if settings.target_game_m is None else np.array(settings.target_game_m)
    if optimal is None:
        optimal = _vector(solve(game, np.array(pursuer), E, T, evader_velocity_m_s=seen).pursuer_velocity_m_s)
    late = late_start(pursuer, optimal, flown, settings.acceleration)
    both = solve(game, np.array((pursuer, late)), E, T, evader_velocity_m_s=seen)
    here, there = (Solution(*(column[row] for column in both)) for row in (0, 1))
    if T is None:
        return here, Promise(float(there.value), math.nan)
    short = int(there.winner) == Winner.EVADER
    return here, Promise(float(there.meeting_time_s), float(-there.value if short else there.value))


def _strategy(
    game: Game,
    settings: CycleSettings,
    pursuer: Vector,
    evader: Vector,
    evader_velocity: Vector,
    optimal: Vector,
    memory: StrategyMemory,
    dt_s: float,
) -> Vector:
    if settings.strategy.name == OPTIMAL:
        return optimal
    P, E, seen = np.array(pursuer), np.array(evader), np.array(evader_velocity)
    T = None if settings.target_game_m is None else np.array(settings.target_game_m)
    return _vector(pursue(settings.strategy, game, P, E, T, seen, memory, dt_s=dt_s))


def _vector(parts: np.typing.NDArray[np.float64]) -> Vector:
    x, y, z = (float(part) for part in parts)
    return (x, y, z)


def _gaps(position_ned_m: Vector, evader_ned_m: Vector, standoff: StandOff) -> Gaps:
    north, east = evader_ned_m[0] - position_ned_m[0], evader_ned_m[1] - position_ned_m[1]
    distance_m = math.hypot(north, east)
    scale = 1.0 / distance_m if distance_m > 0.0 else 0.0
    height_m = evader_ned_m[2] - position_ned_m[2] - standoff.height_m
    return Gaps(distance_m - standoff.radius_m, height_m, north * scale, east * scale)


def _limit(command: Setpoint, inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> Limited:
    evader = inputs.evader
    situation = Situation(
        inputs.position_ned_m,
        inputs.velocity_ned_m_s,
        inputs.yaw_rad,
        None if evader is None else evader.position_ned_m,
        None if evader is None else evader.velocity_ned_m_s,
    )
    return limit(command, situation, settings.envelope, memory.limits, inputs.dt_s)


def _certify(
    inputs: CycleInputs,
    settings: CycleSettings,
    game: Game,
    solution: Solution,
    promise: Promise,
    pursuer: Vector,
    evader: Vector,
    gaps: Gaps,
    wanted: Vector,
    limited: Limited,
) -> Certificate:
    meeting_x, meeting_y, meeting_z = (float(part) for part in solution.meeting_point_m)
    near_m = settings.tolerance_m
    reached = gaps.ground_m <= near_m and abs(gaps.height_m) <= near_m
    at = settings.target_game_m
    return Certificate(
        winner=int(solution.winner),
        value=float(solution.value),
        margin_s=float(solution.margin_s),
        meeting_point_game_m=(meeting_x, meeting_y, meeting_z),
        meeting_time_s=float(solution.meeting_time_s),
        speed_ratio=float(horizontal_speed(game.pursuer) / game.evader_speed_m_s),
        evader_age_s=inputs.evader.age_s if inputs.evader is not None else math.inf,
        pursuer_game_m=pursuer,
        evader_game_m=evader,
        gap_m=gaps.ground_m,
        height_gap_m=gaps.height_m,
        wanted_ned_m_s=wanted,
        command_ned_m_s=limited.setpoint.velocity_ned_m_s,
        acted=tuple(str(one) for one in limited.acted),
        captured=reached,
        strayed=gaps.ground_m > 3.0 * near_m or abs(gaps.height_m) > 3.0 * near_m,
        evader_arrived=at is not None and not reached and math.dist(at[:2], evader[:2]) <= near_m,
        no_game=False,
        outside_fence=_outside(inputs.position_ned_m, settings.envelope),
        time_needed_s=promise.time_needed_s,
        assured_distance_m=promise.assured_distance_m,
        reason=int(solution.reason),
    )


def _no_game(
    inputs: CycleInputs, settings: CycleSettings, pursuer: Vector, evader: Vector, gaps: Gaps, setpoint: Setpoint
) -> Certificate:
    nowhere = (math.nan, math.nan, math.nan)
    return Certificate(
        winner=0,
        value=math.nan,
        margin_s=math.nan,
        meeting_point_game_m=nowhere,
        meeting_time_s=math.nan,
        speed_ratio=math.nan,
        evader_age_s=inputs.evader.age_s if inputs.evader is not None else math.inf,
        pursuer_game_m=pursuer,
        evader_game_m=evader,
        gap_m=gaps.ground_m,
        height_gap_m=gaps.height_m,
        wanted_ned_m_s=nowhere,
        command_ned_m_s=setpoint.velocity_ned_m_s,
        acted=(),
        captured=False,
        strayed=False,
        evader_arrived=False,
        no_game=True,
        outside_fence=_outside(inputs.position_ned_m, settings.envelope),
    )


def _outside(position_ned_m: Vector, envelope: Envelope) -> bool:
    """Whether the vehicle has left the fence: the limits should have kept it in."""
    north, east = (position_ned_m[axis] - envelope.home_ned_m[axis] for axis in (0, 1))
    beyond = envelope.fence_radius_m is not None and math.hypot(north, east) > envelope.fence_radius_m
    return beyond or (envelope.fence_polygon is not None and not envelope.fence_polygon.contains((north, east)))
