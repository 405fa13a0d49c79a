"""A height that is held by a velocity, against its closed forms."""

import math
from dataclasses import replace

import pytest

from guidance.control import AltitudeHold, hold_altitude
from tests.control.scenes import DT_S, OPEN


def held_at(error_m, *, trim_m_s=0.0, dt_s=DT_S, **limits):
    """A hold at 50 m, found `error_m` too high (down positive: it has to sink by that much)."""
    envelope = replace(OPEN, **limits)
    memory = AltitudeHold(-50.0, trim_m_s)
    return hold_altitude(memory, down_m=-50.0 - error_m, envelope=envelope, dt_s=dt_s)


@pytest.mark.parametrize("error_m", [0.1, -0.1, 1.0, -1.0, 3.0])
def test_a_hold_asks_for_the_speed_that_still_brakes_at_the_height(error_m):
    out = held_at(error_m, dt_s=0.0)
    speed = abs(out.velocity_down_m_s)
    assert math.copysign(1.0, out.velocity_down_m_s) == math.copysign(1.0, error_m)
    # gain 0.8/s near the height, √(2 · braking · distance) far from it: v/0.8 + v²/(2 · braking) = distance.
    assert speed / 0.8 + speed**2 / (2.0 * OPEN.vertical_braking_m_s2) == pytest.approx(abs(error_m))


@pytest.mark.parametrize(("error_m", "speed"), [(500.0, 2.0), (-500.0, -4.0)])
def test_a_hold_far_away_climbs_and_sinks_at_the_limits(error_m, speed):
    assert held_at(error_m, trim_m_s=0.1).velocity_down_m_s == speed


@pytest.mark.parametrize(
    ("error_m", "dt_s", "trim_m_s"),
    [
        (0.5, 0.02, 0.1 + 0.08 * 0.5 * 0.02),
        (-0.5, 0.05, 0.1 - 0.08 * 0.5 * 0.05),
        (1.49, 0.02, 0.1 + 0.08 * 1.49 * 0.02),
        (1.51, 0.02, 0.1),  # far away it waits
        (0.5, 7.0, 0.1 + 0.08 * 0.5 * 0.1),  # a late step is not made up for
        (0.5, -7.0, 0.1),
        (0.5, math.nan, 0.1),
    ],
)
def test_the_trim_of_a_hold_is_the_slow_integral_of_a_small_error(error_m, dt_s, trim_m_s):
    out = held_at(error_m, trim_m_s=0.1, dt_s=dt_s)
    assert out.memory == AltitudeHold(-50.0, pytest.approx(trim_m_s))
    assert out.velocity_down_m_s - held_at(error_m, dt_s=0.0).velocity_down_m_s == pytest.approx(trim_m_s)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_trim_of_a_hold_is_bounded(sign):
    assert held_at(sign, trim_m_s=0.4999 * sign, dt_s=0.1).memory.trim_m_s == 0.5 * sign


def test_a_hold_begins_without_trim_and_keeps_the_height_that_it_began_at():
    begun = hold_altitude(None, down_m=-50.0, envelope=OPEN, dt_s=DT_S)
    assert begun == (0.0, AltitudeHold(-50.0, 0.0))
    sunk = hold_altitude(begun.memory, down_m=-40.0, envelope=OPEN, dt_s=DT_S)
    assert sunk.memory.down_m == -50.0
    assert sunk.velocity_down_m_s < 0.0


@pytest.mark.parametrize(("down_m", "held_m"), [(-3.0, -10.0), (-90.0, -40.0)])
def test_a_hold_stays_between_floor_and_ceiling_above_home(down_m, held_m):
    between = replace(OPEN, floor_m=5.0, ceiling_m=35.0, home_ned_m=(0.0, 0.0, -5.0))
    assert hold_altitude(None, down_m=down_m, envelope=between, dt_s=DT_S).memory.down_m == held_m
