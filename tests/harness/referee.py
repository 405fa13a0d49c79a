"""Plays the games of `tests.harness.guarded` without autopilot, links and noise: fifty times faster than in the mock.

The vehicle has just the acceleration that its autopilot's description guarantees, behind a delay and a lag. It flies
what the certificate of each step says, and brakes at the disc. The evader is any function of the state (`Evader`).
"""

import copy
import math
from collections import deque
from collections.abc import Sequence
from time import process_time
from typing import Final, NamedTuple

from guidance.control.follow import approach, gaps_to_disc
from guidance.cycle import Capability, Certified, CycleSettings, Players, certify, game_played
from guidance.cycle.circling import Circling
from guidance.cycle.monitor import GUARDED_S, LASTING_S
from guidance.frames import Enu, game_from_ned, ned_from_game
from guidance.game import Extent, Winner
from guidance.game.arrays import FLOATS
from guidance.game.meeting_times import catch_in_ball
from tests.harness.guarded import (
    LONGEST_S,
    Drawn,
    Evader,
    GameState,
    Guarded,
    Point,
    cycle_settings,
)

STEP_S: Final = 0.1
DELAY_S: Final = 0.1
LAG_S: Final = 0.3
AGE_S: Final = 0.05


class Referee:
    """A game step by step. The evader's velocity is given for every step.

    Args:
        settings: Of the cycle.
        pursuer_m: Start of the vehicle, which hovers.
        evader_m: Start of the evader.
        step_s: Duration of a step.
    """

    def __init__(
        self, settings: CycleSettings, pursuer_m: Enu, evader_m: Point, step_s: float = STEP_S
    ) -> None:
        self.now_s = 0.0
        self.step_s = step_s
        self._settings = settings
        self._before_m_s: Enu | None = None
        self._circling = Circling()
        self._shown_m_s = 0.0
        still = Enu((0.0, 0.0, 0.0))
        self.commands = deque([still] * round(DELAY_S / step_s))
        self.state = GameState(
            Enu(pursuer_m), still, Enu((*evader_m, 0.0)), still, settings.target_game_m
        )

    @property
    def target_extent(self) -> Extent:
        """Shape of the target."""
        return self._settings.game.target_extent

    def copy(self) -> "Referee":
        """Return a game that goes on from here by itself."""
        other = copy.copy(self)
        other.commands = self.commands.copy()
        return other

    def certify(self) -> Certified:
        """Certify the present state."""
        settings = self._settings
        state = self.state
        evader_speed_m_s = float(settings.game.evader_speed_m_s)
        game = game_played(settings, evader_speed_m_s, AGE_S).game
        gaps = gaps_to_disc(
            ned_from_game(Enu(state.pursuer_m)),
            ned_from_game(state.evader_m),
            settings.game.standoff,
        )
        players = Players(*state, gaps, AGE_S)
        vehicle = Capability(
            settings.handling.acceleration,
            settings.envelope,
            settings.handling.approach,
            self._shown_m_s,
            settings.tolerance_m,
        )
        certified = certify(
            game, players, vehicle, self._before_m_s, self._circling, dt_s=self.step_s
        )
        self._circling = certified.circling
        self._before_m_s = Enu(certified.solution.pursuer_velocity_m_s)
        command_ned_m_s, _ = approach(
            ned_from_game(certified.velocity_m_s),
            ned_from_game(state.pursuer_m_s),
            ned_from_game(state.evader_m_s),
            gaps,
            settings.handling.approach,
        )
        self.commands.append(game_from_ned(command_ned_m_s))
        return certified

    def step(self, evader_m_s: Point) -> None:
        """Move both for one step."""
        state = self.state
        velocity_m_s = self._accelerated(self.commands.popleft())
        self._shown_m_s = max(self._shown_m_s, math.hypot(*velocity_m_s[:2]))
        target_m = state.target_m
        if target_m is not None:
            target_m += Enu((*self._settings.game.target_velocity_m_s, 0.0)) * self.step_s
        evader_3d_m_s = Enu((*evader_m_s, 0.0))
        self.state = GameState(
            state.pursuer_m + velocity_m_s * self.step_s,
            velocity_m_s,
            state.evader_m + evader_3d_m_s * self.step_s,
            evader_3d_m_s,
            target_m,
        )
        self.now_s += self.step_s

    def _accelerated(self, command_m_s: Enu) -> Enu:
        """Return the vehicle's velocity one step later."""
        most = self._settings.handling.acceleration
        share = self.step_s / LAG_S
        x_m_s, y_m_s, z_m_s = self.state.pursuer_m_s
        x = share * (command_m_s[0] - x_m_s)
        y = share * (command_m_s[1] - y_m_s)
        down = command_m_s[2] * most.descent_share if command_m_s[2] < 0.0 else command_m_s[2]
        z = share * (down - z_m_s)
        size = math.hypot(x, y)
        if size > most.ground_m_s2 * self.step_s:
            x *= most.ground_m_s2 * self.step_s / size
            y *= most.ground_m_s2 * self.step_s / size
        steep = most.vertical_m_s2 * self.step_s
        return Enu((x_m_s + x, y_m_s + y, z_m_s + min(steep, max(-steep, z))))


class Played(NamedTuple):
    """The result of a game.

    Attributes:
        result: How it ended, and the verdicts.
        states: Copies of the game, one for each step.
        largest_fall_s: Largest fall of the vehicle's margin from one step to the next.
        certify_s: Processor time of a certificate, mean.
        final_m: Distance of the evader from the target at the end.
    """

    result: Guarded
    states: list[Referee]
    largest_fall_s: float
    certify_s: float
    final_m: float


def referee(drawn: Drawn, evader: Evader | None = None, step_s: float = STEP_S) -> Played:
    """Play a drawn game to its end, against its own evader or another one."""
    settings = cycle_settings(drawn.setup)
    game = Referee(settings, Enu(drawn.setup.start_m), drawn.evader_m, step_s)
    return play_out(game, evader or on_course(drawn, drawn.course_m, step_s))


def play_out(game: Referee, evader: Evader) -> Played:
    """Play a game to its end, at most `LONGEST_S` from now."""
    until_s = game.now_s + LONGEST_S
    end = "undecided"
    margin_s = math.nan
    claimed_s = math.nan
    sustained_s = math.nan
    since_s = math.inf
    before_s = -math.inf
    fall_s = 0.0
    spent_s = 0.0
    states = []
    while end == "undecided" and game.now_s < until_s:
        states.append(game.copy())
        began_s = process_time()
        certified = game.certify()
        spent_s += process_time() - began_s
        certificate = certified.certificate
        margin_s = certificate.margin_s if math.isnan(margin_s) else margin_s
        claims = certificate.vehicle_winner == Winner.PURSUER
        since_s = min(since_s, game.now_s) if claims else math.inf
        if certificate.captured:
            end = "captured"
        elif certificate.evader_arrived:
            end = "arrived"
        else:
            fall_s = max(fall_s, before_s - certificate.vehicle_margin_s)
            before_s = certificate.vehicle_margin_s
        if math.isnan(claimed_s) and game.now_s - since_s >= LASTING_S:
            claimed_s = game.now_s
        if math.isnan(sustained_s) and game.now_s - since_s >= GUARDED_S:
            sustained_s = game.now_s
        if end == "undecided":
            meeting_m = Enu(certified.solution.meeting_point_m)
            game.step(evader(game.state, game.now_s, meeting_m))
    result = Guarded(end, game.now_s, margin_s, claimed_s, sustained_s, sustained_s)
    target_m = game.state.target_m or Enu((math.nan, math.nan, math.nan))
    final_m = game.target_extent.distance_m(target_m, game.state.evader_m)
    return Played(result, states, fall_s, spent_s / len(states), final_m)


def on_course(drawn: Drawn, course_m: Sequence[Point], step_s: float) -> Evader:
    """Return an evader that runs through places, the last one a point of the target; without any, optimally."""
    course = list(course_m)
    speed_m_s = float(cycle_settings(drawn.setup).game.evader_speed_m_s)
    target_m_s = drawn.setup.aim.velocity_m_s

    def velocity(state: GameState, _now_s: float, meeting_m: Enu) -> Point:
        here = state.evader_m[:2]
        while len(course) > 1 and math.dist(course[0], here) < 0.2:
            del course[0]
        if len(course) == 1:
            return towards(state, course[0], speed_m_s, target_m_s)
        east_m, north_m = course[0] if course else meeting_m[:2]
        away_m = math.dist((east_m, north_m), here)
        pace = min(speed_m_s, away_m / step_s) / away_m if away_m > 0.0 else 0.0
        return (pace * (east_m - here[0]), pace * (north_m - here[1]))

    return velocity


def towards(state: GameState, goal_m: Point, speed_m_s: float, target_m_s: Point) -> Point:
    """Return the velocity to a point that moves with the target, given from the target's position; none when there."""
    x_m, y_m, _ = state.evader_m
    target_m = state.target_m or Enu((math.nan, math.nan, math.nan))
    way_m = (target_m[0] + goal_m[0] - x_m, target_m[1] + goal_m[1] - y_m)
    time_s = catch_in_ball(FLOATS, speed_m_s, 0.0, way_m, target_m_s, 0.0)
    x = way_m[0] + target_m_s[0] * time_s
    y = way_m[1] + target_m_s[1] * time_s
    away_m = math.hypot(x, y)
    if away_m == 0.0:
        return target_m_s
    return (speed_m_s * x / away_m, speed_m_s * y / away_m)
