"""The approach to the stand-off disc: braking distances, and loops closed over lagging vehicles."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from guidance.autopilots import AUTOPILOTS
from guidance.control.follow import RETREAT_M, Approach, Gaps, approach
from guidance.frames import STILL, Ned

DT_S = 0.02
SETTINGS = Approach(braking_m_s2=2.0, vertical_braking_m_s2=1.0, lag_s=0.3, margin_m=0.15)
FAR = Gaps(500.0, 100.0, Ned((1.0, 0.0, 0.0)))

speeds = st.floats(-12.0, 12.0)
velocities = st.tuples(speeds, speeds, speeds).map(Ned)
settings = st.sampled_from(
    [SETTINGS, *(autopilot.handling.approach for autopilot in AUTOPILOTS.values())]
)


@st.composite
def all_gaps(draw):
    bearing = draw(st.floats(0.0, math.tau))
    return Gaps(
        draw(st.floats(-5.0, 60.0)),
        draw(st.floats(-5.0, 60.0)),
        Ned((math.cos(bearing), math.sin(bearing), 0.0)),
    )


def closing(velocity, evader, gaps):
    return (velocity[0] - evader[0]) * gaps.towards_ned.north + (
        velocity[1] - evader[1]
    ) * gaps.towards_ned.east


def across(velocity, evader, gaps):
    return (velocity[1] - evader[1]) * gaps.towards_ned.north - (
        velocity[0] - evader[0]
    ) * gaps.towards_ned.east


@given(velocities, velocities, velocities, all_gaps(), settings)
def test_never_asks_to_close_faster_than_can_be_braked(wanted, flown, evader, gaps, settings):
    assume(
        evader[0] * gaps.towards_ned.north + evader[1] * gaps.towards_ned.east >= 0.0
    )  # it flees
    velocity, _ = approach(wanted, flown, evader, gaps, settings)
    asked = closing(velocity, evader, gaps)
    assert asked <= closing(wanted, evader, gaps) + 1e-9
    used_m = settings.lag_s * closing(flown, evader, gaps)
    left_m = gaps.ground_m - settings.margin_m - used_m
    if asked > 1e-6:
        assert (
            asked * settings.settle_s + asked**2 / (2.0 * settings.braking_m_s2)
            <= max(left_m, 0.0) + 1e-6
        )
    if left_m <= 0.0:
        assert asked <= 1e-9


@given(velocities, velocities, velocities, all_gaps(), settings)
def test_never_adds_speed_across_the_line_of_sight(wanted, flown, evader, gaps, settings):
    velocity, braking = approach(wanted, flown, evader, gaps, settings)
    assert abs(across(velocity, evader, gaps)) <= abs(across(wanted, evader, gaps)) + 1e-9
    if not braking:
        assert velocity[:2] == wanted[:2]


@given(velocities, velocities, velocities, all_gaps(), settings)
def test_never_descends_or_climbs_faster_than_can_be_braked(wanted, flown, evader, gaps, settings):
    down = approach(wanted, flown, evader, gaps, settings)[0][2]
    assert abs(down) <= abs(wanted[2])
    assert down * wanted[2] >= 0.0
    distance_m = max(abs(gaps.height_m), abs(gaps.height_m) + settings.lag_s * abs(flown[2]))
    assert down**2 / (2.0 * settings.vertical_braking_m_s2) <= distance_m + 1e-6


@given(velocities, velocities, velocities)
def test_far_away_nothing_is_touched(wanted, flown, evader):
    velocity, braking = approach(wanted, flown, evader, FAR, SETTINGS)
    assert velocity[:2] == wanted[:2]
    assert not braking


@pytest.mark.parametrize("evader", [STILL, Ned((3.0, 0.0, 0.0)), Ned((-1.0, 2.0, 0.0))])
def test_at_rest_before_the_rim_the_velocity_is_the_evaders(evader):
    rim = Gaps(SETTINGS.margin_m, 0.0, Ned((1.0, 0.0, 0.0)))
    velocity, braking = approach(Ned((6.0, 1.0, 0.0)), evader, evader, rim, SETTINGS)
    # It retreats more slowly than the evader comes
    waited_m_s = max(0.0, -evader[0]) * SETTINGS.margin_m / RETREAT_M
    assert velocity == pytest.approx((evader[0] + waited_m_s, evader[1], 0.0))
    assert braking


@pytest.mark.parametrize(
    ("ground_m", "closing_m_s", "allowed_m_s", "kept"),
    [
        (0.150 + 0.25 * 0.3 + 0.25**2 / 4.0, 0.5, 0.25, 0.5),
        (0.150 + 1.50 * 0.3 + 1.50**2 / 4.0, 2.0, 1.50, 0.75),
        (0.150 - 0.3, 0.8, -0.5, 0.0),  # inside: back off, and nothing across
        (0.150 - 0.3, -0.2, -0.5, 0.0),
        (0.150 - 9.0, -0.6, -1.0, 0.0),
    ],
)
@pytest.mark.parametrize("towards", [(0.6, 0.8), (-0.8, 0.6), (0.0, -1.0)])
def test_what_goes_across_the_line_of_sight_fades_as_the_closing_does(
    towards, ground_m, closing_m_s, allowed_m_s, kept
):
    def moving(along, across):
        along = along + 2.0
        across = across - 1.0  # the evader flees
        return Ned(
            (
                along * towards[0] - across * towards[1],
                along * towards[1] + across * towards[0],
                0.0,
            )
        )

    evader = moving(0.0, 0.0)
    gaps = Gaps(ground_m, 0.0, Ned((*towards, 0.0)))
    velocity, braking = approach(moving(closing_m_s, 0.7), evader, evader, gaps, SETTINGS)
    assert velocity == pytest.approx(moving(allowed_m_s, 0.7 * kept))
    assert braking


def test_the_speed_allowed_is_the_root_of_the_stopping_distance():
    bare = Approach(
        braking_m_s2=2.0, vertical_braking_m_s2=1.0, lag_s=0.0, settle_s=0.3, margin_m=0.0
    )
    for left_m in (0.0, 0.01, 0.5, 3.0, 40.0):
        (v, _, _), _ = approach(
            Ned((50.0, 0.0, 0.0)),
            STILL,
            STILL,
            Gaps(left_m, 0.0, Ned((1.0, 0.0, 0.0))),
            bare,
        )
        assert v * 0.3 + v * v / 4.0 == pytest.approx(left_m)


def _rest_m(settings, coming_m_s):
    """Gap at which it backs off as fast as the evader comes: w = c·g/2 and margin − g = 2·w·(settle + w/b)."""
    waited_s = coming_m_s / RETREAT_M
    quadratic = 2.0 * waited_s**2 / settings.braking_m_s2
    linear = 1.0 + 2.0 * waited_s * settings.settle_s
    if quadratic == 0.0:
        return settings.margin_m
    return (math.sqrt(linear**2 + 4.0 * quadratic * settings.margin_m) - linear) / (2.0 * quadratic)


@pytest.mark.parametrize("pace", [0.0, 3.0, -1.0])
@pytest.mark.parametrize("lag_s", [0.1, 0.3])
@pytest.mark.parametrize("name", sorted(AUTOPILOTS))
def test_a_vehicle_that_lags_no_more_than_planned_never_enters_the_disc(name, lag_s, pace):
    settings = AUTOPILOTS[name].handling.approach
    evader = (pace, 0.0, 0.0)
    gap_m = 40.0
    flown = 0.0
    reached_s = math.inf
    for cycle in range(2000):
        wanted = approach(
            Ned((6.0, 0.0, 0.0)),
            Ned((flown, 0.0, 0.0)),
            Ned(evader),
            Gaps(gap_m, 0.0, Ned((1.0, 0.0, 0.0))),
            settings,
        )[0]
        flown += (wanted[0] - flown) * (1.0 - math.exp(-DT_S / lag_s))
        gap_m -= (flown - pace) * DT_S
        assert gap_m >= 0.0
        if gap_m <= 0.5:
            reached_s = min(reached_s, cycle * DT_S)
    assert gap_m == pytest.approx(
        _rest_m(settings, max(0.0, -pace)), abs=0.01 if pace < 0.0 else 0.02
    )
    assert flown == pytest.approx(pace, abs=0.02)
    # Beside full speed to the rim: braking costs half of its time, and what is planned with to answer and to settle.
    closing = 6.0 - pace
    braking_s = 0.5 * closing / settings.braking_m_s2
    assert reached_s <= 39.5 / closing + braking_s + 2.0 * (settings.lag_s + settings.settle_s)


@pytest.mark.parametrize("lag_s", [0.1, 0.3])
@pytest.mark.parametrize(("height_m", "wanted"), [(15.0, 1.5), (-4.0, -3.0), (40.0, 3.0)])
@pytest.mark.parametrize("name", sorted(AUTOPILOTS))
def test_the_height_of_the_disc_is_reached_without_overshoot(name, height_m, wanted, lag_s):
    settings = AUTOPILOTS[name].handling.approach
    flown = 0.0
    side = math.copysign(1.0, height_m)
    for _ in range(2500):
        # The game turns the sign of its vertical speed at the height of the disc.
        game = math.copysign(wanted, height_m)
        down = approach(
            Ned((0.0, 0.0, game)),
            Ned((0.0, 0.0, flown)),
            STILL,
            Gaps(40.0, height_m, Ned((1.0, 0.0, 0.0))),
            settings,
        )[0][2]
        flown += (down - flown) * (1.0 - math.exp(-DT_S / lag_s))
        height_m -= flown * DT_S
        assert height_m * side >= -0.02
    assert abs(height_m) < 0.05


@pytest.mark.parametrize("height_m", [0.0, 3.0])
def test_an_evader_that_comes_is_waited_for_at_the_discs_height_and_fled_from_above_it(height_m):
    evader = (-4.0, 0.0, 0.0)
    gaps = Gaps(3.0, height_m, Ned((1.0, 0.0, 0.0)))
    velocity, _ = approach(STILL, STILL, Ned(evader), gaps, SETTINGS)
    assert velocity[0] == pytest.approx(0.0) if height_m == 0.0 else velocity[0] < -1.0
