"""Orders' mailbox: an order is answered once, by whom it was asked, before the loop runs and when it hangs."""

from guidance.clock import VirtualClock
from guidance.session.orders.mailbox import MOST_ORDERS, MOST_QUERIES, Mailbox, startup_answers


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
    assert (status["accepted"], status["name"], status["state"], status["waited_s"]) == (
        True,
        "uav1",
        "waiting",
        2.5,
    )
    assert status["waiting_for"] == "a HEARTBEAT of system 1 at udp://"
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
