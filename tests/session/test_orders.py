"""Orders' mailbox: an order is answered once, by whom it was asked, before the loop runs and when it hangs."""

from guidance.autopilots import Mode
from guidance.clock import VirtualClock
from guidance.flight import Authority, Event, State
from guidance.session.orders import mailbox as mailbox_module
from guidance.session.orders.mailbox import (
    ANSWER_LIMIT_S,
    HANDOVER_LIMIT_S,
    MOST_ORDERS,
    MOST_QUERIES,
    ORDER_OF,
    READ_WITHIN_S,
    Mailbox,
    ShutdownHandover,
    startup_answers,
)
from tests.flight.flown import Flown


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
    mailbox = Mailbox()
    mailbox.meanwhile = startup_answers("uav1", "a HEARTBEAT of system 1 at udp://", 30.0, clock)
    clock.sleep_until(2.5)
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
    engage = mailbox.ask("engage").result(0.0)
    assert not engage["accepted"]
    assert engage["reason"].endswith("at udp://, 2.5 s so far")
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
    answer = mailbox.ask("hold").result(0.0)
    assert not answer["accepted"]
    assert "does the loop run?" in answer["reason"]
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
    answer = Mailbox().answer("hold", "Ada")
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
    assert sorted(ORDER_OF) == ["hold", "land", "return"]
    assert [str(ORDER_OF[word]) for word in sorted(ORDER_OF)] == sorted(ORDER_OF)
