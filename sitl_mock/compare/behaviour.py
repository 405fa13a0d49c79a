"""How a vehicle's messages behave: how often each comes, and which of its fields move, on the ground and in the air."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from sitl_mock.mavlink import Message

GROUND, AIR = "ground", "air"
_AIRBORNE_MM, _AIRBORNE_M = 1000, 1.0
_CLOCKS = frozenset({"time_boot_ms", "time_usec", "time_unix_usec", "seq", "ts1", "tc1", "timestamp", "time_utc"})


@dataclass(slots=True)
class Field:
    """The values one field has had."""

    least: float = math.inf
    most: float = -math.inf
    first: float = math.nan
    moves: bool = False
    missing: bool = False

    def take(self, value: float) -> None:
        """One more value."""
        if math.isnan(value):
            self.missing = True
            return
        if math.isnan(self.first):
            self.first = value
        self.moves = self.moves or value != self.first
        self.least, self.most = min(self.least, value), max(self.most, value)


@dataclass(slots=True)
class Stream:
    """One message: when it first and last came, how often, and its fields in each phase."""

    count: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    fields: dict[str, dict[str, Field]] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Mean rate between the first and the last one; 0 for a single one."""
        span_s = self.last_s - self.first_s
        return (self.count - 1) / span_s if span_s > 0.0 else 0.0


Behaviour = Mapping[str, Stream]


def behaviour_of(messages: Iterable[tuple[float, Message]]) -> Behaviour:
    """Measure messages in the order of their times."""
    streams: dict[str, Stream] = {}
    phase = GROUND
    for at_s, message in messages:
        name = message.get_type()
        phase = _phase(phase, name, message)
        stream = streams.setdefault(name, Stream())
        stream.count += 1
        stream.first_s = at_s if math.isnan(stream.first_s) else stream.first_s
        stream.last_s = at_s
        values = stream.fields.setdefault(phase, {})
        for label in message.get_fieldnames():
            if label not in _CLOCKS:
                _take(values, label, getattr(message, label))
    return streams


def _take(values: dict[str, Field], label: str, value: object) -> None:
    if isinstance(value, int | float):
        values.setdefault(label, Field()).take(float(value))
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            _take(values, f"{label}[{index}]", each)


def _phase(phase: str, name: str, message: Message) -> str:
    if name == "GLOBAL_POSITION_INT":
        return AIR if message.relative_alt > _AIRBORNE_MM else GROUND
    return phase
