"""Content of a record: metadata, raw messages, and as entries cycles, events and evader reports."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from guidance.clock import Timing
from guidance.cycle import Alarm, Certificate
from guidance.flight import Authority, Inputs, Outputs, State
from guidance.log.codec import Codec
from guidance.messages import EvaderReport, Request, Setpoint
from guidance.team.messages import RolesMessage

BEGUN: Final = "flight begins"
"""Event at the first cycle of a flight. A daemon may fly several; each starts without the state of the last."""

RELOADED: Final = "configuration read again"
"""Event of a configuration reload; the detail is the new configuration as JSON."""

BEGINNINGS: Final = (BEGUN, RELOADED)
"""Events that discard the state of the flight before."""

FLIGHT_OVER: Final = "flight over"
"""Last event of a broadcast. Its detail is JSON: how it `ended`, the `record` and its name in the records' `replay`."""

ORDERED: Final = "ordered"
"""Event of an operator order: order, operator and reply."""

TEAM_NEWS: Final = "team"
"""Event: a vehicle noticed something about its mates, such as a position that jumped."""

EVADER_NEWS: Final = "evader's reports"
"""Event: the stamps or the velocities of the evader's reports are no longer used, or used again."""

LINK_NEWS: Final = "vehicle's link"
"""Event of frames in the vehicle's name that its link refused."""

ASSIGNED: Final = "team assignment"
"""Event of a changed assignment, and of the one that is valid when the vehicle engages; the detail is its JSON."""

STOPPED: Final = "recording has stopped; the flight goes on"
"""Event of a failed record; it goes to the log, the metrics and the bus."""


OUTCOME: Final = "outcome.json"
"""Name of the file with the outcome of a run, beside its record."""

RUN: Final = "run"
"""Name of the metadata record: vehicle file or scenario, versions, start time."""

SCENARIO: Final = "scenario"
CONFIG: Final = "config"
"""Keys of the metadata: a mocked flight's scenario and a daemon's vehicle file, as JSON."""

Idle = Callable[[], bool]
"""Called at the end of a file that is still being written: it waits a little, and returns True to stop reading."""


class Item(NamedTuple):
    """One message of a record: log time, topic, encoding and bytes."""

    now_s: float
    topic: str
    encoding: str
    data: bytes


class CycleEntry(NamedTuple):
    """One cycle: inputs, outputs, who caused the state (`by`), timing, and the vehicle's name (older records: None)."""

    now_s: float
    state: State
    inputs: Inputs
    requests: Sequence[Request]
    setpoint: Setpoint | None = None
    certificate: Certificate | None = None
    alarm: Alarm | None = None
    timing: Timing | None = None
    by: Authority | None = None
    vehicle: str | None = None


class EventEntry(NamedTuple):
    """One event."""

    now_s: float
    event: str
    detail: str

    @property
    def words(self) -> str:
        """The detail for people."""
        if self.event != ASSIGNED:
            return self.detail
        try:
            return RolesMessage.model_validate_json(self.detail).words
        except ValueError:  # a stranger's record
            return self.detail


CYCLE: Final = Codec("guidance.Cycle", CycleEntry, "guidance/cycle")
EVENT: Final = Codec("guidance.Event", EventEntry, "guidance/event")
REPORT: Final = Codec("guidance.EvaderReport", EvaderReport, "guidance/evader_report")
"""Every report of the evader as received, at its arrival time."""


def cycle_entry(
    now_s: float,
    inputs: Inputs,
    outputs: Outputs,
    timing: Timing | None = None,
    vehicle: str | None = None,
) -> CycleEntry:
    """Return the entry of a cycle of a vehicle."""
    results = outputs.requests, outputs.setpoint, outputs.certificate, outputs.alarm
    by = Authority.FLIGHT if outputs.cause is None else outputs.cause.by
    return CycleEntry(now_s, outputs.state, inputs, *results, timing, by, vehicle)


def title_of(metadata: Mapping[str, str]) -> str:
    """Return the title of a flight."""
    for kind, key in ((SCENARIO, "title"), (CONFIG, "name")):
        if kind in metadata:
            return str(json.loads(metadata[kind]).get(key, ""))
    return "flight"
