"""Where two behaviours differ, worst first."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from sitl_mock.compare.behaviour import Behaviour, Field, Stream

RATE_SHARE = 0.2
LEAST = 5
"""Messages that came less often on both sides are answers or news, and have no rate."""

ANSWERS = frozenset(
    {"COMMAND_ACK", "PARAM_VALUE", "STATUSTEXT", "MISSION_ACK", "MISSION_ITEM_INT", "MISSION_REQUEST_INT"}
)
"""They come when a client asks or something happens, and have no rate."""


class Difference(NamedTuple):
    """One difference.

    Attributes:
        kind: missing, extra, rate, constant (on one side only), absent (NaN on one side only).
        message: Name of the message.
        field: Name of the field and its phase, "" for the message itself.
        recorded: What the recording has.
        mock: What the mock has.
    """

    kind: str
    message: str
    field: str
    recorded: str
    mock: str


def differences(recorded: Behaviour, mock: Behaviour) -> list[Difference]:
    """Return every difference of two behaviours."""
    found = []
    for name in sorted({*recorded, *mock}):
        real, ours = recorded.get(name), mock.get(name)
        if ours is None and real is not None:
            found.append(Difference("missing", name, "", _often(real), "none"))
        elif real is None and ours is not None:
            found.append(Difference("extra", name, "", "none", _often(ours)))
        elif real is not None and ours is not None:
            found += _of_stream(name, real, ours)
    return found


def _often(stream: Stream) -> str:
    return f"{stream.rate_hz:.2f} Hz" if stream.count >= LEAST else f"{stream.count} times"


def _of_stream(name: str, real: Stream, ours: Stream) -> Iterator[Difference]:
    counted = max(real.count, ours.count) >= LEAST
    if (
        counted
        and name not in ANSWERS
        and abs(real.rate_hz - ours.rate_hz) > RATE_SHARE * max(real.rate_hz, ours.rate_hz)
    ):
        yield Difference("rate", name, "", _often(real), _often(ours))
    for phase in sorted(real.fields.keys() & ours.fields.keys()):
        for label, values in real.fields[phase].items():
            other = ours.fields[phase].get(label)
            if other is not None and counted:
                yield from _of_field(name, f"{label} ({phase})", values, other)


def _of_field(name: str, label: str, real: Field, ours: Field) -> Iterator[Difference]:
    if math.isnan(real.first) != math.isnan(ours.first):
        yield Difference("absent", name, label, span(real), span(ours))
    elif real.moves != ours.moves:
        yield Difference("constant", name, label, span(real), span(ours))


def span(values: Field) -> str:
    """The range of a field, in words."""
    if math.isnan(values.first):
        return "NaN"
    return f"{values.least:.6g} … {values.most:.6g}" if values.moves else f"{values.first:.6g}"
