"""The place of the fence: fixed when a flight is accepted. A home that is reported later is told and not used."""

import math
from dataclasses import replace

import pytest

from guidance.autopilots import PX4, Mode
from guidance.autopilots.description import HOME_POSITION
from guidance.control.polygon import Polygon
from guidance.flight import Event, State
from guidance.flight.tracking import HOME_NOTE_M
from guidance.frames import Amsl, Ned
from guidance.messages import Command, Home, Origin
from guidance.session.orders.answers import refusal
from tests.flight.flown import ARM, SLOW_S, Flown, commands
from tests.flight.scenes import BOTH, CYCLE, ENVELOPE, HOME_DOWN_M, settings_of
from tests.harness.sortie import Sorties, Stepped

DO_SET_HOME = 179


@pytest.fixture(scope="module")
def sorties(soon_up_and_down):
    made = Sorties(Stepped)
    yield made
    made.close()


def set_home(sortie, north_m, east_m):
    """Set the autopilot's home, as a ground station does."""
    frame = sortie.flight.tracking.local_frame
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(Ned((north_m, east_m, 0.0)))
    params = (0.0, 0.0, 0.0, 0.0, latitude_deg, longitude_deg, altitude.metres)
    link = sortie.world.links["pursuer"]
    link.request(Command(DO_SET_HOME, params, frame=0))
    sortie.run(1.0)
    link.request(PX4.request_message(HOME_POSITION))


@pytest.mark.parametrize("autopilot", ["px4", "arducopter"])
def test_a_home_that_is_set_in_flight_moves_no_fence_and_is_told(sorties, autopilot):
    """Catches a fence that follows a home which somebody moves in flight."""
    beside_m = 5.0
    sortie = sorties(autopilot)
    sortie.until(State.READY)
    set_home(sortie, beside_m, 0.0)
    sortie.run(4.0)
    assert sortie.flight.tracking.home_ned_m[0] == pytest.approx(beside_m, abs=0.3)
    sortie.standing_by()
    placed_ned_m = sortie.flight.observed.cycle.envelope.home_ned_m
    assert placed_ned_m[0] == pytest.approx(beside_m, abs=0.3)
    set_home(sortie, 0.0, 35.0)
    sortie.run(8.0)
    assert sortie.mock.autopilot.state.home_m[1] == pytest.approx(35.0, abs=0.5)
    assert sortie.flight.observed.cycle.envelope.home_ned_m == placed_ned_m
    assert sortie.flight.tracking.home_ned_m == placed_ned_m
    told = [transition for transition in sortie.transitions if transition.event is Event.HOME_MOVED]
    away_m = math.hypot(beside_m, 35.0)
    assert [f"{away_m:.0f}" in transition.detail.split(" m away")[0] for transition in told] == [
        True
    ]


def home_at(flight, place_m):
    latitude_deg, longitude_deg, altitude = flight.flight.tracking.local_frame.wgs84_from_ned(
        Ned(place_m)
    )
    assert isinstance(altitude, Amsl)
    return Home(flight.now_s, latitude_deg, longitude_deg, altitude.metres, Ned(place_m))


def test_the_home_at_the_start_order_stays_whatever_is_reported_while_the_vehicle_arms():
    flight = Flown()
    flight.cycle()
    flight.cycle()
    assert flight.state is State.READY
    flight.cycle(Event.START)
    assert flight.state is State.ARMING
    flight.cycle(more=[home_at(flight, (1.0, 0.0, HOME_DOWN_M))])
    assert flight.flight.tracking.home_ned_m == (0.0, 0.0, HOME_DOWN_M)


def test_a_home_that_is_reported_elsewhere_is_told_once_for_each_place():
    flight = Flown().standing_by()
    near = (0.9 * HOME_NOTE_M, 0.0, HOME_DOWN_M)
    far = (35.0, 0.0, HOME_DOWN_M)
    back = (0.0, 0.0, HOME_DOWN_M)
    told = []
    for place_m in (near, near, far, far, back, far):
        outputs = flight.cycle(more=[home_at(flight, place_m)])
        told.append([one.event for one in outputs.transitions] == [Event.HOME_MOVED])
    assert told == [False, False, True, False, True, True]
    assert flight.flight.tracking.home_ned_m == (0.0, 0.0, HOME_DOWN_M)
    assert flight.state is State.STANDING_BY


def test_a_vehicle_handed_over_before_a_flight_was_accepted_is_engaged_about_the_home_of_then():
    flight = Flown()
    flight.armed = True
    flight.landed = 2
    flight.position[2] = HOME_DOWN_M - 10.0
    flight.cycle()
    flight.cycle(Event.HOLD)
    assert flight.state is State.HOLDING
    moved = (8.0, 0.0, HOME_DOWN_M)
    flight.cycle(more=[home_at(flight, moved)])
    assert flight.flight.tracking.home_ned_m == moved
    flight.cycle(Event.ENGAGE)
    assert flight.state is State.ENTERING
    flight.cycle(more=[home_at(flight, (0.0, 0.0, HOME_DOWN_M))])
    assert flight.flight.tracking.home_ned_m == moved


REACH_M = 16.0


def about_a_small_fence(autopilot, **fence):
    """A vehicle on the ground at home, ready; its fence reaches 16 m."""
    envelope = replace(ENVELOPE, **{"fence_radius_m": REACH_M} | fence)
    settings = settings_of(autopilot, cycle=replace(CYCLE, envelope=envelope))
    flight = Flown(settings)
    flight.mode = autopilot.arming_mode
    flight.cycles(0.1)
    assert flight.state is State.READY
    return flight


@pytest.mark.parametrize("airborne", [False, True])
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_start_outside_the_fence_about_home_is_refused_from_the_cycle_that_hears_it(
    autopilot, airborne
):
    flight = about_a_small_fence(autopilot)
    if airborne:
        flight.armed = True
        flight.mode = Mode.HOLD
        flight.landed = 2
        flight.position[2] = HOME_DOWN_M - 10.0
        flight.cycles(0.1, beat=True)
    moved = (18.0, -24.0, HOME_DOWN_M)
    flight.cycle(Event.START, more=[home_at(flight, moved)])
    assert flight.state is State.CHECKING
    words = refusal(Event.START, flight.flight, flight.now_s, ())
    assert "30.0 m from home, 14.0 m outside the fence of 16.0 m: set home" in words
    flight.cycle(Event.START)
    assert flight.state is State.CHECKING
    # Inside, it is accepted again.
    back = [home_at(flight, (9.0, -13.0, HOME_DOWN_M))]
    flight.cycle(more=back)
    flight.cycle(Event.START, more=back)
    assert flight.state is (State.STANDING_BY if airborne else State.ARMING)


def test_a_home_without_its_place_in_the_local_frame_is_compared_on_the_map():
    flight = about_a_small_fence(BOTH[0])
    told = home_at(flight, (0.0, 30.0, HOME_DOWN_M))._replace(position_ned_m=Ned((math.nan,) * 3))
    place = flight.flight.tracking.local_frame
    origin = Origin(flight.now_s, place.latitude_deg, place.longitude_deg, place.altitude.metres)
    flight.cycle(Event.START, more=[origin, told])
    assert flight.state is State.CHECKING
    assert "14.0 m outside" in refusal(Event.START, flight.flight, flight.now_s, ())


def test_a_start_outside_a_polygon_is_refused_although_home_is_near():
    corners = ((-40.0, -5.0), (-40.0, 5.0), (40.0, 5.0), (40.0, -5.0))
    flight = about_a_small_fence(BOTH[0], fence_radius_m=None, fence_polygon=Polygon(corners))
    flight.position[1] = 8.0
    flight.cycle(Event.START)
    words = refusal(Event.START, flight.flight, flight.now_s, ())
    assert "8.0 m from home, 3.0 m outside the fence" in words


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_vehicle_that_proves_to_be_outside_while_it_arms_is_not_armed_and_the_end_says_so(
    autopilot,
):
    flight = about_a_small_fence(autopilot)
    flight.cycle(Event.START)
    assert flight.state is State.ARMING
    flight.position[0] = 30.0
    outputs = flight.cycles(15.2, dt_s=SLOW_S)
    assert ARM not in commands(outputs)
    assert flight.state is State.FAILED
    assert "30.0 m from home, 14.0 m outside the fence" in flight.flight.cause.words
