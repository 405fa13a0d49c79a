"""An evader that circles: its predicted path, when a pursuit counts as late, and that it is captured as promised."""

import math
from dataclasses import replace
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.cycle import ChosenCourse
from guidance.cycle.circling import LATE_M, LATE_PURSUIT_S, Circling
from guidance.frames import Enu
from guidance.game import Cylinder, Game, StandOff
from tests.harness.guarded import SETUPS, Setup, cycle_settings
from tests.harness.referee import Referee
from tests.test_certificate import FULL

GAME = Game(Cylinder(6.0, 3.0, 1.5), 4.0, standoff=StandOff(3.0, 5.0))
DT_S = 0.02
EVADER_M = Enu((3.0, -2.0, 0.0))


def observed(rate_rad_s, needed_s=lambda _now_s: 10.0, lasting_s=12.0, speed_m_s=4.0):
    """Observe an evader that turns at this rate."""
    memory = Circling()
    for step in range(round(lasting_s / DT_S)):
        heading = rate_rad_s * step * DT_S
        velocity = Enu((speed_m_s * math.cos(heading), speed_m_s * math.sin(heading), 0.0))
        memory = memory.after(velocity, needed_s(step * DT_S), DT_S)
    return memory


@given(st.floats(-1.5, 1.5), st.floats(0.0, 15.0))
def test_the_predicted_path_is_that_of_the_turn_at_its_speed(rate_rad_s, after_s):
    memory = observed(rate_rad_s, lasting_s=2.0)
    assert memory.turn_rad_s == pytest.approx(rate_rad_s, abs=1e-9)
    step_s = 1e-4
    here = memory.place_m(EVADER_M, after_s)
    moved = memory.place_m(EVADER_M, after_s + step_s) - here
    heading = math.atan2(memory.evader_m_s.north, memory.evader_m_s.east) + rate_rad_s * after_s
    assert moved.east == pytest.approx(4.0 * step_s * math.cos(heading), abs=1e-6)
    assert moved.north == pytest.approx(4.0 * step_s * math.sin(heading), abs=1e-6)
    assert memory.place_m(EVADER_M, 0.0) == EVADER_M


@given(st.floats(-0.2, 0.2), st.floats(0.0, 60.0))
def test_an_evader_that_the_vehicle_can_follow_is_pursued_unchanged_however_late(
    rate_rad_s, late_s
):
    memory = observed(rate_rad_s, needed_s=lambda now_s: 10.0 + late_s * (now_s > 5.0))
    assert memory.share(GAME, FULL) == 0.0
    assert memory.detour_s(GAME, FULL) == 0.0


@given(st.floats(0.6, 1.5))
def test_a_pursuit_whose_promise_falls_as_time_passes_is_not_late(rate_rad_s):
    memory = observed(rate_rad_s, needed_s=lambda now_s: 30.0 - now_s)
    assert memory.late_s < LATE_PURSUIT_S
    assert memory.share(GAME, FULL) == 0.0


def test_a_pursuit_whose_promise_stands_still_cuts_more_and_more():
    shares = [
        observed(0.8, needed_s=lambda _now_s: 8.0, lasting_s=lasting_s).share(GAME, FULL)
        for lasting_s in (1.0, 2.0, 2.5, 3.0, 6.0)
    ]
    assert shares[0] == 0.0
    assert 0.0 < shares[2] < 1.0
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_delay_is_forgiven_while_the_promise_falls_again():
    memory = observed(0.8, lasting_s=20.0)
    least_late_s = LATE_PURSUIT_S + LATE_M / 2.0
    assert memory.late_s > least_late_s
    for step in range(round(30.0 / DT_S)):
        memory = memory.after(Enu((4.0, 0.0, 0.0)), 40.0 - step * DT_S, DT_S)
    assert memory.late_s < least_late_s


def circled(setup, radius_m, away_m, height_m):
    """Chase an evader on a circle; return when it is captured, what is promised after one round, and the courses."""
    cycle = replace(cycle_settings(setup), target_game_m=None)
    game = Referee(cycle, Enu((0.0, 0.0, height_m)), (0.0, away_m))
    speed_m_s = float(cycle.game.evader_speed_m_s)
    rate_rad_s = speed_m_s / radius_m
    promised_s = math.nan
    courses = set()
    while game.now_s < 90.0:
        certified = game.certify()
        certificate = certified.certificate
        courses.add(certified.course)
        if certificate.captured:
            break
        if math.isnan(promised_s) and game.now_s >= 2.0 * math.pi / rate_rad_s:
            promised_s = game.now_s + certificate.time_needed_s + certificate.allowance
        heading = rate_rad_s * game.now_s
        game.step((speed_m_s * math.cos(heading), speed_m_s * math.sin(heading)))
    return game.now_s, promised_s, courses


@pytest.mark.parametrize("number", range(12))
def test_an_evader_on_a_circle_is_captured_within_the_promise_after_one_round(number):
    draw = Random(f"circles/{number}")
    radius_m = draw.uniform(4.0, 12.0)
    captured_s, promised_s, _ = circled(
        SETUPS[number % len(SETUPS)], radius_m, draw.uniform(15.0, 60.0), draw.uniform(8.0, 20.0)
    )
    assert captured_s < 60.0
    assert math.isnan(promised_s) or captured_s <= promised_s


@pytest.mark.parametrize(
    ("speeds_m_s", "radius_m", "away_m", "height_m"),
    [((7.0, 6.0), 9.6, 53.0, 17.0), ((7.0, 5.0), 10.7, 28.0, 16.0)],
)
def test_a_vehicle_that_missed_once_goes_on_cutting_the_circle(
    speeds_m_s, radius_m, away_m, height_m
):
    # It turned back after each miss, pursued until it was late again, and was never there in time.
    setup = Setup("arducopter", speeds_m_s, (0.0, 0.0, 20.0))
    captured_s, _, _ = circled(setup, radius_m, away_m, height_m)
    assert captured_s < 25.0


def test_an_evader_that_reverses_does_not_circle():
    memory = observed(0.0, lasting_s=2.0)
    memory = memory.after(Enu((-4.0, 0.1, 0.0)), 20.0, DT_S)
    assert memory.late_s > LATE_PURSUIT_S
    assert memory.share(GAME, FULL) == 0.0
    assert memory.detour_s(GAME, FULL) == 0.0


def test_a_circle_that_pursuit_never_ends_on_is_cut():
    courses = set()
    for radius_m in (4.0, 6.0, 8.0):
        _, _, flown = circled(SETUPS[10], radius_m, 18.0, 9.0)
        courses |= flown
    assert ChosenCourse.CUTTING in courses
