"""The vehicle's verdict beside the ideal game's: closed forms, and what makes it stricter."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.certificate import Players, Vehicle, certify
from guidance.control import Acceleration
from guidance.control.follow import gaps_to_disc
from guidance.frames import ned_from_game
from guidance.game import Cylinder, Game, StandOff, Winner
from tests.control.scenes import MULTICOPTER as ENVELOPE

GAME = Game(Cylinder(6.0, 3.0, 1.5), 3.0, standoff=StandOff(3.0, 5.0))
ACCELERATION = Acceleration(3.0, 2.0)
TARGET = (0.0, 0.0, 0.0)
FULL = Vehicle(ACCELERATION, ENVELOPE, 6.0)

lengths = st.floats(-80.0, 80.0)
speeds = st.floats(-4.0, 4.0)


def certified(
    pursuer_m, pursuer_m_s, evader_m, evader_m_s=(0.0, 0.0, 0.0), *, vehicle=FULL, target_m=TARGET, age_s=0.0
):
    gaps = gaps_to_disc(ned_from_game(pursuer_m), ned_from_game(evader_m), GAME.standoff)
    players = Players(pursuer_m, pursuer_m_s, evader_m, evader_m_s, target_m)
    return certify(GAME, players, vehicle, gaps, None, evader_age_s=age_s, tolerance_m=0.5)[1]


@given(lengths, lengths, st.floats(5.0, 40.0), lengths, lengths, speeds, speeds, speeds)
def test_the_vehicle_never_does_better_than_the_ideal_pursuer(x, y, z, e_x, e_y, v_x, v_y, v_z):
    says = certified((x, y, z), (v_x, v_y, v_z), (e_x, e_y, 0.0))
    assert not says.vehicle_margin_s > says.margin_s
    assert says.allowance >= -1e-9
    if says.vehicle_winner == Winner.PURSUER and not says.captured:
        assert says.winner == Winner.PURSUER


def test_at_full_speed_only_reacting_and_braking_are_subtracted():
    # Both run along x, the evader to the target at 0: they close at 6 - 3 m/s.
    says = certified((-60.0, 0.0, 5.0), (6.0, 0.0, 0.0), (-50.0, 0.0, 0.0), (3.0, 0.0, 0.0))
    braking_s = (6.0 - 3.0) / (2.0 * ENVELOPE.braking_m_s2)
    assert says.vehicle_margin_s == pytest.approx(says.margin_s - ENVELOPE.reaction_s - braking_s, abs=0.01)


def test_a_speed_that_was_not_flown_yet_is_counted_on_in_part_only():
    shown, new = (
        certified((-60.0, 0.0, 5.0), (6.0, 0.0, 0.0), (-50.0, 0.0, 0.0), vehicle=FULL._replace(shown_m_s=speed_m_s))
        for speed_m_s in (6.0, 0.0)
    )
    assert shown.vehicle_margin_s - new.vehicle_margin_s == pytest.approx(57.0 / (0.8 * 6.0) - 57.0 / 6.0, abs=0.3)


def test_a_vehicle_in_hover_may_lose_what_the_ideal_pursuer_wins():
    says = certified((-20.0, 0.0, 5.0), (0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (-3.0, 0.0, 0.0))
    assert (says.winner, says.vehicle_winner) == (Winner.PURSUER, Winner.UNDECIDED)


@pytest.mark.parametrize(
    ("height_m", "evader_m", "target_m", "winner"),
    [
        (5.0, 18.0, 6.0, Winner.PURSUER),  # at the disc's height, it captures an evader that comes
        (6.5, 18.0, 6.0, Winner.UNDECIDED),  # too high for that, it flies past and has to turn round
        (6.5, 18.0, -90.0, Winner.UNDECIDED),  # and could not stop before the rim
        (9.0, 30.0, -90.0, Winner.PURSUER),  # it can stop, and has enough time to turn
    ],
)
def test_an_evader_may_pass_below_a_vehicle_that_is_too_high(height_m, evader_m, target_m, winner):
    says = certified((11.0, 0.0, height_m), (6.0, 0.0, 0.0), (evader_m, 0.0, 0.0), target_m=(target_m, 0.0, 0.0))
    assert (says.winner, says.vehicle_winner) == (Winner.PURSUER, winner)


def test_a_captured_evader_has_lost_and_has_not_arrived():
    says = certified((3.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.2, 0.0, 0.0))
    assert (says.captured, says.evader_arrived, says.vehicle_winner) == (True, False, Winner.PURSUER)


def test_without_a_target_the_pursuer_wins_and_no_distance_is_assured():
    says = certified((0.0, 0.0, 20.0), (0.0, 0.0, 0.0), (0.0, 60.0, 0.0), target_m=None)
    assert says.vehicle_winner == Winner.PURSUER
    assert math.isnan(says.assured_distance_m)
    assert says.time_needed_s == pytest.approx(says.value + says.allowance)
