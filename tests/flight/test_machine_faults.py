"""No data from a wire ends a flight with an exception; an error in our code ends it in the autopilot's hold."""

import math
from typing import get_args, get_type_hints

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.flight import FINAL, ORDERS, Event, State
from guidance.flight.sending import REPEAT_S
from guidance.frames import Ned
from guidance.messages import Attitude, EvaderReport, Home, LocalPosition, Message
from guidance.vehicle import is_plausible
from tests.flight.flown import SET_MODE, Flown, commands
from tests.flight.scenes import BOTH, ENVELOPE, settings_of

BAD = (math.nan, math.inf, -math.inf, 1e38, -1e38)
PLAIN = {float: 0.5, int: 3, bool: True, str: "word", Ned: Ned((0.5, 0.5, 0.5))}


def sane(kind, at_s):
    """A message of a kind, with numbers that anything might have."""
    values = {}
    for name, hint in get_type_hints(kind).items():
        values[name] = at_s if name in {"received_s", "time_boot_s", "sent_s"} else PLAIN.get(hint)
    return kind(**values)


def spoilt(message):
    """The message once for every number in it and every bad value; arrival times are our own."""
    for name, hint in get_type_hints(type(message)).items():
        if name == "received_s":
            continue
        value = getattr(message, name)
        if isinstance(value, float) and hint is float:
            yield from (message._replace(**{name: bad}) for bad in BAD)
        elif isinstance(value, int) and not isinstance(value, bool):
            yield from (message._replace(**{name: bad}) for bad in (-(2**63), 2**63 - 1, -1))
        elif isinstance(value, tuple):
            for axis in range(3):
                yield from (
                    message._replace(
                        **{name: type(value)((*value[:axis], bad, *value[axis + 1 :]))}
                    )
                    for bad in BAD
                )


@pytest.mark.parametrize("kind", sorted([*get_args(Message), EvaderReport], key=str))
def test_any_plausible_number_in_any_message_ends_no_flight(kind):
    for brought in (lambda one: one.standing_by(), lambda one: one.engaged()):
        flown = brought(Flown())
        outputs = []
        for bad in filter(is_plausible, spoilt(sane(kind, flown.now_s))):  # links drop all others
            said = [bad._replace(received_s=flown.now_s)]
            outputs.append(
                flown.cycle(reports=said) if kind is EvaderReport else flown.cycle(more=said)
            )
            outputs += flown.cycles(0.04)
        assert flown.flight.fault is None
        assert_within_limits(outputs)


def assert_within_limits(outputs):
    for output in outputs:
        if output.setpoint is None:
            continue
        said = (
            *output.setpoint.velocity_ned_m_s,
            *(output.setpoint.acceleration_ned_m_s2 or ()),
            output.setpoint.yaw_rad or 0.0,
        )
        assert all(map(math.isfinite, said))
        north, east, down = output.setpoint.velocity_ned_m_s
        assert math.hypot(north, east) <= ENVELOPE.speed_m_s + 1e-9
        assert -ENVELOPE.climb_m_s - 1e-9 <= down <= ENVELOPE.descent_m_s + 1e-9


def test_what_cannot_be_meant_is_told_from_what_is_only_not_known():
    assert is_plausible(Home(0.0, 47.0, 8.0, 488.0, Ned((math.nan,) * 3)))
    assert not is_plausible(Home(0.0, 47.0, 8.0, 488.0, Ned((0.0, math.nan, 0.0))))
    assert not is_plausible(Home(0.0, 47.0, 8.0, 488.0, Ned((0.0, 1e38, 0.0))))
    assert not is_plausible(Attitude(0.0, 0.0, 57.3))


@pytest.mark.parametrize("number", BAD)
def test_nonsense_leaves_what_was_known_as_it_was(number):
    """Once: several positions that contradict the vehicle's are a second sender, and end the game."""
    flown = Flown().engaged()
    before = flown.flight.observed.cycle.envelope, flown.flight.tracking.local_frame
    flown.cycle(more=[Home(flown.now_s, 47.0, 8.0, 488.0, Ned((number, 0.0, 0.0)))])
    boot_s = flown.now_s + 0.001
    flown.cycle(
        more=[LocalPosition(flown.now_s, boot_s, Ned((0.0, number, 0.0)), Ned((0.0, 0.0, 0.0)))]
    )
    flown.cycle()
    assert (flown.flight.observed.cycle.envelope, flown.flight.tracking.local_frame) == before
    assert flown.state is State.ENGAGED


def break_at(flown, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("the speed is nil")

    monkeypatch.setattr(flown.flight.tracking, "evader", broken)


@pytest.mark.parametrize("autopilot", BOTH)
def test_an_error_of_our_own_ends_in_the_autopilots_hold_says_why_and_yields(
    autopilot, monkeypatch
):
    flown = Flown(settings_of(autopilot)).engaged()
    break_at(flown, monkeypatch)
    failed = flown.cycle()
    assert (failed.state, failed.setpoint) == (State.YIELDED, None)
    assert failed.requests == (autopilot.set_mode(Mode.HOLD),)
    assert [(h.event, h.before, h.after) for h in failed.transitions] == [
        (Event.FAULT, State.ENGAGED, State.YIELDED)
    ]
    assert failed.fault.startswith("ZeroDivisionError: the speed is nil (broken, line ")
    assert flown.flight.fault == failed.fault
    outputs = flown.cycles(REPEAT_S + 1.5)
    # Again, for a HEARTBEAT shows that it has not been heard
    assert commands(outputs) == [SET_MODE]
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    flown.mode = Mode.GUIDED  # a pilot's doing
    outputs += flown.cycles(5.0)
    assert {output.setpoint for output in outputs} == {None}
    assert commands(outputs) == [SET_MODE]
    ordered = flown.cycle(Event.ENGAGE, Event.HOLD)
    assert [(h.event, h.after) for h in ordered.transitions] == [
        (Event.ENGAGE, State.YIELDED),
        (Event.HOLD, State.YIELDED),
    ]


def test_a_pilot_who_has_the_vehicle_keeps_it_whatever_goes_wrong(monkeypatch):
    flown = Flown().engaged()
    break_at(flown, monkeypatch)
    flown.mode = Mode.OTHER
    assert commands([flown.cycle(beat=True)]) == []
    assert commands(flown.cycles(5.0)) == []


def test_on_the_ground_nothing_is_asked_of_the_vehicle(monkeypatch):
    flown = Flown()
    flown.cycles(0.1)
    monkeypatch.setattr(flown.flight.tracking, "observe", lambda *_: 1 / 0)
    failed = flown.cycle()
    assert (failed.state, failed.setpoint, failed.requests) == (State.FAILED, None, ())
    assert flown.state in FINAL


def test_after_an_internal_error_orders_are_refused_without_another_error(monkeypatch):
    flown = Flown().engaged()
    assert flown.flight.follows(Event.HOLD, flown.now_s)
    monkeypatch.setattr(flown.flight.tracking, "silence_s", lambda _now_s: 1 / 0)
    assert flown.cycle().fault.startswith("ZeroDivisionError")
    assert [flown.flight.follows(order, flown.now_s) for order in sorted(ORDERS)] == [False] * len(
        ORDERS
    )


def test_after_an_error_modes_are_still_shown_and_a_second_error_is_no_second_fault(monkeypatch):
    flown = Flown().engaged()
    break_at(flown, monkeypatch)
    assert flown.cycle().fault is not None
    flown.mode = Mode.RETURN
    flown.cycle(beat=True)
    assert flown.flight.mode_name == "return"
    monkeypatch.setattr(flown.flight.observed, "vehicle_says", lambda _messages: 1 / 0)
    again = flown.cycle(Event.HOLD)
    assert (again.state, again.setpoint, again.fault) == (State.YIELDED, None, None)
    assert [transition.event for transition in again.transitions] == [Event.HOLD]
    assert flown.flight.fault.startswith("ZeroDivisionError: the speed is nil")


LOST = {
    "loop stopped": {"dt_s": 3.1, "beat": True},
    "telemetry lost": {"dt_s": 3.1, "silent": True},
}


def yielded(autopilot, how):
    flown = Flown(settings_of(autopilot)).engaged()
    flown.cycles(1.0)
    outputs = flown.cycle(**LOST[how])
    assert outputs.state is State.YIELDED
    return flown, outputs


@pytest.mark.parametrize("how", sorted(LOST))
def test_an_arducopter_waiting_in_guided_after_a_loss_is_switched_to_hold(how):
    flown, lost = yielded(ARDUCOPTER, how)
    assert commands([lost]) == []  # the HEARTBEAT received so far is older than the loss
    (asked,) = [flown.cycle(beat=True)]
    assert asked.requests == (ARDUCOPTER.set_mode(Mode.HOLD),)
    assert commands([*flown.cycles(0.5), flown.cycle(beat=True)]) == []
    flown.cycles(REPEAT_S)
    flown.mode = Mode.GUIDED
    assert SET_MODE in commands(
        [flown.cycle(beat=True), *flown.cycles(REPEAT_S), flown.cycle(beat=True)]
    )
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    flown.mode = Mode.GUIDED  # somebody else's now
    later = flown.cycles(5.0)
    assert commands(later) == []
    assert {one.setpoint for one in [lost, asked, *later]} == {None}
    assert flown.state is State.YIELDED


@pytest.mark.parametrize("how", sorted(LOST))
@pytest.mark.parametrize(
    ("autopilot", "mode"), [(ARDUCOPTER, Mode.OTHER), (ARDUCOPTER, Mode.LAND), (PX4, Mode.GUIDED)]
)
def test_after_a_loss_no_mode_is_requested_from_a_pilot_or_an_active_failsafe(how, autopilot, mode):
    flown, _ = yielded(autopilot, how)
    flown.mode = mode
    assert commands([flown.cycle(beat=True), *flown.cycles(5.0)]) == []


def test_after_a_pilots_takeover_an_arducopter_is_left_alone_in_whatever_mode():
    flown = Flown(settings_of(ARDUCOPTER)).engaged()
    flown.mode = Mode.OTHER
    assert flown.cycle(beat=True).state is State.YIELDED
    flown.mode = Mode.GUIDED
    assert commands(flown.cycles(5.0)) == []


@pytest.mark.parametrize("autopilot", BOTH)
@pytest.mark.parametrize(
    ("order", "mode", "flown_by_us"),
    [
        (None, Mode.HOLD, False),  # standing by, in its own hold
        (Event.ENGAGE, Mode.HOLD, True),  # asked for the guided mode: it may be there by now
        (Event.LAND, Mode.HOLD, False),
        (Event.ABORT, Mode.LAND, False),
    ],
)
def test_after_an_error_the_hold_is_requested_if_our_setpoints_may_be_in_use(
    autopilot, order, mode, flown_by_us, monkeypatch
):
    flown = Flown(settings_of(autopilot)).standing_by()
    if order is not None:
        flown.cycle(order)
    flown.mode = mode
    flown.cycle(beat=True)
    assert requests_after_an_error(flown, monkeypatch) == (
        (autopilot.set_mode(Mode.HOLD),) if flown_by_us else ()
    )


@pytest.mark.parametrize("autopilot", BOTH)
def test_after_an_error_the_hold_is_requested_if_a_landing_was_not_heard_to_begin(
    autopilot, monkeypatch
):
    flown = Flown(settings_of(autopilot)).engaged()
    flown.cycle(Event.LAND)
    flown.cycle(beat=True)
    assert requests_after_an_error(flown, monkeypatch) == (autopilot.set_mode(Mode.HOLD),)


def requests_after_an_error(flown, monkeypatch):
    assert flown.state not in FINAL
    monkeypatch.setattr(flown.flight.tracking, "observe", lambda *_, **_in_flight: 1 / 0)
    failed = flown.cycle()
    assert failed.state is State.YIELDED
    return failed.requests
