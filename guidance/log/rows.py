"""The cycle rows of a record, typed again: what a cycle read, and what it decided."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

from guidance.certificate import Certificate
from guidance.errors import ConfigError
from guidance.flight import Event, Inputs
from guidance.log.reader import Item, Survey, scan
from guidance.log.typed import decoder
from guidance.log.writer import CYCLE_TOPIC, EVADER_TOPIC, EVENT_TOPIC
from guidance.messages import EvaderReport, Message, Setpoint
from guidance.monitor import Alarm

_MESSAGES: Final = {kind.__name__: decoder(kind) for kind in get_args(Message)}
_REPORT: Final = decoder(EvaderReport)
_ORDER: Final = decoder(Event)
_SETPOINT: Final = decoder(Setpoint | None)
_CERTIFICATE: Final = decoder(Certificate | None)
_ALARM: Final = decoder(Alarm | None)


class EventRow(NamedTuple):
    """One event as recorded."""

    now_s: float
    event: str
    detail: str


class CycleRow(NamedTuple):
    """One cycle as recorded, still JSON; the functions below type it, so that nothing is typed in vain."""

    now_s: float
    json: Mapping[str, Any]

    @property
    def state(self) -> str:
        """Name of the flight's state after the cycle."""
        return str(self.json["state"])

    @property
    def inputs(self) -> Inputs:
        """What the cycle read."""
        return inputs_of(self.json["inputs"], self.now_s)

    @property
    def setpoint(self) -> Setpoint | None:
        """What it sent."""
        setpoint: Setpoint | None = _SETPOINT(self.json.get("setpoint"))
        return setpoint

    @property
    def certificate(self) -> Certificate | None:
        """What the game said."""
        certificate: Certificate | None = _CERTIFICATE(self.json.get("certificate"))
        return certificate

    @property
    def alarm(self) -> Alarm | None:
        """What of the guarantee was broken."""
        alarm: Alarm | None = _ALARM(self.json.get("alarm"))
        return alarm


def inputs_of(inputs: Mapping[str, Any], now_s: float) -> Inputs:
    """Build a cycle's inputs again.

    Raises:
        ConfigError: If the record was written by a version that knew other messages.
    """
    return Inputs(
        now_s,
        tuple(_message(message) for message in inputs["messages"]),
        tuple(_REPORT(report) for report in inputs["reports"]),
        tuple(_ORDER(order) for order in inputs["orders"]),
        tuple(str(refusal) for refusal in inputs.get("refusals", ())),
    )


def rows_of(path: Path, survey: Survey | None = None) -> Iterator[CycleRow]:
    """Yield the cycles of a record.

    Raises:
        ConfigError: As `scan`, or if a row is not what this version writes.
    """
    for item in scan(path, survey):
        if item.topic == CYCLE_TOPIC:
            yield row_of(item, path)


def row_of(item: Item, path: Path) -> CycleRow:
    """Read a cycle's JSON.

    Raises:
        ConfigError: If it is none.
    """
    row = _document(item, path)
    if not {"now_s", "state", "inputs"} <= row.keys():
        raise ConfigError(f"{path}: the cycle at {item.now_s:.3f} s has only {', '.join(sorted(row))}")
    return CycleRow(float(row["now_s"]), row)


def events_of(path: Path) -> Iterator[EventRow]:
    """Yield the events of a record.

    Raises:
        ConfigError: As `rows_of`.
    """
    for item in scan(path):
        if item.topic == EVENT_TOPIC:
            yield event_of(item, path)


def reports_of(path: Path) -> Iterator[EvaderReport]:
    """Yield the reports of the evader as their source had them, in order of arrival.

    Raises:
        ConfigError: As `rows_of`.
    """
    for item in scan(path):
        if item.topic == EVADER_TOPIC:
            report: EvaderReport = _REPORT(_document(item, path))
            yield report


def event_of(item: Item, path: Path) -> EventRow:
    """Read an event's JSON.

    Raises:
        ConfigError: If it is none.
    """
    row = _document(item, path)
    return EventRow(item.now_s, str(row.get("event", "")), str(row.get("detail", "")))


def _document(item: Item, path: Path) -> dict[str, Any]:
    try:
        row = json.loads(item.data)
    except ValueError as error:
        raise ConfigError(f"{path}: {item.topic} at {item.now_s:.3f} s is not JSON: {error}") from error
    if not isinstance(row, dict):
        raise ConfigError(f"{path}: {item.topic} at {item.now_s:.3f} s is no JSON object")
    return row


def _message(message: Mapping[str, Any]) -> Message:
    read = _MESSAGES.get(message["kind"])
    if read is None:
        raise ConfigError(f"message kind {message['kind']!r}: this version knows {', '.join(sorted(_MESSAGES))}")
    heard: Message = read(message)
    return heard
