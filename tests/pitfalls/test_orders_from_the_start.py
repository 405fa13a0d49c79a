"""An order to end stands from the start order on, and a vehicle that somebody else has is not taken."""

import math

import pytest

from guidance.flight import Event, State
from tests.harness.linked import FlownByHand

pytestmark = pytest.mark.flight

ENDINGS = (Event.HOLD, Event.RETURN, Event.LAND, Event.ABORT)
STICKS = {"px4": "POSCTL", "arducopter": "LOITER"}
HOLDS = {"px4": "HOLD", "arducopter": "BRAKE"}


def height_m(flight):
    """Height of the vehicle, in truth."""
    return -flight.mock.truth.position_ned_m[2]


@pytest.mark.parametrize("order", ENDINGS)
@pytest.mark.parametrize("after_s", [0.1, 0.8])
def test_an_order_to_end_right_after_the_start_leaves_the_vehicle_on_the_ground_disarmed(
    sortie, autopilot, order, after_s
):
    flight = sortie.ready(autopilot)
    if autopilot == "px4":
        flight.mock.autopilot.parameters.set("COM_SPOOLUP_TIME", 1.0)
    ground_m = height_m(flight)
    flight.cycle(Event.START)
    flight.run(after_s)
    flight.cycle(order)
    for _ in range(160):
        flight.cycle()
        assert height_m(flight) == pytest.approx(ground_m, abs=0.05)
    assert flight.state is State.LANDED
    assert not flight.mock.armed
    assert not flight.setpoints


@pytest.mark.parametrize(
    ("order", "mode"), [(Event.HOLD, None), (Event.RETURN, "RTL"), (Event.LAND, "LAND")]
)
def test_an_order_to_end_in_the_climb_ends_the_climb(sortie, autopilot, order, mode):
    flight = sortie.ready(autopilot)
    flight.cycle(Event.START)
    while height_m(flight) < 2.0:
        flight.cycle()
    assert flight.state is State.CLIMBING
    flight.cycle(order)
    flight.until_mock(HOLDS[autopilot] if mode is None else mode, 0.5).run(3.0)
    if order is Event.HOLD:
        assert flight.state is State.HOLDING
        assert height_m(flight) < 6.0
        assert math.hypot(*flight.mock.truth.velocity_ned_m_s) < 0.3


def test_a_hold_on_the_way_to_the_start_stops_the_vehicle(sortie, autopilot):
    flight = sortie.ready(autopilot)
    flight.cycle(Event.START)
    flight.until(State.POSITIONING).run(2.0)
    assert flight.state is State.POSITIONING
    assert math.hypot(*flight.mock.truth.velocity_ned_m_s) > 1.0
    flight.cycle(Event.HOLD)
    flight.run(6.0)
    assert flight.state is State.HOLDING
    assert math.hypot(*flight.mock.truth.velocity_ned_m_s) < 0.3


def test_a_vehicle_that_a_pilot_armed_on_the_ground_is_not_started(sortie, autopilot):
    flight = sortie.ready(autopilot)
    flight.mock.inject("rc", True)
    flight.run(0.5)
    flight.mock.inject("pilot_mode", STICKS[autopilot])
    flight.run(0.5)
    flight.mock.autopilot.state.arm()
    flight.run(1.5)
    sent = len(flight.sent)
    flight.cycle(Event.START)
    flight.run(3.0)
    assert flight.state is not State.ARMING
    assert (flight.mock.mode, flight.mock.armed) == (STICKS[autopilot], True)
    commands = [one.message.command for one in flight.sent[sent:] if one.name == "COMMAND_LONG"]
    assert not {22, 176, 400} & set(commands)


def test_a_vehicle_that_a_pilot_arms_just_before_the_start_order_is_left_to_the_pilot(
    sortie, autopilot
):
    flight = sortie.ready(autopilot)
    while not flight.pilot.flight.observed.beats:
        flight.cycle()
    flight.mock.autopilot.state.arm()  # the next HEARTBEAT will show it
    flight.cycle(Event.START)
    assert flight.state is State.ARMING
    flight.until(State.YIELDED, limit_s=2.5)
    ground_m = height_m(flight)
    sent = len(flight.sent)
    flight.run(5.0)
    assert height_m(flight) == pytest.approx(ground_m, abs=0.05)
    assert {one.name for one in flight.sent[sent:]} <= {"HEARTBEAT", "TIMESYNC"}


def test_a_pilots_hold_in_the_climb_is_left_alone(sortie, autopilot):
    flight = sortie.ready(autopilot)
    flight.cycle(Event.START)
    while height_m(flight) < 2.0:
        flight.cycle()
    flight.mock.inject("pilot_mode", HOLDS[autopilot])
    flight.until(State.YIELDED, limit_s=2.5)
    sent = len(flight.sent)
    flight.run(5.0)
    assert flight.mock.mode == HOLDS[autopilot]
    assert {one.name for one in flight.sent[sent:]} <= {"HEARTBEAT", "TIMESYNC"}


def test_a_second_guidance_does_not_take_a_vehicle_that_the_first_one_flies(sortie, autopilot):
    flight = sortie.engaged(autopilot).run(1.0)
    first = flight.pilot
    second = FlownByHand(
        type(first.flight)(first.flight.settings),
        flight.world.links["pursuer"],
        flight.world.evaders["pursuer"]["evader"],
        None,
    )
    flight.pilot = second
    flight.until(State.READY, limit_s=3.0)
    flight.cycle(Event.START)
    assert second.flight.state is State.READY
