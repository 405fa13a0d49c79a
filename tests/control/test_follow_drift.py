"""The drift between reported velocity and reported positions, and the place that is held by it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guidance.control.follow import LARGEST_CORRECTION_M_S, Drift, observe_drift
from guidance.control.servo import keep_station
from guidance.frames import Ned

DT_S = 0.02
coordinates = st.floats(-50.0, 50.0)
vectors = st.tuples(coordinates, coordinates, coordinates).map(Ned)
STILL = (0.0, 0.0, 0.0)


def drive(*, seconds, velocity, error, hold_cycles=1):
    """Report a motion whose velocity is off by `error(t)`; positions come every `hold_cycles` cycles, as streams do."""
    drift = Drift()
    place = [0.0, 0.0, 0.0]
    reported = (0.0, 0.0, 0.0)
    for cycle in range(round(seconds / DT_S)):
        now_s = cycle * DT_S
        true = velocity(now_s)
        if cycle % hold_cycles == 0:
            reported = tuple(place)
        told = tuple(v + e for v, e in zip(true, error(now_s), strict=True))
        drift = observe_drift(drift, Ned(reported), Ned(told), dt_s=DT_S)
        place = [p + v * DT_S for p, v in zip(place, true, strict=True)]
    return drift.velocity_ned_m_s


@pytest.mark.parametrize("hold_cycles", [1, 2])
def test_a_constant_error_is_found(hold_cycles):
    found = drive(
        seconds=15.0,
        velocity=lambda _now_s: (6.0, -2.0, 1.5),
        error=lambda _now_s: (0.2, -0.3, 0.1),
        hold_cycles=hold_cycles,
    )
    assert found == pytest.approx((0.2, -0.3, 0.1), abs=0.05)


def test_an_error_that_wanders_slowly_is_followed():
    found = drive(
        seconds=40.0,
        velocity=lambda now_s: (6.0 * math.sin(now_s), 0.0, 0.0),
        error=lambda now_s: (0.0, 0.3 * math.sin(0.1 * now_s), 0.0),
    )
    assert found == pytest.approx((0.0, 0.3 * math.sin(4.0), 0.0), abs=0.1)


@given(st.lists(st.tuples(vectors, vectors, st.floats(0.0, 1.0)), min_size=1, max_size=40))
def test_the_drift_is_bounded_whatever_is_reported(reports):
    drift = Drift()
    for position, velocity, dt_s in reports:
        drift = observe_drift(drift, Ned(position), Ned(velocity), dt_s=dt_s)
        assert all(abs(part) <= LARGEST_CORRECTION_M_S for part in drift.velocity_ned_m_s)


KNOWN = Drift(Ned((0.1, -0.2, 0.3)), Ned((5.0, -6.0, -20.0)))
FLOWN = (2.1, -1.2, 0.8)  # by what is known, 2.0, -1.0 and 0.5 m/s over the ground


@pytest.mark.parametrize(
    ("dt_s", "counted_s"), [(0.0, 0.0), (0.05, 0.05), (0.1, 0.1), (0.4, 0.1), (-1.0, 0.0)]
)
@pytest.mark.parametrize("off", [(0.3, -0.6, 0.12), (-0.9, 0.0, 0.0), (0.0, 0.9, 0.3)])
def test_one_report_moves_place_and_drift_by_its_share_of_what_it_is_off(off, dt_s, counted_s):
    expected = [
        at + speed * counted_s
        for at, speed in zip(KNOWN.position_ned_m, (2.0, -1.0, 0.5), strict=True)
    ]
    reported = tuple(at + by for at, by in zip(expected, off, strict=True))
    after = observe_drift(KNOWN, Ned(reported), Ned(FLOWN), dt_s=dt_s)
    # Two poles at -1/1.2 s: 2/1.2 of an error a second for the place, 1/1.2² for the drift.
    assert after.position_ned_m == pytest.approx(
        [at + by * counted_s / 0.6 for at, by in zip(expected, off, strict=True)]
    )
    assert after.velocity_ned_m_s == pytest.approx(
        [was - by * counted_s / 1.44 for was, by in zip(KNOWN.velocity_ned_m_s, off, strict=True)]
    )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_error_above_one_metre_is_a_jump_that_teaches_nothing_and_drift_is_bounded(axis, side):
    def along(size):
        return tuple(side * size if n == axis else 0.0 for n in range(3))

    known = Ned(along(0.2))
    for off_m, jumped in ((1.19, False), (1.21, True)):  # a sixth of it is taken up within 0.1 s
        after = observe_drift(Drift(known, Ned(STILL)), Ned(along(off_m)), known, dt_s=0.1)
        assert (after == Drift(known, Ned(along(off_m)))) is jumped
    for known, learned in ((0.599, 0.6), (0.5, 0.5 + 0.05 / 1.44)):
        after = observe_drift(
            Drift(Ned(along(known)), Ned(STILL)),
            Ned(along(-0.5 - 0.1 * known)),
            Ned(STILL),
            dt_s=0.1,
        )
        assert after.velocity_ned_m_s == pytest.approx(along(learned))


def test_a_place_is_held_against_an_autopilot_that_slides():
    slide = (0.2, -0.1)  # m/s, by which the autopilot's velocity is wrong
    drift = Drift()
    place = None
    here = [0.0, 0.0]
    flown = [0.0, 0.0]
    for _ in range(3000):
        told = (flown[0] + slide[0], flown[1] + slide[1], 0.0)
        drift = observe_drift(drift, Ned((here[0], here[1], -5.0)), Ned(told), dt_s=DT_S)
        less = tuple(v - d for v, d in zip(told, drift.velocity_ned_m_s, strict=True))
        (north, east), place = keep_station(place, Ned((here[0], here[1], -5.0)), Ned(less))
        for axis, asked in enumerate((north, east)):
            command = asked + drift.velocity_ned_m_s[axis]
            flown[axis] += (command - slide[axis] - flown[axis]) * (1.0 - math.exp(-DT_S / 0.3))
            here[axis] += flown[axis] * DT_S
    assert flown == pytest.approx([0.0, 0.0], abs=0.01)
    assert math.dist(here, place) < 0.05
