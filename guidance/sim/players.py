"""The game and the players of a scenario: strategies with their courses, and the pilot of the mocked evader.

The evader of a mocked flight is a ground vehicle that this process commands over MAVLink.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from guidance.autopilots import ROVER, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HOME_POSITION
from guidance.frames import Amsl, GameFrame, Vector, ned_from_game
from guidance.game import Ball, Cylinder, Extent, Game, SpeedSet, StandOff
from guidance.links.port import VehicleLink
from guidance.messages import Heartbeat, Home, LocalPosition, Message, Origin, Setpoint
from guidance.sim.scenario import Player, Scenario
from guidance.strategies import Course, Strategy, StrategyMemory, evade, random_turns, recorded, waypoints
from guidance.strategies.course import Array
from guidance.vehicle import VehicleState, local_frame, observe

REPEAT_S = 1.0

PURSUER_STREAM, EVADER_STREAM = 1, 2
"""Random streams of the players. They differ, so both players turn independently with one seed."""


class EvaderPilot:
    """Prepares the evader's vehicle, waits for the game, and plays it.

    Args:
        link: To the vehicle.
        scenario: Its game, its strategy and its place.

    Attributes:
        ready: Whether it is armed, in GUIDED, and its position is known.
    """

    def __init__(self, link: VehicleLink, scenario: Scenario) -> None:
        self._link = link
        self._game, self._target_game_m, self._site = game(scenario), target_game_m(scenario), site(scenario)
        start_m = np.array((*scenario.evader.position_m, 0.0))
        self._strategy = evader_strategy(scenario, start_m, scenario.evader.speed_m_s, scenario.seed)
        self._began_s: float | None = None
        self._requested_s = self._stood_s = float("-inf")
        self.vehicle = VehicleState()
        self.messages: Sequence[Message] = ()
        self.ready = False
        self._position_m: Vector | None = None
        self._frame: GameFrame | None = None
        self._frame_sources: tuple[Home | None, Origin | None] = (None, None)

    def position_game_m(self) -> Vector | None:
        """Its position in the game frame from its own telemetry, None until known."""
        return self._position_m

    def _located(self) -> Vector | None:
        sources = (self.vehicle.last(Home), self.vehicle.last(Origin))
        if sources != self._frame_sources:
            self._frame_sources = sources
            frame = local_frame(self.vehicle, ROVER.projection)
            self._frame = None if frame is None else GameFrame(frame.ned_from_wgs84(*self._site))
        local = self.vehicle.last(LocalPosition)
        return None if self._frame is None or local is None else self._frame.position_from_ned(local.position_ned_m)

    def step(self, now_s: float, pursuers_game_m: Sequence[Vector], *, playing: bool) -> None:
        """Run one cycle: receive, then prepare the vehicle, play against the nearest pursuer, or stand still."""
        self.messages = self._link.receive()
        self.vehicle = observe(self.vehicle, self.messages)
        position = self._position_m = self._located()
        beat = self.vehicle.last(Heartbeat)
        guided = beat is not None and beat.armed and beat.custom_mode == ROVER.custom_modes[Mode.GUIDED]
        self.ready = guided and position is not None
        if not guided or position is None:
            self._make_ready(now_s)
        elif playing and pursuers_game_m:
            self._began_s = now_s if self._began_s is None else self._began_s
            nearest = min(pursuers_game_m, key=lambda pursuer: math.dist(pursuer, position))
            self._link.send_setpoint(Setpoint(self._velocity_ned_m_s(nearest, position, now_s - self._began_s)))
            self._stood_s = float("-inf")
        elif now_s - self._stood_s >= REPEAT_S:
            self._stood_s = now_s
            self._link.send_setpoint(Setpoint((0.0, 0.0, 0.0)))

    def stop(self) -> None:
        """Disarm the vehicle."""
        self._link.request(ROVER.disarm())

    def _make_ready(self, now_s: float) -> None:
        if now_s - self._requested_s < REPEAT_S:
            return
        self._requested_s = now_s
        for request in (
            *ROVER.stream_requests(),
            ROVER.request_message(HOME_POSITION),
            ROVER.request_message(GPS_GLOBAL_ORIGIN),
            ROVER.set_mode(Mode.GUIDED),
            ROVER.arm(),
        ):
            self._link.request(request)

    def _velocity_ned_m_s(self, pursuer_game_m: Vector, evader_game_m: Vector, played_s: float) -> Vector:
        target = self._target_game_m
        velocity = evade(
            self._strategy,
            self._game,
            np.array(pursuer_game_m),
            np.array((evader_game_m[0], evader_game_m[1], 0.0)),
            None if target is None else np.array(target),
            StrategyMemory(None, played_s),
        )
        x, y, _ = (float(part) for part in velocity)
        return ned_from_game((x, y, 0.0))


def site(scenario: Scenario) -> tuple[float, float, Amsl]:
    """Return the origin of the game frame, on the evader's plane."""
    where = scenario.site
    return where.latitude_deg, where.longitude_deg, Amsl(where.altitude_amsl_m + scenario.evader.height_m)


def speed_set(scenario: Scenario) -> SpeedSet:
    """Return the pursuer's speed set."""
    pursuer = scenario.pursuer
    if pursuer.speed_set == "ball":
        return Ball(pursuer.speed_m_s)
    return Cylinder(pursuer.speed_m_s, pursuer.climb_m_s, pursuer.descent_m_s)


def standoff(scenario: Scenario) -> StandOff:
    """Return the terminal disc, with its height above the evader's plane."""
    return StandOff(scenario.standoff.radius_m, scenario.standoff.height_m - scenario.evader.height_m)


def game(scenario: Scenario) -> Game:
    """Return the game with the evader's true speed, as the evader plays it in flight."""
    return Game(
        speed_set(scenario),
        scenario.evader.speed_m_s,
        standoff=standoff(scenario),
        target_extent=target_extent(scenario),
    )


def target_game_m(scenario: Scenario) -> Vector | None:
    """Return the evader's target in the game frame, None in the PE game."""
    return None if scenario.target is None else (*scenario.target.position_m, 0.0)


def target_extent(scenario: Scenario) -> Extent:
    """Return the target's shape, a point in the PE game."""
    return Extent() if scenario.target is None else scenario.target.extent


def pursuer_strategy(scenario: Scenario, start_m: Array, speeds: SpeedSet, seed: ArrayLike) -> Strategy:
    """Return the pursuer's strategy.

    Args:
        scenario: Policy, course and gain.
        start_m: Starts, (..., 3), m.
        speeds: Speed set with numbers of shape (...), m/s.
        seed: Shape (...), one for each row.
    """
    course = _course(scenario.pursuer, scenario, start_m, speeds, seed, PURSUER_STREAM)
    return Strategy(scenario.pursuer.policy, course, scenario.pursuer.navigation_gain)


def evader_strategy(scenario: Scenario, start_m: Array, speed_m_s: float | Array, seed: ArrayLike) -> Strategy:
    """Return the evader's strategy.

    Args:
        scenario: Policy and course.
        start_m: Starts, (..., 3), m.
        speed_m_s: Shape (...), one for each row.
        seed: Shape (...), one for each row.
    """
    course = _course(scenario.evader, scenario, start_m, Ball(speed_m_s), seed, EVADER_STREAM)
    return Strategy(scenario.evader.policy, course)


def _course(
    player: Player, scenario: Scenario, start_m: Array, speeds: SpeedSet, seed: ArrayLike, stream: int
) -> Course | None:
    match player.policy:
        case "waypoints":
            points = np.array([(*point, 0.0)[:3] for point in player.waypoints_m])
            return waypoints(start_m, points, speeds)
        case "random_turns":
            return random_turns(
                start_m,
                speeds.horizontal_m_s,
                seed,
                stream=stream,
                every_s=player.turn_every_s,
                max_turn_rad=np.deg2rad(player.turn_most_deg),
                duration_s=scenario.time_limit_s,
            )
        case "recorded":
            return recorded(start_m, player.track)
    return None
