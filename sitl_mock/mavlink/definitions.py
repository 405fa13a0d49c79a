"""The messages of MAVLink's dialect `all`, read from `messages.csv`.

A row has a message's id, its name and its fields in the order of declaration. Extension fields follow a bar. Sizes,
order on the wire and the CRC's seed follow by the rules of https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import csv
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from sitl_mock.c_types import LETTERS

if TYPE_CHECKING:
    from collections.abc import Iterator

_MESSAGES: Final = Path(__file__).with_name("messages.csv")
_COMMANDS: Final = Path(__file__).with_name("commands.csv")
_SIZES: Final = {kind: struct.calcsize(letter) for kind, letter in LETTERS.items()}


class Field(NamedTuple):
    """A field of a message.

    Attributes:
        kind: Type of one element, as in MAVLink's definitions: ``uint8_t``.
        name: Name of the field.
        length: Number of elements of an array or text, 0 for a scalar.
    """

    kind: str
    name: str
    length: int

    @property
    def letter(self) -> str:
        """Format of one element, as `struct` has it."""
        return LETTERS[self.kind]

    @property
    def format(self) -> str:
        """Format of the whole field, as `struct` has it."""
        if not self.length:
            return self.letter
        return f"{self.length}s" if self.kind == "char" else f"{self.length}{self.letter}"

    @property
    def size(self) -> int:
        """Length on the wire in bytes."""
        return _SIZES[self.kind] * max(1, self.length)


class Definition(NamedTuple):
    """A message of the dialect.

    Attributes:
        message_id: 24-bit message id.
        name: Name as in MAVLink's definitions.
        fields: Fields in the order of declaration, without extensions.
        extensions: Extension fields; MAVLink 1 frames lack them, and the CRC's seed does not depend on them.
    """

    message_id: int
    name: str
    fields: tuple[Field, ...]
    extensions: tuple[Field, ...]

    @property
    def wire_fields(self) -> tuple[Field, ...]:
        """All fields as on the wire: the largest elements first, and extensions as declared."""
        return (*sorted(self.fields, key=lambda field: -_SIZES[field.kind]), *self.extensions)

    @property
    def crc_extra(self) -> int:
        """The seed byte that closes the CRC."""
        hashed = f"{self.name} ".encode()
        for field in self.wire_fields[: len(self.fields)]:
            hashed += f"{field.kind} {field.name} ".encode()
            if field.length:
                hashed += bytes((field.length,))
        crc = mcrf4xx(hashed)
        return (crc & 0xFF) ^ (crc >> 8)


def read_definitions() -> Iterator[Definition]:
    """Yield every message of the dialect."""
    with _MESSAGES.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            base, _, extensions = row["fields"].partition("|")
            yield Definition(
                int(row["id"]), row["name"], tuple(_fields(base)), tuple(_fields(extensions))
            )


def command_names() -> dict[int, str]:
    """Return the names of all commands (MAV_CMD) by number."""
    with _COMMANDS.open(encoding="utf-8", newline="") as file:
        return {int(row["number"]): row["name"] for row in csv.DictReader(file)}


def _fields(text: str) -> Iterator[Field]:
    for described in text.split(";"):
        if described.strip():
            kind, name = described.split()
            element, _, length = kind.removesuffix("]").partition("[")
            yield Field(element, name, int(length) if length else 0)
