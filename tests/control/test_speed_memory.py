"""What a vehicle has shown that it can do: closed forms of the time to be somewhere, and the speed that it reaches."""

import pytest

from guidance.control.servo import SpeedMemory, observe_speed
from guidance.frames import Ned

DT_S = 0.02


def flown(
    speeds_m_s, asked_m_s=10.0, at_full_speed=True, guided=lambda _number: True, down_m_s=None
):
    """Fly along north at these speeds, with a HEARTBEAT every second; return every memory."""
    memory = SpeedMemory()
    kept = []
    for number, speed in enumerate(speeds_m_s):
        memory = observe_speed(
            memory,
            Ned((asked_m_s, 0.0, 0.0)),
            Ned((speed, 0.0, down_m_s[number] if down_m_s else 0.0)),
            unslowed=at_full_speed,
            guided=number % 50 == 49 and guided(number),
            dt_s=DT_S,
        )
        kept.append(memory)
    return kept


def test_a_vehicle_that_stays_below_its_command_has_reached_what_it_can():
    kept = flown([8.5] * 300)
    assert kept[98].share == 1.0
    assert kept[-1].share == pytest.approx(0.85, abs=0.01)
    assert kept[-1].shown_m_s == pytest.approx(8.5, abs=0.01)


def test_a_vehicle_that_gains_speed_or_is_slowed_down_has_not():
    assert flown([0.03 * step for step in range(300)])[-1].share == 1.0
    assert flown([8.5] * 300, at_full_speed=False)[-1].share == 1.0
    assert flown([9.9] * 300)[-1].share == 1.0


def test_a_vehicle_that_flies_faster_later_is_believed():
    kept = flown([8.5] * 300 + [9.0] * 250 + [9.9] * 150)
    assert kept[540].share == pytest.approx(0.9, abs=0.01)
    assert kept[-1].share == 1.0


def test_a_vehicle_that_a_pilot_takes_over_teaches_nothing():
    taken = [8.5] * 300 + [max(0.0, 8.5 - 0.06 * step) for step in range(400)]
    assert flown(taken, guided=lambda number: number < 300)[-1].share == pytest.approx(
        0.85, abs=0.01
    )
    assert flown([0.0] * 300, guided=lambda _number: False)[-1].share == 1.0


def test_a_descent_explains_a_tenth_of_the_speed_and_level_flight_is_compared_by_itself():
    assert flown([7.6] * 400, asked_m_s=8.0, down_m_s=[1.5] * 400)[-1].share == 1.0
    assert flown([7.6] * 400, asked_m_s=8.0)[-1].share == pytest.approx(0.95, abs=0.01)
    assert flown([6.8] * 400, asked_m_s=8.0, down_m_s=[1.5] * 400)[-1].share == pytest.approx(
        0.85, abs=0.01
    )
    # 6 s of a fast descent, then 5 s level: the mean of the level flight has nothing of the descent in it.
    speeds_m_s = [6.4] * 300 + [8.0] * 250
    kept = flown(speeds_m_s, asked_m_s=8.0, down_m_s=[2.0] * 300 + [0.0] * 250)
    assert kept[299].share == pytest.approx(0.8, abs=0.01)
    assert kept[-1].share == 1.0
