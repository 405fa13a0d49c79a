import itertools

import pytest

from guidance.autopilots import Mode
from guidance.flight import FINAL, ORDERS, Event, State
from guidance.flight.table import (
    ASKED_MODES,
    HANDING_OVER,
    SETPOINT_STATES,
    TRANSITIONS,
    is_done,
    next_state,
    state_words,
)

COMMANDING = {State.ENTERING, State.ENGAGED, State.PAUSED, State.ON_STATION}
AIRBORNE = {State.CLIMBING, State.POSITIONING, State.STANDING_BY}
LEAVING = {State.HOLDING, State.RETURNING, State.LANDING}
LOST = State.OUT_OF_CONTACT
FLOWN = AIRBORNE | {LOST} | COMMANDING | LEAVING
BEGUN = FLOWN | {State.ARMING}


def test_a_pair_that_is_not_listed_changes_nothing():
    unlisted = set(itertools.product(State, Event)) - set(TRANSITIONS)
    assert len(unlisted) + len(TRANSITIONS) == len(State) * len(Event)
    assert not [
        (state, event) for state, event in unlisted if next_state(state, event) is not state
    ]


def test_a_vehicle_found_in_the_air_is_not_called_ready():
    assert state_words(State.READY, airborne=True) == "not taken over"
    assert state_words(State.READY, airborne=False) == "ready"
    assert state_words(State.ENGAGED, airborne=True) == "engaged"


@pytest.mark.parametrize("state", sorted(FINAL))
def test_nothing_leads_out_of_a_final_state(state):
    assert {next_state(state, event) for event in Event} == {state}


def test_only_an_order_leads_to_entering_and_only_order_or_pilot_start_the_game():
    into_entering = {
        (state, event) for (state, event), after in TRANSITIONS.items() if after is State.ENTERING
    }
    assert {event for _, event in into_entering} == {Event.ENGAGE}
    into_engaged = {state for (state, _), after in TRANSITIONS.items() if after is State.ENGAGED}
    assert into_engaged == {State.ENTERING, State.STANDING_BY, State.PAUSED, State.ON_STATION}
    assert {
        event
        for (state, event), after in TRANSITIONS.items()
        if state is State.STANDING_BY and after is State.ENGAGED
    } == {Event.INVITED}


def test_after_a_telemetry_gap_the_only_way_into_the_game_is_an_engage_order():
    assert next_state(State.STANDING_BY, Event.TELEMETRY_LOST) is LOST
    out = {event: after for (state, event), after in TRANSITIONS.items() if state is LOST}
    assert {event for event, after in out.items() if after in COMMANDING} == set()
    assert out[Event.CONTACT] is State.STANDING_BY


def test_setpoints_go_out_in_the_states_of_the_guided_mode_only():
    assert SETPOINT_STATES == COMMANDING
    assert not SETPOINT_STATES & (FINAL | HANDING_OVER)


def test_no_line_leads_to_where_it_began():
    assert not [(state, event) for (state, event), after in TRANSITIONS.items() if after is state]


def test_every_state_can_be_reached_and_every_event_does_something():
    assert {State.CONNECTING, *TRANSITIONS.values()} == set(State)
    only_told = {Event.AIRCRAFT, Event.HOME_MOVED}
    assert {event for _, event in TRANSITIONS} == set(Event) - only_told


def test_orders_are_events_of_the_table():
    assert set(Event) >= ORDERS


@pytest.mark.parametrize("order", sorted(ORDERS))
def test_an_order_is_done_in_the_states_to_which_it_leads(order):
    done = {
        Event.START: {State.ARMING},
        Event.ENGAGE: {State.ENTERING},
        Event.HOLD: {State.HOLDING},
        Event.RETURN: {State.RETURNING},
        Event.LAND: {State.LANDING},
        Event.ABORT: {State.LANDING, State.FAILED},
    }
    assert {state for state in State if is_done(order, state)} == done[order]


S = State
GROUND = {State.CONNECTING, State.CHECKING, State.READY}
OUT_OF_THE_PLAYED = {State.ENGAGED, State.ON_STATION}
BY_EVENT = {
    # A person's orders.
    Event.START: {S.ARMING: {S.READY}},
    Event.ENGAGE: {S.ENTERING: {S.STANDING_BY, S.HOLDING}},
    Event.HOLD: {S.HOLDING: BEGUN - {S.HOLDING}},
    Event.RETURN: {S.RETURNING: BEGUN - {S.RETURNING}},
    Event.LAND: {S.LANDING: BEGUN - {S.LANDING}},
    Event.ABORT: {S.LANDING: BEGUN - {S.LANDING}, S.FAILED: GROUND},
    # Of a vehicle that was found armed.
    Event.HOLD_ARMED: {S.HOLDING: GROUND - {S.CONNECTING}},
    Event.RETURN_ARMED: {S.RETURNING: GROUND - {S.CONNECTING}},
    Event.LAND_ARMED: {S.LANDING: GROUND - {S.CONNECTING}},
    # The way up.
    Event.HEARD: {S.CHECKING: {S.CONNECTING}},
    Event.FIT: {S.READY: {S.CHECKING}},
    Event.UNFIT: {S.CHECKING: {S.READY}},
    Event.ALOFT: {S.STANDING_BY: {S.READY}},
    Event.ARMED: {S.CLIMBING: {S.ARMING}},
    Event.AT_HEIGHT: {S.POSITIONING: {S.CLIMBING}},
    Event.AT_START: {S.STANDING_BY: {S.POSITIONING}},
    # The game.
    Event.GUIDED: {S.ENGAGED: {S.ENTERING}},
    Event.INVITED: {S.ENGAGED: {S.STANDING_BY}},
    Event.CAPTURED: {S.ON_STATION: {S.ENGAGED}},
    Event.STRAYED: {S.ENGAGED: {S.ON_STATION}},
    Event.DONE: {S.RETURNING: {S.ON_STATION}},
    Event.ESCAPED: {S.HOLDING: {S.ENGAGED}},
    Event.NO_GAME: {S.HOLDING: OUT_OF_THE_PLAYED},
    Event.POLICY_FAILED: {S.HOLDING: OUT_OF_THE_PLAYED},
    Event.CLEAR: {S.ENGAGED: {S.PAUSED}},
    Event.CHASE_TIMED_OUT: {S.HOLDING: {S.ENGAGED, S.PAUSED}},
    # What may go wrong.
    Event.EVADER_LOST: {S.PAUSED: OUT_OF_THE_PLAYED},
    Event.MATE_SILENT: {S.PAUSED: OUT_OF_THE_PLAYED},
    Event.ASSIGNED: {S.ENGAGED: {S.ON_STATION}},
    Event.ESTIMATOR_RESET: {S.PAUSED: OUT_OF_THE_PLAYED},
    Event.LOOP_LATE: {S.PAUSED: OUT_OF_THE_PLAYED},
    Event.FENCE: {S.HOLDING: COMMANDING},
    Event.FLOOR: {S.HOLDING: COMMANDING},
    Event.CEILING: {S.HOLDING: COMMANDING},
    Event.STAND_OFF: {S.HOLDING: COMMANDING},
    Event.AIRCRAFT: {},
    Event.HOME_MOVED: {},
    Event.LATE: {S.HOLDING: COMMANDING},
    Event.SECOND_SENDER: {S.HOLDING: COMMANDING},
    Event.FOREIGN: {S.HOLDING: COMMANDING},
    Event.RIVAL: {S.HOLDING: COMMANDING},
    Event.OPERATOR_LOST: {S.HOLDING: COMMANDING},
    Event.OPERATOR_GONE: {S.RETURNING: {S.STANDING_BY, S.HOLDING}},
    Event.LOOP_STOPPED: {S.YIELDED: COMMANDING},
    Event.BATTERY_LOW: {
        S.RETURNING: COMMANDING | {S.STANDING_BY, S.POSITIONING, S.HOLDING},
        S.LANDING: {S.CLIMBING},
    },
    Event.BATTERY_UNKNOWN: {
        S.RETURNING: COMMANDING | {S.STANDING_BY, S.POSITIONING, S.HOLDING},
        S.LANDING: {S.CLIMBING},
    },
    Event.PILOT: {S.YIELDED: BEGUN},
    Event.REBOOTED: {S.YIELDED: BEGUN},
    Event.TELEMETRY_LOST: {
        S.YIELDED: BEGUN - {S.STANDING_BY, LOST},
        LOST: {S.STANDING_BY},
        S.CONNECTING: {S.CHECKING, S.READY},
    },
    Event.CONTACT: {S.STANDING_BY: {LOST}},
    Event.FAULT: {S.YIELDED: BEGUN, S.FAILED: GROUND},
    Event.DISARMED: {S.LANDED: AIRBORNE | LEAVING | {LOST}, S.YIELDED: COMMANDING},
    Event.TIMED_OUT: {
        S.FAILED: {S.CONNECTING, S.CHECKING, S.ARMING},
        S.LANDING: {S.CLIMBING, S.POSITIONING},
        S.HOLDING: {S.ENTERING, S.PAUSED},
    },
}


@pytest.mark.parametrize("event", list(Event))
def test_each_event_leads_where_it_should_and_from_nowhere_else(event):
    # The table is by state; this is the same by event, kept by hand: a line has to be wrong twice to be believed.
    listed = {state: after for (state, cause), after in TRANSITIONS.items() if cause is event}
    assert listed == {state: after for after, states in BY_EVENT[event].items() for state in states}


def test_the_mode_that_each_state_asks_for():
    assert {
        State.CLIMBING: Mode.TAKEOFF,
        **dict.fromkeys(COMMANDING, Mode.GUIDED),
        State.HOLDING: Mode.HOLD,
        State.RETURNING: Mode.RETURN,
        State.LANDING: Mode.LAND,
    } == ASKED_MODES
