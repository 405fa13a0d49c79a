"""TOML as people read it: on which line a key stands, and a value as they would write it."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

MOST_LETTERS: Final = 60
"""A longer value is cut: its key says which one is meant."""

_HEADING: Final = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_NAME: Final = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_KEY: Final = re.compile(rf"^\s*({_NAME}(?:\s*\.\s*{_NAME})*)\s*=")
_PART: Final = re.compile(_NAME)

Location = Sequence[str | int]


def line_of(text: str, location: Location) -> int | None:
    """Return the line, counted from 1, on which a key or what holds it begins; None where it is not found.

    Args:
        text: A TOML document.
        location: The names of the key's tables and its own; numbers count in arrays.
    """
    wanted = [str(part) for part in location]
    best: tuple[int, int] | None = None
    for number, path in _keys(text):
        if wanted[: len(path)] == path and (best is None or len(path) > best[0]):
            best = len(path), number
    return None if best is None else best[1]


def _keys(text: str) -> list[tuple[int, list[str]]]:
    """Return every heading and key with its line; what is inside an inline table or a long text is not looked into."""
    found: list[tuple[int, list[str]]] = []
    table: list[str] = []
    counts: dict[tuple[str, ...], int] = {}
    quoted = ""
    for number, line in enumerate(text.splitlines(), 1):
        if quoted:
            quoted = "" if quoted in line else quoted
            continue
        heading, key = _HEADING.match(line), _KEY.match(line)
        if heading is not None and key is None:
            table = _parts(heading[2])
            if heading[1] == "[[":
                place = tuple(table)
                counts[place] = counts.get(place, -1) + 1
                table = [*table, str(counts[place])]
            found.append((number, table))
        elif key is not None:
            found.append((number, [*table, *_parts(key[1])]))
            quoted = next((mark for mark in ('"""', "'''") if line.count(mark) % 2), "")
    return found


def _parts(text: str) -> list[str]:
    return [part.strip("\"'") for part in _PART.findall(text)]


def as_toml(value: Any) -> str:  # noqa: ANN401 - any value of a document
    """Return a value as it would be written in TOML, cut where it is long."""
    text = _written(value)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"


def _written(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_written(part)}" for key, part in value.items()) + " }" if value else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_written, value)) + "]"
    return repr(value)
