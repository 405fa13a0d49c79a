"""A height that is held by a velocity, against its closed forms."""

import math
from dataclasses import replace

import pytest

from guidance.control.servo import AltitudeHold, hold_altitude, keep_station
from guidance.frames import Ned
from tests.control.scenes import DT_S, OPEN


def held_at(error_m, *, trim_m_s=0.0, dt_s=DT_S, **limits):
    """A hold at 50 m, found `error_m` too high (down positive: it has to sink by that much)."""
    envelope = replace(OPEN, **limits)
    memory = AltitudeHold(-50.0, trim_m_s)
    return hold_altitude(memory, down_m=-50.0 - error_m, envelope=envelope, dt_s=dt_s)


@pytest.mark.parametrize("error_m", [0.1, -0.1, 1.0, -1.0, 3.0])
def test_a_hold_asks_for_the_speed_that_still_brakes_at_the_height(error_m):
    down_m_s, _ = held_at(error_m, dt_s=0.0)
    speed = abs(down_m_s)
    assert math.copysign(1.0, down_m_s) == math.copysign(1.0, error_m)
    # gain 0.8/s near the height, √(2 · braking · distance) far from it: v/0.8 + v²/(2 · braking) = distance.
    assert speed / 0.8 + speed**2 / (2.0 * OPEN.vertical_braking_m_s2) == pytest.approx(
        abs(error_m)
    )


@pytest.mark.parametrize(("error_m", "speed"), [(500.0, 2.0), (-500.0, -4.0)])
def test_a_hold_far_away_climbs_and_sinks_at_the_limits(error_m, speed):
    assert held_at(error_m, trim_m_s=0.1)[0] == speed


@pytest.mark.parametrize(
    ("error_m", "dt_s", "trim_m_s"),
    [
        (0.5, 0.02, 0.1 + 0.08 * 0.5 * 0.02),
        (-0.5, 0.05, 0.1 - 0.08 * 0.5 * 0.05),
        (1.49, 0.02, 0.1 + 0.08 * 1.49 * 0.02),
        (1.51, 0.02, 0.1),  # far away it waits
        (-1.51, 0.02, 0.1),
        (0.5, 7.0, 0.1 + 0.08 * 0.5 * 0.1),  # a late step is not made up for
        (0.5, -7.0, 0.1),
        (0.5, math.nan, 0.1),
    ],
)
def test_the_trim_of_a_hold_is_the_slow_integral_of_a_small_error(error_m, dt_s, trim_m_s):
    (trimmed_m_s, memory) = held_at(error_m, trim_m_s=0.1, dt_s=dt_s)
    (plain_m_s, _) = held_at(error_m, dt_s=0.0)
    assert memory == AltitudeHold(-50.0, pytest.approx(trim_m_s))
    assert trimmed_m_s - plain_m_s == pytest.approx(trim_m_s)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_trim_of_a_hold_is_bounded(sign):
    assert held_at(sign, trim_m_s=0.4999 * sign, dt_s=0.1)[1].trim_m_s == 0.5 * sign


def test_a_hold_begins_without_trim_and_keeps_the_height_that_it_began_at():
    begun = _, memory = hold_altitude(None, down_m=-50.0, envelope=OPEN, dt_s=DT_S)
    assert begun == (0.0, AltitudeHold(-50.0, 0.0))
    down_m_s, memory = hold_altitude(memory, down_m=-40.0, envelope=OPEN, dt_s=DT_S)
    assert memory.down_m == -50.0
    assert down_m_s < 0.0


@pytest.mark.parametrize(("down_m", "held_m"), [(-3.0, -10.0), (-90.0, -40.0)])
def test_a_hold_stays_between_floor_and_ceiling_above_home(down_m, held_m):
    between = replace(OPEN, floor_m=5.0, ceiling_m=35.0, home_ned_m=Ned((0.0, 0.0, -5.0)))
    assert hold_altitude(None, down_m=down_m, envelope=between, dt_s=DT_S)[1].down_m == held_m


@pytest.mark.parametrize("down_m", [math.nan, -math.inf, 1e9])
def test_a_height_that_is_no_number_commands_nothing_and_forgets_nothing(down_m):
    memory = AltitudeHold(-50.0, 0.3)
    for held in (memory, None):
        assert hold_altitude(held, down_m=down_m, envelope=OPEN, dt_s=DT_S) == (0.0, held)


@pytest.mark.parametrize(
    ("off", "velocity", "held"),
    [
        ((0.3, -0.4), (0.24, -0.32), True),  # 0.8/s
        ((0.6, 0.0), (0.48, 0.0), True),
        ((0.78, -1.04), (0.3, -0.4), True),  # no faster than 0.5 m/s
        ((-0.894, 1.192), (-0.3, 0.4), True),
        ((0.906, 1.208), (0.0, 0.0), False),  # more than a metre and a half: here is the place
    ],
)
def test_a_place_is_held_in_proportion_and_slowly_and_no_old_place_is_chased(off, velocity, held):
    here = (10.0, -20.0)
    place = (here[0] + off[0], here[1] + off[1])
    asked, kept = keep_station(place, Ned((*here, -5.0)), Ned((9.0, 9.0, 9.0)))
    assert asked == pytest.approx(velocity)
    assert kept == (place if held else here)


@pytest.mark.parametrize(
    ("flown", "begun"), [((0.29, -0.39, 2.0), True), ((0.31, -0.41, 0.0), False)]
)
def test_a_place_is_taken_once_the_vehicle_is_slow_over_the_ground(flown, begun):
    assert keep_station(None, Ned((1.0, 2.0, -5.0)), Ned(flown)) == (
        (0.0, 0.0),
        (1.0, 2.0) if begun else None,
    )
