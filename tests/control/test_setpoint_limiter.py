"""Limits on the command itself, each against its closed form, and the names under which each one reports."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.control import Limiter, Situation
from guidance.control.braking_law import approach_speed
from guidance.control.limits import Agility
from guidance.control.polygon import Polygon
from guidance.control.servo import shape
from guidance.control.setpoint_limiter import NOTED, LimitMemory, limit, start
from guidance.frames import Ned
from guidance.game import StandOff
from guidance.messages import Setpoint
from tests.control.scenes import DT_S, HOVER, OPEN, settled
from tests.harness.examples import drawn


@settings(deadline=None)
@given(st.floats(0.0, 1e4), st.floats(0.1, 100.0), st.floats(0.0, 3.0))
def test_the_approach_speed_uses_up_the_distance_exactly(distance, deceleration, lag):
    speed = approach_speed(distance, deceleration, lag)
    assert speed * lag + speed**2 / (2.0 * deceleration) == pytest.approx(
        distance, rel=1e-6, abs=1e-6
    )


def test_a_command_within_the_envelope_passes_untouched():
    limited = settled((3.0, -4.0, 1.0), acceleration_ned_m_s2=None, yaw_rad=None)
    assert limited.setpoint == Setpoint(Ned((3.0, -4.0, 1.0)))
    assert limited.active == ()


def test_a_ground_velocity_is_scaled_and_keeps_its_direction():
    limited = limit(
        Setpoint(Ned((300.0, -400.0, 1.0))), HOVER, OPEN, LimitMemory(Ned((6.0, -8.0, 1.0))), DT_S
    )
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((6.0, -8.0, 1.0))
    assert limited.active == (Limiter.SPEED,)


@pytest.mark.parametrize(("down", "allowed"), [(50.0, 2.0), (-50.0, -4.0)])
def test_climb_and_descent_have_their_own_limits_and_cost_no_ground_speed(down, allowed):
    limited = limit(
        Setpoint(Ned((6.0, 8.0, down))), HOVER, OPEN, LimitMemory(Ned((6.0, 8.0, allowed))), DT_S
    )
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((6.0, 8.0, allowed))
    assert limited.active == (Limiter.VERTICAL_SPEED,)


def test_acceleration_is_limited_on_the_ground_as_a_vector_and_vertically_on_its_own():
    limited = limit(
        Setpoint(Ned((3.0, 4.0, -2.0))), HOVER, OPEN, LimitMemory(Ned((0.0, 0.0, 0.0))), DT_S
    )
    assert limited.setpoint.velocity_ned_m_s == pytest.approx((3.0 * DT_S, 4.0 * DT_S, -3.0 * DT_S))
    assert limited.memory.acceleration_ned_m_s2 == pytest.approx((3.0, 4.0, -3.0))
    assert limited.active == (Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION)


@pytest.mark.parametrize("down", [10.0, -10.0, 0.3, -0.3])
def test_a_vertical_velocity_settles_within_its_acceleration_up_and_down(down):
    most = Agility(acceleration_m_s2=4.0, vertical_acceleration_m_s2=2.0, jerk_m_s3=1e6)
    shaped = shape(
        Ned((0.0, 0.0, down)), Ned((0.0, 0.0, 0.0)), Ned((0.0, 0.0, 0.0)), most, DT_S, 4.0
    )
    wanted = math.copysign(min(2.0, 4.0 * abs(down)), down)
    assert shaped == ((0.0, 0.0, pytest.approx(wanted * DT_S)), (0.0, 0.0, pytest.approx(wanted)))


@pytest.mark.parametrize("way", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_limiter_is_named_on_every_side_for_a_change_that_a_vehicle_could_tell(way):
    sent = Ned((10.0 * way[0], 10.0 * way[1], 0.0))
    for change, named in ((0.9, ()), (1.1, (Limiter.SPEED,))):
        wanted = (10.0 + change * NOTED) / 10.0 * sent
        limited = limit(Setpoint(wanted), HOVER, OPEN, LimitMemory(sent), DT_S)
        assert limited.setpoint.velocity_ned_m_s == pytest.approx(sent)
        assert limited.active == named


@pytest.mark.parametrize(
    ("turn", "named"),
    [(0.045, ()), (-0.045, ()), (0.065, (Limiter.YAW,)), (-0.065, (Limiter.YAW,))],
)
def test_the_turn_rate_is_named_for_what_is_left_of_a_turn(turn, named):
    memory = LimitMemory(Ned((0.0, 0.0, 0.0)), yaw_rad=0.4)
    assert (
        limit(Setpoint(Ned((0.0, 0.0, 0.0)), yaw_rad=0.4 + turn), HOVER, OPEN, memory, DT_S).active
        == named
    )


def test_a_nan_acceleration_is_zero_and_a_known_one_needs_no_evader_velocity():
    fenced = replace(OPEN, fence_radius_m=6.0)
    velocity = (8.0, 1.0, 0.0)

    def allowed(acceleration, moving=None):
        at = HOVER._replace(
            acceleration_ned_m_s2=Ned(acceleration),
            evader_velocity_ned_m_s=None if moving is None else Ned(moving),
        )
        return settled(velocity, at, fenced).setpoint.velocity_ned_m_s

    unknown = (NAN, NAN, NAN)
    assert allowed(unknown) == allowed((0.0, 0.0, 0.0))
    assert allowed((3.0, 1.0, 0.0), unknown) == allowed((3.0, 1.0, 0.0)) != allowed((0.0, 0.0, 0.0))

    def stopping(acceleration):
        at = HOVER._replace(acceleration_ned_m_s2=Ned(acceleration))
        limited = settled(velocity, at, fenced, yaw_rad=NAN)
        assert Limiter.COMMAND in limited.active
        return limited.setpoint.velocity_ned_m_s

    assert stopping((3.0, 1.0, 0.0)) != stopping((0.0, 0.0, 0.0))


@pytest.mark.parametrize(("asked", "flown"), [((5.0, 0.0, 0.0), (10.6, 0.0, 0.0)), ((0.0, 0.0, 1.0), (0.0, 0.0, 2.2)),
                                              ((0.0, 0.0, -1.0), (0.0, 0.0, -4.4))])  # fmt: skip
def test_a_feed_forward_leans_on_no_speed_limit_that_is_not_commanded(asked, flown):
    limited = settled(
        asked, HOVER._replace(velocity_ned_m_s=Ned(flown)), acceleration_ned_m_s2=Ned(asked)
    )
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx(
        tuple(min(part, 5.0) for part in asked)
    )


@settings(deadline=None)
@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(-0.1, 0.1), st.floats(-0.06, 0.06))
def test_a_velocity_that_is_led_already_passes_to_the_digit_within_the_acceleration(
    north, east, change, climb
):
    soft = replace(OPEN, jerk_m_s3=1.0)
    before = (0.5 * north, 0.5 * east, 0.3)
    wanted = (before[0] + 0.7 * change, before[1] - 0.7 * change, 0.3 + climb)
    limited = limit(
        Setpoint(Ned(wanted)), HOVER, soft, LimitMemory(Ned(before)), DT_S, already_shaped=True
    )
    assert limited.setpoint.velocity_ned_m_s == wanted
    assert limited.active == ()
    assert limited.memory.acceleration_ned_m_s2 == pytest.approx(
        (35.0 * change, -35.0 * change, 50.0 * climb), abs=1e-9
    )


def test_a_velocity_that_is_led_already_jumps_no_further_than_the_acceleration():
    for before, wanted, got in (
        ((1.0, 2.0, 1.5), (1.0, 9.0, -3.0), (1.0, 2.1, 1.44)),
        ((0.0, 0.0, 0.0), (-3.0, -4.0, 2.0), (-0.06, -0.08, 0.06)),
    ):
        limited = limit(
            Setpoint(Ned(wanted)), HOVER, OPEN, LimitMemory(Ned(before)), DT_S, already_shaped=True
        )
        assert limited.setpoint.velocity_ned_m_s == pytest.approx(got)
        assert limited.active == (Limiter.ACCELERATION, Limiter.VERTICAL_ACCELERATION)
    held = limit(
        Setpoint(Ned(wanted)),
        HOVER,
        OPEN,
        LimitMemory(Ned(before), Ned((1.0, 1.0, 1.0))),
        0.0,
        already_shaped=True,
    )
    assert (held.setpoint.velocity_ned_m_s, held.memory.acceleration_ned_m_s2) == (
        before,
        (0.0, 0.0, 0.0),
    )


def test_jerk_limits_the_rise_of_acceleration():
    soft = replace(OPEN, jerk_m_s3=10.0)
    memory = LimitMemory(Ned((0.0, 0.0, 0.0)))
    accelerations = []
    for _ in range(5):
        memory = limit(Setpoint(Ned((8.0, 0.0, 0.0))), HOVER, soft, memory, DT_S).memory
        accelerations.append(memory.acceleration_ned_m_s2[0])
    assert accelerations == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


@settings(max_examples=drawn(30), deadline=None)
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(1.0, 50.0), st.sampled_from([0, 1]))
def test_velocity_arrives_without_overshoot_along_a_line(before, wanted, jerk, axis):
    def along(speed):
        return (0.0, speed, 0.0) if axis else (speed, 0.0, 0.0)

    soft = replace(OPEN, jerk_m_s3=jerk)
    memory = LimitMemory(Ned(along(before)))
    low = min(before, wanted) - 1e-9
    high = max(before, wanted) + 1e-9
    for _ in range(500):
        memory = limit(Setpoint(Ned(along(wanted))), HOVER, soft, memory, DT_S).memory
        assert low <= memory.velocity_ned_m_s[axis] <= high
    for _ in range(1500):
        memory = limit(Setpoint(Ned(along(wanted))), HOVER, soft, memory, DT_S).memory
    assert memory.velocity_ned_m_s == pytest.approx(along(wanted), abs=1e-6)
    assert memory.acceleration_ned_m_s2[axis] == pytest.approx(0.0, abs=1e-3)


NAN = math.nan


@pytest.mark.parametrize(
    "command",
    [
        Setpoint(Ned((NAN, 0.0, 0.0))),
        Setpoint(Ned((0.0, math.inf, 0.0))),
        Setpoint(Ned((0.0, 0.0, -1e9))),
        Setpoint(Ned((1.0, 0.0, 0.0)), Ned((NAN, 0.0, 0.0))),
        Setpoint(Ned((1.0, 0.0, 0.0)), yaw_rad=NAN),
    ],
)
def test_a_command_that_is_no_number_becomes_a_smooth_stop(command):
    limited = limit(command, HOVER, OPEN, LimitMemory(Ned((4.0, 0.0, 0.0)), yaw_rad=0.3), DT_S)
    assert limited.active == (Limiter.COMMAND, Limiter.ACCELERATION)
    assert limited.setpoint == Setpoint(
        Ned((pytest.approx(4.0 - 5.0 * DT_S), 0.0, 0.0)), yaw_rad=pytest.approx(0.3)
    )


@pytest.mark.parametrize(
    "situation",
    [
        HOVER._replace(position_ned_m=Ned((0.0, NAN, 0.0))),
        HOVER._replace(velocity_ned_m_s=Ned((0.0, 0.0, math.inf))),
        HOVER._replace(yaw_rad=NAN),
        HOVER._replace(evader_position_ned_m=Ned((NAN, 0.0, 0.0))),
    ],
)
def test_a_place_that_is_not_known_stops_the_vehicle_at_once(situation):
    limited = limit(
        Setpoint(Ned((4.0, 0.0, 0.0)), yaw_rad=1.0),
        situation,
        OPEN,
        LimitMemory(Ned((4.0, 0.0, 0.0)), yaw_rad=0.2),
        DT_S,
    )
    assert limited == (
        Setpoint(Ned((0.0, 0.0, 0.0))),
        (Limiter.SITUATION,),
        LimitMemory(Ned((0.0, 0.0, 0.0)), yaw_rad=0.2),
    )


@pytest.mark.parametrize(
    ("dt_s", "counted"), [(5.0, 0.1), (math.inf, 0.1), (-1.0, 0.0), (NAN, 0.0)]
)
def test_a_late_or_impossible_step_is_not_made_up_for(dt_s, counted):
    limited = limit(
        Setpoint(Ned((8.0, 0.0, 0.0))), HOVER, OPEN, LimitMemory(Ned((0.0, 0.0, 0.0))), dt_s
    )
    assert limited.setpoint.velocity_ned_m_s[0] == pytest.approx(5.0 * counted)
    assert limited.active == (Limiter.CLOCK, Limiter.ACCELERATION)


@pytest.mark.parametrize(
    "memory",
    [
        None,
        LimitMemory(Ned((NAN, 0.0, 0.0))),
        LimitMemory(Ned((1.0, 0.0, 0.0)), yaw_rad=math.inf),
        LimitMemory(Ned((0.0, 0.0, 1e9))),
        LimitMemory(Ned((1.0, 0.0, 0.0)), Ned((NAN, 0.0, 0.0))),
        LimitMemory(Ned((1.0, 0.0, 0.0)), feed_forward_ned_m_s2=Ned((NAN, 0.0, 0.0))),
    ],
)
def test_without_a_usable_memory_the_vehicle_s_own_motion_is_the_start(memory):
    moving = Situation(Ned((0.0, 0.0, 0.0)), Ned((3.0, 4.0, -1.0)), 0.7)
    limited = limit(Setpoint(Ned((3.0, 4.0, -1.0)), yaw_rad=0.7), moving, OPEN, memory, DT_S)
    assert limited.setpoint == Setpoint(Ned((3.0, 4.0, -1.0)), yaw_rad=pytest.approx(0.7))
    assert limited.active == ()


def test_a_start_from_nothing_known_is_at_rest_and_says_nothing_of_the_heading():
    still = (0.0, 0.0, 0.0)
    unknown = Situation(Ned((0.0, 0.0, -20.0)), Ned((math.nan, 0.0, 0.0)), 1.0)
    assert start(unknown, OPEN) == LimitMemory(Ned(still), Ned(still), Ned(still), 0.0)
    turned_nowhere = Situation(Ned((0.0, 0.0, -20.0)), Ned((1.0, 2.0, 0.5)), math.nan)
    assert start(turned_nowhere, OPEN) == LimitMemory(Ned(still))
    moving = Situation(Ned((0.0, 0.0, -20.0)), Ned((1.0, 2.0, 0.5)), 1.0)
    assert start(moving, OPEN) == LimitMemory(Ned((1.0, 2.0, 0.5)), Ned(still), Ned(still), 1.0)


def test_a_start_in_a_gale_is_within_the_envelope():
    assert start(Situation(Ned((0.0, 0.0, 0.0)), Ned((30.0, 40.0, 9.0)), 0.7), OPEN) == LimitMemory(
        Ned((6.0, 8.0, 2.0)), yaw_rad=0.7
    )
    assert start(Situation(Ned((0.0, 0.0, 0.0)), Ned((NAN, 0.0, 0.0)), 0.7), OPEN) == LimitMemory(
        Ned((0.0, 0.0, 0.0))
    )


@pytest.mark.parametrize(
    ("before", "wanted", "after"),
    [
        (0.0, 2.0, 0.01),
        (0.0, -2.0, -0.01),
        (3.1, -3.1, 3.11),
        (-3.1, 3.1, -3.11),
        (0.0, 0.004, 0.004),
        (0.2, 0.2 + math.tau, 0.2),
    ],
)
def test_yaw_turns_the_short_way_at_the_turn_rate(before, wanted, after):
    limited = limit(
        Setpoint(Ned((0.0, 0.0, 0.0)), yaw_rad=wanted),
        HOVER,
        OPEN,
        LimitMemory(Ned((0.0,) * 3), yaw_rad=before),
        DT_S,
    )
    assert limited.setpoint.yaw_rad == limited.memory.yaw_rad == pytest.approx(after)
    assert (Limiter.YAW in limited.active) == (abs(math.remainder(after - wanted, math.tau)) > 1e-6)


def test_while_no_yaw_is_asked_for_the_memory_follows_the_nose():
    limited = settled((1.0, 0.0, 0.0), HOVER._replace(yaw_rad=2.0))
    assert limited.setpoint.yaw_rad is None
    assert limited.memory.yaw_rad == 2.0


def test_what_is_taken_away_before_a_wall_is_remembered_and_a_slower_setpoint_is_not():
    fenced = replace(OPEN, fence_radius_m=10.0)
    near = HOVER._replace(position_ned_m=Ned((9.0, 0.0, 0.0)))
    for wanted, held in (
        ((3.0, 0.0, 0.0), True),
        ((-3.0, 0.0, 0.0), False),
        ((0.0, 0.0, -30.0), False),
    ):
        assert settled(wanted, near, fenced).memory.held_back is held
    assert not LimitMemory(Ned((0.0, 0.0, 0.0))).held_back


def test_a_feed_forward_within_the_limits_passes_and_a_large_one_is_scaled():
    limited = settled((1.0, 0.0, 0.0), acceleration_ned_m_s2=Ned((3.0, 0.0, -1.0)))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((3.0, 0.0, -1.0))
    assert limited.active == ()
    limited = settled((1.0, 0.0, 0.0), acceleration_ned_m_s2=Ned((30.0, 40.0, -9.0)))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((3.0, 4.0, -3.0))
    assert limited.active == (Limiter.FEED_FORWARD,)


@pytest.mark.parametrize(
    ("wanted", "sent"),
    [((3.0, 0.0, 2.0), (0.7, 0.0, 0.2)), ((0.6, 0.0, 0.1), (0.6, 0.0, 0.1))],
)
def test_a_feed_forward_changes_at_the_jerk_limit_from_the_last_one_sent(wanted, sent):
    soft = replace(OPEN, jerk_m_s3=10.0)
    memory = LimitMemory(Ned((1.0, 0.0, 0.0)), feed_forward_ned_m_s2=Ned((0.5, 0.0, 0.0)))
    limited = limit(Setpoint(Ned((1.0, 0.0, 0.0)), Ned(wanted)), HOVER, soft, memory, DT_S)
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx(sent)
    assert limited.memory.feed_forward_ned_m_s2 == limited.setpoint.acceleration_ned_m_s2
    assert settled((1.0, 0.0, 0.0)).memory.feed_forward_ned_m_s2 == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("velocity", "limits", "wanted", "allowed"),
    [
        ((8.0, 0.0, 0.0), {"fence_radius_m": 6.0}, (3.0, 2.0, 1.0), (0.0, 2.0, 1.0)),
        ((8.0, 0.0, 0.0), {"fence_radius_m": 6.0}, (-3.0, 2.0, 1.0), (-3.0, 2.0, 1.0)),
        ((0.0, 0.0, 2.0), {"floor_m": -1.0}, (3.0, 2.0, 1.0), (3.0, 2.0, 0.0)),
        ((10.0, 0.0, 0.0), {}, (3.0, 2.0, 1.0), (0.0, 2.0, 1.0)),
        ((10.0, 0.0, 0.0), {}, (-3.0, 2.0, 1.0), (-3.0, 2.0, 1.0)),
        ((0.0, 0.0, 2.0), {}, (3.0, 2.0, 1.0), (3.0, 2.0, 0.0)),
        ((0.0, 0.0, -4.0), {}, (3.0, 2.0, -1.0), (3.0, 2.0, 0.0)),
        ((0.0, 0.0, -4.0), {}, (3.0, 2.0, 1.0), (3.0, 2.0, 1.0)),
        (
            (0.0, 0.0, -3.0),
            {},
            (3.0, 2.0, -1.0),
            (3.0, 2.0, -1.0),
        ),  # faster than the descent, slower than the climb
        ((6.0, 8.0, 0.0), {}, (3.0, 4.0, 1.0), (0.0, 0.0, 1.0)),
        ((0.0, -10.0, 0.0), {}, (1.0, -3.0, 1.0), (1.0, 0.0, 1.0)),
    ],
)
def test_a_feed_forward_does_not_lean_on_a_limit_that_acts(velocity, limits, wanted, allowed):
    at = (
        HOVER._replace(position_ned_m=Ned((0.001, 0.0, 0.0)))
        if "fence_radius_m" in limits
        else HOVER
    )
    flown = tuple(1.05 * part for part in velocity)  # a little faster than any limit of speed
    at = at._replace(velocity_ned_m_s=Ned((0.0, 0.0, 0.0) if limits else flown))
    limited = settled(velocity, at, replace(OPEN, **limits), acceleration_ned_m_s2=Ned(wanted))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx(allowed, abs=1e-9)


@pytest.mark.parametrize("along", [(0.6, 0.8, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_at_a_speed_limit_drag_is_made_up_for_until_the_vehicle_is_past_it(along):
    ground = along[2] == 0.0
    limit_m_s = {0.0: 10.0, 1.0: 2.0, -1.0: 4.0}[along[2]]
    most_m_s2, asked_m_s2 = (5.0, 4.0) if ground else (3.0, 2.0)
    given = []
    for share in (0.0, 0.9, 1.0, 1.01, 1.025, 1.04, 1.05, 1.5):
        at = HOVER._replace(velocity_ned_m_s=share * limit_m_s * Ned(along))
        wanted = asked_m_s2 * Ned(along)
        limited = settled(
            tuple(limit_m_s * part for part in along), at, acceleration_ned_m_s2=wanted
        )
        given.append(
            sum(a * b for a, b in zip(limited.setpoint.acceleration_ned_m_s2, along, strict=True))
        )
    faded = [
        min(asked_m_s2, most_m_s2 * (1.0 - (share - 1.0) / 0.05)) for share in (1.01, 1.025, 1.04)
    ]
    assert given == pytest.approx([asked_m_s2] * 3 + faded + [0.0, 0.0], abs=1e-9)


def test_nothing_winds_up_behind_a_wall():
    fenced = replace(OPEN, fence_radius_m=6.0, jerk_m_s3=20.0)
    memory = None
    at_fence = Situation(Ned((6.0, 0.0, 0.0)), Ned((0.0, 0.0, 0.0)))
    for _ in range(200):
        memory = limit(Setpoint(Ned((8.0, 0.0, 0.0))), at_fence, fenced, memory, DT_S).memory
    assert memory.velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert memory.acceleration_ned_m_s2 == (0.0, 0.0, 0.0)
    released = limit(Setpoint(Ned((-8.0, 0.0, 0.0))), at_fence, fenced, memory, DT_S)
    assert released.setpoint.velocity_ned_m_s[0] == pytest.approx(-20.0 * DT_S**2)


def test_the_longest_step_is_no_late_one():
    limited = limit(
        Setpoint(Ned((0.5, 0.0, 0.0))), HOVER, OPEN, LimitMemory(Ned((0.0, 0.0, 0.0))), 0.1
    )
    assert limited.active == ()


@pytest.mark.parametrize(
    "command",
    [
        Setpoint(Ned((NOTED, 0.0, 0.0))),
        Setpoint(Ned((0.0, NOTED, 0.0))),
        Setpoint(Ned((0.0, 0.0, NOTED))),
        Setpoint(Ned((0.0, 0.0, 0.0)), yaw_rad=NOTED),
    ],
)
def test_a_change_of_just_what_is_noted_is_not_named(command):
    assert limit(command, HOVER, OPEN, LimitMemory(Ned((0.0, 0.0, 0.0))), 0.0).active == ()


def test_walls_that_were_measured_already_are_not_measured_again():
    fenced = replace(OPEN, fence_radius_m=1.0)
    memory = LimitMemory(Ned((8.0, 0.0, 0.0)))
    command = Setpoint(Ned((8.0, 0.0, 0.0)))
    assert limit(command, HOVER, fenced, memory, DT_S).active == (Limiter.FENCE_RADIUS,)
    assert limit(command, HOVER, fenced, memory, DT_S, walls=()).active == ()


@pytest.mark.parametrize("asked_m_s", [7.0, 7.2, 7.4, 7.6, 9.0])
def test_the_stand_off_ends_the_push_towards_it_as_it_takes_speed_away(asked_m_s):
    zone = replace(OPEN, stand_off=StandOff(radius_m=4.0, height_m=6.0))
    at = HOVER._replace(evader_position_ned_m=Ned((20.0, 0.0, 0.0)))
    limited = settled((asked_m_s, 0.0, 0.0), at, zone, acceleration_ned_m_s2=Ned((4.0, 1.0, 0.0)))
    taken_m_s = asked_m_s - limited.setpoint.velocity_ned_m_s[0]
    north, east, _ = limited.setpoint.acceleration_ned_m_s2
    assert (taken_m_s > 0.0) is (asked_m_s > 7.1)
    assert north == pytest.approx(min(4.0, 5.0 * max(0.0, 1.0 - taken_m_s)))
    assert east == pytest.approx(1.0)


def test_a_fence_ends_the_push_towards_it_at_once():
    square = Polygon(((-16.0, -16.0), (-16.0, 16.0), (16.0, 16.0), (16.0, -16.0)))
    fenced = replace(OPEN, fence_polygon=square)
    limited = settled((7.2, 0.0, 0.0), HOVER, fenced, acceleration_ned_m_s2=Ned((4.0, 1.0, 0.0)))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((0.0, 1.0, 0.0))


def test_a_slow_vehicles_speed_limit_is_one_too():
    slow = replace(OPEN, speed_m_s=0.5)
    at = HOVER._replace(velocity_ned_m_s=Ned((0.6, 0.0, 0.0)))
    limited = settled((0.5, 0.0, 0.0), at, slow, acceleration_ned_m_s2=Ned((4.0, 1.0, 0.0)))
    assert limited.setpoint.acceleration_ned_m_s2 == pytest.approx((0.0, 1.0, 0.0))
