"""An operator's order stands until another order, a pilot's action or a safety event."""

import pytest

from guidance.autopilots import Mode
from guidance.flight import BEFORE_FLIGHT, FINAL, Authority, Event, State, is_done
from guidance.flight.table import ASKED_MODES, TRANSITIONS
from tests.flight.flown import ARM, SET_MODE, SLOW_S, Flown, commands
from tests.flight.scenes import BOTH, settings_of, status

ENDING = (Event.HOLD, Event.RETURN, Event.LAND, Event.ABORT)
LEADS_TO = {
    Event.HOLD: State.HOLDING,
    Event.RETURN: State.RETURNING,
    Event.LAND: State.LANDING,
    Event.ABORT: State.LANDING,
}
IN_THE_AIR = sorted(set(State) - BEFORE_FLIGHT - FINAL - {State.ARMING})
STANDS_S = 8.0
BEAT_S = 0.5


class Obeying(Flown):
    """A vehicle in the air that takes every mode it is asked for."""

    def __init__(self, autopilot, state=State.STANDING_BY, **changes):
        super().__init__(settings_of(autopilot, **changes))
        self.standing_by()
        self.flight.stage.state = state
        asked = ASKED_MODES.get(state)
        self.mode = asked if asked in autopilot.custom_modes else autopilot.arming_mode
        self.flight.stage.left = frozenset({self.mode})
        self.cycle(beat=True)
        self.flight.stage.state = state
        self.flight.cause = None  # where the vehicle is leads on from some states

    def cycle(self, *orders, mission=(), **given):
        self.mission = mission
        outputs = super().cycle(*orders, **given)
        for request in outputs.requests:
            self.mode = next((one for one in Mode if one in self.autopilot.custom_modes
                              and request == self.autopilot.set_mode(one)), self.mode)  # fmt: skip
        return outputs

    def inputs(self, *args):
        return super().inputs(*args)._replace(mission=self.mission)


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("order", ENDING)
@pytest.mark.parametrize("state", IN_THE_AIR)
def test_what_an_operator_orders_in_the_air_stands_whatever_a_mission_orders(
    state, order, autopilot
):
    flown = Obeying(autopilot, state)
    flown.cycle(order)
    assert flown.state is LEADS_TO[order]
    assert flown.flight.cause[1:] == (order, state, LEADS_TO[order], Authority.OPERATOR, "")
    for number in range(round(STANDS_S / BEAT_S)):
        flown.cycle(mission=[list(LEADS_TO)[number % 4], Event.ENGAGE], dt_s=BEAT_S)
        assert flown.state is LEADS_TO[order]
        assert flown.flight.ordered_by_operator


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("order", ENDING)
@pytest.mark.parametrize("state", [State.CLIMBING, State.ENGAGED])
def test_the_next_order_of_an_operator_is_followed(state, order, autopilot):
    for then in (Event.HOLD, Event.RETURN, Event.LAND):
        flown = Obeying(autopilot, state)
        flown.cycle(order)
        flown.cycles(2.0, dt_s=SLOW_S)
        flown.cycle(then)
        assert flown.state is LEADS_TO[then]
        assert flown.flight.ordered_by_operator


def started(autopilot, mode, *, armed):
    """A vehicle that was ordered to start; it may be armed already."""
    flown = Flown(settings_of(autopilot))
    flown.mode = mode
    flown.cycles(0.1)
    flown.cycle(Event.START)
    assert flown.state is State.ARMING
    if armed:
        flown.armed_as_asked()
        flown.cycle(beat=True)
        assert flown.state is State.CLIMBING
    return flown


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("order", ENDING)
@pytest.mark.parametrize("armed", [False, True])
@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.GUIDED, Mode.LAND, Mode.OTHER])
def test_an_order_to_end_undoes_a_start_until_the_vehicle_is_seen_disarmed(
    mode, armed, order, autopilot
):
    flown = started(autopilot, mode, armed=armed)
    undone = (autopilot.set_mode(Mode.HOLD), autopilot.disarm())
    ended = flown.cycle(order)
    assert (ended.state, ended.requests) == (LEADS_TO[order], undone)
    flown.armed = True  # the request to arm was on its way
    outputs = flown.cycles(3.0, dt_s=SLOW_S)
    asked = [request for output in outputs for request in output.requests]
    assert asked[:2] == list(undone)  # again, while it is armed
    assert set(asked) == set(undone)
    assert {output.setpoint for output in outputs} == {None}
    flown.armed = False
    outputs += flown.cycles(1.2, dt_s=SLOW_S)
    assert flown.state is State.LANDED
    assert not set(commands(outputs)) - {SET_MODE, ARM}
    assert flown.flight.ordered_by_operator is False  # it is seen to be on the ground


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize("order", ENDING)
def test_a_vehicle_that_leaves_the_ground_as_its_start_is_undone_is_ended_in_the_air(
    order, autopilot
):
    flown = started(autopilot, Mode.HOLD, armed=True)
    flown.cycle(order)
    flown.landed = 3
    flown.mode = Mode.TAKEOFF if Mode.TAKEOFF in autopilot.custom_modes else Mode.GUIDED
    asked = [request for output in flown.cycles(2.5) for request in output.requests]
    assert autopilot.set_mode(ASKED_MODES[LEADS_TO[order]]) in asked
    assert autopilot.disarm() not in asked


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_vehicle_on_the_ground_is_not_engaged(autopilot):
    flown = started(autopilot, Mode.HOLD, armed=True)
    flown.evader = (60.0, 0.0)
    flown.cycle(Event.HOLD)
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    assert flown.cycle(Event.ENGAGE).state is State.HOLDING


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_hold_ends_the_way_to_the_start(autopilot):
    """PX4 flies there in its hold, so that the mode alone changes nothing."""
    flown = Obeying(autopilot, State.POSITIONING)
    ordered = flown.cycle(Event.HOLD)
    stop = [autopilot.stop()] if autopilot.arming_mode is Mode.HOLD else []
    assert list(ordered.requests) == [autopilot.set_mode(Mode.HOLD), *stop]
    assert commands(flown.cycles(5.0)) == []


@pytest.mark.parametrize("state", sorted(BEFORE_FLIGHT | FINAL))
@pytest.mark.parametrize("order", ENDING)
def test_without_a_start_an_order_ends_the_flight_or_changes_nothing(state, order):
    flown = Flown()
    flown.cycle()
    flown.flight.stage.state = state
    (transition,) = [one for one in flown.cycle(order).transitions if one.event is order]
    expected = State.FAILED if order is Event.ABORT and state in BEFORE_FLIGHT else state
    assert (transition.before, transition.after, transition.by) == (
        state,
        expected,
        Authority.OPERATOR,
    )


def test_a_mission_may_end_what_the_flight_or_the_mission_itself_began():
    flown = Obeying(settings_of().autopilot)
    (held,) = flown.cycle(mission=[Event.HOLD]).transitions
    assert (held.after, held.by) == (State.HOLDING, Authority.MISSION)
    flown.cycle(mission=[Event.LAND])
    assert (flown.state, flown.flight.ordered_by_operator) == (State.LANDING, False)


@pytest.mark.parametrize("order", ENDING)
def test_an_order_for_what_is_done_already_takes_it_from_the_mission(order):
    flown = Obeying(settings_of().autopilot)
    flown.cycle(mission=[order])
    assert not flown.flight.ordered_by_operator
    flown.cycle(order)
    assert flown.flight.ordered_by_operator
    other = Event.LAND if order is Event.HOLD else Event.HOLD
    (refused,) = flown.cycle(mission=[other]).transitions
    assert refused.event is other
    assert refused.after is refused.before is LEADS_TO[order]


def test_an_operators_order_of_the_same_cycle_goes_before_the_missions():
    flown = Obeying(settings_of().autopilot)
    first, second = flown.cycle(Event.HOLD, mission=[Event.LAND]).transitions
    assert (first.by, first.after) == (Authority.OPERATOR, State.HOLDING)
    assert (second.by, second.after) == (Authority.MISSION, State.HOLDING)


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(
    ("mode", "given", "ends_in"),
    [
        (Mode.HOLD, {"silent": True}, State.YIELDED),
        (Mode.OTHER, {}, State.YIELDED),
        (Mode.HOLD, {"more": [status(1e9, 0.2)]}, State.RETURNING),
    ],
)
def test_a_hold_ends_by_a_pilot_or_a_safety_event(mode, given, ends_in, autopilot):
    flown = Obeying(autopilot)
    flown.cycle(Event.HOLD)
    flown.cycles(2.0)
    flown.mode = mode
    flown.cycles(3.0, **given)
    assert flown.state is ends_in
    assert flown.flight.cause.by is Authority.FLIGHT


def test_a_hold_ordered_while_the_battery_is_low_stands():
    flown = Obeying(settings_of().autopilot, State.RETURNING)
    low = {"more": [status(1e9, 0.2)]}
    flown.cycles(0.1, **low)
    flown.cycle(Event.HOLD, **low)
    flown.cycles(3.0, **low)
    assert flown.state is State.HOLDING


def test_a_missions_hold_with_a_low_battery_does_not_stand_and_an_operators_stands_until_the_next_order():
    low = {"more": [status(1e9, 0.2)] * 3}
    by_mission = Obeying(settings_of().autopilot)
    assert by_mission.cycle(mission=[Event.HOLD], **low).state is State.RETURNING
    by_operator = Obeying(settings_of().autopilot)
    assert by_operator.cycle(Event.HOLD, **low).state is State.HOLDING
    by_operator.cycles(3.0, **low)
    assert by_operator.state is State.HOLDING
    assert by_operator.cycle(Event.ENGAGE, **low).state is State.RETURNING


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_pilots_hold_right_after_the_engagement_is_noticed_at_once(autopilot):
    flown = Flown(settings_of(autopilot)).engaged()
    flown.mode = Mode.HOLD
    assert flown.cycle(beat=True).state is State.YIELDED


@pytest.mark.parametrize("autopilot", BOTH)
def test_the_mode_that_a_vehicle_found_armed_flies_by_now_is_left_by_the_order(autopilot):
    flown = Flown(settings_of(autopilot))
    flown.armed = True
    flown.landed = 2
    for flown.mode in (Mode.HOLD, Mode.RETURN):
        flown.cycles(0.1)
        flown.cycle(beat=True)
    flown.cycle(Event.LAND)
    assert flown.cycle(beat=True).state is State.LANDING


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_telemetry_gap_while_standing_by_is_named_and_heals_but_does_not_engage(autopilot):
    flown = Obeying(autopilot)
    flown.cycles(2.3, silent=True)
    assert flown.state is State.OUT_OF_CONTACT
    assert flown.flight.cause.words == "no telemetry for 1.0 s"
    assert flown.cycle(Event.ENGAGE, silent=True).transitions[0].after is State.OUT_OF_CONTACT
    outputs = flown.cycles(20.0)
    assert [transition.after for output in outputs for transition in output.transitions] == [
        State.STANDING_BY
    ]
    assert commands(outputs) == []
    assert flown.cycle(Event.ENGAGE).state is State.ENTERING


def test_standing_by_does_not_return_while_a_check_fails():
    flown = Obeying(settings_of().autopilot)
    flown.cycles(2.0, silent=True)
    flown.cycles(10.0, more=[status(1e9, healthy=0)])
    assert flown.state is State.OUT_OF_CONTACT
    flown.cycles(3.0)
    assert flown.state is State.STANDING_BY


@pytest.mark.parametrize(("order", "state"), list(LEADS_TO.items()))
def test_out_of_contact_the_vehicle_can_be_sent_somewhere(order, state):
    flown = Obeying(settings_of().autopilot)
    flown.cycles(2.0, silent=True)
    outputs = flown.cycle(order, silent=True)
    assert outputs.transitions[0].after is state
    assert commands([outputs]) != []


@pytest.mark.parametrize("autopilot", BOTH)
def test_a_hold_ordered_while_positions_are_missing_sends_no_setpoint_from_an_old_one(autopilot):
    """HEARTBEAT still shows the guided mode; the hover that covers the mode change ends with the position's age."""
    flown = Flown(settings_of(autopilot)).engaged()
    flown.without_position = True
    before = flown.cycles(0.5)
    after = [flown.cycle(Event.HOLD), *flown.cycles(1.4)]
    assert flown.state is State.YIELDED
    sent = [outputs.setpoint is not None for outputs in [*before, *after]]
    assert sum(sent) == pytest.approx(50, abs=1)
    assert not any(sent[51:])


YIELDS = [
    ("no telemetry for 1.0 s", {"silent": True}),
    ("no LOCAL_POSITION_NED for 1.0 s", {"without_position": True}),
    (
        "and guidance stood still for 5.0 s",
        {"dt_s": 5.0},
    ),
    ("the vehicle disarmed while guidance flew it", {"armed": False}),
    ("a pilot or the autopilot chose that mode", {"mode": Mode.OTHER}),
]


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(("words", "happens"), YIELDS)
def test_a_yield_names_its_cause(words, happens, autopilot):
    flown = Flown(settings_of(autopilot)).engaged()
    for name in happens.keys() & {"armed", "mode", "without_position"}:
        setattr(flown, name, happens[name])
    flown.cycle(dt_s=happens.get("dt_s", 0.02), silent="silent" in happens)
    for _ in range(60):
        flown.cycle(beat="silent" not in happens, silent="silent" in happens)
    assert flown.state is State.YIELDED
    assert flown.flight.cause.words.endswith(words)


def test_every_order_that_led_to_a_state_is_done_there():
    for (_, order), after in TRANSITIONS.items():
        assert is_done(order, after)
    assert not is_done(Event.HOLD, State.LANDING)
