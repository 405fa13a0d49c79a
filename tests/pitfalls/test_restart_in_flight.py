"""Guidance that is killed and started again while its vehicle flies: handed over, or taken again, on an order."""

import pytest

from guidance.autopilots import Mode
from guidance.flight import Event, Flight, State
from tests.harness.linked import FlownByHand

pytestmark = pytest.mark.flight


MODES = {
    "px4": {State.HOLDING: "HOLD", State.RETURNING: "RTL", State.LANDING: "LAND"},
    "arducopter": {State.HOLDING: "BRAKE", State.RETURNING: "RTL", State.LANDING: "LAND"},
}


def restarted(flight):
    """Kill the guidance of an engaged flight, and begin another one four seconds later."""
    flight.engaged().run(1.0)
    flight.frozen = True
    flight.run(4.0)
    flight.frozen = False
    again = Flight(flight.flight.settings)
    flight.pilot = FlownByHand(
        again, flight.world.links["pursuer"], flight.world.evaders["pursuer"]["evader"], None
    )
    flight.sent.clear()
    return flight


@pytest.mark.parametrize(
    ("autopilot", "found_in", "order", "state"),
    [
        ("px4", State.READY, Event.HOLD, State.HOLDING),
        ("px4", State.CHECKING, Event.LAND, State.LANDING),
        ("arducopter", State.CHECKING, Event.HOLD, State.HOLDING),
        ("arducopter", State.CHECKING, Event.RETURN, State.RETURNING),
        ("arducopter", State.READY, Event.ABORT, State.LANDING),
    ],
)
def test_after_a_restart_in_mid_air_every_order_to_end_is_carried_out(
    sortie, autopilot, found_in, order, state
):
    flight = sortie.after(restarted, autopilot).until(found_in, limit_s=10.0)
    assert flight.mock.armed
    flight.cycle(order)
    assert flight.state is state
    flight.until_mock(MODES[autopilot][state], 3.0).run(5.0)
    assert flight.state is state
    assert not flight.setpoints
    if state is State.LANDING:
        flight.until(State.LANDED, limit_s=60.0)
        assert not flight.mock.armed


def test_after_a_restart_the_vehicle_is_ready_within_two_seconds_of_being_heard(sortie, autopilot):
    flight = sortie.after(restarted, autopilot).until(State.CHECKING, limit_s=5.0)
    flight.until(State.READY, limit_s=2.0)


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_after_a_restart_nothing_is_taken_without_a_persons_word(sortie, autopilot):
    flight = sortie.after(restarted, autopilot).run(10.0)
    assert flight.state is State.READY
    assert not flight.setpoints
    assert 176 not in [sent.message.command for sent in flight.sent if sent.name == "COMMAND_LONG"]


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_engaging_again_takes_a_hold_and_an_order(sortie, autopilot):
    flight = sortie.after(restarted, autopilot).until(State.READY, limit_s=10.0)
    flight.cycle(Event.ENGAGE)
    assert flight.state is State.READY
    flight.cycle(Event.HOLD)
    flight.until_mock(MODES[autopilot][State.HOLDING], 3.0).run(2.0)
    # HEARTBEATs of 2.5 s have to agree that it holds.
    flight.cycle(Event.ENGAGE)
    assert flight.state is State.HOLDING
    flight.run(2.0).cycle(Event.ENGAGE)
    flight.until(State.ENGAGED, limit_s=6.0).until(State.ON_STATION, limit_s=40.0)


def test_a_vehicle_that_returns_is_engaged_once_it_is_seen_to_hold(sortie):
    flight = sortie.after(restarted, "px4").until(State.READY, limit_s=10.0)
    flight.cycle(Event.HOLD)
    flight.cycle(Event.ENGAGE)
    assert flight.flight.mode_name == str(Mode.RETURN)
    assert flight.state is State.HOLDING
    flight.run(4.0).cycle(Event.ENGAGE)
    flight.until(State.ENGAGED, limit_s=6.0)


def test_a_start_order_does_not_take_a_vehicle_out_of_a_mode_that_is_not_ours(sortie):
    flight = sortie.after(restarted, "px4").until(State.READY, limit_s=10.0)
    assert flight.mock.mode == "RTL"
    flight.cycle(Event.START)
    assert flight.state is State.READY


@pytest.mark.parametrize(
    ("autopilot", "order", "state"),
    [
        ("px4", Event.RETURN, State.RETURNING),
        ("arducopter", Event.HOLD, State.HOLDING),
        ("arducopter", Event.LAND, State.LANDING),
    ],
)
def test_what_a_pilot_flies_is_asked_for_once_and_a_pilot_who_keeps_it_has_it(
    sortie, autopilot, order, state
):
    flight = sortie.after(restarted, autopilot).until(State.READY, limit_s=10.0)
    flight.mock.inject("rc", True)
    flight.run(0.5)
    sticks = {"px4": "POSCTL", "arducopter": "LOITER"}[autopilot]
    flight.mock.inject("pilot_mode", sticks)
    flight.run(2.0).sent.clear()
    flight.cycle(order)
    assert flight.state is state
    flight.cycle()
    flight.mock.inject("pilot_mode", sticks)  # at once, before any HEARTBEAT showed our mode
    flight.until(State.YIELDED, limit_s=6.0).run(5.0)
    assert flight.mock.mode == sticks
    modes = [
        sent for sent in flight.sent if sent.name == "COMMAND_LONG" and sent.message.command == 176
    ]
    assert len(modes) == 1
    assert not flight.setpoints


@pytest.mark.parametrize(
    ("autopilot", "flown", "order", "state"),
    [
        ("px4", State.CLIMBING, Event.HOLD, State.HOLDING),
        ("px4", State.RETURNING, Event.LAND, State.LANDING),
        ("arducopter", State.CLIMBING, Event.RETURN, State.RETURNING),
        ("arducopter", State.RETURNING, Event.HOLD, State.HOLDING),
    ],
)
def test_an_order_is_not_taken_for_a_pilots_because_heartbeat_shows_the_mode_before(
    sortie, autopilot, flown, order, state
):
    if flown is State.CLIMBING:
        flight = sortie.ready(autopilot)
        flight.cycle(Event.START)
        flight.until(State.CLIMBING)
        flight.run(10.0, lambda: flight.mock.truth.position_ned_m[2] < -1.0)
    else:
        flight = sortie.standing_by(autopilot)
        flight.cycle(Event.RETURN)
        flight.run(3.0)
        assert flight.flight.mode_name == str(Mode.RETURN)
    flight.cycle(order)
    flight.until_mock(MODES[autopilot][state], 3.0).run(3.0)
    assert flight.state is state
