"""The daemon of one vehicle. Each cycle: orders in, the flight, then answers, status, log and metrics out."""

import logging
import re
from collections.abc import Callable, Sequence
from typing import Any, Final

from guidance.clock import IN_TIME, Timing
from guidance.errors import ConfigError
from guidance.flight import FINAL, Authority, Event, Flight, Inputs, Outputs, is_done
from guidance.links.port import EvaderSource, VehicleLink
from guidance.log.entries import ORDERED, RELOADED
from guidance.log.writer import Record
from guidance.messages import LocalPosition, Message
from guidance.preflight import Facts, Finding, PreflightMemory, advice, parameter_names, refusals, rows
from guidance.session.answers import flight_line, missing, refusal, status
from guidance.session.control_socket import ALIVE, RESET, WORDS
from guidance.session.linked_flight import LinkedFlight, Stopped
from guidance.session.log import SILENT, Logger, say_outputs
from guidance.session.metrics import Metrics
from guidance.session.orders import (
    ON_GROUND,
    Engaging,
    Mailbox,
    Question,
    ShutdownHandover,
)
from guidance.session.plan import FlightPlan
from guidance.session.process import Notifier
from guidance.session.recording import Recording

PREFLIGHT_EVERY_S: Final = 0.5
SHOWN_EVERY_S: Final = 1.0
_NUMBER: Final = re.compile(r"\d+(\.\d+)?")
_ORDERING: Final = (Authority.OPERATOR, Authority.MISSION)


class Daemon:
    """One vehicle's guidance, in real or virtual time. Log, metrics, record and broadcast are optional."""

    def __init__(
        self,
        name: str,
        plan: FlightPlan,
        link: VehicleLink,
        evader: EvaderSource,
        *,
        mailbox: Mailbox | None = None,
        log: Logger = SILENT,
        metrics: Metrics | None = None,
        notifier: Notifier | None = None,
        record: Record | None = None,
        broadcast: Record | None = None,
        record_required: bool = False,
        live: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.name = name
        self._link = link
        self._evader = evader
        self.mailbox = Mailbox() if mailbox is None else mailbox
        self._log = log
        self.metrics = Metrics(name) if metrics is None else metrics
        self._notifier = Notifier(None, None) if notifier is None else notifier
        self._recording = Recording(record, broadcast, required=record_required)
        self._live = live
        self._leaving: ShutdownHandover | None = None
        self._rows: tuple[Finding, ...] = ()
        self._judged_s = self._shown_s = float("-inf")
        self._refused: tuple[str, ...] = ()
        self.outputs: Outputs | None = None
        self.finished = False
        self._begin(plan)

    def _begin(self, plan: FlightPlan) -> None:
        self._plan = plan
        self.flight = Flight(plan.flight)
        self._survey = PreflightMemory(parameter_names(plan.flight.autopilot))
        self._engaging = Engaging(self.flight, self._survey, plan.wants)
        self._linked = LinkedFlight(self.flight, self._link, self._evader, self._recording.kept)
        self._judged_s = float("-inf")
        self._rows = ()
        self._refused_for: dict[str, str] = {}

    @property
    def rows(self) -> tuple[Finding, ...]:
        """Preflight's rows as last judged."""
        return self._rows

    def facts(self, now_s: float) -> Facts:
        """Preflight's facts about the vehicle."""
        return self._survey.facts(self.flight.vehicle, now_s)

    @property
    def surveyed(self) -> bool:
        """True once every parameter that preflight judges was read."""
        return self._survey.complete

    @property
    def parameters_read(self) -> tuple[int, int]:
        """Number of preflight parameters read, and their total."""
        return self._survey.read

    @property
    def heard(self) -> Sequence[Message]:
        """The vehicle's messages of the last cycle."""
        return self._linked.inputs.messages

    @property
    def position_age_s(self) -> float:
        """Age of the vehicle's position at the last cycle, s; infinite before the first one."""
        return self.flight.vehicle.age_s(LocalPosition, self._linked.inputs.now_s)

    @property
    def in_flight(self) -> bool:
        """True while the vehicle is ours in the air, or was just ordered up."""
        return self.flight.state not in FINAL | ON_GROUND

    @property
    def judged(self) -> bool:
        """Whether preflight judges the vehicle before it flies."""
        return self._plan.wants is not None

    @property
    def record_stopped(self) -> Stopped | None:
        """When and why the record stopped; None while it goes on."""
        return self._linked.record_stopped

    @property
    def leaving(self) -> Authority | None:
        """Whether a person or a mission asked the daemon to end; None while it goes on."""
        return None if self._leaving is None else self._leaving.authority

    def step(self, now_s: float, timing: Timing = IN_TIME) -> Outputs:
        """Run one cycle; `timing` is how the loop kept time."""
        queries, orders = self.mailbox.queries(), self._orders(now_s)
        people, mission = ([one for one in orders if one.authority is by] for by in _ORDERING)
        inputs = self._linked.read(
            now_s,
            [Event(one.order) for one in people],
            self._refusals(orders),
            alive=any(query.order == ALIVE for query in queries),
            mission=[Event(one.order) for one in mission],
        )
        outputs = self.outputs = self.flight.step(inputs)
        self._linked.write(outputs, timing)
        self._answer((*people, *mission), outputs, now_s)
        self._tell(queries, now_s)
        say_outputs(self._log, outputs)
        self._recording.look(now_s, self.metrics, self._log)
        self._preflight(now_s)
        self.metrics.lateness.observe(max(0.0, timing.late_s))
        self.metrics.follow(outputs)
        self._show(now_s, outputs)
        self._notifier.alive(now_s)
        self.finished = self._leaving is not None and self._leaving.finished(self.flight, now_s)
        return outputs

    def _orders(self, now_s: float) -> list[Question]:
        """Return the orders for this cycle's flight; all others are answered here."""
        orders = [question for question in self.mailbox.orders() if self._is_for_the_flight(question, now_s)]
        orders += self._due(now_s)
        return orders if self._leaving is None else [*orders, *self._leaving.orders(self.flight)]

    def _is_for_the_flight(self, question: Question, now_s: float) -> bool:
        word = question.order
        if word in WORDS and word != Event.ENGAGE:
            self._give_up_engaging(f"{word} was ordered meanwhile", now_s)
        if word == RESET:
            self._reply(question, now_s, self._reset())
        elif word not in WORDS:
            self._reply(question, now_s, f"order = {word!r}: allowed are {', '.join(WORDS)}")
        elif self._is_leaving(question):
            self._reply(question, now_s, "the daemon is ending")
        elif word == Event.ENGAGE and self._must_read_first(now_s):
            self._engaging.wait(question, now_s)
        else:
            return True
        return False

    def _is_leaving(self, question: Question) -> bool:
        """Whether the daemon ends. An operator's order cancels an end that a mission asked for."""
        if self.leaving is Authority.MISSION and question.authority is Authority.OPERATOR:
            self._leaving = None
        return self._leaving is not None

    def _must_read_first(self, now_s: float) -> bool:
        if self._plan.wants is None or not self.in_flight:
            return False
        return self.flight.follows(Event.ENGAGE, now_s, self._barred())

    def _due(self, now_s: float) -> tuple[Question, ...]:
        """Return the engage orders that waited for parameters, once these were read again or did not answer."""
        read, due = self._engaging.reading, self._engaging.due(now_s)
        if read and not self._engaging.reading:
            fresh = {row.name: row for row in self._engaging.rows}
            self._rows = tuple(fresh.get(row.name, row) for row in self._rows)
            if refusals(self._engaging.rows) and not due:
                self._log.say(logging.WARNING, "not engaged", reason=advice(self._engaging.rows))
        return due

    def _refusals(self, orders: Sequence[Question]) -> tuple[str, ...]:
        """Name what bars the vehicle from flying, or from being engaged by one of these orders or by a pilot."""
        engaging = any(one.order == Event.ENGAGE for one in orders)
        return self._barred() + (refusals(self._engaging.rows) if engaging else self._engaging.bars_the_pilot)

    def _barred(self) -> tuple[str, ...]:
        """Names of what preflight refuses; before its first verdict, preflight itself."""
        if self._plan.wants is None or not self._judging:
            return ()
        return refusals(self._rows) if self._rows else ("preflight",)

    @property
    def _judging(self) -> bool:
        """Whether preflight applies: on the ground, and for a vehicle found armed until it has passed once."""
        return self.flight.state in ON_GROUND or (self.in_flight and not self.flight.checked)

    def survive(self, error: Exception, now_s: float) -> None:
        """Go on after a cycle that failed: the vehicle is handed over, the record kept, and orders are answered.

        Args:
            error: Raised by `step`.
            now_s: The present.
        """
        outputs = self.outputs = self.flight.give_up(Inputs(now_s), error)
        for request in outputs.requests:
            self._link.request(request)
        if outputs.fault is not None:
            say_outputs(self._log, outputs)
            self.metrics.follow(outputs)
            self._recording.note(now_s, str(Event.FAULT), outputs.fault)
        self._notifier.alive(now_s)

    def leave(self, order: Event, now_s: float, authority: Authority = Authority.OPERATOR) -> None:
        """Hand the vehicle to the autopilot and finish. An operator who asks a second time finishes at once.

        Args:
            order: How the vehicle is handed over.
            now_s: The present.
            authority: Who asks. A mission asks once, and an operator's order keeps the daemon going.
        """
        if self.leaving is Authority.OPERATOR:
            self._log.say(logging.WARNING, "ending at once: asked twice", state=self.flight.state)
            self.finished = True
            return
        self._log.say(logging.INFO, "ending", by=order, state=self.flight.state)
        self._notifier.stopping()
        self._leaving = ShutdownHandover(order, now_s, authority)
        self._give_up_engaging("the daemon is ending", now_s)

    def exchange(self, load: Callable[[], FlightPlan], now_s: float) -> None:
        """Take another plan, on the ground only; in flight it is refused, and said so."""
        if self.in_flight:
            self._log.say(logging.WARNING, "configuration not read again: refused in flight", state=self.flight.state)
            return
        try:
            self._begin(load())
        except ConfigError as error:
            self._log.say(logging.ERROR, "configuration not read again: the old one stays", error=str(error))
        else:
            self._log.say(logging.INFO, RELOADED)
            self.metrics.happened(RELOADED)
            self._recording.note(now_s, RELOADED, self._plan.document)

    def _give_up_engaging(self, reason: str, now_s: float) -> None:
        for question in self._engaging.give_up():
            self._reply(question, now_s, reason)

    def _reset(self) -> str:
        if self.in_flight:
            return f"in flight ({self.flight.state}): order land or return first"
        self._begin(self._plan)
        return ""

    def _answer(self, orders: Sequence[Question], outputs: Outputs, now_s: float) -> None:
        """Answer the flight's orders. Its first happenings are one for each order, in the same order."""
        for question, happening in zip(orders, outputs.happenings, strict=False):
            order = Event(question.order)
            done = happening.after is not happening.before or is_done(order, happening.after)
            self._reply(question, now_s, "" if done else refusal(order, self.flight, now_s, self._rows))

    def _tell(self, queries: Sequence[Question], now_s: float) -> None:
        """Answer all queries of this cycle with one status."""
        if queries:
            status = self._status(now_s)
            for query in queries:
                query.answer({"accepted": True, "order": query.order, **status})

    def _reply(self, question: Question, now_s: float, reason: str) -> None:
        """Answer an order, accepted if there is no reason against it; log it and record who gave it.

        A mission asks every second: a refusal for the same reason is logged once.
        """
        order, accepted = question.order, not reason
        known, words = order if order in WORDS else "unknown", _NUMBER.sub("", reason)
        self.metrics.order(known, accepted=accepted)
        repeated = not accepted and question.authority is Authority.MISSION and words == self._refused_for.get(known)
        self._refused_for[known] = words
        level = logging.INFO if accepted else logging.WARNING
        why = {} if accepted else {"reason": reason}
        by = {"by": question.by} if question.by else {}
        if not repeated:
            self._log.say(level, "order", order=order, accepted=accepted, state=self.flight.state, **by, **why)
        question.answer(
            {"accepted": accepted, "order": order, "name": self.name, "state": str(self.flight.state), **why}
        )
        if question.by:
            self._recording.note(now_s, ORDERED, f"{order} by {question.by}: {reason or 'accepted'}")

    def _status(self, now_s: float) -> dict[str, Any]:
        return status(
            self.name,
            now_s,
            self.flight,
            self.outputs,
            self._rows,
            barred=self._barred(),
            recording=self._recording.words,
        )

    def _preflight(self, now_s: float) -> None:
        """Read and judge parameters on the ground, and read the failsafe parameters again before the game begins."""
        inputs, wants = self._linked.inputs, self._plan.wants
        if wants is None or not (self._judging or self._engaging.reading):
            return
        self._survey.observe(inputs.messages, inputs.reports)
        if self._judging or not self._survey.complete:  # the uploaded fence is read on the ground
            for request in self._survey.requests(now_s):
                self._link.request(request)
        if not self._judging or now_s - self._judged_s < PREFLIGHT_EVERY_S:
            return
        self._judged_s = now_s
        self._rows = (*rows(self.facts(now_s), self._plan.flight.autopilot, wants), *self._recording.rows())
        refused = refusals(self._rows)
        if refused != self._refused and self._survey.complete:
            self._refused = refused
            if refused:
                self._log.say(logging.WARNING, "not ready", missing=missing(self.flight, now_s, self._rows))

    def _show(self, now_s: float, outputs: Outputs) -> None:
        changed = any(happening.after is not happening.before for happening in outputs.happenings)
        if now_s - self._shown_s < SHOWN_EVERY_S and not changed:
            return
        self._shown_s = now_s
        counters = {"vehicle": self._link.counters(), "evader": self._evader.counters()}
        self.metrics.show(now_s, self.flight, outputs, counters)
        self._notifier.status(f"{outputs.state}, mode {self.flight.mode_name}")
        self._live(flight_line(self.flight, outputs, now_s))
