"""Plays the games of `tests.harness.guarded` without autopilot, links and noise: fifty times faster than in the mock.

The vehicle has just the acceleration that its autopilot's description guarantees, behind a delay and a lag. It flies
what the certificate of each step says, and brakes at the disc.
"""

import copy
import math
from collections import deque
from typing import Final, NamedTuple

from guidance.control.follow import approach, gaps_to_disc
from guidance.cycle import Capability, Certified, CycleSettings, Players, certify, game_played
from guidance.cycle.monitor import GUARDED_S, LASTING_S
from guidance.frames import Enu, game_from_ned, ned_from_game
from guidance.game import Winner
from guidance.game.arrays import FLOATS
from guidance.game.meeting_times import catch_in_ball
from tests.harness.guarded import LONGEST_S, Drawn, Guarded, Point, cycle_settings

STEP_S: Final = 0.1
DELAYED_STEPS: Final = 1
LAG_S: Final = 0.3
AGE_S: Final = 0.05


class State(NamedTuple):
    """Positions and velocities of a vehicle and an evader, game frame, m and m/s."""

    pursuer_m: Enu
    pursuer_m_s: Enu
    evader_m: Enu
    evader_m_s: Enu
    target_m: Enu | None


class Referee:
    """A game step by step. The evader's velocity is given for every step.

    Args:
        settings: Of the cycle.
        pursuer_m: Start of the vehicle, which hovers.
        evader_m: Start of the evader.
    """

    def __init__(self, settings: CycleSettings, pursuer_m: Enu, evader_m: Point) -> None:
        self.now_s = 0.0
        self._settings = settings
        self._before_m_s: Enu | None = None
        self._shown_m_s = 0.0
        still = Enu((0.0, 0.0, 0.0))
        self.commands = deque([still] * DELAYED_STEPS)
        self.state = State(
            Enu(pursuer_m), still, Enu((*evader_m, 0.0)), still, settings.target_game_m
        )

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
        certified = certify(game, players, vehicle, self._before_m_s)
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
            target_m = _moved(target_m, Enu((*self._settings.game.target_velocity_m_s, 0.0)))
        evader_3d_m_s = Enu((*evader_m_s, 0.0))
        self.state = State(
            _moved(state.pursuer_m, velocity_m_s),
            velocity_m_s,
            _moved(state.evader_m, evader_3d_m_s),
            evader_3d_m_s,
            target_m,
        )
        self.now_s += STEP_S

    def _accelerated(self, command_m_s: Enu) -> Enu:
        """Return the vehicle's velocity one step later."""
        most = self._settings.handling.acceleration
        share = STEP_S / LAG_S
        x_m_s, y_m_s, z_m_s = self.state.pursuer_m_s
        x = share * (command_m_s[0] - x_m_s)
        y = share * (command_m_s[1] - y_m_s)
        down = command_m_s[2] * most.descent_share if command_m_s[2] < 0.0 else command_m_s[2]
        z = share * (down - z_m_s)
        size = math.hypot(x, y)
        if size > most.ground_m_s2 * STEP_S:
            x *= most.ground_m_s2 * STEP_S / size
            y *= most.ground_m_s2 * STEP_S / size
        steep = most.vertical_m_s2 * STEP_S
        return Enu((x_m_s + x, y_m_s + y, z_m_s + min(steep, max(-steep, z))))


def _moved(place_m: Enu, velocity_m_s: Enu) -> Enu:
    return place_m + velocity_m_s * STEP_S


class Played(NamedTuple):
    """The result of a game, and copies of the game, one for each step."""

    result: Guarded
    states: list[Referee]


def referee(drawn: Drawn) -> Played:
    """Play a game to its end."""
    settings = cycle_settings(drawn.setup)
    game = Referee(settings, Enu(drawn.setup.start_m), drawn.evader_m)
    course = list(drawn.course_m)
    speed_m_s = float(settings.game.evader_speed_m_s)
    end = "undecided"
    margin_s = math.nan
    claimed_s = math.nan
    sustained_s = math.nan
    since_s = math.inf
    states = []
    while end == "undecided" and game.now_s < LONGEST_S:
        states.append(game.copy())
        certified = game.certify()
        certificate = certified.certificate
        margin_s = certificate.margin_s if math.isnan(margin_s) else margin_s
        claims = certificate.vehicle_winner == Winner.PURSUER
        since_s = min(since_s, game.now_s) if claims else math.inf
        if certificate.captured:
            end = "captured"
        elif certificate.evader_arrived:
            end = "arrived"
        if math.isnan(claimed_s) and game.now_s - since_s >= LASTING_S:
            claimed_s = game.now_s
        if math.isnan(sustained_s) and game.now_s - since_s >= GUARDED_S:
            sustained_s = game.now_s
        game.step(runs(game.state, course, certified, speed_m_s, drawn.setup.aim.velocity_m_s))
    result = Guarded(end, game.now_s, margin_s, claimed_s, sustained_s, sustained_s)
    return Played(result, states)


def runs(
    state: State,
    course: list[Point],
    certified: Certified,
    speed_m_s: float,
    target_m_s: Point,
) -> Point:
    """Return the evader's velocity on its course; without one, to the game's meeting point."""
    here = state.evader_m[:2]
    while len(course) > 1 and math.dist(course[0], here) < 0.2:
        del course[0]
    east_m, north_m, _ = certified.solution.meeting_point_m
    if course:
        east_m, north_m = course[0]
    if len(course) == 1 and state.target_m is not None:
        to_target_m = (
            state.target_m[0] + east_m - here[0],
            state.target_m[1] + north_m - here[1],
        )
        meeting_s = catch_in_ball(FLOATS, speed_m_s, 0.0, to_target_m, target_m_s, 0.0)
        east_m = here[0] + to_target_m[0] + target_m_s[0] * meeting_s
        north_m = here[1] + to_target_m[1] + target_m_s[1] * meeting_s
    away_m = math.dist((east_m, north_m), here)
    pace = min(speed_m_s, away_m / STEP_S) / away_m if away_m > 0.0 else 0.0
    return (pace * (east_m - here[0]), pace * (north_m - here[1]))
