import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.control import Limiter
from guidance.flight import Inputs
from guidance.flight.observed import (
    APART_S,
    REMEMBERED_S,
    STRANGE_REPORTS,
    TOLERANCE_M_S,
    WINDOW_S,
    Echo,
    Observed,
)
from guidance.frames import Ned
from guidance.messages import EstimatorStatus, PositionTarget, Setpoint
from tests.flight.scenes import NOW_S, SETTINGS, home, local, settings_of


def reported(now_s, velocity):
    return [PositionTarget(now_s, now_s, 2503, Ned(velocity))]


def flown(echo, velocity, seconds=3.0):
    """Send one velocity at 50 Hz, hear it back at 5 Hz."""
    for step in range(round(seconds * 50)):
        now_s = 0.02 * step
        echo.sent(now_s, Setpoint(Ned(velocity)))
        if step % 10 == 9:
            echo.hear(reported(now_s, velocity), guided=True)
    return 0.02 * round(seconds * 50)


component = st.floats(-8.0, 8.0)


@settings(deadline=None)  # the machine may be busy
@given(st.tuples(component, component, component), st.floats(0.5, 1.0))
def test_our_own_setpoint_is_ours_also_where_the_autopilot_cut_it_to_its_limits(velocity, share):
    echo = Echo()
    now_s = flown(echo, velocity)
    for later in range(10):
        echo.hear(
            reported(now_s + 0.1 * later, tuple(share * part for part in velocity)), guided=True
        )
        echo.sent(now_s + 0.1 * later, Setpoint(Ned(velocity)))
    assert not echo.foreign


@settings(deadline=None)  # the machine may be busy
@given(st.tuples(component, component, component), st.tuples(component, component, component))
def test_a_velocity_far_from_all_that_was_sent_is_foreign_after_a_few_reports(ours, theirs):
    nearest = min(
        math.dist(theirs, [share / 100 * part for part in ours]) for share in range(50, 101)
    )
    if nearest < TOLERANCE_M_S + 0.1:
        return
    echo = Echo()
    now_s = flown(echo, ours)
    for count in range(STRANGE_REPORTS):
        assert not echo.foreign
        echo.hear(reported(now_s + APART_S * count, theirs), guided=True)
    assert echo.foreign


@pytest.mark.parametrize(
    ("told", "foreign"),
    [
        ((3.0, 0.7, 0.0), False),
        ((3.0, 0.0, -0.8), True),
        ((3.7, 0.0, 0.0), False),  # faster than what was sent: nothing that limits of its own make
        ((3.8, 0.0, 0.0), True),
        ((2.0, -0.7, 0.0), False),  # cut to two thirds, to a half, and by more than that
        ((0.8, 0.0, 0.0), False),
        ((0.7, 0.0, 0.0), True),
    ],
)
def test_what_is_off_by_less_than_three_quarters_of_a_metre_a_second_is_ours(told, foreign):
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for count in range(3):
        echo.hear(reported(now_s + APART_S * count, told), guided=True)
    assert echo.foreign is foreign


def test_what_was_sent_two_seconds_ago_is_not_ours_any_more():
    echo = Echo()
    for step in range(250):
        velocity = (3.0, 0.0, 0.0) if step < 150 else (0.0, 3.0, 0.0)
        echo.sent(0.02 * step, Setpoint(Ned(velocity)))
    for count, (at_s, foreign) in enumerate(
        ((4.4, False), (4.6, False), (4.8, False), (5.0, True))
    ):
        echo.hear(reported(at_s, (3.0, 0.0, 0.0)), guided=True)
        assert echo.foreign is foreign, count


def test_after_silence_the_count_begins_anew():
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for count in range(STRANGE_REPORTS):
        echo.hear(reported(now_s + APART_S * count, (-3.0, 0.0, 0.0)), guided=True)
    assert echo.foreign
    echo.silent()
    assert not echo.foreign
    for step in range(100):
        echo.sent(10.0 + 0.02 * step, Setpoint(Ned((3.0, 0.0, 0.0))))
    for count in range(STRANGE_REPORTS):
        assert not echo.foreign
        echo.hear(reported(12.0 + APART_S * count, (-3.0, 0.0, 0.0)), guided=True)
    assert echo.foreign


def test_two_odd_reports_are_no_alarm_however_long_the_flight():
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for step in range(1500):
        now_s += 0.02
        echo.sent(now_s, Setpoint(Ned((3.0, 0.0, 0.0))))
        odd = step % 60 == 0  # 1.2 s apart: two in every window
        echo.hear(reported(now_s, (-3.0, 0.0, 0.0) if odd else (3.0, 0.0, 0.0)), guided=True)
        assert not echo.foreign


@pytest.mark.parametrize("every", [25, 10, 5, 2, 1])
def test_odd_reports_between_our_own_are_a_second_source_within_two_seconds(every):
    echo = Echo()
    begun_s = now_s = flown(echo, (3.0, 0.0, 0.0))
    for step in range(10_000):
        now_s = begun_s + 0.02 * step
        echo.sent(now_s, Setpoint(Ned((3.0, 0.0, 0.0))))
        echo.hear(
            reported(now_s, (-3.0, 0.0, 0.0) if step % every == 0 else (3.0, 0.0, 0.0)), guided=True
        )
        if echo.foreign:
            break
    assert now_s - begun_s == pytest.approx(2.0 * max(APART_S, 0.02 * every), abs=0.03)


def test_a_transient_of_the_autopilot_of_a_third_of_a_second_is_no_alarm():
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for step in range(19):
        echo.sent(now_s + 0.02 * step, Setpoint(Ned((3.0, 0.0, 0.0))))
        echo.hear(reported(now_s + 0.02 * step, (-3.0, 0.0, 0.0)), guided=True)
    assert echo.strange_s
    assert not echo.foreign
    echo.sent(now_s + 0.3 + WINDOW_S, Setpoint(Ned((3.0, 0.0, 0.0))))
    echo.hear(reported(now_s + 0.3 + WINDOW_S, (3.0, 0.0, 0.0)), guided=True)
    assert not echo.strange_s


@pytest.mark.parametrize("velocity", [(math.nan, math.nan, math.nan), (math.nan, 0.0, 0.0)])
def test_a_report_that_says_nothing_of_the_velocity_is_no_alarm(velocity):
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for count in range(10):
        echo.hear(reported(now_s + APART_S * count, velocity), guided=True)
    assert not echo.foreign


def test_late_autopilot_reports_from_before_our_stream_are_no_takeover():
    echo = Echo()
    for step in range(60):
        now_s = 0.02 * step
        echo.sent(now_s, Setpoint(Ned((0.0, 0.0, 0.0))))
        echo.hear(reported(now_s, (5.0, 0.0, 0.0)), guided=True)
    assert now_s < REMEMBERED_S
    assert not echo.foreign


def test_what_is_strange_at_once_after_a_silence_may_be_of_before_it():
    echo = Echo()
    flown(echo, (3.0, 0.0, 0.0))
    echo.silent()
    for step in range(75):
        echo.sent(10.0 + 0.02 * step, Setpoint(Ned((3.0, 0.0, 0.0))))
        echo.hear(reported(10.0 + 0.02 * step, (-3.0, 0.0, 0.0)), guided=True)
        assert not echo.strange_s


def test_in_a_mode_that_is_not_ours_nothing_is_strange_and_what_was_is_forgotten():
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0))
    for count, guided in enumerate((True, True, False, True, True, False, False, False)):
        echo.hear(reported(now_s + APART_S * count, (-3.0, 0.0, 0.0)), guided=guided)
        assert not echo.foreign
        assert bool(echo.strange_s) is guided


@pytest.mark.parametrize("later_s", [0.0, 0.1, 0.7, 1234.56])
@pytest.mark.parametrize(("apart_s", "foreign"), [(1.0, True), (1.02, False)])
def test_three_strange_reports_in_two_seconds_are_foreign_for_any_clock_rounding(
    apart_s, foreign, later_s
):
    echo = Echo()
    now_s = flown(echo, (3.0, 0.0, 0.0)) + later_s
    for count in range(3):
        echo.sent(now_s + apart_s * count, Setpoint(Ned((3.0, 0.0, 0.0))))
        echo.hear(reported(now_s + apart_s * count, (-3.0, 0.0, 0.0)), guided=True)
    assert echo.foreign is foreign


def test_a_position_that_jumps_moves_the_frame_once_and_fences_are_measured_from_it():
    observed = Observed(SETTINGS)
    places = [(1.0, 2.0, -14.0), (31.0, 2.0, -14.0), (31.0, 2.0, -14.0), (31.0, -18.0, -10.0)]
    moved = []
    for n, place in enumerate(places):
        said = [home(NOW_S), local(NOW_S + 0.02 * n, place)]
        observed.take_in(NOW_S, Inputs(said), in_flight=True)
        moved.append(observed.moved_ned_m)
        assert observed.position_ned_m == place
        (circle,) = [
            wall for wall in observed.view(NOW_S).walls if wall.limiter is Limiter.FENCE_RADIUS
        ]
        assert circle.gap_m == pytest.approx(300.0 - math.hypot(*place[:2]))
        assert observed.messages == said
    assert moved == [(0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, -20.0, 4.0)]


@pytest.mark.parametrize(("sd_m", "margin_m"), [(None, 0.0), (0.3, 0.3), (math.nan, 0.0)])
def test_the_floor_is_kept_by_the_error_that_the_estimator_reports(sd_m, margin_m):
    envelope = replace(SETTINGS.cycle.envelope, floor_margin_m=0.5)
    observed = Observed(settings_of(cycle=replace(SETTINGS.cycle, envelope=envelope)))
    said = [home(NOW_S), local(NOW_S)]
    observed.take_in(
        NOW_S,
        Inputs(said if sd_m is None else [*said, EstimatorStatus(NOW_S, sd_m)]),
        in_flight=True,
    )
    (floor,) = [wall for wall in observed.view(NOW_S).walls if wall.limiter is Limiter.FLOOR]
    assert (floor.margin_m, floor.gap_m) == pytest.approx(
        (margin_m, 10.0 - envelope.floor_m - margin_m)
    )
