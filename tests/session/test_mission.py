"""The orders of a mission: when it starts, engages and ends, and what it waits for."""

from types import SimpleNamespace

import pytest

from guidance.clock import VirtualClock
from guidance.flight import Event, Outputs, State, Transition
from guidance.session.fly.mission import Mission
from guidance.sim.stepped import SteppedWorld
from tests.harness.flights import NEAR


class Directed:
    """The mission of a vehicle whose states are told: it holds 3 s on station, and its game lasts 60 s."""

    def __init__(self):
        clock = VirtualClock()
        scenario = NEAR.model_copy(update={"hold_s": 3.0, "time_limit_s": 60.0})
        world = SteppedWorld(scenario, clock)
        self.player = world.players["evader"] = SimpleNamespace(ready=True, position_game_m=None)
        self.mission = Mission(scenario, world, clock)
        (self.vehicle,) = self.mission.vehicles
        self.daemon = self.vehicle.daemon
        self.silence_s = 0.0
        self.daemon.flight = self.flight = SimpleNamespace(
            state=State.CONNECTING,
            cause=None,
            ordered_by_operator=False,
            observed=SimpleNamespace(role=None),
            tracking=SimpleNamespace(silence_s=lambda _: self.silence_s),
            settings=self.daemon.flight.settings,
        )

    def told(self, now_s, state):
        transitions = ()
        if state is not self.flight.state:
            transitions = (Transition(now_s, Event.GUIDED, self.flight.state, state),)
            self.flight.state = state
            self.flight.cause = transitions[0]
        self.daemon.outputs = Outputs(state, None, (), transitions, None, cause=self.flight.cause)
        self.vehicle.after(now_s, 0.0, None)

    def orders(self, now_s, *, ready=True, fresh=True):
        """Return the orders that come to the daemon."""
        self.player.ready = ready
        self.silence_s = 0.0 if fresh else 1.6
        self.vehicle.before(now_s)
        orders, _ = self.daemon.mailbox.take()
        return [order.order for order in orders]

    @property
    def finished(self):
        return self.mission.finished


@pytest.fixture
def directed():
    return Directed()


def test_the_flight_starts_only_when_the_evader_is_ready(directed):
    directed.told(1.0, State.READY)
    assert directed.orders(1.0, ready=False) == []
    assert directed.orders(1.0) == [Event.START]


def test_the_game_is_engaged_once_and_only_with_an_evader_that_is_heard(directed):
    directed.told(1.0, State.STANDING_BY)
    assert directed.orders(1.0, fresh=False) == []
    assert directed.orders(1.0) == [Event.ENGAGE]
    directed.told(2.0, State.ENGAGED)
    directed.told(9.0, State.STANDING_BY)
    assert directed.orders(9.1) == []


def test_the_evader_plays_from_engagement_until_capture(directed):
    assert not directed.vehicle.playing
    directed.told(2.0, State.ENGAGED)
    assert directed.vehicle.playing
    directed.told(4.0, State.PAUSED)
    assert directed.vehicle.playing
    directed.told(9.0, State.ON_STATION)
    assert not directed.vehicle.playing
    assert directed.vehicle.engaged_s == 2.0


def test_after_capture_it_holds_and_then_lands(directed):
    directed.told(10.0, State.ON_STATION)
    assert directed.orders(12.9) == []
    assert directed.orders(13.0) == [Event.LAND]


@pytest.mark.parametrize("state", [State.HOLDING, State.STANDING_BY])
def test_a_hold_that_leads_nowhere_is_landed(directed, state):
    directed.told(1.0, State.ENGAGED)
    directed.told(10.0, state)
    assert directed.orders(11.9) == []
    assert directed.orders(12.0) == [Event.LAND]


@pytest.mark.parametrize("state", [State.ENGAGED, State.PAUSED])
def test_a_game_over_its_time_is_landed(directed, state):
    directed.told(5.0, State.ENGAGED)
    directed.told(6.0, state)
    assert directed.orders(64.0) == []
    assert directed.orders(65.5) == [Event.LAND]


@pytest.mark.parametrize("state", [State.LANDED, State.FAILED])
def test_a_final_state_is_the_end_and_gets_no_orders(directed, state):
    directed.told(5.0, state)
    assert directed.finished
    assert directed.orders(500.0) == []


def test_a_pilot_who_took_over_is_watched_for_two_seconds_and_given_no_orders(directed):
    directed.told(5.0, State.ENGAGED)
    directed.told(6.0, State.YIELDED)
    assert not directed.finished
    assert directed.orders(7.0) == []
    directed.told(8.0, State.YIELDED)
    assert directed.finished


@pytest.mark.parametrize(
    ("state", "limit_s"), [(State.READY, 60.0), (State.RETURNING, 300.0), (State.LANDING, 300.0)]
)
def test_a_state_that_leads_nowhere_is_given_up(directed, state, limit_s):
    directed.told(5.0, state)
    directed.told(4.9 + limit_s, state)
    assert not directed.finished
    directed.told(5.1 + limit_s, state)
    assert directed.finished


def test_while_an_operators_order_stands_nothing_is_ordered_and_nothing_given_up(directed):
    directed.told(5.0, State.RETURNING)
    directed.flight.ordered_by_operator = True
    directed.told(500.0, State.RETURNING)
    directed.told(501.0, State.HOLDING)
    assert directed.orders(600.0) == []
    assert not directed.finished
