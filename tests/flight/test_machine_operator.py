"""The operator's sign of life, if required: without it the vehicle holds, and later it returns."""

import pytest

from guidance.autopilots import Mode
from guidance.flight import Event, Flight, Inputs, State
from guidance.flight.detection import events
from guidance.messages import Attitude, LandedState
from tests.flight.scenes import NOW_S, context, heartbeat, home, local, settings_of, status, well

CYCLE_S = 0.1


class Held:
    """A flight in STANDING_BY or HOLDING with a good link; the test advances its clock."""

    def __init__(self, state, **changes):
        self.flight = Flight(settings_of(**changes))
        self.flight.stage.state = state
        self.flight.stage.left = frozenset({Mode.HOLD})
        self.now_s = NOW_S
        self.step(home(NOW_S))

    def step(self, *messages, alive=None, orders=()):
        now_s = self.now_s
        well = [
            heartbeat(now_s),
            local(now_s),
            Attitude(now_s, now_s, 0.0),
            LandedState(now_s, 2),
            status(now_s),
        ]
        outputs = self.flight.step(now_s, Inputs([*messages, *well], (), orders, (), alive))
        self.now_s += CYCLE_S
        return [transition.event for transition in outputs.transitions]

    def wait(self, seconds, **given):
        return [event for _ in range(round(seconds / CYCLE_S)) for event in self.step(**given)]


@pytest.mark.parametrize("state", [State.STANDING_BY, State.HOLDING])
def test_a_vehicle_that_waits_for_nobody_returns(state):
    held = Held(state, operator_timeout_s=5.0, operator_return_s=10.0)
    assert held.wait(14.9) == []
    assert held.wait(0.5) == [Event.OPERATOR_GONE]
    assert held.flight.state is State.RETURNING


def test_signs_of_life_and_orders_keep_it_waiting():
    held = Held(State.HOLDING, operator_timeout_s=5.0, operator_return_s=1.0)
    for given in ({"alive": True}, {"orders": (Event.HOLD,)}) * 3:
        held.step(**given)
        assert Event.OPERATOR_GONE not in held.wait(4.5)
    assert held.flight.state is State.HOLDING
    assert held.flight.operator_silence_s(held.now_s) == pytest.approx(4.6, abs=0.11)


def test_where_none_is_asked_for_nobody_is_missed():
    held = Held(State.HOLDING)
    assert held.wait(100.0) == []


def test_before_its_first_cycle_a_flight_has_missed_nobody():
    assert Flight(settings_of()).operator_silence_s(NOW_S) == 0.0


@pytest.mark.parametrize(
    ("silence_s", "expected"),
    [
        (4.9, []),
        (5.1, [Event.OPERATOR_LOST]),
        (14.9, [Event.OPERATOR_LOST]),
        (15.1, [Event.OPERATOR_LOST]),
    ],
)
def test_who_falls_silent_in_a_game_ends_it(silence_s, expected):
    settings = settings_of(operator_timeout_s=5.0, operator_return_s=10.0)
    playing = context(
        State.ENGAGED,
        settings=settings,
        operator_s=NOW_S - silence_s,
        vehicle=well(heartbeat(mode=Mode.GUIDED)),
    )
    assert list(events(playing))[:1] == expected
    gone = [Event.OPERATOR_GONE] if silence_s > 15.0 else []
    assert (
        list(events(context(State.HOLDING, settings=settings, operator_s=NOW_S - silence_s)))
        == gone
    )
