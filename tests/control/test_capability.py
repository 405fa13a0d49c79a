"""What a vehicle has shown that it can do: closed forms of the time to be somewhere, and the speed that it reaches."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control import SpeedMemory, observe_speed, time_to_stop_at

DT_S = 0.02
LIMITS = {"top_m_s": 6.0, "gaining_m_s2": 2.0, "braking_m_s2": 2.0}


def flown(speeds_m_s, asked_m_s=10.0, at_full_speed=True):
    """Fly along north at these speeds; return every memory."""
    memory, kept = SpeedMemory(), []
    for speed in speeds_m_s:
        memory = observe_speed(memory, (asked_m_s, 0.0, 0.0), (speed, 0.0, 0.0), at_full_speed=at_full_speed, dt_s=DT_S)
        kept.append(memory)
    return kept


@pytest.mark.parametrize(
    ("distance_m", "speed_m_s", "seconds"),
    [
        (0.0, 3.0, 0.0),
        (8.0, 0.0, 4.0),  # 2 s up to 4 m/s, 2 s down
        (18.0, 0.0, 6.0),  # 3 s up to 6 m/s, 3 s down
        (30.0, 0.0, 8.0),  # and 2 s at 6 m/s
        (9.0, 6.0, 3.0),  # braking only
        (4.0, -4.0, 2.0 + 4.0),  # 2 s to stop after 4 m, then 8 m from rest
    ],
)
def test_the_time_to_stop_somewhere_is_that_of_accelerating_cruising_and_braking(distance_m, speed_m_s, seconds):
    assert time_to_stop_at(distance_m, speed_m_s, **LIMITS) == pytest.approx(seconds)


@given(st.floats(0.0, 200.0), st.floats(0.0, 50.0), st.floats(0.0, 6.0))
def test_further_away_takes_longer(distance_m, more_m, speed_m_s):
    near, far = (time_to_stop_at(each, speed_m_s, **LIMITS) for each in (distance_m, distance_m + more_m))
    assert near <= far + 1e-9 or distance_m < speed_m_s**2 / 4.0  # it brakes longer than the distance


def test_a_vehicle_that_stays_below_its_command_has_reached_what_it_can():
    kept = flown([8.5] * 300)
    assert kept[10].share == 1.0
    assert kept[-1].share == pytest.approx(0.85, abs=0.01)
    assert kept[-1].shown.speed_m_s == pytest.approx(8.5, abs=0.01)


def test_a_vehicle_that_gains_speed_or_is_slowed_down_has_not():
    assert flown([0.03 * step for step in range(300)])[-1].share == 1.0
    assert flown([8.5] * 300, at_full_speed=False)[-1].share == 1.0
    assert flown([9.7] * 300)[-1].share == 1.0


def test_a_vehicle_that_flies_faster_later_is_believed():
    kept = flown([8.5] * 300 + [9.0] * 100 + [9.8] * 100)
    assert kept[390].share == pytest.approx(0.9, abs=0.01)
    assert kept[-1].share == 1.0
