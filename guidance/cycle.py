"""One guidance cycle on one page: where both are ▸ the game ▸ the strategy ▸ the approach ▸ the servo ▸ the limits.

Pure: the same inputs, settings and memory give the same setpoint, bit for bit: in flight, in virtual time, in replay.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from guidance.certificate import Certificate, Players, Vehicle, certify, without_game
from guidance.control import Envelope, Handling, Situation
from guidance.control.braking_law import Wall, held_back
from guidance.control.follow import FollowMemory, Pace, follow, gaps_to_disc, observe_drift
from guidance.control.polygon import Point
from guidance.control.servo import (
    AltitudeHold,
    SpeedMemory,
    hold_altitude,
    keep_station,
    observe_speed,
)
from guidance.control.setpoint_limiter import LimitMemory, limit
from guidance.errors import ConfigError
from guidance.estimation import EvaderEstimate
from guidance.frames import (
    GameFrame,
    Place,
    Vector,
    difference,
    game_from_ned,
    ned_from_game,
    total,
)
from guidance.game import Ball, Game, Reason, guaranteed_age_s
from guidance.messages import Setpoint
from guidance.strategies import OPTIMAL, Strategy, StrategyMemory, pursue


@dataclass(frozen=True, slots=True)
class CycleSettings:
    """Settings of every cycle of a flight.

    Attributes:
        game: The game against the declared speed; each cycle plays it with the estimated speed.
        strategy: Strategy of the pursuer; one of `guidance.strategies.PURSUER_STRATEGIES`.
        speed_sigmas: k of the evader's speed bound max(declared, estimate + kσ). Too large a bound costs time too: the
            pursuer aims too far ahead.
        tolerance_m: Distance from the disc, horizontally and vertically, that counts as captured.
        envelope: The limits.
        handling: How the vehicle flies.
        target_game_m: The evader's target in the game frame (TAD); None in the PE game.
        site: Latitude and longitude in degrees and altitude of the game frame's zero; None for home.
        evader_timeout_s: The evader counts as lost when its last report is older than this.
    """

    game: Game
    strategy: Strategy
    tolerance_m: float
    envelope: Envelope
    handling: Handling
    target_game_m: Vector | None = None
    site: Place | None = None
    evader_timeout_s: float = 1.5
    speed_sigmas: float = 0.5


class CycleInputs(NamedTuple):
    """Inputs of one cycle, read once.

    Attributes:
        dt_s: Time since the last cycle.
        situation: State of the vehicle, and of the evader if there is one.
        walls: All walls around the vehicle, see `guidance.control.braking_law`.
        evader: The estimated evader.
        game_frame: The game's frame, if it is known.
        guided: Whether a HEARTBEAT of this cycle shows the guided mode, so the vehicle has followed the setpoints.
    """

    dt_s: float
    situation: Situation
    walls: tuple[Wall, ...]
    evader: EvaderEstimate | None
    game_frame: GameFrame | None
    guided: bool = False


class CycleMemory(NamedTuple):
    """Memory between cycles."""

    follow: FollowMemory = FollowMemory()
    limits: LimitMemory | None = None
    height: AltitudeHold | None = None
    yaw_rad: float | None = None
    place: Point | None = None
    strategy: StrategyMemory = StrategyMemory()
    optimal_game_m_s: Vector | None = None
    speed: SpeedMemory = SpeedMemory()


class CycleOutput(NamedTuple):
    """The setpoint to send, the certificate (None for a hover), and the memory for the next cycle."""

    setpoint: Setpoint
    certificate: Certificate | None
    memory: CycleMemory


def play(inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> CycleOutput:  # noqa: PLR0915 - five steps in one
    """Play the game for one cycle.

    Raises:
        ValueError: If there is no evader or no game frame; the flight hovers then instead.
    """
    (dt_s, here, walls, evader, frame, guided) = inputs
    envelope = settings.envelope
    if evader is None or frame is None:
        raise ValueError("play needs an evader and a game frame; hover without them")
    P = frame.position_from_ned(here.position_ned_m)
    flown_m_s = game_from_ned(here.velocity_ned_m_s)
    E = frame.position_from_ned(evader.position_ned_m)
    seen_m_s = game_from_ned(evader.velocity_ned_m_s)
    T = settings.target_game_m
    (x_m_s, y_m_s) = settings.game.target_velocity_m_s
    played_s = memory.strategy.played_s
    T = None if T is None else (T[0] + x_m_s * played_s, T[1] + y_m_s * played_s, T[2])
    gaps = gaps_to_disc(here.position_ned_m, evader.position_ned_m, settings.game.standoff)
    players = Players(P, flown_m_s, E, seen_m_s, T, gaps, evader.age_s)
    try:
        game, too_old = game_played(
            settings, evader.speed_bound_m_s, evader.age_s, memory.speed.share
        )
    except ConfigError:
        # The evader is too fast for this vehicle: no game, and no extrapolation of one
        output = hover(inputs, settings, memory)
        refused = without_game(players)._replace(command_ned_m_s=output.setpoint.velocity_ned_m_s)
        return output._replace(certificate=refused)
    vehicle = Vehicle(
        settings.handling.acceleration, envelope, memory.speed.shown_m_s, settings.tolerance_m
    )
    solution, waiting, certificate = certify(game, players, vehicle, memory.optimal_game_m_s)
    optimal = solution.pursuer_velocity_m_s
    asked = waiting or optimal
    if settings.strategy.name != OPTIMAL:
        seen = np.array(seen_m_s)
        at = None if T is None else np.array(T)
        flies = pursue(
            settings.strategy, game, np.array(P), np.array(E), at, seen, memory.strategy, dt_s=dt_s
        )
        asked = (float(flies[0]), float(flies[1]), float(flies[2]))
    hurried = asked is not waiting
    played = StrategyMemory(np.array(asked), played_s + dt_s)
    (x, y, z) = asked
    ball = isinstance(game.pursuer, Ball)
    reached_m_s = game.pursuer.horizontal_m_s
    full_m_s = settings.game.pursuer.horizontal_m_s
    if math.hypot(x, y, z if ball else 0.0) >= reached_m_s * (1.0 - 1e-6):
        # It is flown at the configured speed, which shows whether the vehicle can fly faster. A vehicle that waits for
        # its height, or keeps up with the evader, asks for less than the game's speed.
        scale = full_m_s / reached_m_s
        x = scale * x
        y = scale * y
        z = scale * z if ball else z
    nominal_ned_m_s = ned_from_game((x, y, z))
    asked_ned_m_s = held_back(nominal_ned_m_s, walls, envelope)
    at_wall = memory.limits is not None and memory.limits.held_back
    most_m_s = envelope.speed_m_s
    pace = Pace(dt_s, most_m_s / full_m_s, most_m_s + evader.speed_bound_m_s, hurried, at_wall)
    followed = follow(asked_ned_m_s, here, gaps, settings.handling, memory.follow, pace)
    unslowed = (
        followed.unslowed and hurried and not at_wall and asked_ned_m_s[:2] == nominal_ned_m_s[:2]
    )
    flown = followed.flown_ned_m_s
    speed = observe_speed(
        memory.speed, asked_ned_m_s, flown, unslowed=unslowed, confirmed=guided, dt_s=dt_s
    )
    yaw_rad = here.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    command = Setpoint(followed.velocity_ned_m_s, followed.acceleration_ned_m_s2, yaw_rad=yaw_rad)
    already_shaped = settings.handling.servo is not None
    limited = limit(
        command, here, envelope, memory.limits, dt_s, walls=walls, already_shaped=already_shaped
    )
    certificate = certificate._replace(
        desired_ned_m_s=followed.desired_ned_m_s,
        command_ned_m_s=limited.setpoint.velocity_ned_m_s,
        active_limits=tuple(map(str, limited.active)),
        reason=int(Reason.TOO_OLD) if too_old else certificate.reason,
    )
    kept = CycleMemory(followed.memory, limited.memory, None, yaw_rad, None, played, optimal, speed)
    return CycleOutput(limited.setpoint, certificate, kept)


def game_played(
    settings: CycleSettings, evader_speed_m_s: float, evader_age_s: float, speed_share: float = 1.0
) -> tuple[Game, bool]:
    """Return the game that a cycle plays, and whether the evader's last report is too old for a guarantee.

    Args:
        settings: Of the cycle.
        evader_speed_m_s: Bound of the evader's speed in this cycle.
        evader_age_s: Age of the evader's last report; the evader may have run elsewhere for so long.
        speed_share: Share of the configured speed that this vehicle reaches.

    Raises:
        ConfigError: If the evader is too fast for this vehicle.
    """
    age_s = min(max(evader_age_s, 0.0), settings.evader_timeout_s)
    reached_m_s = max(speed_share, 1e-3) * settings.game.pursuer.horizontal_m_s
    game = settings.game.against(evader_speed_m_s, age_s, reached_m_s)
    too_old = age_s > guaranteed_age_s(game)
    if settings.target_game_m is not None:
        # With age the value can be beaten in TAD. Of the laws that tests/bench/bench_game_age.py sets against a worst
        # evader, this one loses least: a pursuer that keeps to the disc about an old place lets the evader out of it.
        game = game.within_spread()
    elif too_old:
        game = settings.game.against(evader_speed_m_s, 0.0, reached_m_s)
    return game, too_old


def hover(inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> CycleOutput:
    """Stop and keep the place, the height and the heading, within the limits."""
    dt_s = inputs.dt_s
    here = inputs.situation
    envelope = settings.envelope
    yaw_rad = here.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    down_m_s, height = hold_altitude(
        memory.height, down_m=here.position_ned_m[2], envelope=envelope, dt_s=dt_s
    )
    drift = observe_drift(
        memory.follow.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=dt_s
    )
    flown_ned_m_s = difference(here.velocity_ned_m_s, drift.velocity_ned_m_s)
    (north, east), place = keep_station(memory.place, here.position_ned_m, flown_ned_m_s)
    still = total((north, east, down_m_s), drift.velocity_ned_m_s)
    limited = limit(
        Setpoint(still, yaw_rad=yaw_rad), here, envelope, memory.limits, dt_s, walls=inputs.walls
    )
    begun = memory.strategy.velocity_m_s is not None
    paused = (
        StrategyMemory(np.zeros(3), memory.strategy.played_s + dt_s) if begun else StrategyMemory()
    )
    # Without the present comparison
    speed = SpeedMemory(memory.speed.shown_m_s, memory.speed.share)
    kept = CycleMemory(
        FollowMemory(drift=drift), limited.memory, height, yaw_rad, place, paused, speed=speed
    )
    return CycleOutput(limited.setpoint, None, kept)
