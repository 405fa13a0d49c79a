"""Mates in a flight's cycle: a cylinder around each, a growing one around a silent one, and another evader."""

import math

import pytest

from guidance.autopilots import PX4
from guidance.control import Limiter
from guidance.flight.freshness import FORGOTTEN_S, HOLD_S
from guidance.flight.observed import MOST_AIRCRAFT, Observed
from guidance.flight.settings import Inputs, TeamSection
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.messages import Aircraft, EvaderReport, MateState, Origin, Role
from tests.flight.scenes import HOME_DOWN_M, SETTINGS, home, local

HERE = (47.397742, 8.545594)
ZERO = LocalFrame(*HERE, Amsl(488.0), projection=PX4.projection)
TEAM = SETTINGS.model_copy(
    update={
        "team": TeamSection(separation_m=8.0, separation_height_m=3.0),
        "evaders": {"red": 2.0, "blue": 3.0},
    }
)
AT_S = 100.0
UP_M = HOME_DOWN_M - 10.0


def mate(north_m, *, at_s=AT_S, velocity=(0.0, 0.0, 0.0), airborne=True, doubt_m=0.0):
    latitude, longitude, altitude = ZERO.wgs84_from_ned(Ned((north_m, 0.0, UP_M)))
    return MateState(
        "bravo", at_s, latitude, longitude, altitude.metres, Ned(velocity), 6.0, doubt_m, airborne
    )


def observed(*mates, now_s=AT_S, role=None, reports=()):
    one = Observed(TEAM)
    messages = [home(AT_S), Origin(AT_S, *HERE, 488.0), local(AT_S, (0.0, 0.0, UP_M))]
    one.take_in(AT_S, Inputs(messages, reports, mates=mates, role=role), in_flight=True)
    if now_s != AT_S:
        one.take_in(now_s, Inputs(), in_flight=True)
    return one


def gap_m(one, now_s=AT_S):
    walls = [wall for wall in one.view(now_s).walls if wall.limiter is Limiter.SEPARATION]
    return 2.0 * walls[0].gap_m if walls else math.inf


def test_a_mate_is_a_wall_at_the_separation():
    assert gap_m(observed(mate(30.0))) == pytest.approx(22.0, abs=0.01)
    assert gap_m(observed(mate(30.0, doubt_m=5.0))) == pytest.approx(17.0, abs=0.01)
    assert gap_m(observed(mate(30.0, airborne=False))) == math.inf


def aircraft(north_m, *, name="ICAO 3C6444", velocity=(0.0, 0.0, 0.0), error_m=0.0, **changes):
    latitude, longitude, altitude = ZERO.wgs84_from_ned(Ned((north_m, 0.0, UP_M)))
    known = Aircraft(AT_S, name, latitude, longitude, altitude.metres, Ned(velocity), 0.0, error_m)
    return known._replace(**changes)


def flown_beside(*others, mates=(), now_s=AT_S, reports=(), settings=TEAM):
    one = Observed(settings)
    messages = [home(AT_S), Origin(AT_S, *HERE, 488.0), local(AT_S, (0.0, 0.0, UP_M)), *others]
    one.take_in(AT_S, Inputs(messages, reports, mates=mates, role=Role("red")), in_flight=True)
    if now_s != AT_S:
        one.take_in(now_s, Inputs(), in_flight=True)
    return one


def test_another_aircraft_is_a_disc_that_grows_until_it_is_forgotten():
    assert gap_m(flown_beside(aircraft(90.0))) == pytest.approx(82.0, abs=0.01)
    assert gap_m(flown_beside(aircraft(90.0, error_m=30.0))) == pytest.approx(52.0, abs=0.01)
    moving = [
        gap_m(flown_beside(aircraft(90.0, velocity=(0.0, 8.0, 0.0), age_s=age_s)))
        for age_s in (1.0, 2.0)
    ]
    assert 6.0 < moving[0] - moving[1] <= 8.01
    unknown = aircraft(
        300.0, velocity=(math.nan, math.nan, math.nan), altitude_amsl_m=math.nan, age_s=2.0
    )
    assert gap_m(flown_beside(unknown)) == pytest.approx(
        300.0 - 8.0 - 0.5 * 5.0 * 0.25 - 60.0 * 1.5, abs=0.1
    )
    late = AT_S + FORGOTTEN_S + 0.1
    assert gap_m(flown_beside(aircraft(90.0), now_s=late), late) == math.inf


def test_another_aircraft_pauses_nothing_and_a_vehicle_alone_keeps_no_distance_to_it():
    near = flown_beside(aircraft(15.0))
    assert near.silent_mate(AT_S + HOLD_S + 0.1) == ""
    assert gap_m(flown_beside(aircraft(90.0), settings=SETTINGS)) == math.inf


def test_an_aircraft_where_a_mate_or_an_evader_is_is_that_one():
    report = EvaderReport(
        AT_S,
        AT_S,
        "test",
        HERE[0] + 5e-4,
        HERE[1],
        488.0 - UP_M,
        Ned((0.0, 0.0, 0.0)),
        evader="red",
    )
    assert flown_beside(aircraft(90.0), mates=(mate(85.0),)).aircraft == {}
    assert flown_beside(aircraft(90.0), mates=(mate(60.0),)).aircraft.keys() == {"ICAO 3C6444"}
    assert flown_beside(aircraft(55.0), reports=(report,)).aircraft == {}


def test_a_silent_mate_becomes_a_disc_that_grows_with_its_top_speed():
    young = AT_S + 0.5
    old = AT_S + 1.5
    grown_m = gap_m(observed(mate(60.0), now_s=young), young) - gap_m(
        observed(mate(60.0), now_s=old), old
    )
    assert grown_m == pytest.approx(6.0, abs=0.01)
    late = AT_S + FORGOTTEN_S + 0.1
    assert gap_m(observed(mate(60.0), now_s=late), late) == math.inf


@pytest.mark.parametrize(("north_m", "near"), [(15.0, True), (400.0, False)])
def test_a_mate_nearby_that_is_silent_for_two_seconds_is_named(north_m, near):
    one = observed(mate(north_m))
    assert one.silent_mate(AT_S + HOLD_S - 0.1) == ""
    assert one.silent_mate(AT_S + HOLD_S + 0.1) == ("bravo" if near else "")


def test_a_role_chooses_the_evader_its_speed_and_the_height():
    reports = [
        EvaderReport(
            AT_S,
            AT_S,
            "test",
            HERE[0] + north,
            HERE[1],
            488.0,
            Ned((0.0, 0.0, 0.0)),
            0.1,
            0.1,
            evader=name,
        )
        for name, north in (("red", 1e-4), ("blue", -1e-4))
    ]
    for name, sign, speed_m_s in (("red", 1.0, 2.0), ("blue", -1.0, 3.0)):
        one = observed(role=Role(name, 4.0), reports=reports)
        assert one.switched
        assert math.copysign(1.0, one.view(AT_S).evader.position_ned_m[0]) == sign
        assert one.cycle.game.evader_speed_m_s == speed_m_s
        assert one.cycle.game.standoff.height_m == TEAM.cycle.game.standoff.height_m + 4.0
        one.take_in(AT_S, Inputs(), in_flight=True)
        assert not one.switched


def test_of_a_crowd_of_phantoms_only_the_nearest_count_and_each_is_told_once():
    one = flown_beside(aircraft(40.0, name="near"))
    assert [words.split(",")[0] for _, words in one.notes] == ["near"]
    for number in range(500):
        one.take_in(
            AT_S,
            Inputs(messages=[aircraft(100.0 + number, name=f"system {number}")]),
            in_flight=True,
        )
        assert len(one.aircraft) <= MOST_AIRCRAFT
        assert one.notes == []  # one note a second
    assert one.aircraft.keys() == {"near", *(f"system {number}" for number in range(7))}
    one.take_in(AT_S, Inputs(messages=[aircraft(100.0, name="system 0")]), in_flight=True)
    assert one.notes == []


def test_what_leaps_as_no_aircraft_can_is_none():
    one = flown_beside(aircraft(40.0))
    for number in range(50):
        leaping = aircraft(40.0 if number % 2 else 900.0)._replace(received_s=AT_S + 0.1 * number)
        one.take_in(AT_S, Inputs(messages=[leaping]), in_flight=True)
    assert one.aircraft == {}
    later = aircraft(40.0)._replace(received_s=AT_S + 20.0)
    one.take_in(AT_S, Inputs(messages=[later]), in_flight=True)
    assert one.aircraft.keys() == {"ICAO 3C6444"}


def test_an_aircraft_far_away_takes_no_place():
    assert flown_beside(aircraft(6000.0)).aircraft == {}
