"""PX4's log format ULog: messages to write, and a reader of topics.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html. A file is a header and messages; a message is its
length, a letter and its body. Definitions (flags, formats, information, parameters) come first, then subscriptions,
data and texts. Everything is little-endian and without padding.
"""

from __future__ import annotations

import struct
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sitl_mock.c_types import LETTERS
from sitl_mock.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

MAGIC: Final = b"ULog\x01\x12\x35"
_VERSION: Final = 1
_SHOWN: Final = 100
"""Most characters of a file's text in an error."""
_HEADER: Final = struct.Struct("<7sBQ")
_HEAD: Final = struct.Struct("<HB")


class TopicField(NamedTuple):
    """A field of a topic: type of one element, name, and number of elements (1 for a scalar)."""

    kind: str
    name: str
    length: int


class Topic:
    """A topic with its fields.

    Args:
        name: As in PX4.
        fields: ``uint64_t timestamp;float[4] q;uint8_t quat_reset_counter``.
        number: The topic's id in data messages.

    Attributes:
        size: Bytes of the values.
        pack: Makes the data message of the values of all fields in order, arrays flattened.
    """

    def __init__(self, name: str, fields: str, number: int) -> None:
        self.name = name
        self.text = fields
        self.number = number
        self.fields = tuple(fields_of(fields))
        body = layout(self.fields)
        self.size = struct.calcsize("<" + body)
        packed = struct.Struct("<HBH" + body).pack
        self.pack = partial(packed, struct.calcsize("<H") + self.size, _DATA, number)


def fields_of(text: str) -> Iterator[TopicField]:
    """Yield the fields of a format's text.

    Raises:
        ValueError: The number of elements of an array is not a number.
    """
    for described in text.strip(";").split(";"):
        kind, _, name = described.partition(" ")
        element, _, count = kind.removesuffix("]").partition("[")
        yield TopicField(element, name, int(count) if count else 1)


def layout(fields: Sequence[TopicField]) -> str:
    """Return the fields as `struct` has them.

    Raises:
        KeyError: A field has another topic as its type.
    """
    return "".join(f"{each.length}{LETTERS[each.kind]}" for each in fields)


_DATA: Final = ord("D")
_FORMAT: Final = ord("F")
_SUBSCRIPTION: Final = ord("A")


def header(start_us: int) -> bytes:
    """Return the first 16 bytes of a file."""
    return _HEADER.pack(MAGIC, _VERSION, start_us)


def message(letter: str, body: bytes) -> bytes:
    """Return one message."""
    return _HEAD.pack(len(body), ord(letter)) + body


def flags() -> bytes:
    """Return the flag bits: nothing incompatible, nothing appended."""
    return message("B", bytes(40))


def information(kind: str, name: str, value: float | str) -> bytes:
    """Return a piece of information; `kind` is ``char`` for a text of any length."""
    if isinstance(value, str):
        content = value.encode()
        key = f"char[{len(content)}] {name}".encode()
    else:
        content = struct.pack("<" + LETTERS[kind], value)
        key = f"{kind} {name}".encode()
    return message("I", bytes((len(key),)) + key + content)


def parameter(name: str, value: float, *, whole: bool) -> bytes:
    """Return a parameter's value: as an initial one in the definitions, or as a change after them."""
    key = f"{'int32_t' if whole else 'float'} {name}".encode()
    return message("P", bytes((len(key),)) + key + struct.pack("<i" if whole else "<f", value))


def topic_format(topic: Topic) -> bytes:
    """Return the definition of a topic."""
    return message("F", f"{topic.name}:{topic.text};".encode())


def subscription(topic: Topic) -> bytes:
    """Return the announcement that data of a topic will come."""
    return message("A", struct.pack("<BH", 0, topic.number) + topic.name.encode())


def logged_text(now_us: int, severity: int, text: str) -> bytes:
    """Return a text with its MAV_SEVERITY."""
    return message("L", struct.pack("<BQ", ord("0") + severity, now_us) + text.encode())


class _Layout:
    """How the selected fields of a subscribed topic lie in its data."""

    def __init__(self, name: str, text: str, names: Sequence[str]) -> None:
        self.name = name
        self._fields = tuple(each for each in fields_of(text) if not each.name.startswith("_pad"))
        self._names = names
        self._struct = struct.Struct("<" + layout(self._fields))

    @cached_property
    def _places(self) -> tuple[slice, ...]:
        starts = {}
        at = 0
        for each in self._fields:
            starts[each.name] = slice(at, at + each.length)
            at += each.length
        return tuple(starts[name] for name in self._names)

    def row(self, body: bytes) -> tuple[Any, ...]:
        """Return the values of the selected fields, arrays flattened."""
        values = self._struct.unpack_from(body, 2)
        row: tuple[Any, ...] = ()
        for part in self._places:
            row += values[part]
        return row


def read(
    content: bytes, selection: Mapping[str, Sequence[str]], source: str
) -> dict[str, list[Any]]:
    """Return rows of the selected fields by topic; a topic that is not in the file has no rows.

    A message that is cut off ends the file, as after a crash. Only the first instance of a topic is read.

    Args:
        content: The file.
        selection: Names of fields by topic.
        source: Name of the file for errors.

    Raises:
        ConfigError: It is no ULog, or a selected topic is damaged: its format has no fixed layout or not the selected
            fields, or its data is shorter than its format.
    """
    if not content.startswith(MAGIC):
        raise ConfigError(f"{source} is not a ULog: it does not begin with {MAGIC!r}")
    rows: dict[str, list[Any]] = {name: [] for name in selection}
    formats: dict[str, str] = {}
    subscribed: dict[int, _Layout] = {}
    for letter, body in _messages(content):
        if letter == _DATA:
            topic = subscribed.get(int.from_bytes(body[:2], "little"))
            if topic is None:
                continue
            try:
                rows[topic.name].append(topic.row(body))
            except KeyError as error:
                raise ConfigError(f"{source}: topic {topic.name} has no field {error}") from error
            except struct.error as error:
                raise ConfigError(
                    f"{source}: data of topic {topic.name} is cut off: {error}"
                ) from error
        elif letter == _FORMAT:
            name, _, text = body.decode(errors="replace").partition(":")
            formats[name] = text
        elif letter == _SUBSCRIPTION:
            name = body[3:].decode(errors="replace")
            if name not in selection or name not in formats or body[0] != 0:
                continue
            try:
                selected = _Layout(name, formats[name], selection[name])
            except (KeyError, ValueError, struct.error) as error:
                raise ConfigError(
                    f"{source}: topic {name} has the format {formats[name][:_SHOWN]!r}; allowed are fields of the types"
                    f" {', '.join(LETTERS)} and arrays of them, as in float[4] q"
                ) from error
            subscribed[int.from_bytes(body[1:3], "little")] = selected
    return rows


def _messages(content: bytes) -> Iterator[tuple[int, bytes]]:
    at = _HEADER.size
    while at + _HEAD.size <= len(content):
        size, letter = _HEAD.unpack_from(content, at)
        at += _HEAD.size
        if at + size > len(content):
            return
        yield letter, content[at : at + size]
        at += size
