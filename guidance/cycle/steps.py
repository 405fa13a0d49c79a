"""One guidance cycle in five steps: both positions ▸ the game ▸ the policy ▸ following ▸ the limits.

Pure: the same inputs, settings and memory give the same setpoint, bit for bit: in flight, in virtual time, in replay.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from guidance.control import Envelope, Gaps, Handling, Situation
from guidance.control.braking_law import Wall, held_back
from guidance.control.follow import (
    Followed,
    FollowMemory,
    Pace,
    follow,
    gaps_to_disc,
    observe_drift,
)
from guidance.control.limits import Agility
from guidance.control.polygon import Point
from guidance.control.servo import (
    AltitudeHold,
    SpeedMemory,
    hold_altitude,
    keep_station,
    observe_speed,
)
from guidance.control.setpoint_limiter import LimitMemory, limit
from guidance.cycle.certificate import (
    Certificate,
    Certified,
    ChosenCourse,
    certify,
    without_game,
)
from guidance.cycle.circling import Circling
from guidance.cycle.players import Capability, Players
from guidance.errors import ConfigError
from guidance.estimation import EvaderEstimate
from guidance.frames import STILL, Enu, GameFrame, Ned, Place, game_from_ned, ned_from_game
from guidance.game import Game, Reason, guaranteed_age_s
from guidance.messages import Setpoint
from guidance.strategies import OPTIMAL, Strategy, StrategyMemory, pursue
from guidance.strategies.own import PURSUER_SHARES, Ask, observe_pursuit, pursuer_velocity


@dataclass(frozen=True, slots=True)
class CycleSettings:
    """Settings of every cycle of a flight.

    Attributes:
        game: The game against the declared speed; each cycle plays it with the estimated speed.
        policy: Strategy of the pursuer; one of `guidance.strategies.PURSUER_STRATEGIES`.
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
    policy: Strategy
    tolerance_m: float
    envelope: Envelope
    handling: Handling
    target_game_m: Enu | None = None
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
        ask: Asks the user's policy, if one is flown.
        guided: Whether a HEARTBEAT of this cycle shows the guided mode, so the vehicle has followed the setpoints.
    """

    dt_s: float
    situation: Situation
    walls: tuple[Wall, ...]
    evader: EvaderEstimate | None
    game_frame: GameFrame | None
    guided: bool = False
    ask: Ask | None = None


class CycleMemory(NamedTuple):
    """Memory between cycles."""

    follow: FollowMemory = FollowMemory()
    limits: LimitMemory | None = None
    height: AltitudeHold | None = None
    yaw_rad: float | None = None
    place: Point | None = None
    policy: StrategyMemory = StrategyMemory()
    optimal_game_m_s: Enu | None = None
    speed: SpeedMemory = SpeedMemory()
    circling: Circling = Circling()


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
    evader = inputs.evader
    frame = inputs.game_frame
    if evader is None or frame is None:
        raise ValueError("play needs an evader and a game frame; hover without them")
    # Step 1: where both players and the target are, in the game frame. The target may have moved since the game began.
    here = inputs.situation
    pursuer_m, pursuer_m_s = frame.motion_from_ned(here.position_ned_m, here.velocity_ned_m_s)
    evader_m, evader_m_s = frame.motion_from_ned(evader.position_ned_m, evader.velocity_ned_m_s)
    gaps = gaps_to_disc(here.position_ned_m, evader.position_ned_m, settings.game.standoff)
    target_m = settings.target_game_m
    if target_m is not None:
        east_m_s, north_m_s = settings.game.target_velocity_m_s
        target_m += Enu((east_m_s, north_m_s, 0.0)) * memory.policy.played_s
    players = Players(
        pursuer_m,
        pursuer_m_s,
        evader_m,
        evader_m_s,
        target_m,
        gaps,
        evader.age_s,
        _bound_for(memory.limits, settings.handling.servo or settings.envelope),
    )

    try:
        played = game_played(settings, evader.speed_bound_m_s, evader.age_s, memory.speed.share)
    except ConfigError:
        # The evader is too fast for this vehicle: there is no game, and none is extrapolated.
        output = hover(inputs, settings, memory)
        certificate = without_game(players)._replace(
            command_ned_m_s=output.setpoint.velocity_ned_m_s
        )
        return output._replace(certificate=certificate)
    aim = _aim(played.game, players, inputs, settings, memory)
    if aim.policy_fault is not None:
        # The user's policy has no answer: none of an earlier cycle is flown.
        output = hover(inputs, settings, memory)
        certificate = aim.certified.certificate._replace(
            policy_fault=aim.policy_fault, command_ned_m_s=output.setpoint.velocity_ned_m_s
        )
        return output._replace(certificate=certificate)
    unlimited = _follow(aim, gaps, evader.speed_bound_m_s, inputs, settings, memory)
    # Step 5: the limits. The servo has shaped the command already, where there is one.
    limited = limit(
        unlimited.command,
        here,
        settings.envelope,
        memory.limits,
        inputs.dt_s,
        walls=inputs.walls,
        already_shaped=settings.handling.servo is not None,
    )

    # The certificate with the command, and the memory for the next cycle.
    certified = aim.certified
    certificate = certified.certificate._replace(
        reason=int(Reason.TOO_OLD) if played.too_old else certified.solution.reason,
        desired_ned_m_s=unlimited.followed.desired_ned_m_s,
        command_ned_m_s=limited.setpoint.velocity_ned_m_s,
        active_limits=tuple(map(str, limited.active)),
    )
    kept = CycleMemory(
        follow=unlimited.followed.memory,
        limits=limited.memory,
        yaw_rad=unlimited.command.yaw_rad,
        policy=aim.memory,
        optimal_game_m_s=Enu(certified.solution.pursuer_velocity_m_s),
        speed=unlimited.speed,
        circling=certified.circling,
    )
    return CycleOutput(limited.setpoint, certificate, kept)


def _bound_for(sent: LimitMemory | None, agility: Agility) -> Enu | None:
    """Return the velocity that the setpoints come to while their acceleration ends, in the game frame."""
    if sent is None:
        return None
    gained = sent.acceleration_ned_m_s2
    ends_in_s = math.hypot(gained.north, gained.east) / agility.jerk_m_s3
    return game_from_ned(sent.velocity_ned_m_s + gained * (0.5 * ends_in_s))


class GamePlayed(NamedTuple):
    """The game of one cycle, and whether the evader's last report is too old for a guarantee."""

    game: Game
    too_old: bool


def game_played(
    settings: CycleSettings, evader_speed_m_s: float, evader_age_s: float, speed_share: float = 1.0
) -> GamePlayed:
    """Step 2: return the game that a cycle plays.

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
        # With age the value can be beaten in TAD. Of the games that tests/bench/bench_game_age.py sets against a worst
        # evader, this one loses least: a pursuer that keeps to the disc about an old place lets the evader out of it.
        game = game.within_spread()
    elif too_old:
        game = settings.game.against(evader_speed_m_s, 0.0, reached_m_s)
    return GamePlayed(game, too_old)


class Aim(NamedTuple):
    """The velocity of the pursuer's policy.

    Attributes:
        certified: The game from here, seen from this vehicle.
        nominal_ned_m_s: This velocity at the configured speed.
        hurried: Whether it is the game's full speed. A vehicle that waits or guards has time to spare.
        memory: Of the policy.
        policy_fault: Why the user's policy has no answer, so there is no velocity; None if there is one.
    """

    certified: Certified
    nominal_ned_m_s: Ned
    hurried: bool
    memory: StrategyMemory
    policy_fault: str | None = None


def _aim(
    game: Game,
    players: Players,
    inputs: CycleInputs,
    settings: CycleSettings,
    memory: CycleMemory,
) -> Aim:
    """Step 3: certify the game from here, and ask the policy for a velocity.

    Args:
        game: Of this cycle.
        players: Where both are.
        inputs: Of the cycle.
        settings: Of the cycle.
        memory: Of the cycle.
    """
    vehicle = Capability(
        settings.handling.acceleration,
        settings.envelope,
        settings.handling.approach,
        memory.speed.shown_m_s,
        settings.tolerance_m,
    )
    before_m_s = memory.optimal_game_m_s
    certified = certify(game, players, vehicle, before_m_s, memory.circling, dt_s=inputs.dt_s)
    velocity_m_s: Enu | str = certified.velocity_m_s
    hurried = certified.course is ChosenCourse.SOLUTION
    if settings.policy.name != OPTIMAL:
        velocity_m_s = _asked(settings.policy, game, players, inputs, memory.policy)
        hurried = True
    if isinstance(velocity_m_s, str):
        return Aim(certified, STILL, hurried, memory.policy, policy_fault=velocity_m_s)
    # At the configured speed, which shows whether the vehicle can fly faster. A vehicle that waits for its height, or
    # keeps up with the evader, asks for less than the game's speed.
    nominal_m_s = velocity_m_s
    configured_m_s = settings.game.pursuer.horizontal_m_s
    reached_m_s = game.pursuer.horizontal_m_s
    asks_for_all = game.pursuer.pace(velocity_m_s) >= reached_m_s * (1.0 - 1e-6)
    if reached_m_s != configured_m_s and asks_for_all:
        nominal_m_s = velocity_m_s * (configured_m_s / reached_m_s)
        if game.pursuer.separate:
            nominal_m_s = nominal_m_s.level_with(velocity_m_s.up)
    played = StrategyMemory(np.array(velocity_m_s), memory.policy.played_s + inputs.dt_s)
    return Aim(certified, ned_from_game(nominal_m_s), hurried, played)


def _asked(
    policy: Strategy, game: Game, players: Players, inputs: CycleInputs, memory: StrategyMemory
) -> Enu | str:
    """Return the velocity of a policy other than the optimal one, in the game frame, or why there is none."""
    if policy.is_own:
        if inputs.ask is None:
            return "there is no policy here to ask"
        last_m_s = np.zeros(3) if memory.velocity_m_s is None else memory.velocity_m_s
        observation = observe_pursuit(
            game,
            np.array([players.pursuer_m]),
            np.array([players.evader_m]),
            np.array([players.evader_m_s]),
            last_m_s[None],
            None if players.target_m is None else np.array([players.target_m]),
        )
        answer = inputs.ask(observation)
        if isinstance(answer, str):
            return answer
        if len(answer) != PURSUER_SHARES or not all(map(math.isfinite, answer)):
            return f"the policy's answer {answer} is not {PURSUER_SHARES} finite numbers"
        return Enu(pursuer_velocity(game, np.array([answer]))[0].tolist())
    target_m = None if players.target_m is None else np.array(players.target_m)
    x, y, z = pursue(
        policy,
        game,
        np.array(players.pursuer_m),
        np.array(players.evader_m),
        target_m,
        np.array(players.evader_m_s),
        memory,
        dt_s=inputs.dt_s,
    )
    return Enu((float(x), float(y), float(z)))


class UnlimitedCommand(NamedTuple):
    """The command before the limits, how it came about, and the speeds that the vehicle has flown."""

    command: Setpoint
    followed: Followed
    speed: SpeedMemory


def _follow(
    aim: Aim,
    gaps: Gaps,
    evader_speed_m_s: float,
    inputs: CycleInputs,
    settings: CycleSettings,
    memory: CycleMemory,
) -> UnlimitedCommand:
    """Step 4: make the vehicle follow the policy's velocity, and compare it with the one flown.

    Args:
        aim: The policy's velocity.
        gaps: Distances to the evader's disc.
        evader_speed_m_s: Bound of the evader's speed.
        inputs: Of the cycle.
        settings: Of the cycle.
        memory: Of the cycle.
    """
    largest_m_s = settings.envelope.speed_m_s
    asked_m_s = held_back(aim.nominal_ned_m_s, inputs.walls, settings.envelope)
    at_wall = memory.limits is not None and memory.limits.held_back
    speed_ratio = largest_m_s / settings.game.pursuer.horizontal_m_s
    meeting_m_s = largest_m_s + evader_speed_m_s
    pace = Pace(inputs.dt_s, speed_ratio, meeting_m_s, hurried=aim.hurried, held_back=at_wall)
    followed = follow(asked_m_s, inputs.situation, gaps, settings.handling, memory.follow, pace)
    flown_m_s = followed.flown_ned_m_s
    is_turned = asked_m_s[:2] != aim.nominal_ned_m_s[:2]
    unslowed = followed.unslowed and aim.hurried and not at_wall and not is_turned
    speed = observe_speed(
        memory.speed, asked_m_s, flown_m_s, unslowed=unslowed, guided=inputs.guided, dt_s=pace.dt_s
    )
    yaw_rad = inputs.situation.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    command = Setpoint(followed.velocity_ned_m_s, followed.acceleration_ned_m_s2, yaw_rad=yaw_rad)
    return UnlimitedCommand(command, followed, speed)


def hover(inputs: CycleInputs, settings: CycleSettings, memory: CycleMemory) -> CycleOutput:
    """Stop and keep the place, the height and the heading, within the limits."""
    here = inputs.situation
    dt_s = inputs.dt_s
    yaw_rad = here.yaw_rad if memory.yaw_rad is None else memory.yaw_rad
    down_m_s, height = hold_altitude(
        memory.height, down_m=here.position_ned_m.down, envelope=settings.envelope, dt_s=dt_s
    )
    drift = observe_drift(
        memory.follow.drift, here.position_ned_m, here.velocity_ned_m_s, dt_s=dt_s
    )
    flown_ned_m_s = here.velocity_ned_m_s - drift.velocity_ned_m_s
    (north_m_s, east_m_s), place = keep_station(memory.place, here.position_ned_m, flown_ned_m_s)
    still_ned_m_s = Ned((north_m_s, east_m_s, down_m_s)) + drift.velocity_ned_m_s
    still = Setpoint(still_ned_m_s, yaw_rad=yaw_rad)
    limited = limit(still, here, settings.envelope, memory.limits, dt_s, walls=inputs.walls)
    paused = StrategyMemory()
    if memory.policy.velocity_m_s is not None:
        paused = StrategyMemory(np.zeros(3), memory.policy.played_s + dt_s)
    kept = CycleMemory(
        follow=FollowMemory(drift=drift),
        limits=limited.memory,
        height=height,
        yaw_rad=yaw_rad,
        place=place,
        policy=paused,
        # A comparison in progress is dropped
        speed=SpeedMemory(memory.speed.shown_m_s, memory.speed.share),
    )
    return CycleOutput(limited.setpoint, None, kept)
