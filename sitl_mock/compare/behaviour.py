"""Behaviour of a vehicle's messages: their rates, and which fields change, on the ground and in the air.

`differences` lists the differences of two behaviours, worst first.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sitl_mock.mavlink import Message

GROUND = "ground"
AIR = "air"
_AIRBORNE_MM = 1000
"""Height above the first home; later ones may differ in height (PX4's does, by metres)."""
_CLOCKS = frozenset(
    {"time_boot_ms", "time_usec", "time_unix_usec", "seq", "ts1", "tc1", "timestamp", "time_utc"}
)


@dataclass(slots=True)
class FieldRange:
    """Range of the values of one field."""

    least: float = math.inf
    most: float = -math.inf
    first: float = math.nan
    moves: bool = False
    missing: bool = False

    def take(self, value: float) -> None:
        """Take one more value."""
        if math.isnan(value):
            self.missing = True
            return
        if math.isnan(self.first):
            self.first = value
        if not self.moves:
            self.moves = value != self.first
        self.least = min(self.least, value)
        self.most = max(self.most, value)


@dataclass(slots=True)
class Stream:
    """One message: first and last time, count, and its fields in each phase."""

    count: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    fields: dict[str, dict[str, FieldRange]] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Mean rate between the first and the last message; 0 for a single one."""
        span_s = self.last_s - self.first_s
        return (self.count - 1) / span_s if span_s > 0.0 else 0.0


Behaviour = Mapping[str, Stream]


def behaviour_of(messages: Iterable[tuple[float, Message]]) -> Behaviour:
    """Measure messages in time order."""
    streams: dict[str, Stream] = {}
    phase = GROUND
    ground_mm = None
    for at_s, message in messages:
        name = message.get_type()
        if name == "GLOBAL_POSITION_INT":
            if ground_mm is None:
                ground_mm = message.alt - message.relative_alt
            phase = AIR if message.alt - ground_mm > _AIRBORNE_MM else GROUND
        stream = streams.setdefault(name, Stream())
        stream.count += 1
        stream.first_s = at_s if math.isnan(stream.first_s) else stream.first_s
        stream.last_s = at_s
        values = stream.fields.setdefault(phase, {})
        for label in message.get_fieldnames():
            if label not in _CLOCKS:
                _take(values, label, getattr(message, label))
    return streams


def _take(values: dict[str, FieldRange], label: str, value: object) -> None:
    if isinstance(value, int | float):
        values.setdefault(label, FieldRange()).take(float(value))
    elif isinstance(value, list | tuple):
        for index, element in enumerate(value):
            _take(values, f"{label}[{index}]", element)


RATE_SHARE = 0.2
_LEAST = 5
"""Rarer messages on both sides are answers or events and have no rate."""

ANSWERS = frozenset(
    {
        "COMMAND_ACK",
        "PARAM_VALUE",
        "STATUSTEXT",
        "MISSION_ACK",
        "MISSION_ITEM_INT",
        "MISSION_REQUEST_INT",
    }
)
"""Answers to clients and reports of events, which have no rate."""


class MessageDifference(NamedTuple):
    """One difference.

    Attributes:
        kind: missing, extra, rate, constant (on one side only), absent (NaN on one side only).
        message: Name of the message.
        field: Name of the field and its phase, "" for the message itself.
        recorded: Value in the recording.
        mock: Value in the mock.
    """

    kind: str
    message: str
    field: str
    recorded: str
    mock: str


def differences(recorded: Behaviour, mock: Behaviour) -> list[MessageDifference]:
    """Return all differences of two behaviours."""
    lines = []
    for name in sorted({*recorded, *mock}):
        real = recorded.get(name)
        ours = mock.get(name)
        if ours is None and real is not None:
            lines.append(MessageDifference("missing", name, "", _often(real), "none"))
        elif real is None and ours is not None:
            lines.append(MessageDifference("extra", name, "", "none", _often(ours)))
        elif real is not None and ours is not None:
            counted = max(real.count, ours.count) >= _LEAST
            rate_off_hz = abs(real.rate_hz - ours.rate_hz)
            rates_differ = rate_off_hz > RATE_SHARE * max(real.rate_hz, ours.rate_hz)
            if counted and name not in ANSWERS and rates_differ:
                lines.append(MessageDifference("rate", name, "", _often(real), _often(ours)))
            for phase in sorted(real.fields.keys() & ours.fields.keys()) if counted else ():
                for label, values in real.fields[phase].items():
                    other = ours.fields[phase].get(label)
                    if other is None:
                        continue
                    kind = ""
                    if math.isnan(values.first) != math.isnan(other.first):
                        kind = "absent"
                    elif values.moves != other.moves:
                        kind = "constant"
                    if kind:
                        field = f"{label} ({phase})"
                        lines.append(
                            MessageDifference(kind, name, field, span(values), span(other))
                        )
    return lines


def _often(stream: Stream) -> str:
    return f"{stream.rate_hz:.2f} Hz" if stream.count >= _LEAST else f"{stream.count} times"


def span(values: FieldRange) -> str:
    """The range of a field, in words."""
    if math.isnan(values.first):
        return "NaN"
    return f"{values.least:.6g} … {values.most:.6g}" if values.moves else f"{values.first:.6g}"
