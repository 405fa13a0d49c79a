"""Orders' mailbox: an order is answered once, by whom it was asked, before the loop runs and when it hangs."""

import pytest

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.clock import VirtualClock
from guidance.flight import Authority, EngageOn, Event, State
from guidance.preflight import Facts, engage_rows, parameter_names, refusals
from guidance.session.orders import mailbox as mailbox_module
from guidance.session.orders.mailbox import (
    ANSWER_LIMIT_S,
    FENCE_WITHIN_S,
    HANDOVER_LIMIT_S,
    MOST_ORDERS,
    MOST_QUERIES,
    ORDER_OF,
    READ_WITHIN_S,
    Engaging,
    Mailbox,
    Question,
    ShutdownHandover,
    startup_answers,
)
from tests.flight.flown import Flown
from tests.flight.scenes import settings_of
from tests.preflight.wants import wants_of


def test_an_order_is_taken_once_and_its_answer_reaches_who_asked():
    mailbox = Mailbox()
    question = mailbox.ask("hold")
    (taken,), _ = mailbox.take()
    assert mailbox.take() == ([], [])
    assert not question.done()
    taken.set_result({"accepted": True})
    assert question.result(0.0) == {"accepted": True}


def test_before_the_loop_runs_an_order_is_answered_with_what_is_waited_for():
    clock = VirtualClock()
    clock.sleep_until(1.0)
    mailbox = Mailbox()
    mailbox.meanwhile = startup_answers("uav1", "a HEARTBEAT of system 1 at udp://", 30.0, clock)
    clock.sleep_until(3.54)
    status = mailbox.ask("status").result(0.0)
    assert status == {
        "accepted": True,
        "order": "status",
        "name": "uav1",
        "state": "waiting",
        "waiting_for": "a HEARTBEAT of system 1 at udp://",
        "waited_s": 2.5,
        "connect_timeout_s": 30.0,
    }
    engage = dict(mailbox.ask("engage").result(0.0))
    reason = engage.pop("reason")
    assert reason == "waiting for a HEARTBEAT of system 1 at udp://, 2.5 s so far"
    assert engage == {**status, "order": "engage", "accepted": False}
    assert (
        mailbox.ask("jump").result(0.0)["reason"].startswith("order = 'jump': allowed are abort, ")
    )
    assert mailbox.take() == ([], [])
    mailbox.meanwhile = None
    mailbox.ask("status")
    assert [question.order for question in mailbox.take()[1]] == ["status"]


def test_a_loop_that_hangs_is_not_buried_in_orders():
    mailbox = Mailbox()
    kept = [mailbox.ask("hold") for _ in range(MOST_ORDERS)]
    answer = dict(mailbox.ask("hold").result(0.0))
    assert "does the loop run?" in answer.pop("reason")
    assert answer == {"accepted": False, "order": "hold"}
    assert mailbox.take() == (kept, [])


def test_queries_that_fill_their_queue_keep_no_order_out():
    mailbox = Mailbox()
    queries = [mailbox.ask(word) for word in ("status", "alive") * MOST_QUERIES]
    assert sum(not query.done() for query in queries) == MOST_QUERIES
    hold = mailbox.ask("hold")
    orders, kept = mailbox.take()
    assert orders == [hold]
    assert len(kept) == MOST_QUERIES


def test_an_answer_that_does_not_come_in_time_is_a_refusal(monkeypatch):
    monkeypatch.setattr(mailbox_module, "ANSWER_LIMIT_S", 0.0)
    mailbox = Mailbox()
    answer = mailbox.answer("hold", "Ada")
    ((question,), _) = mailbox.take()
    assert (question.order, question.by) == ("hold", "Ada")
    assert answer == {
        "accepted": False,
        "order": "hold",
        "reason": "the loop did not answer within 0 s",
    }


def test_an_order_arrives_with_its_sender_and_queries_wait_apart():
    mailbox = Mailbox()
    mailbox.ask("hold", "Ada")
    mailbox.ask("land", authority=Authority.MISSION)
    mailbox.ask("status", "Bob")
    mailbox.ask("alive")
    assert mailbox.waiting_orders == 2
    assert mailbox.oversized == 0
    orders, queries = mailbox.take()
    assert [(one.order, one.by, one.authority) for one in (*orders, *queries)] == [
        ("hold", "Ada", Authority.OPERATOR),
        ("land", "", Authority.MISSION),
        ("status", "Bob", Authority.OPERATOR),
        ("alive", "", Authority.OPERATOR),
    ]


def test_a_process_that_ends_hands_a_flight_over_once_and_waits_until_heartbeat_shows_it():
    flown = Flown().engaged()
    ending = ShutdownHandover(Event.HOLD, flown.now_s, Authority.MISSION)
    assert not ending.finished(flown.flight, flown.now_s)
    (question,) = ending.orders(flown.flight)
    assert (question.order, question.authority) == ("hold", Authority.MISSION)
    assert ending.orders(flown.flight) == ()
    flown.cycle(Event.HOLD)
    assert not ending.finished(flown.flight, flown.now_s)
    flown.mode = Mode.HOLD
    flown.cycle(beat=True)
    assert ending.finished(flown.flight, flown.now_s)


def test_a_process_that_ends_waits_for_a_vehicle_on_the_ground_to_be_disarmed():
    flown = Flown()
    flown.cycles(0.1)
    assert Question("land").by == ""
    before = ShutdownHandover(Event.LAND, flown.now_s)
    assert before.authority is Authority.OPERATOR
    assert before.orders(flown.flight) == ()
    assert before.finished(flown.flight, flown.now_s)
    flown.cycle(Event.START)
    flown.armed_as_asked()
    flown.cycle(Event.LAND, beat=True)
    flown.mode = Mode.LAND
    flown.cycle(beat=True)
    ending = ShutdownHandover(Event.LAND, flown.now_s)
    assert not ending.finished(flown.flight, flown.now_s)
    assert not ending.finished(flown.flight, flown.now_s + HANDOVER_LIMIT_S)
    assert ending.finished(flown.flight, flown.now_s + HANDOVER_LIMIT_S + 0.01)
    flown.armed = False
    flown.cycles(3.0)
    assert flown.state is State.LANDED
    assert ending.finished(flown.flight, flown.now_s)
    assert ending.orders(flown.flight) == ()


def test_the_queues_and_time_limits_of_orders_are_these():
    assert (MOST_ORDERS, MOST_QUERIES) == (64, 256)
    assert (ANSWER_LIMIT_S, HANDOVER_LIMIT_S, READ_WITHIN_S) == (2.0, 12.0, 1.5)
    assert FENCE_WITHIN_S == 10.0
    assert sorted(ORDER_OF) == ["hold", "land", "return"]
    assert [str(ORDER_OF[word]) for word in sorted(ORDER_OF)] == sorted(ORDER_OF)


class Survey:
    """What preflight reads, as the test says."""

    def __init__(self):
        self.version = PX4.versions[0]
        self.parameters_complete = False
        self.fence_read_s = None
        self.fence_progress = "0 of 4 items"
        self.asked = []

    def fence_read_since(self, since_s):
        return self.fence_read_s is not None and self.fence_read_s >= since_s

    def facts(self, vehicle, now_s):
        self.judged_s = now_s
        return Facts(vehicle=vehicle)

    def read_again(self, names):
        self.asked.append(tuple(names))

    def read_fence_again(self):
        self.asked.append("fence")


def test_an_engage_order_waits_until_parameters_and_fence_were_read_again():
    flown = Flown().standing_by()
    survey = Survey()
    engaging = Engaging(flown.flight, survey, None)
    assert engaging.bars_the_pilot == ()
    assert engaging.due(10.0) is None
    first = Question("engage")
    second = Question("engage")
    engaging.wait(first, 10.0)
    engaging.wait(second, 10.1)
    names = tuple(parameter_names(PX4.versions[0], announces=False, only_needed=True))
    assert survey.asked == [names, "fence"]
    assert engaging.due(10.2) is None
    survey.parameters_complete = True
    assert engaging.due(10.2) is None
    survey.fence_read_s = 10.3
    assert engaging.due(10.3) == (first, second)
    assert engaging.due(10.4) is None
    assert engaging.give_up() == ()
    assert (engaging.rows, engaging.bars_the_pilot) == ((), ())


def test_what_is_not_read_in_time_is_judged_without_it_and_the_fence_is_read_on():
    flown = Flown().standing_by()
    survey = Survey()
    engaging = Engaging(flown.flight, survey, wants_of())
    question = Question("engage")
    engaging.wait(question, 10.0)
    assert engaging.due(10.0 + READ_WITHIN_S - 0.01) is None
    assert engaging.due(10.0 + READ_WITHIN_S) == (question,)
    assert survey.judged_s == 10.0 + READ_WITHIN_S
    assert "COM_OF_LOSS_T" in refusals(engaging.rows)
    assert any("0 of 4 items" in row.value for row in engaging.rows)
    assert engaging.bars_the_pilot == ()
    engaging.wait(question, 10.0 + FENCE_WITHIN_S)
    assert survey.asked.count("fence") == 1
    survey.parameters_complete = True
    survey.fence_read_s = 20.1
    assert engaging.due(20.1) == (question,)
    facts = Facts(vehicle=flown.flight.vehicle)
    assert engaging.rows == engage_rows(facts, PX4, wants_of())
    engaging.wait(question, 21.0)
    assert survey.asked.count("fence") == 2
    assert engaging.give_up() == (question,)


@pytest.mark.parametrize("announces", [False, True])
def test_only_what_an_engagement_needs_is_read_again(announces):
    survey = Survey()
    survey.version = ARDUCOPTER.versions[0]
    Engaging(Flown().flight, survey, wants_of(announces=announces)).wait(Question("engage"), 10.0)
    needed = parameter_names(survey.version, announces=announces, only_needed=True)
    assert survey.asked == [needed, "fence"]
    assert set(needed) < set(parameter_names(survey.version, announces=announces))


def test_a_pilots_switch_waits_for_the_same_and_is_barred_by_name():
    flown = Flown(settings_of(engage_on=EngageOn.PILOT_MODE)).standing_by()
    survey = Survey()
    engaging = Engaging(flown.flight, survey, wants_of())
    assert engaging.due(10.0) is None
    assert engaging.bars_the_pilot == ("parameters read again",)
    assert survey.asked == []
    flown.mode = Mode.GUIDED
    flown.cycle(beat=True, refusals=engaging.bars_the_pilot)
    assert engaging.due(10.0) is None
    assert "fence" in survey.asked
    assert engaging.due(10.0 + READ_WITHIN_S) == ()
    assert "COM_OF_LOSS_T" in engaging.bars_the_pilot
    begun = Survey()
    assert Engaging(flown.flight, begun, wants_of()).due(10.0) is None
    assert "fence" in begun.asked
    without = Engaging(flown.flight, Survey(), None)
    assert without.due(10.0) is None
    assert without.bars_the_pilot == ()
