"""ArduPilot's log format DataFlash: records to write, and a reader of them.

Source: https://ardupilot.org/copter/docs/common-downloading-and-analyzing-data-logs-in-mission-planner.html and
``LogStructure.h`` of ArduPilot 4.5. A record is two fixed bytes, the number of its kind and its values. FMT records
describe the kinds; letters of a format tell types, and some of them a scale (``c``: hundredths).
"""

from __future__ import annotations

import contextlib
import struct
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

START: Final = b"\xa3\x95"
_HEAD: Final = 3
_FMT: Final = 128
_FMT_BODY: Final = struct.Struct("<BB4s16s64s")
_LETTERS: Final = {
    "a": "64s",
    "b": "b",
    "B": "B",
    "h": "h",
    "H": "H",
    "i": "i",
    "I": "I",
    "f": "f",
    "d": "d",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "B",
    "q": "q",
    "Q": "Q",
}
_SCALES: Final = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
"""Value of one unit of a letter's integer."""
_SHORTEST: Final = {"h": (-32768, 32767), "H": (0, 65535), "i": (-(2**31), 2**31 - 1)}


class RecordKind:
    """A kind of record.

    Args:
        number: Its number.
        name: At most four letters.
        letters: Type of each value.
        columns: Names of the values, divided by commas.
    """

    def __init__(self, number: int, name: str, letters: str, columns: str) -> None:
        self.name = name
        self.columns = tuple(columns.split(","))
        self._struct = struct.Struct("<" + "".join(_LETTERS[letter] for letter in letters))
        self._scaled = tuple(
            (index, _SCALES[letter], _SHORTEST.get(_LETTERS[letter], (0, 2**32 - 1)))
            for index, letter in enumerate(letters)
            if letter in _SCALES
        )
        self._scales = tuple(_SCALES.get(letter, 0.0) for letter in letters)
        with_head = struct.Struct(f"<{_HEAD}s{self._struct.format[1:]}").pack
        self._pack = partial(with_head, START + bytes((number,)))
        self.size = _HEAD + self._struct.size
        body = _FMT_BODY.pack(number, self.size, name.encode(), letters.encode(), columns.encode())
        self.definition = START + bytes((_FMT,)) + body

    def pack(self, *values: Any) -> bytes:  # noqa: ANN401 - numbers and texts
        """Return a record of values in their units; those too large for their type are clipped."""
        units = list(values)
        for index, scale, _ in self._scaled:
            units[index] = round(units[index] / scale)
        try:
            return self._pack(*units)
        except struct.error:
            for index, _, (least, most) in self._scaled:
                units[index] = min(max(units[index], least), most)
            return self._pack(*units)

    def unpack(self, content: bytes, at: int) -> tuple[Any, ...]:
        """Return the values of the record at an offset, in their units."""
        units = self._struct.unpack_from(content, at + _HEAD)
        return tuple(
            unit * scale if scale else unit for unit, scale in zip(units, self._scales, strict=True)
        )


FMT: Final = RecordKind(_FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")


def read(
    content: bytes, selection: Mapping[str, Sequence[str]], source: str
) -> dict[str, list[Any]]:
    """Return rows of the selected columns by kind; a kind that is not in the file has no rows.

    A damaged record is skipped up to the next one. One that is cut off ends the file.

    Args:
        content: The file.
        selection: Names of columns by kind.
        source: Name of the file for errors.

    Raises:
        ConfigError: It is no DataFlash log, or a selected column is not in its kind.
    """
    if not content.startswith(START + bytes((_FMT,))):
        raise ConfigError(f"{source} is not a DataFlash log: it does not begin with a FMT record")
    rows: dict[str, list[Any]] = {name: [] for name in selection}
    for kind, values in _records(content):
        if kind.name in rows:
            row = dict(zip(kind.columns, values, strict=True))
            try:
                rows[kind.name].append(tuple(row[column] for column in selection[kind.name]))
            except KeyError as error:
                raise ConfigError(f"{source}: {kind.name} has no column {error}") from error
    return rows


def _records(content: bytes) -> Iterator[tuple[RecordKind, tuple[Any, ...]]]:
    kinds = {_FMT: FMT}
    at = 0
    while (at := content.find(START, at)) >= 0 and at + _HEAD <= len(content):
        kind = kinds.get(content[at + 2])
        if kind is None:
            at += 1
            continue
        if at + kind.size > len(content):
            return
        values = kind.unpack(content, at)
        if kind is FMT:
            # A FMT record describes another kind. One about FMT itself or an impossible kind is ignored.
            number, _, name, letters, columns = values
            text = letters.rstrip(b"\0").decode(errors="replace")
            names = columns.rstrip(b"\0").decode(errors="replace")
            is_alike = set(text) <= _LETTERS.keys() and len(names.split(",")) == len(text)
            if number != _FMT and is_alike:
                # A kind longer than 255 bytes is refused.
                with contextlib.suppress(struct.error):
                    title = name.rstrip(b"\0").decode(errors="replace")
                    kinds[number] = RecordKind(number, title, text, names)
        else:
            yield kind, values
        at += kind.size
