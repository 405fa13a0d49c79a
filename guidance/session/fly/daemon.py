"""The daemon of one vehicle. Each cycle takes orders, steps the flight, then gives answers, status, log and metrics."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from guidance.clock import IN_TIME, Timing
from guidance.errors import ConfigError
from guidance.flight import (
    BEFORE_FLIGHT,
    FINAL,
    Authority,
    Event,
    Flight,
    Inputs,
    Outputs,
)
from guidance.links.port import EvaderSource, TellsProblem, VehicleLink
from guidance.log.entries import ASSIGNED, EVADER_NEWS, LINK_NEWS, RELOADED, TEAM_NEWS
from guidance.log.sink import FlightIdentity, Sink
from guidance.log.writer import Record
from guidance.session.fly.order_desk import OrderDesk
from guidance.session.fly.preflight_survey import PreflightSurvey
from guidance.session.observe.recording import Recording
from guidance.session.observe.refused import RefusedFrames, RefusedReports
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders.words import ALIVE
from guidance.session.plan import FlightPlan
from guidance.strategies.own import Ask
from guidance.team import Member

HEARTBEAT_EVERY_S: Final = 1.0
_SHOWN_EVERY_S: Final = 1.0


@dataclass(slots=True, kw_only=True)
class Equipment:
    """Optional parts of a daemon, filled in as they are opened.

    Attributes:
        mailbox: Orders of people.
        record: On disk.
        record_required: Whether nothing flies without the record.
        sinks: The other outputs of the flight: log, metrics, signs of life, broadcast, another program's messages.
        team: Its part in a team; None if it flies alone.
        ask: Asks the user's policy; None if another one is flown.
    """

    mailbox: Mailbox = field(default_factory=Mailbox)
    record: Record | None = None
    record_required: bool = False
    sinks: list[Sink] = field(default_factory=list)
    team: Member | None = None
    ask: Ask | None = None

    def say(self, level: int, message: str, **fields: Any) -> None:  # noqa: ANN401 - any value may be logged
        """Log a message for people before or after the life of a daemon; `level` is as in `logging`."""
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
        self.survey = PreflightSurvey(link, self.recording)
        self._desk = OrderDesk(
            name, equipment.mailbox, self.recording, equipment.team, self.begin_again
        )
        self._heartbeat_s = self._shown_s = float("-inf")
        self.inputs = Inputs()
        self.finished = False
        self.begin(plan)
        self.outputs = Outputs(self.flight.state, None, (), (), None)

    def begin(self, plan: FlightPlan) -> None:
        """Begin another flight at once, wherever the vehicle is."""
        self.plan = plan
        self.flight = Flight(plan.flight, self._ask)
        if self.team is not None:
            self.team.begin()
        self.survey.begin(self.flight, plan.wants)
        self._desk.begin(self.flight, self.survey)
        self.recording.begin(FlightIdentity(self.name, tuple(self._evaders), plan.flight))

    def begin_again(self) -> None:
        """Begin another flight by the same plan."""
        self.begin(self.plan)

    @property
    def in_flight(self) -> bool:
        """True while the vehicle is ours in the air, or was just ordered up."""
        return self.flight.state not in FINAL | BEFORE_FLIGHT

    @property
    def leaving(self) -> Authority | None:
        """The authority that ordered the daemon to end, a person or a mission; None before that."""
        return self._desk.leaving

    def step(self, now_s: float, timing: Timing = IN_TIME) -> Outputs:
        """Run one cycle; `timing` is how the loop kept time."""
        # Read everything that the cycle sees, and send our HEARTBEAT once a second.
        orders, queries = self._desk.take(now_s)
        people = [
            Event(question.order) for question in orders if question.authority is Authority.OPERATOR
        ]
        mission = [
            Event(question.order) for question in orders if question.authority is Authority.MISSION
        ]
        alive = True if any(query.order == ALIVE for query in queries) else None
        bars = self._desk.bars(orders)
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
        self.inputs = Inputs(messages, reports, people, bars, alive, mission, mates, role)

        outputs = self.outputs = self.flight.step(now_s, self.inputs)
        if outputs.answer is not None:  # a replay does not run the policy
            self.inputs = self.inputs._replace(answer=outputs.answer)

        # The setpoint first: everything else can wait a millisecond.
        if outputs.setpoint is not None:
            self._link.send_setpoint(outputs.setpoint)
        for request in outputs.requests:
            self._link.request(request)

        self.recording.cycle(now_s, self.inputs, outputs, timing)
        team = self.team
        if team is not None:
            team.tell(now_s, self.flight, outputs)
            if (assigned := team.changed(outputs)) is not None:
                self.recording.event(now_s, ASSIGNED, assigned.model_dump_json())
            for words in team.board.news:
                self.recording.say(logging.WARNING, words)
                self.recording.event(now_s, TEAM_NEWS, words)
            team.board.news.clear()
        news = self.flight.tracking.news
        for words in news:
            self.recording.say(logging.WARNING, words)
            self.recording.event(now_s, EVADER_NEWS, words)
        news.clear()
        self._desk.answer(now_s, orders, queries, outputs)
        self.survey.step(now_s, self.inputs, self._problems.values(), engaging=self._desk.reading)
        changed = any(
            transition.after is not transition.before for transition in outputs.transitions
        )
        counters = None
        if now_s - self._shown_s >= _SHOWN_EVERY_S or changed:
            self._shown_s = now_s
            counters = self._counters(now_s)
        self.recording.report(now_s, self.flight, outputs, timing, counters)
        self.finished = self._desk.finished(now_s)
        return outputs

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
        if self._desk.leave(order, now_s, authority):
            self.finished = True

    def exchange(self, load: Callable[[], FlightPlan], now_s: float) -> None:
        """Take another plan, on the ground only; in flight it is refused, with a message."""
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

    def _counters(self, now_s: float) -> Mapping[str, Mapping[str, int]]:
        """Return the counters of the vehicle's link, of orders, of each evader's source and of the team."""
        vehicle_counters = {
            **self._link.counters(),
            "other_heartbeats": self.flight.observed.other_beats,
        }
        words = self._refused_frames.note(now_s, vehicle_counters)
        if words:  # another program sends in the vehicle's name
            self.recording.say(logging.WARNING, words)
            self.recording.event(now_s, LINK_NEWS, words)
        counters = {
            "vehicle": vehicle_counters,
            "orders": {"oversized": self.mailbox.oversized},
        }
        # Of each evader: its source's counts, and the reports that its track dropped.
        tracking = self.flight.tracking
        for source_name, source in self._evaders.items():
            evader = "" if self.team is None else source_name
            counted = source.counters()
            refused = self._refused_reports[source_name].note(now_s, counted)
            problem = source.problem() if isinstance(source, TellsProblem) else ""
            if problem != self._problems.get(source_name, ""):
                self._problems[source_name] = problem
                if problem:
                    self.recording.say(logging.WARNING, problem, evader=source_name)
                else:
                    self.recording.say(
                        logging.INFO, "the evader's source answers", evader=source_name
                    )
            tracking.refused[evader] = problem if problem else refused
            dropped = {
                f"dropped_{outcome}": count for outcome, count in tracking.dropped(evader).items()
            }
            counters[source_name] = {**counted, **dropped}
        if self.team is not None:
            counters["team"] = self.team.board.counts
        return counters
