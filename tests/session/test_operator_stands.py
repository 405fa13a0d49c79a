"""An operator's order has priority over the mission, its limits and its end, on every runner."""

import pytest

from guidance.clock import VirtualClock
from guidance.flight import Authority, Event, State
from guidance.session.fly import mission
from guidance.session.fly.daemon import Equipment
from guidance.session.fly.mission import MOCKED, Mission, MissionPolicy
from guidance.session.fly.result import outcome_of_flight
from guidance.session.orders.mailbox import Mailbox
from guidance.sim.stepped import SteppedWorld
from tests.harness.flights import NEAR

pytestmark = pytest.mark.usefixtures("soon_up_and_down")
RUNNERS = {
    "fly": MOCKED,
    "fly --vehicle": MissionPolicy(engage=True, end_with=Event.LAND, hand_over=Event.LAND),
    "scenario run --as vehicle": MissionPolicy(engage=True, hand_over=Event.LAND),
}
LEADS_TO = {
    "hold": State.HOLDING,
    "return": State.RETURNING,
    "land": State.LANDING,
    "abort": State.LANDING,
}
STANDS_S = 12.0
NEXT = {
    State.HOLDING: "held by operator",
    State.RETURNING: "returning by operator",
    State.LANDING: "landing by operator",
}


class Operator:
    """Gives each order once, after the flight has been in a state for a while; `shown` stores all progress shown."""

    def __init__(self, *orders):
        self.mailbox = Mailbox()
        self.orders = list(orders)  # (state, seconds in it, order)
        self.shown = []
        self.state = None
        self.since_s = 0.0

    def watch(self, progress):
        if progress.state is not self.state:
            self.state = progress.state
            self.since_s = progress.now_s
        self.shown.append(progress)
        if self.orders:
            state, wait_s, order = self.orders[0]
            if progress.state is state and progress.now_s - self.since_s >= wait_s:
                self.orders.pop(0)
                self.mailbox.ask(order, "a person")

    def fly(self, policy=MOCKED, scenario=NEAR, **changes):
        clock = VirtualClock()
        pursuer = scenario.pursuer.model_copy(update=changes)
        scenario = scenario.model_copy(update={"pursuer": pursuer})
        world = SteppedWorld(scenario, clock)
        try:
            used = {"pursuer": Equipment(mailbox=self.mailbox)}
            flown = Mission(
                scenario, world, clock, equipment=used, policy=policy, show=self.watch
            ).fly()
            self.result = flown.vehicles["pursuer"]
        finally:
            world.close()
        assert self.orders == []
        return self.result


def by_operator(result):
    """Every change that a person ordered, and when; and what came next."""
    changes = [
        transition for transition in result.transitions if transition.after is not transition.before
    ]
    return [
        (one, changes[number + 1 : number + 2])
        for number, one in enumerate(changes)
        if one.by is Authority.OPERATOR
    ]


@pytest.mark.flight
@pytest.mark.parametrize(
    ("runner", "autopilot"),
    [
        ("fly", "px4"),
        ("fly --vehicle", "arducopter"),
        pytest.param("scenario run --as vehicle", "px4", marks=pytest.mark.long),
    ],
)
def test_a_hold_in_the_game_is_kept_until_land_is_ordered(runner, autopilot):
    operator = Operator((State.ENGAGED, 1.0, "hold"), (State.HOLDING, STANDS_S, "land"))
    result = operator.fly(RUNNERS[runner], autopilot=autopilot)
    (held, (landing,)), _ = by_operator(result)
    assert (held.event, held.before, held.after) == (Event.HOLD, State.ENGAGED, State.HOLDING)
    assert (landing.event, landing.by, landing.after) == (
        Event.LAND,
        Authority.OPERATOR,
        State.LANDING,
    )
    assert landing.now_s - held.now_s >= STANDS_S
    if RUNNERS[runner].end_with is not None:
        assert result.ended is State.LANDED
    told = {one.next for one in operator.shown if one.state is State.HOLDING}
    assert "held by operator: continue with guidance ctl engage, return or land" in told


@pytest.mark.flight
@pytest.mark.parametrize(
    ("before", "order"),
    [
        (State.CLIMBING, "abort"),
        (State.STANDING_BY, "return"),
        (State.ON_STATION, "land"),
    ],
)
def test_return_land_and_abort_stand_from_any_phase_of_a_mission(order, before):
    result = Operator((before, 0.0, order)).fly()
    (ordered, (after,)), *_ = by_operator(result)
    assert (ordered.before, ordered.after) == (before, LEADS_TO[order])
    assert (after.event, after.after) == (Event.DISARMED, State.LANDED)


@pytest.mark.flight
@pytest.mark.parametrize("autopilot", ["px4", pytest.param("arducopter", marks=pytest.mark.long)])
def test_a_landing_can_be_held_and_returned_and_a_return_held(autopilot):
    operator = Operator(
        (State.ENGAGED, 0.5, "land"),
        (State.LANDING, 0.5, "hold"),
        (State.HOLDING, 5.0, "return"),
        (State.RETURNING, 1.0, "hold"),
        (State.HOLDING, 5.0, "land"),
        (State.LANDING, 0.5, "return"),
    )
    result = operator.fly(autopilot=autopilot)
    kept = [(one.before, one.after) for one, _ in by_operator(result)]
    assert kept == [
        (State.ENGAGED, State.LANDING),
        (State.LANDING, State.HOLDING),
        (State.HOLDING, State.RETURNING),
        (State.RETURNING, State.HOLDING),
        (State.HOLDING, State.LANDING),
        (State.LANDING, State.RETURNING),
    ]
    assert result.ended is State.LANDED


@pytest.mark.flight
def test_a_game_engaged_again_after_a_hold_is_judged_by_itself():
    limit_s = 10.0
    operator = Operator((State.ENGAGED, 1.0, "hold"), (State.HOLDING, limit_s + 5.0, "engage"))
    result = operator.fly(scenario=NEAR.model_copy(update={"time_limit_s": limit_s}))
    outcome = outcome_of_flight(result, "fast")
    assert (result.captured, outcome.end, result.ended) == (True, "captured", State.LANDED)
    assert outcome.capture_time_s < limit_s
    engaged = [transition for transition in result.transitions if transition.after is State.ENGAGED]
    assert len(engaged) == 2


@pytest.mark.flight
def test_a_mission_that_ends_its_vehicle_is_kept_going_by_an_operators_order():
    operator = Operator((State.LANDING, 0.1, "hold"), (State.HOLDING, 8.0, "land"))
    result = operator.fly(RUNNERS["scenario run --as vehicle"])
    (held, (landing,)), _ = by_operator(result)
    assert held.before is State.LANDING
    assert landing.now_s - held.now_s >= 8.0


@pytest.mark.flight
def test_a_hold_outlasts_the_longest_mission(monkeypatch):
    limit_s = 28.0  # of 900, to fly less
    monkeypatch.setattr(mission, "MISSION_LIMIT_S", limit_s)
    operator = Operator((State.ENGAGED, 1.0, "hold"), (State.HOLDING, limit_s + 10.0, "land"))
    result = operator.fly()
    (held, (landing,)), _ = by_operator(result)
    assert landing.now_s - held.now_s >= limit_s


@pytest.mark.parametrize("order", LEADS_TO)
def test_a_daemon_without_a_mission_keeps_every_order_too(base, order):
    """Catches an order that the daemon takes back by itself."""
    base = base.engaged()
    assert base.order(order)["accepted"]
    state = base.state
    assert state is LEADS_TO[order]
    base.run(3.0)
    assert base.state is state
    assert base.flight.cause.by is Authority.OPERATOR
    said = base.order("status")
    assert (said["by"], said["next"].split(":")[0]) == ("operator", NEXT[state])
