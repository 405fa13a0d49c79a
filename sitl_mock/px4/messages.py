"""PX4's messages on ROS 2's wire: their fields, their bytes (CDR) and the hash of their type (RIHS01).

``messages.csv`` has the fields of each message in PX4's order. PX4's messages hold neither texts nor lists of varying
length, so each has one size and `struct` reads and writes it. Sources: OMG's DDS-XTypes 1.3, section 7.4 (plain CDR,
version 1), and ROS 2's REP 2011 (type hashes).
"""

from __future__ import annotations

import csv
import hashlib
import json
import struct
from collections import namedtuple
from functools import cache, cached_property
from importlib.resources import files
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

HEAD: Final = b"\x00\x01\x00\x00"
"""Little-endian CDR without options."""
PADDING: Final = 24
"""PX4 publishes its message's size in memory plus this, whatever the encoding needs."""
_PACKAGE: Final = "px4_msgs/msg/"
_ROS_TYPES: Final = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
}
"""Numbers of types in ROS 2's type descriptions."""
_NESTED: Final = 1
_ARRAY: Final = 48
"""Added to the number of the type for an array of fixed length."""
_LETTERS: Final = {
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
    "bool": "?",
}
_LOG_TYPES: Final = {
    **{name: f"{name}_t" for name in _ROS_TYPES},
    "float32": "float",
    "float64": "double",
    "bool": "bool",
}


class MessageField(NamedTuple):
    """A field of a message: type of one element, name, and number of elements (0 for a scalar)."""

    kind: str
    name: str
    length: int


class MessageType:
    """One message.

    Args:
        name: As in PX4, ``VehicleStatus``.
        fields: ``uint64 timestamp;float32[4] q``, in PX4's order.

    Attributes:
        size: Bytes of its encoding, without padding.
        memory_bytes: Its size in PX4's memory.
    """

    def __init__(self, name: str, fields: str) -> None:
        self.name = name
        described = []
        for text in fields.split(";"):
            kind, _, of_name = text.partition(" ")
            element, _, count = kind.removesuffix("]").partition("[")
            described.append(MessageField(element, of_name, int(count) if count else 0))
        self.fields = tuple(described)
        # Each value is at a multiple of its size.
        body = ""
        self.size = 0
        for kind in _primitives(self):
            size = struct.calcsize("<" + _LETTERS[kind])
            gap = -self.size % size
            body += "x" * gap + _LETTERS[kind]
            self.size += gap + size
        # In memory the largest types come first, so without gaps, and the size is a multiple of 8.
        used = 0
        for field in self.fields:
            if field.kind in _ROS_TYPES:
                element_bytes = _alignment(field.kind)
            else:
                element_bytes = message_type(field.kind).memory_bytes
            used += max(field.length, 1) * element_bytes
        self.memory_bytes: int = used + -used % 8
        padding = self.memory_bytes + PADDING - self.size
        self._read = struct.Struct("<4x" + body).unpack_from
        self._write = struct.Struct(f"<4s{body}{padding}x").pack
        self._record = namedtuple(name, [field.name for field in self.fields])  # type: ignore[misc]

    def encode(self, values: Sequence[Any]) -> bytes:
        """Return a payload as PX4 publishes it.

        Args:
            values: Every element of every field, in PX4's order, arrays and nested messages flattened.

        Raises:
            struct.error: A value does not fit its type.
        """
        return self._write(HEAD, *values)

    def encoded(self, **values: Any) -> bytes:  # noqa: ANN401 - as the fields have it
        """Return a payload of fields by name; those left out are 0."""
        flat: list[Any] = []
        for field in self.fields:
            value = values.get(field.name)
            if value is None:
                flat += [0] * (max(field.length, 1) * _elements(field.kind))
            elif field.length:
                flat += value
            else:
                flat.append(value)
        return self.encode(flat)

    def decode(self, payload: bytes) -> Any | None:  # noqa: ANN401 - a record with the message's fields
        """Return the message in a payload for PX4 as a record; None if its size is wrong.

        As in PX4, bytes of the head are not looked at, and a payload that is longer than the message in memory is
        dropped. Some encodings are longer than that; cut to its size they are taken, and what is cut off is 0 here. PX4
        reads other short payloads beyond their end too; here they are dropped.
        """
        if len(payload) > len(HEAD) + self.memory_bytes:
            return None
        if len(payload) == len(HEAD) + self.memory_bytes:
            payload = payload.ljust(len(HEAD) + self.size, b"\0")
        return self.read(payload)

    def read(self, payload: bytes) -> Any | None:  # noqa: ANN401 - as above
        """Return the message in a payload of PX4, which is padded; None if it is too short."""
        if len(payload) < len(HEAD) + self.size:
            return None
        return self._taken(iter(self._read(payload)))

    def _taken(self, values: Iterator[Any]) -> Any:  # noqa: ANN401 - as above
        taken: list[Any] = []
        for field in self.fields:
            nested = None if field.kind in _ROS_TYPES else message_type(field.kind)
            elements = [
                next(values) if nested is None else nested._taken(values)  # noqa: SLF001 - its own kind
                for _ in range(max(field.length, 1))
            ]
            taken.append(tuple(elements) if field.length else elements[0])
        return self._record(*taken)

    @cached_property
    def in_log_order(self) -> tuple[MessageField, ...]:
        """The fields in the order of PX4's memory and log: the largest types first."""
        return tuple(sorted(self.fields, key=lambda field: -_alignment(field.kind)))

    @cached_property
    def log_format(self) -> str:
        """The fields as PX4's log describes them."""
        return ";".join(
            f"{_LOG_TYPES[field.kind]}{f'[{field.length}]' if field.length else ''} {field.name}"
            for field in self.in_log_order
        )

    @cached_property
    def from_log_order(self) -> itemgetter[Any]:
        """Puts the values of all fields in the order of the log into that of the wire."""
        at: dict[str, range] = {}
        count = 0
        for field in self.in_log_order:
            length = max(field.length, 1)
            at[field.name] = range(count, count + length)
            count += length
        return itemgetter(*(index for field in self.fields for index in at[field.name]))

    @cached_property
    def hash(self) -> str:
        """The type's hash as in topic names: ``RIHS01_`` and 64 hexadecimal digits."""
        nested = sorted({field.kind for field in self.fields if field.kind not in _ROS_TYPES})
        described = {
            "type_description": self.description,
            "referenced_type_descriptions": [message_type(name).description for name in nested],
        }
        digest = hashlib.sha256(json.dumps(described).encode()).hexdigest()
        return f"RIHS01_{digest}"

    @cached_property
    def description(self) -> Mapping[str, Any]:
        """The type without those that it refers to, as REP 2011 hashes it."""
        fields = []
        for field in self.fields:
            nested = "" if field.kind in _ROS_TYPES else _PACKAGE + field.kind
            number = _ROS_TYPES.get(field.kind, _NESTED) + (_ARRAY if field.length else 0)
            kind = {
                "type_id": number,
                "capacity": field.length,
                "string_capacity": 0,
                "nested_type_name": nested,
            }
            fields.append({"name": field.name, "type": kind})
        return {"type_name": _PACKAGE + self.name, "fields": fields}


@cache
def message_type(name: str) -> MessageType:
    """Return a message of ``messages.csv``.

    Raises:
        KeyError: There is none of this name.
    """
    return MessageType(name, _table()[name])


@cache
def _table() -> Mapping[str, str]:
    text = files("sitl_mock.px4").joinpath("messages.csv").read_text(encoding="utf-8")
    return {row["name"]: row["fields"] for row in csv.DictReader(text.splitlines())}


def names() -> Sequence[str]:
    """Return the names of all messages."""
    return tuple(_table())


def _elements(kind: str) -> int:
    """Number of values in one element of a type."""
    if kind in _ROS_TYPES:
        return 1
    nested = message_type(kind)
    return sum(max(field.length, 1) * _elements(field.kind) for field in nested.fields)


def _primitives(message: MessageType) -> Iterator[str]:
    """Yield the type of every value on the wire."""
    for field in message.fields:
        for _ in range(max(field.length, 1)):
            if field.kind in _ROS_TYPES:
                yield field.kind
            else:
                yield from _primitives(message_type(field.kind))


def _alignment(kind: str) -> int:
    return struct.calcsize("<" + _LETTERS[kind]) if kind in _ROS_TYPES else 8
