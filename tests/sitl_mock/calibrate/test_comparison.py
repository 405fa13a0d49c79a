"""Rise, overshoot and steady error against closed forms; segments against the commands."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl_mock.calibrate.comparison import response_of, segments_of


@given(
    start=st.floats(-5.0, 5.0),
    change=st.floats(0.5, 8.0),
    sign=st.sampled_from([-1.0, 1.0]),
    tau_s=st.floats(0.2, 1.0),
)
def test_a_first_order_answer_rises_in_its_time_constant_times_log_nine(start, change, sign, tau_s):
    time_s = np.arange(0.0, 12.0, 0.02)
    command = start + sign * change
    velocity = command - sign * change * np.exp(-time_s / tau_s)
    answer = response_of(time_s, velocity, start, command)
    assert answer.rise_s == pytest.approx(tau_s * math.log(9.0), abs=0.01)
    assert answer.overshoot_m_s == 0.0
    assert answer.steady_error_m_s == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.6])
def test_a_second_order_answer_overshoots_by_its_closed_form(damping):
    time_s = np.arange(0.0, 30.0, 0.01)
    ringing = math.sqrt(1.0 - damping**2)
    phase = 3.0 * ringing * time_s
    velocity = -4.0 * (
        1.0 - np.exp(-3.0 * damping * time_s) * (np.cos(phase) + damping / ringing * np.sin(phase))
    )
    answer = response_of(time_s, velocity, 0.0, -4.0)
    assert answer.overshoot_m_s == pytest.approx(
        4.0 * math.exp(-math.pi * damping / ringing), rel=1e-3
    )


def test_a_level_never_reached_has_no_rise_but_a_steady_error():
    time_s = np.arange(0.0, 8.0, 0.05)
    answer = response_of(time_s, np.minimum(time_s, 3.0), 0.0, 5.0)
    assert math.isnan(answer.rise_s)
    assert answer.steady_error_m_s == pytest.approx(-2.0)


def test_an_axis_that_was_not_asked_to_move_only_has_a_steady_error():
    answer = response_of(np.arange(5.0), np.full(5, 0.3), 0.0, 0.0)
    assert math.isnan(answer.rise_s)
    assert math.isnan(answer.overshoot_m_s)
    assert answer.steady_error_m_s == pytest.approx(0.3)


def test_a_level_held_from_the_first_sample_on_counts_from_there():
    assert response_of(np.arange(5.0), np.ones(5), 0.0, 1.0).rise_s == 0.0


def test_steps_are_segments_and_a_sweep_between_them_is_one():
    time_s = np.arange(0.0, 12.0, 0.1)
    command = np.zeros((120, 3))
    command[30:70, 0] = np.sin(time_s[30:70])
    command[70:, 2] = -2.0
    segments = segments_of(time_s, command)
    assert [(part.first, part.last, part.varying) for part in segments] == [
        (0, 30, False),
        (30, 70, True),
        (70, 120, False),
    ]
