"""The order desk of a daemon: it passes orders to the flight, lets some wait, and answers all."""

import logging
import re
from collections.abc import Callable, Sequence
from typing import Any

from guidance.flight import (
    BEFORE_FLIGHT,
    FINAL,
    Authority,
    EngageOn,
    Event,
    Flight,
    Outputs,
    is_done,
)
from guidance.log.entries import ORDERED
from guidance.log.sink import AnsweredOrder
from guidance.preflight import advice, refusals
from guidance.session.fly.preflight_survey import PreflightSurvey
from guidance.session.observe.recording import Recording
from guidance.session.observe.signs_of_life import ENDING
from guidance.session.orders.answers import refusal, shown_state, status
from guidance.session.orders.mailbox import Engaging, Mailbox, Question, ShutdownHandover
from guidance.session.orders.words import RESET, WORDS
from guidance.team import Member


class OrderDesk:
    """Takes the orders of one vehicle each cycle and answers them.

    Args:
        name: The daemon's.
        mailbox: Where orders and queries wait.
        recording: Records every answer.
        team: The vehicle's part in a team, for the status; None if it flies alone.
        reset: Begins another flight by the same plan.
    """

    def __init__(
        self,
        name: str,
        mailbox: Mailbox,
        recording: Recording,
        team: Member | None,
        reset: Callable[[], None],
    ) -> None:
        self._name = name
        self._mailbox = mailbox
        self._recording = recording
        self._team = team
        self._reset = reset
        self._leaving: ShutdownHandover | None = None

    def begin(self, flight: Flight, survey: PreflightSurvey) -> None:
        """Take orders for another flight."""
        self._flight = flight
        self._survey = survey
        self._engaging = Engaging(flight, survey.memory, survey.wants)
        self._refused_for: dict[str, str] = {}

    @property
    def leaving(self) -> Authority | None:
        """The authority that ordered the daemon to end, a person or a mission; None before that."""
        return None if self._leaving is None else self._leaving.authority

    @property
    def reading(self) -> bool:
        """True if an engage order waits for parameters that are being read again."""
        return self._engaging.asked_s is not None

    def take(self, now_s: float) -> tuple[Sequence[Question], Sequence[Question]]:
        """Return the orders for this cycle's flight, people's first, and the queries; answer all other orders."""
        questions, queries = self._mailbox.take()
        orders = []
        for question in questions:
            word = question.order
            if word in WORDS and word != Event.ENGAGE:
                self.give_up_engaging(f"{word} was ordered meanwhile", now_s)
            flight = self._flight
            in_flight = flight.state not in FINAL | BEFORE_FLIGHT
            if word == RESET:
                refused = f"in flight ({flight.state}): order land or return first"
                if not in_flight:
                    refused = ""
                    self._reset()
                self._reply(question, now_s, refused)
                continue
            if word not in WORDS:
                self._reply(question, now_s, f"order = {word!r}: allowed are {', '.join(WORDS)}")
                continue
            if self.leaving is Authority.MISSION and question.authority is Authority.OPERATOR:
                self._leaving = None  # an operator's order cancels an end that a mission asked for
            waits = word == Event.ENGAGE and self._survey.judges and in_flight
            if self._leaving is not None:
                self._reply(question, now_s, "the daemon is ending")
            elif waits and flight.follows(Event.ENGAGE, now_s, self._survey.barred):
                self._engaging.wait(question, now_s)
            else:
                orders.append(question)
        if self._survey.judges:
            orders += self._engage_orders(now_s)
        if self._leaving is not None:
            orders += self._leaving.orders(self._flight)
        return sorted(orders, key=lambda order: order.authority is Authority.MISSION), queries

    def _engage_orders(self, now_s: float) -> Sequence[Question]:
        """Return the engage orders whose parameters were read again, or did not answer."""
        due_orders = self._engaging.due(now_s)
        if due_orders is None:
            return ()
        fresh_rows = self._engaging.rows
        self._survey.renew(fresh_rows)
        if refusals(fresh_rows) and not due_orders:
            self._recording.say(logging.WARNING, "not engaged", reason=advice(fresh_rows))
        return due_orders

    def bars(self, orders: Sequence[Question]) -> tuple[str, ...]:
        """Return the names of what bars the flight from taking off and engaging in this cycle."""
        bars = self._survey.barred
        if any(question.order == Event.ENGAGE for question in orders):
            bars += refusals(self._engaging.rows)
        elif self._flight.settings.engage_on is EngageOn.PILOT_MODE:
            bars += self._engaging.bars_the_pilot
        return bars

    def answer(
        self,
        now_s: float,
        orders: Sequence[Question],
        queries: Sequence[Question],
        outputs: Outputs,
    ) -> None:
        """Answer the orders, and all queries with one status. The first transitions are those of the orders."""
        rows = self._survey.rows
        for question, transition in zip(orders, outputs.transitions, strict=False):
            order = Event(question.order)
            if transition.after is not transition.before or is_done(order, transition.after):
                reason = ""
            else:
                reason = refusal(order, self._flight, now_s, rows)
            self._reply(question, now_s, reason)
        if queries:
            fields = status(self._flight, outputs, rows, self._survey.barred, now_s)
            fields |= {"name": self._name, "recording": self._recording.words}
            if self._team is not None:
                fields["assignment"] = self._team.assignment(self._flight)
            for query in queries:
                query.set_result({"accepted": True, "order": query.order, **fields})

    def _reply(self, question: Question, now_s: float, reason: str) -> None:
        """Answer an order, accepted if there is no reason against it; log it and record who gave it.

        A mission asks every second: a refusal for the same reason is logged once.
        """
        order = question.order
        accepted = not reason
        word = order if order in WORDS else "unknown"
        words = re.sub(r"\d+(\.\d+)?", "", reason)
        self._recording.ordered(AnsweredOrder(word, accepted, question.by, reason))
        repeated = (
            not accepted
            and question.authority is Authority.MISSION
            and words == self._refused_for.get(word)
        )
        self._refused_for[word] = words
        answer: dict[str, Any] = {
            "accepted": accepted,
            "order": order,
            "state": shown_state(self._flight),
        }
        if not accepted:
            answer["reason"] = reason
        if not repeated:
            fields = dict(answer)
            if question.by:
                fields["by"] = question.by
            self._recording.say(logging.INFO if accepted else logging.WARNING, "order", **fields)
        question.set_result({"name": self._name, **answer})
        if question.by:
            verdict = "accepted" if accepted else reason
            self._recording.event(now_s, ORDERED, f"{order} by {question.by}: {verdict}")

    def leave(self, order: Event, now_s: float, authority: Authority) -> bool:
        """Order the end of the daemon; return True if an operator ordered it before.

        Args:
            order: How the vehicle is handed over.
            now_s: The present.
            authority: Who asks.
        """
        if self.leaving is Authority.OPERATOR:
            self._recording.say(
                logging.WARNING, "ending at once: asked twice", state=self._flight.state
            )
            return True
        self._recording.say(logging.INFO, ENDING, by=order, state=self._flight.state)
        self._leaving = ShutdownHandover(order, now_s, authority)
        self.give_up_engaging("the daemon is ending", now_s)
        return False

    def give_up_engaging(self, reason: str, now_s: float) -> None:
        """Refuse the engage orders that wait."""
        for question in self._engaging.give_up():
            self._reply(question, now_s, reason)

    def finished(self, now_s: float) -> bool:
        """Return whether an end was ordered, and the vehicle is handed over."""
        return self._leaving is not None and self._leaving.finished(self._flight, now_s)
