"""A reserve to fly home: more is needed the further and higher, against the wind, and the flight returns in time."""

import math

import pytest

from guidance.autopilots import Mode
from guidance.config import parse_document
from guidance.control import Limits
from guidance.errors import ConfigError
from guidance.flight import Flight, Inputs, State
from guidance.flight.settings import Reserve
from guidance.messages import Attitude, LandedState
from tests.flight.flown import Flown
from tests.flight.scenes import NOW_S, heartbeat, home, local, settings_of, status

RESERVE = Reserve(
    endurance_s=600.0, left=0.1, return_speed_m_s=5.0, landing_speed_m_s=0.5, wind_m_s=2.0
)


def test_what_is_needed_is_the_way_home_against_the_wind_and_the_descent():
    # 300 m at 5 - 2 m/s and 20 m at 0.5 m/s are 100 s and 40 s, of 600 s; and a tenth is left.
    assert RESERVE.needed(300.0, 20.0) == pytest.approx(0.1 + 140.0 / 600.0)
    assert RESERVE.needed(0.0, -3.0) == pytest.approx(0.1)
    assert RESERVE.needed(1e9, 0.0) == 1.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"wind_m_s": 6.0}, "cannot fly home against the wind"),
        ({"wind_m_s": 5.0}, "cannot fly home against the wind"),
        ({"endurance_s": 0.0}, "endurance_s"),
        ({"left": 1.5}, "left"),
        ({"left": -0.1}, "left"),
        ({"wind_m_s": -1.0}, "wind_m_s"),
        ({"landing_speed_m_s": 2e6}, "landing_speed_m_s"),
        ({"return_speed_m_s": 0.0}, "return_speed_m_s"),
    ],
)
def test_an_impossible_reserve_is_refused(wrong, words):
    with pytest.raises(ConfigError, match=words):
        parse_document(Reserve, {"endurance_s": 600.0, **wrong}, source="reserve")


def test_the_reserve_needed_is_at_least_what_is_left_and_at_most_a_full_charge():
    assert Reserve(endurance_s=0.5, left=0.0).needed(0.0, 0.0) == 0.0
    assert Reserve(endurance_s=2.0, left=0.99).needed(100.0, 0.0) == 1.0
    assert RESERVE.needed(math.inf, 0.0) == RESERVE.needed(math.nan, 0.0) == 1.0


def test_a_certificate_gives_the_battery_needed_to_fly_home_if_configured():
    reckoned = Flown(settings_of(reserve=RESERVE, limits=Limits(fence_radius_m=100.0)))
    fixed = Flown()
    for flown in (reckoned, fixed):
        flown.position[0] = 60.0
        flown.engaged(evader=(120.0, 0.0)).cycle()
    assert reckoned.outputs.certificate.battery_needed == pytest.approx(
        0.1 + (60.0 / 3.0 + 10.0 / 0.5) / 600.0
    )
    assert math.isnan(fixed.outputs.certificate.battery_needed)


def held(away_m, battery, **changes):
    """A flight that stands by, so far from home, with so much battery."""
    flight = Flight(settings_of(reserve=RESERVE, limits=Limits(fence_radius_m=100.0), **changes))
    flight.stage.state = State.STANDING_BY
    flight.stage.left = frozenset({Mode.HOLD})
    said = [
        heartbeat(NOW_S),
        local(NOW_S, (away_m, 0.0, -14.0)),
        Attitude(NOW_S, NOW_S, 0.0),
        LandedState(NOW_S, 2),
    ]
    batteries = [status(NOW_S, battery)] * 3
    flight.step(NOW_S, Inputs([home(NOW_S), *said, *batteries]))
    return flight


@pytest.mark.parametrize("away_m", [50.0, 200.0])
def test_it_returns_from_where_what_is_left_just_brings_it_home(away_m):
    needed = held(away_m, 0.99).observed.battery_needed
    assert needed > 0.1 + away_m / 3.0 / 600.0
    assert held(away_m, needed + 0.01).state is State.STANDING_BY
    assert held(away_m, needed - 0.01).state is State.RETURNING


def test_without_a_reserve_the_fixed_share_holds_wherever_it_is():
    flight = held(50.0, 0.26)
    assert flight.state is State.STANDING_BY
    fixed = Flight(settings_of())
    assert fixed.observed.battery_needed == 0.25


def test_it_starts_only_with_enough_to_come_back_from_the_edge_of_its_fence():
    flight = Flight(settings_of(reserve=RESERVE, limits=Limits(fence_radius_m=300.0)))
    needed = RESERVE.needed(300.0, 10.0)
    for battery, passed in ((needed - 0.01, False), (needed + 0.01, True)):
        flight.step(
            NOW_S + battery,
            Inputs([heartbeat(NOW_S, Mode.HOLD, armed=False), status(NOW_S, battery)]),
        )
        assert {check.name: check.verdict == "pass" for check in flight.checks(NOW_S)}[
            "battery"
        ] is passed


def test_without_a_position_the_way_home_is_from_the_edge_of_the_fence():
    flown = Flown(settings_of(reserve=RESERVE, limits=Limits(fence_radius_m=300.0)))
    flown.cycles(0.1)
    assert flown.flight.observed.battery_needed == RESERVE.needed(300.0, 10.0)
    lost = Flight(settings_of(reserve=RESERVE, limits=Limits(fence_radius_m=300.0)))
    lost.stage.state = State.STANDING_BY
    assert lost.observed.battery_needed == RESERVE.needed(300.0, 10.0)
