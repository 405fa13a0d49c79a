"""The pilot of the mocked evader, a ground vehicle that this process commands over MAVLink."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from guidance.autopilots import ROVER, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HOME_POSITION
from guidance.frames import STILL, Enu, GameFrame, ned_from_game
from guidance.game import Ball
from guidance.links.port import VehicleLink
from guidance.messages import Heartbeat, Home, LocalPosition, Origin, Setpoint
from guidance.sim.batch import game, policy_for, site, target_game_m
from guidance.sim.scenario import EVADER, Scenario
from guidance.strategies import StrategyMemory, evade
from guidance.vehicle import VehicleState, local_frame, observe

if TYPE_CHECKING:
    from guidance.game.arrays import FloatArray

_REPEAT_S = 1.0


class EvaderPilot:
    """Prepares the evader's vehicle, waits for the game, and plays it.

    Args:
        link: To the vehicle.
        scenario: Its game, its policy and its place.

    Attributes:
        ready: Whether it is armed, in GUIDED, and its position is known.
        position_game_m: Its position in the game frame from its own telemetry, None until known.
    """

    def __init__(self, link: VehicleLink, scenario: Scenario) -> None:
        self.link = link
        self._game = game(scenario)
        self._site = site(scenario)
        target = target_game_m(scenario)
        self._target_m = None if target is None else np.array(target)
        start_m = np.array((*scenario.evader.position_m, 0.0))
        speeds = Ball(scenario.evader.speed_m_s)
        self._policy = policy_for(scenario, EVADER, start_m, speeds, scenario.seed)
        self._began_s = math.inf
        self._seen: tuple[float, FloatArray] = (-math.inf, np.zeros(3))
        self._last_m_s: FloatArray = np.zeros(3)
        self._requested_s = -math.inf
        self._stood_s = -math.inf
        self.vehicle = VehicleState()
        self.ready = False
        self.position_game_m: Enu | None = None
        self._placed: tuple[Home | None, Origin | None, GameFrame | None] = (None, None, None)

    def step(self, now_s: float, pursuers_game_m: Sequence[Enu], *, playing: bool) -> None:
        """Run one cycle: receive, then prepare the vehicle, play against the nearest pursuer, or stand still."""
        self.vehicle = observe(self.vehicle, self.link.receive())
        home = self.vehicle.latest.get(Home)
        origin = self.vehicle.latest.get(Origin)
        if (home, origin) != self._placed[:2]:
            frame = local_frame(self.vehicle, ROVER.projection)
            self._placed = (
                home,
                origin,
                None if frame is None else GameFrame(frame.ned_from_wgs84(*self._site)),
            )
        local = self.vehicle.latest.get(LocalPosition)
        game_frame = self._placed[2]
        position = self.position_game_m = (
            None
            if game_frame is None or local is None
            else game_frame.position_from_ned(local.position_ned_m)
        )
        beat = self.vehicle.latest.get(Heartbeat)
        guided = (
            beat is not None and beat.armed and beat.custom_mode == ROVER.custom_modes[Mode.GUIDED]
        )
        self.ready = guided and position is not None
        if not guided or position is None:
            if now_s - self._requested_s >= _REPEAT_S:
                self._requested_s = now_s
                requests = map(ROVER.request_message, (HOME_POSITION, GPS_GLOBAL_ORIGIN))
                for request in (
                    *ROVER.stream_requests(),
                    *requests,
                    ROVER.set_mode(Mode.GUIDED),
                    ROVER.arm(),
                ):
                    self.link.request(request)
        elif playing and pursuers_game_m:
            self._began_s = min(self._began_s, now_s)
            P = np.array(min(pursuers_game_m, key=lambda pursuer: math.dist(pursuer, position)))
            E = np.array((*position[:2], 0.0))
            # The pursuer's velocity, from its place in the cycle before; only a user's policy uses it.
            seen_s, seen_m = self._seen
            self._seen = (now_s, P)
            passed_s = now_s - seen_s
            seen_m_s = np.zeros(3)
            if 0.0 < passed_s < _REPEAT_S:
                seen_m_s = (P - seen_m) / passed_s
            memory = StrategyMemory(seen_m_s, now_s - self._began_s)
            asked_m_s = evade(
                self._policy,
                self._game,
                P,
                E,
                self._target_m,
                memory,
                last_m_s=self._last_m_s,
            )
            # Without an answer of its policy the evader stands still, and the pursuer's flight continues
            self._last_m_s = np.where(np.isfinite(asked_m_s), asked_m_s, 0.0)
            x, y, _ = self._last_m_s.tolist()
            self.link.send_setpoint(Setpoint(ned_from_game(Enu((x, y, 0.0)))))
            self._stood_s = -math.inf
        elif now_s - self._stood_s >= _REPEAT_S:
            self._stood_s = now_s
            self.link.send_setpoint(Setpoint(STILL))

    def stop(self) -> None:
        """Disarm the vehicle."""
        self.link.request(ROVER.disarm())
