"""A single constraint: the removed and kept parts of a velocity, and the surge of an accelerating vehicle."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.control import Envelope, Limiter, Situation
from guidance.control.braking_law import (
    ROUNDING_M,
    Constraint,
    Wall,
    constraints_of,
    reduced,
    surge,
)
from guidance.frames import Ned

parts = st.floats(-10.0, 10.0)
vectors = st.tuples(parts, parts, parts).map(Ned)
seconds = st.floats(0.1, 5.0)
constraints = st.builds(
    Constraint,
    st.just(Limiter.STAND_OFF),
    vectors,
    st.floats(0.0, 20.0),
    seconds,
    seconds,
    st.none(),
)


def slide(velocity, one):
    return reduced(velocity, one, along=True)


def shrink(velocity, one):
    return reduced(velocity, one, along=False)


def used_m(velocity, one):
    """The law, as it is written: what closes on the ground plus what closes vertically."""
    north, east, down = one.normal_ned
    closing = max(0.0, velocity[0] * north + velocity[1] * east)
    return closing * one.ground_s + max(0.0, velocity[2] * down) * one.vertical_s


@settings(deadline=None)
@given(vectors, constraints)
def test_what_slides_and_what_shrinks_obeys_the_law_and_what_obeys_is_left_alone(velocity, one):
    asks_too_much = used_m(velocity, one) > one.distance_m + ROUNDING_M
    assert (
        (slide(velocity, one) is not velocity)
        == (shrink(velocity, one) is not velocity)
        == asks_too_much
    )
    for kept in (slide(velocity, one), shrink(velocity, one)):
        assert used_m(kept, one) <= one.distance_m + 1e-9
        if not asks_too_much:
            assert kept == velocity
        else:
            assert used_m(kept, one) == pytest.approx(one.distance_m, abs=1e-9)


@settings(deadline=None)
@given(vectors, constraints)
def test_sliding_keeps_what_goes_along_the_wall_and_adds_no_speed(velocity, one):
    north, east, _ = one.normal_ned
    kept = slide(velocity, one)
    assert math.hypot(*kept[:2]) <= math.hypot(*velocity[:2]) + 1e-9
    assert 0.0 <= kept[2] * velocity[2] <= velocity[2] ** 2
    size = math.hypot(north, east)
    if size > 1e-3:  # along the wall: at right angles to its normal, over the ground
        before, after = ((-east * v[0] + north * v[1]) / size for v in (velocity, kept))
        assert after == pytest.approx(before, abs=1e-9)


@settings(deadline=None)
@given(vectors, constraints)
def test_shrinking_keeps_directions_and_touches_only_what_closes(velocity, one):
    north, east, down = one.normal_ned
    kept = shrink(velocity, one)
    asks_too_much = used_m(velocity, one) > one.distance_m + ROUNDING_M
    share = one.distance_m / used_m(velocity, one) if asks_too_much else 1.0
    ground = share if velocity[0] * north + velocity[1] * east > 0.0 else 1.0
    vertical = share if velocity[2] * down > 0.0 else 1.0
    assert kept == pytest.approx(
        (velocity[0] * ground, velocity[1] * ground, velocity[2] * vertical)
    )


@settings(deadline=None)
@given(vectors, constraints)
def test_velocity_along_a_closed_wall_is_kept_and_not_mistaken_for_rounding(velocity, one):
    closed = one._replace(distance_m=0.0)
    along = slide(velocity, closed)
    assert shrink(along, closed) is along


@settings(deadline=None)
@given(vectors, st.lists(constraints, min_size=2, max_size=5))
def test_shrinking_for_one_wall_breaks_no_other(velocity, several):
    for one in several:
        velocity = shrink(velocity, one)
    for one in several:
        assert used_m(velocity, one) <= one.distance_m + 1e-9


def test_a_slow_vehicle_is_held_back_as_a_fast_one_is():
    wall = Constraint(Limiter.FLOOR, Ned((0.0, 0.5, 2.0)), 0.2)
    # 0.15 m on the ground and 0.25 m vertically, of 0.2 m: half of each
    for scale in (
        1.0,
        10.0,
        100.0,
    ):
        moving = Ned((0.2 * scale, 0.3 * scale, 0.125 * scale))
        held = wall._replace(distance_m=0.2 * scale)
        assert slide(moving, held) == pytest.approx((0.2 * scale, 0.15 * scale, 0.0625 * scale))
        assert shrink(moving, held) == pytest.approx((0.1 * scale, 0.15 * scale, 0.0625 * scale))


@pytest.mark.parametrize(
    ("normal", "flown", "left_m"),
    [
        ((1.0, 0.0, 0.0), (3.0, 4.0, 5.0), 7.0),
        ((0.0, 1.0, 0.0), (3.0, 4.0, 5.0), 6.0),
        ((0.6, 0.8, 0.0), (3.0, 4.0, 5.0), 5.0),
        ((0.6, -0.8, 0.0), (3.0, -4.0, 5.0), 5.0),
        ((0.0, 0.0, 1.0), (3.0, 4.0, 5.0), 5.0),
        ((0.0, 0.0, -1.0), (3.0, 4.0, 5.0), 10.0),
        ((0.6, 0.0, 0.8), (3.0, 4.0, 5.0), 10.0 - 1.8 - 4.0),
        ((-0.6, 0.0, 0.8), (3.0, 4.0, 5.0), 6.0),
        ((0.6, 0.0, -0.8), (3.0, 4.0, 5.0), 8.2),
        ((1.0, 0.0, 0.0), (30.0, 0.0, 0.0), 0.0),
    ],
)
def test_a_wall_s_distance_is_what_the_drift_leaves_of_it(normal, flown, left_m):
    envelope = replace(ENVELOPE, reaction_s=1.0, braking_m_s2=2.0, vertical_braking_m_s2=0.5)
    # Seconds: 1 + 4/(2·2) = 2 over the ground, 1 + 2/(2·0.5) = 3 vertically
    asked = (
        0.0,
        4.0,
        2.0,
    )
    (built,) = constraints_of(
        Ned(asked),
        Situation(Ned(STILL), Ned(flown)),
        (Wall(Limiter.FLOOR, Ned(normal), 10.0),),
        envelope,
    )
    assert built.distance_m == pytest.approx(left_m)
    assert (built.normal_ned, built.ground_s, built.vertical_s) == (normal, 2.0, 3.0)
    assert built.limiter is Limiter.FLOOR


def test_beyond_a_wall_its_distance_is_nothing():
    wall = Wall(Limiter.FLOOR, Ned((0.0, 0.0, 1.0)), -5.0)
    assert (
        constraints_of(Ned(STILL), Situation(Ned(STILL), Ned(STILL)), (wall,), ENVELOPE)[
            0
        ].distance_m
        == 0.0
    )


@settings(deadline=None)
@given(vectors, vectors, vectors, st.floats(0.0, 60.0))
def test_a_wall_out_of_reach_would_change_nothing(asked, flown, normal, gap_m):
    size = math.hypot(*normal)
    if size > 1e-3:
        wall = Wall(Limiter.FLOOR, Ned(tuple(part / size for part in normal)), gap_m)
        here = Situation(Ned(STILL), Ned(flown))
        if not constraints_of(Ned(asked), here, (wall,), ENVELOPE):
            near = constraints_of(Ned(asked), here, (wall._replace(gap_m=-1.0),), ENVELOPE)[0]
            drift_m = ENVELOPE.reaction_s * used_m(
                flown, near._replace(ground_s=1.0, vertical_s=1.0)
            )
            assert used_m(asked, near) + drift_m <= gap_m + 1e-9


STILL = (0.0, 0.0, 0.0)
ENVELOPE = Envelope(
    floor_m=1.0,
    ceiling_m=50.0,
    speed_m_s=8.0,
    climb_m_s=3.0,
    descent_m_s=1.5,
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    yaw_rate_rad_s=1.0,
    braking_m_s2=2.3,
    reaction_s=0.4,
    easing_m_s3=3.0,
)


def come_to_rest(speed, acceleration, step_s=1e-4):
    """Let go of an acceleration at the jerk, do nothing for the reaction, and brake: how far that goes, by steps."""
    far = waited = 0.0
    while speed > 0.0:
        if acceleration > 0.0:
            acceleration = max(0.0, acceleration - ENVELOPE.easing_m_s3 * step_s)
            rate = acceleration
        else:
            rate = 0.0 if waited < ENVELOPE.reaction_s else -ENVELOPE.braking_m_s2
            waited += step_s
        far += speed * step_s + 0.5 * rate * step_s**2
        speed += rate * step_s
    return far


@pytest.mark.parametrize(("speed", "acceleration"), [(1.0, 3.0), (4.0, 3.5), (6.0, 1.0)])
def test_the_surge_is_how_much_further_it_goes(speed, acceleration):
    further = come_to_rest(speed, acceleration) - come_to_rest(speed, 0.0)
    way = (0.6, -0.8)
    felt = acceleration + 0.5  # that much is scatter
    longer = surge(
        Ned((speed * way[0], speed * way[1], -1.0)),
        Ned((felt * way[0], felt * way[1], 2.0)),
        ENVELOPE,
    )
    assert longer == pytest.approx((further * way[0], further * way[1], 0.0), abs=0.01)


@pytest.mark.parametrize("way", [(0.6, -0.8), (-0.8, 0.6), (0.28, 0.96)])
def test_only_what_brakes_of_an_acceleration_is_left_out_of_the_surge(way):
    north, east = way
    across = (-east, north)
    aside = surge(
        Ned((0.7 * north, 0.7 * east, 0.0)), Ned((2.5 * across[0], 2.5 * across[1], 0.0)), ENVELOPE
    )
    slowing = tuple(2.5 * b - 3.0 * a for a, b in zip(way, across, strict=True))
    assert surge(
        Ned((0.7 * north, 0.7 * east, 0.0)), Ned((*slowing, 0.0)), ENVELOPE
    ) == pytest.approx(aside)
    assert math.hypot(*aside) == pytest.approx(
        come_to_rest(0.7, 2.0) - come_to_rest(0.7, 0.0), abs=0.01
    )


def test_braking_and_scatter_are_no_surge_and_a_turn_is_one_to_its_side():
    assert surge(Ned((4.0, 0.0, 0.0)), Ned((-3.0, 0.0, 0.0)), ENVELOPE) == (0.0, 0.0, 0.0)
    assert surge(Ned((4.0, 0.0, 0.0)), Ned((0.3, 0.2, 5.0)), ENVELOPE) == (0.0, 0.0, 0.0)
    north, east, _ = surge(Ned((4.0, 0.0, 0.0)), Ned((-3.0, 2.0, 0.0)), ENVELOPE)
    assert abs(north) < 1e-12
    assert east > 1.0
    assert math.isfinite(east)
