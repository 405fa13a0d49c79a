"""Arrival times of a vehicle that brakes: against small steps, and against a chase of what flees."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control.arrival import Stop, closing_s, meeting_s
from guidance.control.braking_law import approach_speed

STOP = Stop(braking_m_s2=2.5, lag_s=0.55, short_m=3.1, arrived_m=0.4)
FAST_M_S = 6.0
STEP_S = 1e-3


@pytest.mark.parametrize("left_m", [0.3, 0.5, 1.0, 3.0, 8.0, 30.0])
def test_a_vehicle_brakes_as_its_approach_allows(left_m):
    time_s = 0.0
    way_m = left_m
    while way_m > STOP.arrived_m:
        speed_m_s = approach_speed(way_m, STOP.braking_m_s2, STOP.lag_s)
        assert STOP.allowed_m_s(way_m) == pytest.approx(speed_m_s)
        way_m -= STEP_S * min(FAST_M_S, speed_m_s)
        time_s += STEP_S
    assert closing_s(left_m, FAST_M_S, STOP) == pytest.approx(time_s, abs=0.01)


@pytest.mark.parametrize("fleeing_m_s", [0.0, 0.5, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("gap_m", [0.4, 0.6, 1.0, 3.0, 8.0, 30.0])
def test_what_flees_is_met_at_the_place_that_it_reaches_meanwhile(gap_m, fleeing_m_s):
    time_s = closing_s(gap_m, FAST_M_S - fleeing_m_s, STOP)
    met_m = gap_m + fleeing_m_s * time_s
    assert meeting_s(met_m, FAST_M_S, fleeing_m_s, STOP) == pytest.approx(time_s, abs=0.01)


@given(st.floats(0.0, 60.0), st.floats(1.0, 10.0), st.floats(0.0, 0.9), st.floats(-1e-3, 1e-3))
def test_a_small_change_of_the_way_changes_the_time_by_little(left_m, fast_m_s, share, change_m):
    times_s = meeting_s(np.array([left_m, left_m + change_m]), fast_m_s, share * fast_m_s, STOP)
    arriving_m_s = min(STOP.allowed_m_s(STOP.arrived_m), (1.0 - share) * fast_m_s)
    assert abs(times_s[1] - times_s[0]) <= 1.01 * abs(change_m) / arriving_m_s + 1e-9
