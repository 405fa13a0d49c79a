"""Way lost to acceleration is made good, and never more than that."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control import follow
from guidance.control.follow import EASE, LARGEST_DEFICIT_M, Gaps, Pace
from guidance.frames import Ned

DT_S = 0.02
WANTED = (6.0, 0.0, 0.0)

speeds = st.floats(-12.0, 12.0)
velocities = st.tuples(speeds, speeds, speeds).map(Ned)


def catch_up(wanted, flown, deficit_m, dt_s=DT_S, most=1.05):
    """High above an evader that is near: no vertical speed is to spare."""
    return follow.catch_up(
        Ned(wanted),
        Ned(flown),
        deficit_m,
        Gaps(1.0, 1e3, Ned((1.0, 0.0, 0.0))),
        Pace(dt_s, most, 20.0),
    )


@given(velocities, velocities, st.floats(0.0, 12.0), st.floats(0.0, 0.5))
def test_never_more_than_the_limits_leave_is_added_and_the_direction_is_kept(
    wanted, flown, deficit_m, dt_s
):
    velocity, deficit_m = catch_up(wanted, flown, deficit_m, dt_s)
    size = math.hypot(*wanted)
    along = sum(w * f for w, f in zip(wanted[:2], flown[:2], strict=True))
    # What flies faster than the limits is told to fly slower
    slow = along <= 1.05 * math.hypot(*wanted[:2]) ** 2
    assert (size if slow else 0.0) - 1e-9 <= math.hypot(*velocity) <= 1.05 * size + 1e-9
    assert 0.0 <= deficit_m <= LARGEST_DEFICIT_M
    assert (
        sum(v * w for v, w in zip(velocity, wanted, strict=True))
        >= size * math.hypot(*velocity) - 1e-6
    )


@given(velocities, st.floats(0.0, 12.0))
def test_limits_at_the_games_speed_leave_nothing_to_catch_up_with(wanted, deficit_m):
    velocity, _ = catch_up(wanted, (0.0, 0.0, 0.0), deficit_m, most=1.0)
    assert velocity == wanted


@pytest.mark.parametrize("lag_s", [0.2, 0.5, 1.0])
def test_a_vehicle_from_hover_comes_as_far_as_the_games_pursuer_and_no_further(lag_s):
    flown = way_m = deficit_m = 0.0
    ahead_m = -math.inf
    for cycle in range(1, 3001):
        velocity, deficit_m = catch_up(WANTED, (flown, 0.0, 0.0), deficit_m)
        way_m += flown * DT_S
        flown += (velocity[0] - flown) * (1.0 - math.exp(-DT_S / lag_s))
        ahead_m = max(ahead_m, way_m - 6.0 * cycle * DT_S)
    # Without it, 6 m/s times the lag would be missing for ever.
    assert way_m == pytest.approx(6.0 * 3000 * DT_S, abs=0.1)
    assert ahead_m <= 0.05 * 6.0 * lag_s


def test_a_vehicle_over_the_speed_limit_is_commanded_to_fly_slower():
    for flown, told in ((6.3, 6.3), (6.4, 6.3 - EASE * 0.1), (40.0, 0.0)):
        velocity, _ = catch_up(WANTED, (flown, 0.0, 0.0), 12.0)
        assert velocity == pytest.approx((told, 0.0, 0.0))


@pytest.mark.parametrize(("most", "scale"), [(3.0, 2.0088), (1.5, 1.5)])
def test_a_slow_game_has_its_deficit_along_the_way_and_its_gain_as_well(most, scale):
    # 0.06 m/s of 0.5 m/s are flown along the way: 8.8 mm more are owed after 0.02 s, at half a metre a second for each.
    velocity, deficit_m = catch_up((0.3, -0.4, 0.2), (0.1, 0.0, 9.0), 1.0, most=most)
    assert deficit_m == pytest.approx(1.0088)
    assert velocity == pytest.approx((0.3 * scale, -0.4 * scale, 0.2 * scale))


def test_a_height_that_is_owed_is_not_made_good_over_ground():
    velocity, deficit_m = catch_up((6.0, 0.0, 1.5), (6.0, 0.0, 0.0), 0.0)
    assert (velocity, deficit_m) == ((6.0, 0.0, 1.5), 0.0)


def test_a_vehicle_that_cannot_keep_up_owes_no_more_than_the_limit():
    deficit_m = 0.0
    for _ in range(1000):
        _, deficit_m = catch_up(WANTED, (3.0, 0.0, 0.0), deficit_m)
    assert deficit_m == LARGEST_DEFICIT_M


def test_where_the_game_asks_for_no_motion_nothing_is_added_or_owed():
    assert catch_up((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), 4.0) == (
        (0.0, 0.0, 0.0),
        4.0,
    )
