"""What two positions of a vehicle show: a jump of its estimate, a second sender, or an acceleration."""

import math

import pytest

from guidance.frames import Ned
from guidance.messages import Home, LandedState, LocalPosition, Odometry, StatusText, Timesync
from guidance.vehicle import VehicleState, observe

STILL = Ned((0.0, 0.0, 0.0))


def local(at_s, north_m=0.0, velocity_m_s=0.0, *, boot_s=None, down_m=-10.0):
    """A position on the north axis; the vehicle's clock is ours unless it is given."""
    stamp_s = at_s if boot_s is None else boot_s
    return LocalPosition(at_s, stamp_s, Ned((north_m, 0.0, down_m)), Ned((velocity_m_s, 0.0, 0.0)))


def seen(*arrived):
    return observe(VehicleState(), arrived)


@pytest.mark.parametrize(
    ("step_s", "way_m", "jumps"),
    [
        # 1 m, and 2.5 m/s² for the whole time: a manoeuvre explains no more
        (0.1, 1.02, 0),
        (0.1, 1.03, 1),
        (0.1, -1.03, 1),
        (1.0, 3.49, 0),
        (1.0, 3.51, 1),
    ],
)
def test_a_way_that_neither_velocities_nor_a_manoeuvre_explain_is_a_jump(step_s, way_m, jumps):
    # From 4 to 8 m/s it flies 6 m in each second besides.
    flown_m = 6.0 * step_s
    state = seen(local(10.0, 0.0, 4.0), local(10.0 + step_s, flown_m + way_m, 8.0))
    assert state.resets == jumps
    if jumps:
        assert state.jump_ned_m.north == pytest.approx(way_m)
        assert state.jumped_ned_m == state.jump_ned_m
        assert (state.reset_s, state.jumped_boot_s) == (10.0 + step_s, 10.0 + step_s)


def test_jumps_are_counted_and_added_up():
    state = seen(local(1.0), local(1.1, 5.0), local(1.2, 5.0), local(1.3, 12.0, down_m=-8.0))
    assert state.resets == 2
    assert state.jump_ned_m == pytest.approx((7.0, 0.0, 2.0))
    assert state.jumped_ned_m == pytest.approx((12.0, 0.0, 2.0))
    assert state.contradicted_s == ()


def to_and_fro(period_s, count):
    """A vehicle whose positions jump away and back, one jump in each period; they arrive ten times a second."""
    positions = []
    for number in range(round(count * period_s * 10.0)):
        at_s = 100.0 + 0.1 * number
        periods = math.floor((at_s - 100.0) / period_s + 1e-6)
        positions.append(local(at_s, 50.0 if periods % 2 else 0.0))
    return seen(*positions)


@pytest.mark.parametrize(
    ("period_s", "second_sender"),
    # Three jumps back within two seconds
    [(0.1, True), (0.9, True), (1.0, True), (1.1, False), (2.0, False)],
)
def test_three_jumps_to_and_fro_within_two_seconds_come_from_two_senders(period_s, second_sender):
    state = to_and_fro(period_s, 6)
    assert state.has_second_sender(100.0 + 6.0 * period_s) is second_sender


def test_two_jumps_to_and_fro_are_no_second_sender_yet():
    state = to_and_fro(0.5, 4)
    assert len(state.contradicted_s) == 2
    assert not state.has_second_sender(102.0)


def test_jumps_that_lead_elsewhere_are_no_second_senders():
    assert seen(*(local(1.0 + 0.1 * number, 20.0 * number) for number in range(9))).resets == 8
    assert (
        seen(*(local(1.0 + 0.1 * number, 20.0 * number) for number in range(9))).contradicted_s
        == ()
    )


@pytest.mark.parametrize(("back_m", "contradicted"), [(0.9, 1), (1.1, 0), (-0.9, 1), (-1.1, 0)])
def test_a_jump_back_leads_to_a_metre_from_where_the_first_one_began(back_m, contradicted):
    state = seen(local(1.0), local(1.1, 20.0), local(1.2, back_m))
    assert len(state.contradicted_s) == contradicted


@pytest.mark.parametrize(("later_s", "contradicted"), [(1.9, 1), (2.1, 0)])
def test_a_jump_back_follows_within_two_seconds(later_s, contradicted):
    steady = [local(1.1 + 0.1 * number, 20.0) for number in range(round(later_s * 10.0))]
    state = seen(local(1.0), *steady, local(1.1 + later_s, 0.0))
    assert state.resets == 2
    assert len(state.contradicted_s) == contradicted


def test_a_second_sender_is_believed_gone_four_seconds_after_the_first_of_three_contradictions():
    state = VehicleState(contradicted_s=(10.0, 11.0, 12.0))
    assert state.has_second_sender(14.0)
    assert not state.has_second_sender(14.01)
    assert not VehicleState(contradicted_s=(11.0, 12.0)).has_second_sender(12.0)


@pytest.mark.parametrize(
    ("late_s", "away_m", "contradicted"),
    [
        # 2 m/s: 0.1 s before the last one it was 0.2 m behind. Beside that 1 m, and 2.5 m for a second.
        (0.1, -0.2 - 1.24, 0),
        (0.1, -0.2 - 1.26, 1),
        (0.1, -0.2 + 1.24, 0),
        (0.1, -0.2 + 1.26, 1),
        (0.4, -0.8 - 1.99, 0),
        (0.4, -0.8 - 2.01, 1),
    ],
)
def test_a_late_position_that_is_not_on_the_way_contradicts(late_s, away_m, contradicted):
    state = seen(local(9.0, -2.0, 2.0), local(10.0, 0.0, 2.0))
    after = observe(state, [local(10.01, away_m, 2.0, boot_s=10.0 - late_s)])
    assert len(after.contradicted_s) == contradicted
    assert after.latest.get(LocalPosition) == local(10.0, 0.0, 2.0)
    assert after.resets == state.resets


def test_a_late_position_from_before_a_jump_contradicts_nothing():
    state = seen(local(10.0), local(10.1, 30.0), local(10.2, 30.0))
    assert observe(state, [local(10.21, 0.0, boot_s=10.05)]).contradicted_s == ()
    assert len(observe(state, [local(10.21, 0.0, boot_s=10.15)]).contradicted_s) == 1


def test_positions_of_two_clocks_contradict_however_near_they_are():
    state = seen(Timesync(10.0, 10_000_000_000, 10_000_000_000), local(10.02))
    ahead = observe(state, [local(10.04, boot_s=10.9)])
    assert ahead.contradicted_s == ()
    back = observe(ahead, [local(10.06)])
    assert back.contradicted_s == (10.06,)


def test_only_the_contradictions_of_the_last_two_seconds_are_kept_and_three_at_most():
    state = seen(local(10.0), local(12.0))
    for number in range(5):
        state = observe(state, [local(12.1 + 0.5 * number, 40.0, boot_s=11.9)])
    assert state.contradicted_s == pytest.approx((13.1, 13.6, 14.1))
    later = observe(state, [local(15.7, 40.0, boot_s=11.9)])
    assert later.contradicted_s == pytest.approx((14.1, 15.7))


@pytest.mark.parametrize(("back_s", "reboots"), [(0.9, 0), (1.0, 0), (1.1, 1)])
def test_a_step_back_of_more_than_a_second_is_a_reboot(back_s, reboots):
    state = seen(local(100.0), local(100.1, boot_s=100.0 - back_s))
    assert state.reboots == reboots
    assert (state.latest.get(LocalPosition).time_boot_s == 100.0) is (reboots == 0)


@pytest.mark.parametrize(("forward_s", "reboots"), [(86_399.0, 0), (86_402.0, 1)])
def test_a_step_forward_of_more_than_a_day_is_a_reboot(forward_s, reboots):
    assert seen(local(100.0), local(101.0, boot_s=100.0 + forward_s)).reboots == reboots


def test_after_a_reboot_the_delay_is_unknown_again():
    state = seen(Timesync(10.0, 10_000_000_000, 10_000_000_000), local(10.02), local(10.04))
    assert state.delay_s == pytest.approx(0.0, abs=0.05)
    assert math.isnan(observe(state, [local(10.1, boot_s=1.0)]).clock.delay_s)


@pytest.mark.parametrize(
    ("step_s", "north_m_s2"),
    [
        (0.05, 10.0),  # half of 1 m/s in 0.05 s
        (0.1, 10.0),  # all of 1 m/s in 0.1 s
        (0.2, 5.0),
        (0.5, 2.0),
        (0.51, 0.0),  # a gap
    ],
)
def test_the_acceleration_is_that_of_a_tenth_of_a_second(step_s, north_m_s2):
    state = seen(local(1.0), local(1.0 + step_s, 0.5 * step_s, 1.0))
    assert state.acceleration_ned_m_s2 == pytest.approx((north_m_s2, 0.0, 0.0))


def test_a_steady_acceleration_is_approached_from_what_was_seen_before():
    state = seen(*(local(1.0 + 0.05 * n, 0.00125 * n * n, 0.05 * n) for n in range(3)))
    assert state.acceleration_ned_m_s2.north == pytest.approx(0.75)


def test_a_delay_adds_to_the_age_and_not_to_the_silence():
    state = seen(
        Timesync(10.0, 10_000_000_000, 10_000_000_000),
        local(10.3, boot_s=10.0),
        LandedState(10.3, 2),
    )
    assert state.delay_s == pytest.approx(0.3, abs=0.01)
    assert state.age_s(LandedState, 11.0) == pytest.approx(1.0, abs=0.01)
    assert state.silence_s(LandedState, 11.0) == pytest.approx(0.7)
    assert state.silence_s(Home, 11.0) == math.inf


@pytest.mark.parametrize(("landed", "on_ground", "in_air"), [
    (0, False, False), (1, True, False), (2, False, True), (3, False, True), (4, False, True), (5, False, False),
])  # fmt: skip
def test_what_the_autopilot_says_about_the_ground(landed, on_ground, in_air):
    state = seen(LandedState(1.0, landed))
    assert (state.on_ground, state.in_air) == (on_ground, in_air)


def test_before_it_says_anything_it_is_neither_on_the_ground_nor_in_the_air():
    assert (VehicleState().on_ground, VehicleState().in_air) == (False, False)
    assert VehicleState().delay_s == 0.0


def test_what_is_just_explained_is_no_jump_and_no_contradiction():
    """Half a second explains 1 m + 2.5 m/s² * (0.5 s)², and of a late position 1 m + 2.5 m/s * 0.5 s."""
    assert seen(local(10.0), local(10.5, 1.625)).resets == 0
    state = seen(local(9.0), local(10.0))
    assert observe(state, [local(10.1, 2.25, boot_s=9.5)]).contradicted_s == ()


def test_a_jump_back_may_come_after_just_two_seconds_and_lead_just_a_metre_aside():
    back = seen(local(1.0), local(2.0, 20.0), local(3.0, 20.0), local(4.0, 1.0))
    assert back.contradicted_s == (4.0,)


def test_a_late_position_with_the_stamp_of_a_jump_may_contradict_it():
    state = seen(local(10.0), local(10.5, 30.0), local(11.0, 30.0))
    assert observe(state, [local(11.1, 0.0, boot_s=10.5)]).contradicted_s == (11.1,)


def test_a_step_forward_of_just_a_day_more_than_has_passed_is_no_reboot():
    assert seen(local(100.0), local(101.0, boot_s=100.0 + 86_401.0)).reboots == 0


def test_a_counted_reset_has_the_time_at_which_it_was_told_and_before_it_there_was_none():
    assert VehicleState().reset_s == -math.inf
    assert seen(Odometry(1.0, 7), Odometry(1.2, 8)).reset_s == 1.2


def test_a_home_after_home_was_fixed_is_kept_apart_and_what_comes_with_it_is_used():
    first = Home(1.0, 47.0, 8.0, 500.0, STILL)
    moved = Home(2.0, 47.1, 8.0, 500.0, STILL)
    state = seen(first)._replace(home_fixed=True)
    after = observe(state, [moved, LandedState(2.0, 2)])
    assert (after.latest.get(Home), after.home_refused) == (first, moved)
    assert after.in_air


def test_a_text_is_no_state_and_what_comes_with_it_is_used():
    assert seen(StatusText(1.0, 6, "armed"), LandedState(1.0, 2)).in_air
