"""The daemon of one vehicle. Each cycle takes orders, steps the flight, then gives answers, status, log and metrics."""

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from guidance.autopilots import Finding, Verdict
from guidance.clock import IN_TIME, Timing
from guidance.errors import ConfigError
from guidance.flight import (
    BEFORE_FLIGHT,
    FINAL,
    Authority,
    EngageOn,
    Event,
    Flight,
    Inputs,
    Outputs,
    is_done,
)
from guidance.links.port import EvaderSource, TellsProblem, VehicleLink
from guidance.log.entries import ASSIGNED, EVADER_NEWS, LINK_NEWS, ORDERED, RELOADED, TEAM_NEWS
from guidance.log.sink import AnsweredOrder, FlightIdentity, Sink
from guidance.log.writer import Record
from guidance.preflight import PreflightMemory, advice, parameter_names, refusals, rows
from guidance.session.observe.recording import Recording
from guidance.session.observe.refused_frames import RefusedFrames
from guidance.session.observe.refused_reports import RefusedReports
from guidance.session.observe.signs_of_life import ENDING
from guidance.session.orders.answers import missing, refusal, shown_state, status
from guidance.session.orders.mailbox import Engaging, Mailbox, Question, ShutdownHandover
from guidance.session.orders.words import ALIVE, RESET, WORDS
from guidance.session.plan import FlightPlan
from guidance.strategies.own import Ask
from guidance.team import Member

HEARTBEAT_EVERY_S: Final = 1.0
PREFLIGHT_EVERY_S: Final = 0.5
SHOWN_EVERY_S: Final = 1.0


@dataclass(slots=True, kw_only=True)
class Equipment:
    """Optional parts of a daemon, filled in as they are opened.

    Attributes:
        mailbox: Orders of people.
        record: On disk.
        record_required: Whether nothing flies without the record.
        sinks: The other outputs of the flight: log, metrics, signs of life, broadcast, another program's messages.
        team: Its part in a team; None if it flies alone.
        ask: Asks the user's policy; None if another strategy is flown.
    """

    mailbox: Mailbox = field(default_factory=Mailbox)
    record: Record | None = None
    record_required: bool = False
    sinks: list[Sink] = field(default_factory=list)
    team: Member | None = None
    ask: Ask | None = None

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Say something to people before or after there is a daemon; `level` is as in `logging`."""
        for sink in self.sinks:
            sink.say(level, message, fields)


Evaders = Mapping[str, EvaderSource]
"""The source of reports of each evader, by name."""


class Daemon:
    """One vehicle's guidance, in real or virtual time, against one evader or, in a team, several by name."""

    def __init__(
        self, name: str, plan: FlightPlan, link: VehicleLink, evaders: Evaders, equipment: Equipment
    ) -> None:
        self.name = name
        self._link = link
        self._evaders = evaders
        self._problems: dict[str, str] = {}
        self._refused_frames = RefusedFrames()
        self._refused_reports = {source_name: RefusedReports() for source_name in evaders}
        self.team = equipment.team
        self._ask = equipment.ask
        self.mailbox = equipment.mailbox
        self.mailbox.meanwhile = None  # orders wait for the loop from now on
        self.recording = Recording(
            name, equipment.record, equipment.sinks, required=equipment.record_required
        )
        self._leaving: ShutdownHandover | None = None
        self._heartbeat_s = self._shown_s = float("-inf")
        self._refused: tuple[str, ...] = ()
        self.inputs = Inputs()
        self.finished = False
        self.begin(plan)
        self.outputs = Outputs(self.flight.state, None, (), (), None)

    def begin(self, plan: FlightPlan) -> None:
        """Begin another flight at once, wherever the vehicle is."""
        self.plan = plan
        self.judged = plan.wants is not None
        """True if preflight judges the vehicle before it flies."""
        self.flight = Flight(plan.flight, self._ask)
        if self.team is not None:
            self.team.begin()
        announces = plan.wants is not None and plan.wants.announces
        names = partial(parameter_names, announces=announces)
        self.survey = PreflightMemory(plan.flight.autopilot, names)
        self._engaging = Engaging(self.flight, self.survey, plan.wants)
        self.recording.begin(FlightIdentity(self.name, tuple(self._evaders), plan.flight))
        self._judged_s = float("-inf")
        self.rows: tuple[Finding, ...] = ()  # preflight's, as last judged
        self._refused_for: dict[str, str] = {}

    @property
    def in_flight(self) -> bool:
        """True while the vehicle is ours in the air, or was just ordered up."""
        return self.flight.state not in FINAL | BEFORE_FLIGHT

    @property
    def leaving(self) -> Authority | None:
        """The one who asked the daemon to end, a person or a mission; None before that."""
        return None if self._leaving is None else self._leaving.authority

    def step(self, now_s: float, timing: Timing = IN_TIME) -> Outputs:
        """Run one cycle; `timing` is how the loop kept time."""
        questions, queries = self.mailbox.take()
        orders = self._orders(questions, now_s)
        self.inputs = self._read(now_s, queries, orders)
        outputs = self.outputs = self.flight.step(now_s, self.inputs)
        if outputs.answer is not None:  # a replay does not run the policy
            self.inputs = self.inputs._replace(answer=outputs.answer)
        self._write(now_s, outputs, timing)
        if self.team is not None:
            self._tell(self.team, now_s, outputs)
        self._tell_evader_news(now_s)
        self._answer(now_s, queries, orders, outputs)
        self._preflight(now_s)
        self._report(now_s, outputs, timing)
        self.finished = self._leaving is not None and self._leaving.finished(self.flight, now_s)
        return outputs

    def _orders(self, questions: Sequence[Question], now_s: float) -> Sequence[Question]:
        """Return the orders for this cycle's flight, people's first; all others are answered here."""
        orders = [question for question in questions if self._is_for_the_flight(question, now_s)]
        if self.judged:
            orders += self._engage_orders(now_s)
        if self._leaving is not None:
            orders += self._leaving.orders(self.flight)
        return sorted(orders, key=lambda question: question.authority is Authority.MISSION)

    def _engage_orders(self, now_s: float) -> Sequence[Question]:
        """Return the engage orders whose parameters were read again, or did not answer."""
        due_orders = self._engaging.due(now_s)
        if due_orders is None:
            return ()
        fresh = {row.name: row for row in self._engaging.rows}
        self.rows = tuple(fresh.get(row.name, row) for row in self.rows)
        if refusals(self._engaging.rows) and not due_orders:
            self.recording.say(logging.WARNING, "not engaged", reason=advice(self._engaging.rows))
        return due_orders

    def _is_for_the_flight(self, question: Question, now_s: float) -> bool:
        word = question.order

        if word in WORDS and word != Event.ENGAGE:
            self._give_up_engaging(f"{word} was ordered meanwhile", now_s)
        if word == RESET:
            refused = (
                f"in flight ({self.flight.state}): order land or return first"
                if self.in_flight
                else ""
            )
            if not refused:
                self.begin(self.plan)
            self._reply(question, now_s, refused)
        elif word not in WORDS:
            self._reply(question, now_s, f"order = {word!r}: allowed are {', '.join(WORDS)}")
        elif self._is_leaving(question):
            self._reply(question, now_s, "the daemon is ending")
        elif (
            word == Event.ENGAGE
            and self.judged
            and self.in_flight
            and self.flight.follows(Event.ENGAGE, now_s, self._barred())
        ):
            self._engaging.wait(question, now_s)
        else:
            return True
        return False

    def _is_leaving(self, question: Question) -> bool:
        """Return True if the daemon ends. An operator's order cancels an end that a mission asked for."""
        if self.leaving is Authority.MISSION and question.authority is Authority.OPERATOR:
            self._leaving = None
        return self._leaving is not None

    def _read(
        self, now_s: float, queries: Sequence[Question], orders: Sequence[Question]
    ) -> Inputs:
        """Read everything that one cycle sees, and send our HEARTBEAT once a second."""
        people = [
            Event(question.order) for question in orders if question.authority is Authority.OPERATOR
        ]
        mission = [
            Event(question.order) for question in orders if question.authority is Authority.MISSION
        ]
        alive = True if any(query.order == ALIVE for query in queries) else None
        bars = self._barred()
        if Event.ENGAGE in people or Event.ENGAGE in mission:
            bars += refusals(self._engaging.rows)
        elif self.plan.flight.engage_on is EngageOn.PILOT_MODE:
            bars += self._engaging.bars_the_pilot
        messages = self._link.receive()
        sources = self._evaders.items()
        named_reports = [(name, report) for name, source in sources for report in source.receive()]
        reports = [report for _, report in named_reports]  # without a team an evader needs no name
        if now_s - self._heartbeat_s >= HEARTBEAT_EVERY_S:
            self._heartbeat_s = now_s
            self._link.send_heartbeat()
        mates = role = None
        if self.team is not None:
            reports = [report._replace(evader=name) for name, report in named_reports]
            mates, role, relayed = self.team.hear(now_s, self.flight, reports)
            reports += relayed
        return Inputs(messages, reports, people, bars, alive, mission, mates, role)

    def _barred(self) -> tuple[str, ...]:
        """Names of what preflight refuses; before its first verdict, preflight itself."""
        if not self.judged or not self._judging:
            return ()
        if not self.rows:
            return ("preflight",)
        return refusals(self.rows)

    @property
    def _judging(self) -> bool:
        """True while preflight applies: on the ground, and for a vehicle found armed until it has passed once."""
        return self.flight.state in BEFORE_FLIGHT or (self.in_flight and not self.flight.checked)

    def _write(self, now_s: float, outputs: Outputs, timing: Timing) -> None:
        """Send the flight's outputs, the setpoint first: everything else can wait a millisecond."""
        if outputs.setpoint is not None:
            self._link.send_setpoint(outputs.setpoint)
        for request in outputs.requests:
            self._link.request(request)
        self.recording.cycle(now_s, self.inputs, outputs, timing)

    def _tell(self, team: Member, now_s: float, outputs: Outputs) -> None:
        """Tell the mates about this cycle, and people what the mates told."""
        team.tell(now_s, self.flight, outputs)
        if (assigned := team.changed(outputs)) is not None:
            self.recording.event(now_s, ASSIGNED, assigned.model_dump_json())
        for words in team.board.news:
            self.recording.say(logging.WARNING, words)
            self.recording.event(now_s, TEAM_NEWS, words)
        team.board.news.clear()

    def _evader_counters(self, now_s: float) -> dict[str, Mapping[str, int]]:
        """Return the counters of each evader: its source's, and the reports that its track dropped."""
        tracking = self.flight.tracking
        counters = dict[str, Mapping[str, int]]()
        for source_name, source in self._evaders.items():
            evader = "" if self.team is None else source_name
            counted = source.counters()
            refused = self._refused_reports[source_name].note(now_s, counted)
            problem = source.problem() if isinstance(source, TellsProblem) else ""
            self._tell_problem(source_name, problem)
            tracking.refused[evader] = problem if problem else refused
            dropped = {
                f"dropped_{outcome}": count for outcome, count in tracking.dropped(evader).items()
            }
            counters[source_name] = {**counted, **dropped}
        return counters

    def _tell_problem(self, evader: str, problem: str) -> None:
        """Log why no report of an evader can arrive, once."""
        if problem != self._problems.get(evader, ""):
            self._problems[evader] = problem
            if problem:
                self.recording.say(logging.WARNING, problem, evader=evader)
            else:
                self.recording.say(logging.INFO, "the evader's source answers", evader=evader)

    def _evader_rows(self) -> list[Finding]:
        """Return a warning for every evader whose source cannot deliver reports yet."""
        return [
            Finding("evader's source", problem, "answers", Verdict.WARN, "guidance tries again")
            for problem in self._problems.values()
            if problem
        ]

    def _link_rows(self) -> list[Finding]:
        """Return a refusal if the vehicle's link knows what bars a flight."""
        problem = self._link.problem() if isinstance(self._link, TellsProblem) else ""
        if not problem:
            return []
        return [Finding("link", problem, "no problem", Verdict.REFUSE, "guidance tries again")]

    def _signing_rows(self) -> list[Finding]:
        """Return a warning if the disk does not keep the timestamps of signed frames."""
        unsaved = self._link.counters().get("used_unsaved", 0)
        if unsaved == 0:
            return []
        words = f"{unsaved} frames were used whose timestamps are not on disk"
        advice = (
            "after a crash they can be replayed: make $STATE_DIRECTORY or ~/.local/state writable"
        )
        return [Finding("signing", words, "on disk", Verdict.WARN, advice)]

    def _tell_evader_news(self, now_s: float) -> None:
        """Log and record what of the evaders' reports is no longer used."""
        news = self.flight.tracking.news
        for words in news:
            self.recording.say(logging.WARNING, words)
            self.recording.event(now_s, EVADER_NEWS, words)
        news.clear()

    def _tell_refused_frames(self, now_s: float, counters: Mapping[str, int]) -> None:
        """Log and record that somebody else sends in the vehicle's name."""
        words = self._refused_frames.note(now_s, counters)
        if words:
            self.recording.say(logging.WARNING, words)
            self.recording.event(now_s, LINK_NEWS, words)

    def survive(self, error: Exception, now_s: float) -> None:
        """Go on after a cycle that failed: the vehicle is handed over, the record kept, and orders are answered.

        Args:
            error: Raised by `step`.
            now_s: The present.
        """
        outputs = self.outputs = self.flight.give_up(now_s, Inputs(), error)
        for request in outputs.requests:
            self._link.request(request)
        if outputs.fault is not None:
            self.recording.event(now_s, str(Event.FAULT), outputs.fault)
        self.recording.report(now_s, self.flight, outputs, None, None)

    def leave(self, order: Event, now_s: float, authority: Authority = Authority.OPERATOR) -> None:
        """Hand the vehicle to the autopilot and finish. An operator who asks a second time finishes at once.

        Args:
            order: How the vehicle is handed over.
            now_s: The present.
            authority: Who asks. A mission asks once, and an operator's order keeps the daemon going.
        """
        if self.leaving is Authority.OPERATOR:
            self.recording.say(
                logging.WARNING, "ending at once: asked twice", state=self.flight.state
            )
            self.finished = True
            return
        self.recording.say(logging.INFO, ENDING, by=order, state=self.flight.state)
        self._leaving = ShutdownHandover(order, now_s, authority)
        self._give_up_engaging("the daemon is ending", now_s)

    def exchange(self, load: Callable[[], FlightPlan], now_s: float) -> None:
        """Take another plan, on the ground only; in flight it is refused, and said so."""
        if self.in_flight:
            self.recording.say(
                logging.WARNING,
                "configuration not read again: refused in flight",
                state=self.flight.state,
            )
            return
        try:
            self.begin(load())
        except ConfigError as error:
            self.recording.say(
                logging.ERROR, "configuration not read again: the old one stays", error=str(error)
            )
        else:
            self.recording.say(logging.INFO, RELOADED)
            self.recording.event(now_s, RELOADED, self.plan.document)

    def _give_up_engaging(self, reason: str, now_s: float) -> None:
        for question in self._engaging.give_up():
            self._reply(question, now_s, reason)

    def _answer(
        self,
        now_s: float,
        queries: Sequence[Question],
        orders: Sequence[Question],
        outputs: Outputs,
    ) -> None:
        """Answer the orders, and all queries with one status. The first happenings are one for each order, in order."""
        for question, happening in zip(orders, outputs.happenings, strict=False):
            order = Event(question.order)
            if happening.after is not happening.before or is_done(order, happening.after):
                reason = ""
            else:
                reason = refusal(order, self.flight, now_s, self.rows)
            self._reply(question, now_s, reason)
        if queries:
            fields = status(self.flight, outputs, self.rows, self._barred(), now_s)
            fields |= {"name": self.name, "recording": self.recording.words}
            if self.team is not None:
                fields["assignment"] = self.team.assignment(self.flight)
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
        self.recording.ordered(AnsweredOrder(word, accepted, question.by, reason))
        repeated = (
            not accepted
            and question.authority is Authority.MISSION
            and words == self._refused_for.get(word)
        )
        self._refused_for[word] = words
        answer: dict[str, Any] = {
            "accepted": accepted,
            "order": order,
            "state": shown_state(self.flight),
        }
        if not accepted:
            answer["reason"] = reason
        if not repeated:
            fields = dict(answer)
            if question.by:
                fields["by"] = question.by
            self.recording.say(logging.INFO if accepted else logging.WARNING, "order", **fields)
        question.set_result({"name": self.name, **answer})
        if question.by:
            verdict = "accepted" if accepted else reason
            self.recording.event(now_s, ORDERED, f"{order} by {question.by}: {verdict}")

    def _preflight(self, now_s: float) -> None:
        """Read and judge parameters and fence on the ground, and read them again before the game begins."""
        wants = self.plan.wants
        reading = self._engaging.asked_s is not None or self.survey.reading_fence
        if wants is None or not (self._judging or reading):
            return
        self.survey.observe(self.inputs.messages, self.inputs.reports)
        for request in self.survey.requests(now_s):
            self._link.request(request)
        if not self._judging or now_s - self._judged_s < PREFLIGHT_EVERY_S:
            return
        self._judged_s = now_s
        facts = self.survey.facts(self.flight.vehicle, now_s, self.flight.heard.other_beat)
        self.rows = (
            *rows(facts, self.plan.flight.autopilot, wants),
            *self.recording.rows(),
            *self._evader_rows(),
            *self._link_rows(),
            *self._signing_rows(),
        )
        refused = refusals(self.rows)
        if refused != self._refused and self.survey.settled(now_s):
            self._refused = refused
            if refused:
                self.recording.say(
                    logging.WARNING, "not ready", missing=missing(self.flight, now_s, self.rows)
                )

    def _report(self, now_s: float, outputs: Outputs, timing: Timing) -> None:
        """Report the cycle, with counters once a second and when the state changes."""
        changed = any(happening.after is not happening.before for happening in outputs.happenings)
        counters = None
        if now_s - self._shown_s >= SHOWN_EVERY_S or changed:
            self._shown_s = now_s
            counters = self._counters(now_s)
        self.recording.report(now_s, self.flight, outputs, timing, counters)

    def _counters(self, now_s: float) -> Mapping[str, Mapping[str, int]]:
        """Return the counters of the vehicle's link, of orders, of each evader's source and of the team."""
        vehicle_counters = {
            **self._link.counters(),
            "other_heartbeats": self.flight.heard.other_beats,
        }
        self._tell_refused_frames(now_s, vehicle_counters)
        counters = {
            "vehicle": vehicle_counters,
            "orders": {"oversized": self.mailbox.oversized},
            **self._evader_counters(now_s),
        }
        if self.team is not None:
            counters["team"] = self.team.board.counts
        return counters
