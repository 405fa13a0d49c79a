"""What a record holds besides raw frames: cycles, events and reports of the evader, the same written as read."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from guidance.certificate import Certificate
from guidance.clock import Timing
from guidance.flight import Authority, Event, Inputs, Outputs, State
from guidance.log.codec import Codec
from guidance.messages import EvaderReport, Message, Request, Setpoint
from guidance.monitor import Alarm

CYCLE_TOPIC: Final = "guidance/cycle"
EVENT_TOPIC: Final = "guidance/event"
EVADER_TOPIC: Final = "guidance/evader_report"
"""Every report of the evader as its source had it, at the time it arrived."""

BEGUN: Final = "flight begins"
"""Event of a flight's first cycle. A daemon may fly again: what the flight before it remembered is then forgotten."""

RELOADED: Final = "configuration read again"
"""Event of a configuration that took the place of the one in the metadata; it is the detail, as JSON."""

ORDERED: Final = "ordered"
"""Event of an order that a person gave: which, by whom, and what was answered."""

STOPPED: Final = "recording has stopped; the flight goes on"
"""Event of a record that can be written no longer: it is the log's, the metrics' and the bus's, not the record's."""


class InputsEntry(NamedTuple):
    """What a cycle read; its time is the cycle's."""

    messages: Sequence[Message]
    reports: Sequence[EvaderReport]
    orders: Sequence[Event]
    refusals: Sequence[str] = ()
    alive: bool | None = None
    mission: Sequence[Event] = ()


class CycleEntry(NamedTuple):
    """One cycle: what it read, what it decided, who caused its state (`by`), and how the loop kept time."""

    now_s: float
    state: State
    inputs: InputsEntry
    requests: Sequence[Request]
    setpoint: Setpoint | None = None
    certificate: Certificate | None = None
    alarm: Alarm | None = None
    timing: Timing | None = None
    by: Authority | None = None

    @property
    def flight_inputs(self) -> Inputs:
        """What it read, as the flight takes it."""
        return Inputs(self.now_s, *self.inputs)


class EventEntry(NamedTuple):
    """One event."""

    now_s: float
    event: str
    detail: str


CYCLE: Final = Codec("guidance.Cycle", CycleEntry)
EVENT: Final = Codec("guidance.Event", EventEntry)
REPORT: Final = Codec("guidance.EvaderReport", EvaderReport)


def cycle_entry(inputs: Inputs, outputs: Outputs, timing: Timing | None = None) -> CycleEntry:
    """Return the entry of a cycle."""
    return CycleEntry(
        inputs.now_s,
        outputs.state,
        InputsEntry(*inputs[1:]),
        outputs.requests,
        outputs.setpoint,
        outputs.certificate,
        outputs.alarm,
        timing,
        Authority.FLIGHT if outputs.cause is None else outputs.cause.by,
    )
