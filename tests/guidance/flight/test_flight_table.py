import itertools

import pytest

from guidance.flight import FINAL, ORDERS, TRANSITIONS, Event, State, next_state
from guidance.flight.table import HANDING_OVER, OUR_MODES, SETPOINT_STATES

COMMANDING = {State.ENTERING, State.ENGAGED, State.PAUSED, State.ON_STATION}
AIRBORNE = {State.CLIMBING, State.POSITIONING, State.STANDING_BY}
LEAVING = {State.HOLDING, State.RETURNING, State.LANDING}


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, Event)))
def test_every_pair_has_one_answer_and_unlisted_pairs_change_nothing(state, event):
    after = next_state(state, event)
    assert after in State
    if (state, event) not in TRANSITIONS:
        assert after is state


@pytest.mark.parametrize("state", sorted(FINAL))
def test_nothing_leads_out_of_a_final_state(state):
    assert {next_state(state, event) for event in Event} == {state}


def test_only_a_persons_word_leads_to_entering_and_only_that_or_a_pilots_hand_begins_the_game():
    into_entering = {(state, event) for (state, event), after in TRANSITIONS.items() if after is State.ENTERING}
    assert {event for _, event in into_entering} == {Event.ENGAGE}
    into_engaged = {state for (state, _), after in TRANSITIONS.items() if after is State.ENGAGED}
    assert into_engaged == {State.ENTERING, State.STANDING_BY, State.PAUSED, State.ON_STATION}
    assert {
        event for (state, event), after in TRANSITIONS.items() if state is State.STANDING_BY and after is State.ENGAGED
    } == {Event.INVITED}


@pytest.mark.parametrize("state", sorted({State.ARMING} | AIRBORNE | COMMANDING | LEAVING))
@pytest.mark.parametrize("event", [Event.PILOT, Event.TELEMETRY_LOST, Event.REBOOTED])
def test_another_hand_a_lost_vehicle_or_a_reboot_ends_it_for_us_from_everywhere(state, event):
    assert next_state(state, event) is State.YIELDED


@pytest.mark.parametrize("state", sorted(AIRBORNE | COMMANDING | LEAVING - {State.LANDING}))
def test_an_abort_in_the_air_lands(state):
    assert next_state(state, Event.ABORT) is State.LANDING


@pytest.mark.parametrize("state", sorted(AIRBORNE | COMMANDING))
def test_every_order_to_leave_is_followed_from_every_state_in_the_air(state):
    assert next_state(state, Event.HOLD) is State.HOLDING
    assert next_state(state, Event.RETURN) is State.RETURNING
    assert next_state(state, Event.LAND) is State.LANDING


def test_setpoints_go_out_in_the_states_of_the_guided_mode_only():
    assert SETPOINT_STATES == COMMANDING
    assert not SETPOINT_STATES & (FINAL | HANDING_OVER)


def test_every_state_in_the_air_knows_which_modes_are_our_own():
    assert set(OUR_MODES) == AIRBORNE | COMMANDING | LEAVING


def test_every_state_can_be_reached_and_every_event_does_something():
    assert {State.CONNECTING, *TRANSITIONS.values()} == set(State)
    assert {event for _, event in TRANSITIONS} == set(Event)


def test_orders_are_events_of_the_table():
    assert set(Event) >= ORDERS


@pytest.mark.parametrize(
    ("state", "event", "after"),
    [
        (State.CONNECTING, Event.HEARD, State.CHECKING),
        (State.CHECKING, Event.FIT, State.READY),
        (State.READY, Event.UNFIT, State.CHECKING),
        (State.READY, Event.START, State.ARMING),
        (State.READY, Event.ALOFT, State.STANDING_BY),
        (State.ARMING, Event.ARMED, State.CLIMBING),
        (State.CLIMBING, Event.AT_HEIGHT, State.POSITIONING),
        (State.POSITIONING, Event.AT_START, State.STANDING_BY),
        (State.STANDING_BY, Event.ENGAGE, State.ENTERING),
        (State.ENTERING, Event.GUIDED, State.ENGAGED),
        (State.ENGAGED, Event.CAPTURED, State.ON_STATION),
        (State.ENGAGED, Event.ESCAPED, State.HOLDING),
        (State.ENGAGED, Event.TARGET_LOST, State.PAUSED),
        (State.ENGAGED, Event.ESTIMATOR_RESET, State.PAUSED),
        (State.ENGAGED, Event.NO_GAME, State.HOLDING),
        (State.ENGAGED, Event.FENCE, State.HOLDING),
        (State.ENGAGED, Event.BATTERY_LOW, State.RETURNING),
        (State.PAUSED, Event.CLEAR, State.ENGAGED),
        (State.PAUSED, Event.TIMED_OUT, State.HOLDING),
        (State.ENTERING, Event.TIMED_OUT, State.HOLDING),
        (State.LANDING, Event.DISARMED, State.LANDED),
        (State.ENGAGED, Event.DISARMED, State.YIELDED),
        (State.HOLDING, Event.ENGAGE, State.ENTERING),
        (State.ON_STATION, Event.STRAYED, State.ENGAGED),
    ],
)
def test_the_lines_of_a_flight(state, event, after):
    assert next_state(state, event) is after
