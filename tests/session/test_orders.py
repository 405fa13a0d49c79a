"""Orders' mailbox: an order is answered once, by whom it was asked, before the loop runs and when it hangs."""

from guidance.clock import VirtualClock
from guidance.config import parse
from guidance.session.answers import StartupResponder
from guidance.session.orders import MOST_WAITING, Mailbox
from guidance.session.vehicle_file import Config


def test_an_order_is_taken_once_and_its_answer_reaches_who_asked():
    mailbox = Mailbox()
    question = mailbox.ask("hold")
    (taken,) = mailbox.take()
    assert mailbox.take() == []
    assert question.wait(0.0) is None
    taken.answer({"accepted": True})
    assert question.wait(0.0) == {"accepted": True}


def test_before_the_loop_runs_an_order_is_answered_with_what_is_waited_for(vehicle_document):
    clock, mailbox = VirtualClock(), Mailbox()
    mailbox.meanwhile(StartupResponder(parse(Config, vehicle_document(), source="test"), clock).answer)
    clock.sleep_until(2.5)
    status = mailbox.ask("status").wait(0.0)
    assert (status["accepted"], status["name"], status["state"], status["waited_s"]) == (True, "uav1", "waiting", 2.5)
    assert status["waiting_for"] == "a HEARTBEAT of system 1, component 1 at udpin://127.0.0.1:14540"
    engage = mailbox.ask("engage").wait(0.0)
    assert not engage["accepted"]
    assert engage["reason"].endswith("at udpin://127.0.0.1:14540, 2.5 s so far")
    assert mailbox.ask("jump").wait(0.0)["reason"].startswith("order = 'jump': allowed are abort, ")
    assert mailbox.take() == []
    mailbox.meanwhile(None)
    mailbox.ask("status")
    assert [question.order for question in mailbox.take()] == ["status"]


def test_a_loop_that_hangs_is_not_buried_in_orders():
    mailbox = Mailbox()
    kept = [mailbox.ask("hold") for _ in range(MOST_WAITING)]
    answer = mailbox.ask("hold").wait(0.0)
    assert not answer["accepted"]
    assert "is the loop running?" in answer["reason"]
    assert list(mailbox.take()) == kept
