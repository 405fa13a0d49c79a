"""The flight's step with inputs from the test: its requests and their times, and the effects of orders."""

import math

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.autopilots.description import GPS_GLOBAL_ORIGIN, HEARTBEAT, HOME_POSITION
from guidance.flight import ORDERS, EngageOn, Event, State
from guidance.flight.observed import AGREEING_S
from guidance.flight.sending import BEAT_EVERY_S, REPEAT_S, STREAM_FIRST_S, UNHEARD_S
from guidance.flight.table import ASKED_MODES
from guidance.messages import ParameterRequest
from tests.flight.flown import (
    ARM,
    CYCLE_S,
    INTERVAL,
    MESSAGE,
    SET_MODE,
    SLOW_S,
    TAKEOFF,
    Flown,
    commands,
)
from tests.flight.scenes import (
    BOTH,
    HOME_DOWN_M,
    heartbeat,
    settings_of,
    status,
)

BEAT = PX4.request_message(HEARTBEAT)
MODES = [(autopilot, mode) for autopilot in BOTH for mode in (*autopilot.custom_modes, Mode.OTHER)]


def asked(outputs):
    """Return the commands that were requested, without requests for messages."""
    return [command for command in commands(outputs) if command != MESSAGE]


def test_a_flight_begins_with_a_heartbeat_and_asks_for_streams_home_and_origin():
    vehicle = Flown()
    assert (vehicle.flight.mode_name, vehicle.flight.mode_title) == ("unknown", "unknown")
    assert vehicle.cycle(silent=True).state is State.CONNECTING
    first = vehicle.cycle()
    assert (first.state, first.transitions[0].event) == (State.CHECKING, Event.HEARD)
    assert (vehicle.flight.mode_name, vehicle.flight.mode_title) == ("hold", "HOLD")
    *asked, loss_time = first.requests
    assert [request.command for request in asked] == [INTERVAL] * 8 + [MESSAGE] * 2
    assert [request.params[0] for request in asked[-2:]] == [HOME_POSITION, GPS_GLOBAL_ORIGIN]
    assert loss_time == ParameterRequest("COM_OF_LOSS_T")
    assert vehicle.cycle().state is State.READY


def test_a_preflight_refusal_prevents_readiness_and_ends_it():
    vehicle = Flown()
    vehicle.cycle()
    assert vehicle.cycle(refusals=("GF_ACTION",)).state is State.CHECKING
    assert vehicle.cycle().state is State.READY
    assert vehicle.cycle(refusals=("GF_ACTION",)).state is State.CHECKING
    assert [
        check.name for check in vehicle.flight.checks(vehicle.now_s) if check.verdict != "pass"
    ] == []


def test_a_start_is_judged_by_preflight_and_the_checks_of_its_own_cycle():
    vehicle = Flown()
    for name in ("refusals", "more"):
        vehicle.cycles(1.1)
        assert vehicle.state is State.READY
        unfit = {"refusals": ("GF_ACTION",), "more": [status(vehicle.now_s, healthy=0)]}
        vehicle.cycle(Event.START, **{name: unfit[name]})
        assert vehicle.state is State.CHECKING


def test_the_time_in_a_phase_counts_from_its_entry():
    vehicle = Flown()
    assert vehicle.cycle(silent=True).state is State.CONNECTING
    outputs = vehicle.cycles(30.0, silent=True)
    assert [output.state for output in outputs[-2:]] == [State.CONNECTING] * 2
    assert vehicle.cycles(0.1, silent=True)[-1].state is State.FAILED


def test_a_request_is_repeated_only_after_a_heartbeat_shows_no_effect():
    vehicle = Flown()
    vehicle.cycle()
    vehicle.cycle()
    starting = vehicle.cycle(Event.START)
    assert starting.state is State.ARMING
    assert asked([starting]) == []  # the mode is there, and its check is not known yet
    assert asked(vehicle.cycles(1.0)) == [ARM]
    assert asked(vehicle.cycles(REPEAT_S - 0.6)) == []  # a HEARTBEAT came meanwhile
    vehicle.beat_s = vehicle.now_s
    assert asked(vehicle.cycles(0.9)) == []  # due, and nothing was heard
    assert asked([vehicle.cycle(beat=True)]) == [ARM]


@pytest.mark.parametrize("autopilot", BOTH)
def test_from_the_ground_the_autopilot_takes_off_and_holds_while_standing_by(autopilot):
    vehicle = Flown(settings_of(autopilot))
    vehicle.cycles(0.1)
    vehicle.cycle(Event.START)
    vehicle.armed_as_asked()
    climbing = vehicle.cycle(beat=True)
    assert (climbing.state, commands([climbing])) == (State.CLIMBING, [TAKEOFF])
    assert climbing.requests[0] == autopilot.takeoff(height_m=10.0, home_amsl_m=492.0)
    vehicle.landed = 3
    if Mode.TAKEOFF in autopilot.custom_modes:
        vehicle.mode = Mode.TAKEOFF
    assert (
        commands([*vehicle.cycles(2.0), vehicle.cycle(beat=True)]) == []
    )  # it has left the ground
    vehicle.position[2] = HOME_DOWN_M - 9.5
    vehicle.mode = autopilot.arming_mode
    assert vehicle.cycle(beat=True).state is State.POSITIONING
    standing_by = vehicle.cycle()
    assert standing_by.state is State.STANDING_BY
    assert {output.setpoint for output in vehicle.cycles(3.0)} == {None}


def test_a_hovering_vehicle_is_taken_over_and_one_on_the_ground_is_armed():
    up = Flown()
    up.standing_by()
    assert [h.event for h in up.outputs.transitions] == [Event.ALOFT]
    for landed in (1, 2):
        down = Flown()
        down.cycles(0.1)
        down.landed = landed
        down.cycle(beat=True)
        ordered = down.cycle(Event.START).transitions[0]
        assert (ordered.event, ordered.after) == (Event.START, State.ARMING)


@pytest.mark.parametrize("engage_on", list(EngageOn))
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_start_takes_no_vehicle_that_somebody_armed_and_that_is_not_seen_in_the_air(
    autopilot, engage_on
):
    for landed in (0, 1):  # 0 is unknown
        for mode in (*autopilot.custom_modes, Mode.OTHER):
            armed = Flown(settings_of(autopilot, engage_on=engage_on))
            armed.mode = mode
            armed.armed = True
            armed.landed = landed
            armed.cycles(0.1)
            assert armed.state is State.READY
            started = armed.cycle(Event.START)
            assert (started.state, started.requests) == (State.READY, ())


@pytest.mark.parametrize("engage_on", list(EngageOn))
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_start_takes_no_vehicle_from_a_program_that_flies_it_in_the_guided_mode(
    autopilot, engage_on
):
    flown = Flown(settings_of(autopilot, engage_on=engage_on))
    flown.mode = Mode.GUIDED
    flown.armed = True
    flown.landed = 2
    flown.position[2] = HOME_DOWN_M - 10.0
    flown.evader = (60.0, 0.0)
    flown.cycles(0.1)
    assert flown.cycle(Event.START).state is State.READY
    # Its hold is asked for, and until it is seen no setpoint goes into the other program's.
    assert flown.cycle(Event.HOLD).state is State.HOLDING
    assert flown.cycle(Event.ENGAGE).state is State.HOLDING
    # Another vehicle with the same system id may have sent the first HEARTBEAT that shows a hold.
    agreed_s = flown.beat_s + AGREEING_S
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    while flown.now_s < agreed_s - 2.0 * CYCLE_S:
        refused = flown.cycle(Event.ENGAGE, beat=True)
        assert (refused.state, refused.setpoint) == (State.HOLDING, None)
    flown.cycles(1.0)
    assert flown.cycle(Event.ENGAGE).state is State.ENTERING


@pytest.mark.parametrize("autopilot", BOTH)
def test_one_heartbeat_of_a_hold_frees_no_vehicle_that_another_program_flies(autopilot):
    flown = Flown(settings_of(autopilot))
    flown.mode = Mode.GUIDED
    flown.armed = True
    flown.landed = 2
    flown.position[2] = HOME_DOWN_M - 10.0
    flown.cycles(2.0)
    assert flown.cycle(Event.HOLD).state is State.HOLDING
    flown.mode = Mode.HOLD  # of another system with its id
    flown.cycle(beat=True)
    engaging = flown.cycle(Event.ENGAGE)
    flown.mode = Mode.GUIDED
    outputs = [engaging, flown.cycle(beat=True), *flown.cycles(5.0)]
    assert {output.setpoint for output in outputs} == {None}
    assert autopilot.set_mode(Mode.GUIDED) not in [
        request for output in outputs for request in output.requests
    ]
    assert flown.state is State.YIELDED


@pytest.mark.parametrize("engage_on", list(EngageOn))
@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("armed", [False, True])
def test_one_heartbeat_that_contradicts_the_others_does_not_make_a_vehicle_free(
    autopilot, engage_on, armed
):
    flown = Flown(settings_of(autopilot, engage_on=engage_on))
    flown.mode = Mode.GUIDED
    flown.armed = True
    flown.landed = 2
    flown.position[2] = HOME_DOWN_M - 10.0
    flown.cycles(2.0)
    flown.cycle(beat=True)
    agreed_s = flown.now_s + AGREEING_S
    # From now on all HEARTBEATs agree.
    flown.mode = Mode.HOLD
    flown.armed = armed
    while flown.now_s < agreed_s - 2 * CYCLE_S:
        started = flown.cycle(Event.START, beat=True)
        assert (started.state, asked([started])) == (State.READY, [])
    flown.cycles(1.0, beat=True)
    taken = State.STANDING_BY if armed else State.ARMING
    assert flown.cycle(Event.START).state is taken


@pytest.mark.parametrize("autopilot", BOTH)
def test_after_a_start_an_armed_heartbeat_counts_though_another_follows_it_at_once(autopilot):
    flown = Flown(settings_of(autopilot))
    flown.cycles(0.1)
    assert flown.cycle(Event.START).state is State.ARMING
    now_s = flown.now_s + CYCLE_S
    beats = [
        heartbeat(now_s, autopilot.arming_mode, armed=armed, autopilot=autopilot)
        for armed in (True, False)
    ]
    noticed = flown.cycle(more=beats)
    assert (noticed.state, noticed.requests) == (State.YIELDED, ())


@pytest.mark.parametrize(("autopilot", "mode"), MODES)
def test_a_pilots_mode_in_the_climb_is_noticed_and_left_alone(autopilot, mode):
    flown = Flown(settings_of(autopilot)).climbing()
    flown.mode = mode
    outputs = [flown.cycle(beat=True), *flown.cycles(5.0, dt_s=SLOW_S)]
    own = {Mode.TAKEOFF} if autopilot is PX4 else {Mode.GUIDED}
    assert (flown.state is State.CLIMBING) is (mode in own)
    assert commands(outputs) == []


def test_the_mode_of_the_climb_is_another_hands_once_the_climb_is_over():
    flown = Flown(settings_of(PX4)).climbing()
    flown.position[2] = HOME_DOWN_M - 9.5
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    flown.cycle()
    assert flown.state is State.STANDING_BY
    flown.mode = Mode.TAKEOFF
    assert flown.cycle(beat=True).state is State.YIELDED


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_stream_that_the_autopilot_stopped_waiting_for_is_not_begun_again_by_an_order(autopilot):
    flown = Flown(settings_of(autopilot)).engaged()
    assert flown.cycle(Event.HOLD).setpoint is not None
    flown.cycle(dt_s=3.5, beat=True)
    assert flown.state is State.HOLDING
    outputs = [flown.cycle(Event.RETURN), *flown.cycles(0.5)]
    assert flown.state is State.RETURNING
    assert {output.setpoint for output in outputs} == {None}
    # A new engagement begins a new stream.
    flown.cycle(Event.HOLD)
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    assert flown.cycle(Event.ENGAGE).state is State.ENTERING
    flown.mode = Mode.GUIDED
    held = flown.cycle(Event.HOLD, beat=True)
    assert (held.state, held.setpoint is not None) == (State.HOLDING, True)


@pytest.mark.parametrize(("autopilot", "mode"), MODES)
@pytest.mark.parametrize("order", [Event.HOLD, Event.RETURN, Event.LAND])
def test_what_an_order_asked_for_and_got_is_not_asked_for_again_when_a_pilot_ends_it(
    autopilot, order, mode
):
    flown = Flown(settings_of(autopilot)).engaged()
    flown.cycle(order)
    asked = ASKED_MODES[flown.state]
    flown.mode = asked
    flown.cycle(beat=True)
    flown.mode = mode
    outputs = [flown.cycle(beat=True), *flown.cycles(5.0, dt_s=SLOW_S)]
    assert (flown.state is State.YIELDED) is (mode is not asked)
    assert commands(outputs) == []


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_request_that_is_overtaken_by_an_order_is_no_pilots_mode(autopilot):
    flown = Flown(settings_of(autopilot)).standing_by()
    flown.evader = (60.0, 0.0)
    flown.cycle(Event.ENGAGE)
    flown.cycles(0.5)  # the guided mode is asked for
    assert flown.cycle(Event.HOLD).requests[0] == autopilot.set_mode(Mode.HOLD)
    for flown.mode in (Mode.HOLD, Mode.GUIDED, Mode.HOLD):
        flown.cycle(beat=True)
        assert flown.state is State.HOLDING
    flown.cycles(6.0)
    flown.mode = Mode.GUIDED  # by now it is another's
    assert flown.cycle(beat=True).state is State.YIELDED


ENDINGS = [
    (Event.HOLD, State.HOLDING),
    (Event.RETURN, State.RETURNING),
    (Event.LAND, State.LANDING),
]


@pytest.mark.parametrize(("order", "state"), [*ENDINGS, (Event.ABORT, State.LANDING)])
@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.GUIDED, Mode.RETURN, Mode.OTHER])
@pytest.mark.parametrize("autopilot", BOTH)
def test_a_vehicle_found_armed_is_handed_over_on_an_order_and_gets_no_setpoint(
    autopilot, mode, order, state
):
    vehicle = Flown(settings_of(autopilot))
    vehicle.armed = True
    vehicle.landed = 2
    vehicle.mode = mode
    vehicle.cycle(refusals=("GF_ACTION",))
    assert vehicle.cycle(refusals=("GF_ACTION",)).state is State.CHECKING
    ending = vehicle.cycle(order, refusals=("GF_ACTION",))
    assert ending.state is state
    ending_mode = {
        State.HOLDING: Mode.HOLD,
        State.RETURNING: Mode.RETURN,
        State.LANDING: Mode.LAND,
    }[state]
    stop = () if not mode is ending_mode is autopilot.arming_mode else (autopilot.stop(),)
    assert ending.requests == (autopilot.set_mode(ending_mode), *stop)
    later = vehicle.cycles(3.0, dt_s=SLOW_S)
    assert vehicle.state is state
    repeats = (
        0 if mode in {ending_mode, Mode.OTHER} else 1
    )  # a pilot's mode is not asked away twice
    assert commands(later) == [SET_MODE] * repeats
    assert {output.setpoint for output in [ending, *later]} == {None}


@pytest.mark.parametrize(("order", "state"), ENDINGS)
def test_of_a_vehicle_that_is_not_armed_there_is_nothing_to_end(order, state):
    down = Flown()
    for before in (State.CONNECTING, State.READY):
        if before is State.READY:
            down.cycles(0.1)
        (transition,) = down.cycle(order, silent=before is State.CONNECTING).transitions
        assert (transition.event, transition.after) == (order, before)
        assert down.state is not state


def test_what_was_taken_before_its_checks_passed_is_not_engaged_until_they_do():
    vehicle = Flown()
    vehicle.armed = True
    vehicle.landed = 2
    vehicle.evader = (60.0, 0.0)
    vehicle.position[2] = HOME_DOWN_M - 10.0
    refused = {"refusals": ("GF_ACTION",)}
    vehicle.cycle(**refused)
    vehicle.cycle(Event.HOLD, **refused)
    assert vehicle.cycle(Event.ENGAGE, **refused).state is State.HOLDING
    assert not vehicle.flight.checked
    assert vehicle.cycle(Event.ENGAGE).state is State.ENTERING


def test_a_vehicle_that_was_ready_is_engaged_again_unless_a_check_refuses():
    vehicle = Flown().standing_by()
    vehicle.cycle(Event.HOLD)
    assert vehicle.flight.checked
    assert vehicle.cycle(Event.ENGAGE, refusals=("GF_ACTION",)).state is State.HOLDING
    # In the air an autopilot's own checks for arming are no more asked for
    unfit = [status(vehicle.now_s, healthy=0)]
    assert vehicle.cycle(Event.ENGAGE, more=unfit).state is State.ENTERING


def test_readiness_that_was_lost_again_does_not_count():
    vehicle = Flown()
    vehicle.armed = True
    vehicle.landed = 2
    vehicle.cycles(0.1)
    assert vehicle.state is State.READY
    vehicle.cycle(refusals=("GF_ACTION",))
    vehicle.cycle(Event.HOLD, refusals=("GF_ACTION",))
    assert vehicle.cycle(Event.ENGAGE, refusals=("GF_ACTION",)).state is State.HOLDING


def test_only_orders_may_be_ordered():
    vehicle = Flown()
    for event in set(Event) - ORDERS:
        with pytest.raises(
            ValueError, match=r"^order = .*: allowed are abort, engage, hold, land, return, start$"
        ):
            vehicle.cycle(event)


def test_orders_are_followed_one_after_the_other_and_have_one_transition_each():
    vehicle = Flown().standing_by()
    outputs = vehicle.cycle(Event.ENGAGE, Event.START, Event.HOLD)
    assert [(h.event, h.before, h.after) for h in outputs.transitions] == [
        (Event.ENGAGE, State.STANDING_BY, State.ENTERING),
        (Event.ALOFT, State.ENTERING, State.ENTERING),
        (Event.HOLD, State.ENTERING, State.HOLDING),
    ]
    assert {h.now_s for h in outputs.transitions} == {vehicle.now_s}


def test_the_guided_mode_is_requested_after_a_setpoint_and_a_requested_heartbeat():
    vehicle = Flown().standing_by()
    vehicle.evader = (60.0, 0.0)
    ordered = vehicle.cycle(Event.ENGAGE, beat=True)  # this HEARTBEAT may be from before the order
    assert (ordered.state, ordered.setpoint is None) == (State.ENTERING, False)
    assert ordered.requests == (BEAT,)
    streamed = vehicle.cycles(STREAM_FIRST_S - CYCLE_S, beat=True)
    assert all(output.setpoint is not None for output in streamed)
    assert set(commands(streamed)) == {MESSAGE}
    assert PX4.set_mode(Mode.GUIDED) in [
        request for output in vehicle.cycles(0.06, beat=True) for request in output.requests
    ]
    vehicle.mode = Mode.GUIDED
    vehicle.beat_s = math.inf  # no HEARTBEAT but those of the test
    outputs = vehicle.cycles(BEAT_EVERY_S)
    assert [request for output in outputs for request in output.requests] == [BEAT]
    assert vehicle.cycle(beat=True).state is State.ENGAGED
    assert commands(vehicle.cycles(1.0)) == []


def test_the_wait_for_a_requested_heartbeat_is_bounded():
    vehicle = Flown().standing_by()
    vehicle.evader = (60.0, 0.0)
    outputs = [vehicle.cycle(Event.ENGAGE), *vehicle.cycles(UNHEARD_S - 2 * CYCLE_S)]
    assert set(commands(outputs)) == {MESSAGE}
    later = vehicle.cycles(3 * CYCLE_S)
    assert [request for output in later for request in output.requests if request != BEAT] == [
        PX4.set_mode(Mode.GUIDED)
    ]
    assert all(output.setpoint is not None for output in (*outputs, *later))


@pytest.mark.parametrize("began_s", [0.0, 1234.56])
@pytest.mark.parametrize(("autopilot", "streamed"), [(PX4, 10), (ARDUCOPTER, 0)])
def test_guided_mode_requests_are_sent_in_the_due_cycle_for_any_clock_rounding(
    autopilot, streamed, began_s
):
    for beat, requests_due in ((True, streamed + 1), (False, 20)):
        vehicle = Flown(settings_of(autopilot))
        vehicle.now_s += began_s
        vehicle.standing_by()
        vehicle.beat_s = math.inf  # no HEARTBEAT but those of the test
        requests_of_cycles = [
            vehicle.cycle(Event.ENGAGE).requests,
            *(vehicle.cycle(beat=beat).requests for _ in range(20)),
        ]
        mode = autopilot.set_mode(Mode.GUIDED)
        message = autopilot.request_message(HEARTBEAT)
        assert [n for n, requests in enumerate(requests_of_cycles) if mode in requests] == [
            requests_due
        ]
        assert [n for n, requests in enumerate(requests_of_cycles) if message in requests] == [
            0,
            5,
            10,
            15,
            20,
        ]


def test_the_guided_mode_is_requested_again_only_while_another_of_our_modes_is_on():
    vehicle = Flown().standing_by()
    vehicle.cycle(Event.ENGAGE)
    assert PX4.set_mode(Mode.GUIDED) in [
        request for output in vehicle.cycles(0.3, beat=True) for request in output.requests
    ]
    vehicle.beat_s = math.inf  # no HEARTBEAT but those of the test
    quiet = vehicle.cycles(REPEAT_S + 0.5)
    assert set(commands(quiet)) == {MESSAGE}
    assert PX4.set_mode(Mode.GUIDED) in vehicle.cycle(beat=True).requests
    vehicle.mode = Mode.OTHER
    assert (vehicle.cycle(beat=True).state, vehicle.outputs.requests) == (State.YIELDED, ())


def test_an_order_without_effect_gives_a_phase_no_more_time():
    vehicle = Flown().standing_by()
    vehicle.cycle(Event.ENGAGE)
    entered_s = vehicle.now_s
    while vehicle.state is State.ENTERING:
        vehicle.cycle(Event.START)
    assert vehicle.state is State.HOLDING
    assert vehicle.now_s - entered_s == pytest.approx(10.0, abs=2 * CYCLE_S)


def test_a_pilots_switch_is_not_undone_by_a_request_that_is_due():
    vehicle = Flown().standing_by()
    assert commands(vehicle.cycles(REPEAT_S + 0.5)) == []
    vehicle.mode = Mode.OTHER
    yielded = vehicle.cycle(beat=True)
    assert (yielded.state, yielded.setpoint, yielded.requests) == (State.YIELDED, None, ())
    for order in sorted(ORDERS):
        after = vehicle.cycle(order, beat=True)
        assert (after.state, after.setpoint, after.requests) == (State.YIELDED, None, ())


@pytest.mark.parametrize(
    ("order", "state", "mode"),
    [
        (Event.HOLD, State.HOLDING, Mode.HOLD),
        (Event.RETURN, State.RETURNING, Mode.RETURN),
        (Event.LAND, State.LANDING, Mode.LAND),
    ],
)
def test_a_hover_goes_out_until_a_heartbeat_shows_that_the_autopilot_has_taken_over(
    order, state, mode
):
    vehicle = Flown().engaged()
    handed = vehicle.cycle(order)
    assert handed.state is state
    assert list(handed.requests) == [PX4.set_mode(mode)]
    assert all(output.setpoint is not None for output in vehicle.cycles(0.5))
    vehicle.mode = mode
    assert vehicle.cycle(beat=True).setpoint is None
    assert {output.setpoint for output in vehicle.cycles(2.5)} == {None}
    assert commands(vehicle.cycles(2.0)) == []


@pytest.mark.parametrize("brought", [lambda vehicle: vehicle, Flown.standing_by, Flown.engaged])
@pytest.mark.parametrize("refusals", [(), ("GF_ACTION",)])
def test_what_an_order_will_do_is_foreseen_and_asking_changes_nothing(brought, refusals):
    for order in sorted(ORDERS):
        vehicle = brought(Flown())
        before = vehicle.state
        foreseen = vehicle.flight.follows(order, vehicle.now_s, refusals)
        assert vehicle.state is before
        transition = vehicle.cycle(order, refusals=refusals).transitions[0]
        assert (transition.event in {order, Event.ALOFT}, transition.before) == (True, before)
        assert foreseen is (transition.after is not before)


@pytest.mark.parametrize(
    ("engage_on", "taken"), [(EngageOn.COMMAND, False), (EngageOn.PILOT_MODE, True)]
)
def test_a_piloted_vehicle_is_taken_over_only_if_the_pilot_engages(engage_on, taken):
    vehicle = Flown(settings_of(engage_on=engage_on))
    vehicle.cycles(0.1)
    vehicle.armed = True
    vehicle.landed = 2
    vehicle.mode = Mode.OTHER
    vehicle.position[2] = HOME_DOWN_M - 10.0
    vehicle.cycle(beat=True)
    assert vehicle.flight.follows(Event.START, vehicle.now_s) is taken
    (transition,) = vehicle.cycle(Event.START).transitions
    expected = (Event.ALOFT, State.STANDING_BY) if taken else (Event.START, State.READY)
    assert (transition.event, transition.after) == expected


def test_an_evader_may_be_set_down_elsewhere_before_the_flight_and_not_in_it():
    on_ground = Flown()
    in_flight = Flown().standing_by()
    for vehicle in (on_ground, in_flight):
        vehicle.evader = (60.0, 0.0)
        vehicle.cycles(1.0)
        vehicle.evader = (560.0, 0.0)
        vehicle.cycles(1.5)
    north_m = [
        output.flight.tracking.evader(output.now_s).position_ned_m[0]
        for output in (on_ground, in_flight)
    ]
    assert north_m == pytest.approx([560.0, 60.0], abs=5.0)


def test_a_mode_of_ours_that_an_order_is_to_end_is_no_pilots_until_it_comes_again():
    vehicle = Flown().standing_by()
    vehicle.cycle(Event.RETURN)
    vehicle.mode = Mode.RETURN
    vehicle.cycle(beat=True)
    assert vehicle.flight.leaving_modes == ()
    vehicle.cycle(Event.HOLD)
    assert vehicle.cycle(beat=True).state is State.HOLDING
    assert vehicle.flight.leaving_modes == (Mode.RETURN,)
    vehicle.mode = Mode.HOLD
    assert vehicle.cycle(beat=True).state is State.HOLDING
    assert vehicle.flight.leaving_modes == ()
    vehicle.mode = Mode.RETURN  # which nobody ordered
    assert vehicle.cycle(beat=True).state is State.YIELDED


def test_two_evader_sources_end_in_hold_or_are_reported_each_time(monkeypatch):
    for hold in (True, False):
        vehicle = Flown(settings_of(hold_on_rival=hold)).engaged()
        events = []
        for rival in ("", "place", "place", "clock", "", "place"):
            monkeypatch.setattr(vehicle.flight.tracking, "rival", lambda _now_s, rival=rival: rival)
            transitions = vehicle.cycle().transitions
            events.append([(transition.event, transition.after) for transition in transitions])
        if hold:
            assert events == [[], [(Event.RIVAL, State.HOLDING)], [], [], [], []]
        else:
            once = [(Event.RIVAL, State.ENGAGED)]
            assert events == [[], once, [], [], [], once]
