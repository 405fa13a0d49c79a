"""Cycles with old information and with a moving target: the game that is played, and its certificate."""

import math
from dataclasses import replace

import numpy as np
import pytest

from guidance.config import parse_document
from guidance.control import Situation
from guidance.control.braking_law import measure_walls
from guidance.cycle import CycleInputs, CycleMemory, MonitorMemory, Violation, play, watch
from guidance.cycle.section import GameSection
from guidance.errors import ConfigError
from guidance.estimation import EvaderEstimate
from guidance.frames import Enu, GameFrame, Ned
from guidance.game import Game, Reason, StandOff, solve
from guidance.strategies import StrategyMemory
from tests.flight.scenes import CYCLE

PURSUER_NED = (-30.0, 5.0, -20.0)
EVADER_NED = (10.0, -4.0, 0.0)


def cycle(age_s=0.1, *, settings=CYCLE, played_s=0.0, at=EVADER_NED):
    evader = EvaderEstimate(Ned(at), Ned((1.0, 2.0, 0.0)), 3.0, age_s)
    here = Situation(
        Ned(PURSUER_NED), Ned((0.0, 0.0, 0.0)), 0.0, evader.position_ned_m, evader.velocity_ned_m_s
    )
    inputs = CycleInputs(
        0.02, here, measure_walls(here, settings.envelope), evader, GameFrame(Ned((0.0, 0.0, 0.0)))
    )
    return play(inputs, settings, CycleMemory(policy=StrategyMemory(None, played_s))).certificate


def in_game(ned):
    return np.array([ned[1], ned[0], -ned[2]])


def test_information_older_than_the_guarantee_is_said_and_taken_for_new():
    """The disc of 3 m is guaranteed for a second against 3 m/s."""
    P = in_game(PURSUER_NED)
    E = in_game(EVADER_NED)
    for age_s, reason, taken_s in (
        (0.99, Reason.SOLVED, 0.99),
        (1.01, Reason.TOO_OLD, 0.0),
        (9.0, Reason.TOO_OLD, 0.0),
    ):
        said = cycle(age_s)
        assert said.reason == reason
        game = Game(
            CYCLE.game.pursuer, 3.0, standoff=CYCLE.game.standoff, information_age_s=taken_s
        )
        assert said.value == pytest.approx(float(solve(game, P, E).value), rel=1e-12)


def test_in_tad_the_disc_is_smaller_by_what_the_evader_may_have_run():
    """Against 3 m/s a disc of 3 m shrinks to a point in one second."""
    settings = replace(CYCLE, target_game_m=Enu((40.0, 10.0, 0.0)))
    P = in_game(PURSUER_NED)
    E = in_game(EVADER_NED)
    T = np.array([40.0, 10.0, 0.0])
    for age_s, reason, radius_m in (
        (0.0, Reason.SOLVED, 3.0),
        (0.4, Reason.SOLVED, 1.8),
        (1.4, Reason.TOO_OLD, 0.0),
    ):
        said = cycle(age_s, settings=settings)
        assert said.reason == reason
        game = Game(
            CYCLE.game.pursuer, 3.0, standoff=StandOff(radius_m, CYCLE.game.standoff.height_m)
        )
        assert said.value == pytest.approx(float(solve(game, P, E, T).value), rel=1e-12)


def test_what_is_not_guaranteed_is_not_watched():
    said = cycle(0.5)
    guarantee = MonitorMemory()
    alarm = None
    for index in range(200):
        worse = said._replace(
            value=said.value + 0.1 * index, time_needed_s=said.time_needed_s + 0.1 * index
        )
        old = worse._replace(reason=int(Reason.TOO_OLD))
        guarantee, alarm = watch(
            guarantee, 0.1 * index, old, with_target=False, speed_m_s=6.0, slack_s=0.5
        )
        assert alarm is None
        assert math.isnan(guarantee.best)
    for reason, expected in (
        (Reason.TOO_OLD, {None}),
        (Reason.SOLVED, {None, Violation.BARRIER_LOST}),
    ):
        guarantee = MonitorMemory(lost=False)
        found = set()
        for index in range(50):
            lost = said._replace(winner=-1, reason=int(reason))
            guarantee, alarm = watch(
                guarantee, 0.1 * index, lost, with_target=True, speed_m_s=6.0, slack_s=0.5
            )
            found.add(alarm and alarm.violation)
        assert found == expected


def test_a_target_that_moves_is_where_it_is_by_now_and_the_game_knows_its_velocity():
    settings = replace(
        CYCLE,
        target_game_m=Enu((40.0, 10.0, 0.0)),
        game=replace(CYCLE.game, target_velocity_m_s=(1.0, -0.5)),
    )
    P = in_game(PURSUER_NED)
    E = in_game(EVADER_NED)
    disc = StandOff(CYCLE.game.standoff.radius_m - 0.1 * 3.0, CYCLE.game.standoff.height_m)
    game = Game(CYCLE.game.pursuer, 3.0, standoff=disc, target_velocity_m_s=(1.0, -0.5))
    for played_s in (0.0, 12.0):
        T = np.array([40.0 + played_s, 10.0 - 0.5 * played_s, 0.0])
        said = cycle(settings=settings, played_s=played_s)
        assert said.value == pytest.approx(float(solve(game, P, E, T).value), rel=1e-12)
    resting = replace(settings, game=CYCLE.game)
    assert cycle(settings=settings).value != pytest.approx(cycle(settings=resting).value, rel=1e-3)
    assert cycle(settings=settings, played_s=4.0, at=(8.0, 44.0, 0.0)).evader_arrived
    assert not cycle(settings=settings, played_s=0.0, at=(8.0, 44.0, 0.0)).evader_arrived


@pytest.mark.parametrize(
    ("kind", "velocity"), [("pe", [1.0, 0.0]), ("tad", [3.0, 0.0]), ("tad", [0.0, -5.0])]
)
def test_a_target_velocity_that_cannot_be_is_refused_by_name(kind, velocity):
    section = {
        "kind": kind,
        "speed_m_s": 6.0,
        "evader_speed_m_s": 3.0,
        "target_velocity_m_s": velocity,
        "target": {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 500.0},
    }
    if kind == "pe":
        del section["target"]
    with pytest.raises(ConfigError, match=r"game\.target_velocity_m_s = .*must be slower than"):
        parse_document(GameSection, section, source="a.toml")
