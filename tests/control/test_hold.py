"""Limits on a height, commanded beside a velocity or held by one, against their closed forms."""

import math
from dataclasses import replace

import pytest

from guidance.control import AltitudeHold, Limiter, Situation, StandOffLimit, hold_altitude
from tests.control.scenes import DT_S, OPEN, settled

ZONE = replace(OPEN, stand_off=StandOffLimit(radius_m=3.0, height_m=5.0))


@pytest.mark.parametrize(
    ("wanted_m", "vertical", "limits", "sent_m"),
    [
        (-21.0, 0.0, {}, -21.0),
        (-40.0, 0.0, {}, -24.0),  # gain 1: no more than the climb of 4 m/s
        (-40.0, -1.0, {}, -23.0),  # of which one is commanded already
        (0.0, 0.0, {}, -18.0),
        (-18.0, 0.0, {"floor_m": 19.5}, -20.0 + 0.5 / 1.5),  # the braking curve of the floor
        (-15.0, 0.0, {"floor_m": 25.0}, -20.0),  # below the floor: no deeper
        (-22.0, 0.0, {"floor_m": 25.0}, -22.0),  # the way back is free
        (-60.0, 0.0, {"height_gain_per_s": 0.1, "ceiling_m": 30.0}, -30.0),  # never beyond, however slow
        (-10.0, 0.0, {"height_gain_per_s": 0.1, "floor_m": 15.0}, -15.0),
        (-10.0, 0.0, {"height_gain_per_s": 2.0}, -19.0),
    ],
)
def test_a_height_is_cut_to_what_the_autopilot_may_make_of_it(wanted_m, vertical, limits, sent_m):
    at = Situation((0.0, 0.0, -20.0), (0.0, 0.0, 0.0))
    limited = settled((0.0, 0.0, vertical), at, replace(OPEN, **limits), down_m=wanted_m)
    assert limited.setpoint.down_m == pytest.approx(sent_m)
    assert (Limiter.HEIGHT in limited.active) == (sent_m != wanted_m)


@pytest.mark.parametrize(
    ("position", "sent_m"),
    [
        ((1.0, 0.0, -6.0), -6.0 + 1.0 / 1.5),  # above the lid: its braking curve
        ((4.0, 0.0, -2.0), 0.0 - 2.0 + 2.0),  # beside: down is free
        ((1.0, 0.0, -2.0), -2.0),  # inside: no deeper
        ((3.3, 0.0, -5.4), -5.4),  # across the rim: what may not be, is not
    ],
)
def test_a_height_does_not_lead_into_the_stand_off(position, sent_m):
    at = Situation(position, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    assert settled((0.0, 0.0, 0.0), at, ZONE, down_m=30.0).setpoint.down_m == pytest.approx(sent_m)


def held_at(error_m, *, trim_m_s=0.0, dt_s=DT_S, **limits):
    """A hold at 50 m, found `error_m` too high (down positive: it has to sink by that much)."""
    envelope = replace(OPEN, **limits)
    memory = AltitudeHold(-50.0, trim_m_s)
    return hold_altitude(memory, down_m=-50.0 - error_m, desired_down_m=None, envelope=envelope, dt_s=dt_s)


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


def test_a_hold_begins_without_trim_and_keeps_a_wanted_height_over_its_own():
    begun = hold_altitude(None, down_m=-50.0, desired_down_m=None, envelope=OPEN, dt_s=DT_S)
    assert begun == (0.0, AltitudeHold(-50.0, 0.0))
    moved = hold_altitude(begun.memory, down_m=-50.0, desired_down_m=-60.0, envelope=OPEN, dt_s=DT_S)
    assert moved.memory.down_m == -60.0
    assert moved.velocity_down_m_s < 0.0
    kept = hold_altitude(moved.memory, down_m=-50.0, desired_down_m=None, envelope=OPEN, dt_s=DT_S)
    assert kept.memory.down_m == -60.0


@pytest.mark.parametrize(("down_m", "held_m"), [(-3.0, -10.0), (-90.0, -40.0)])
def test_a_hold_stays_between_floor_and_ceiling_above_home(down_m, held_m):
    between = replace(OPEN, floor_m=5.0, ceiling_m=35.0, home_ned_m=(0.0, 0.0, -5.0))
    assert hold_altitude(None, down_m=down_m, desired_down_m=None, envelope=between, dt_s=DT_S).memory.down_m == held_m
