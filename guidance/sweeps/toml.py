"""A scenario's document as TOML text: what Python reads and does not write. Numbers come back bit for bit."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_of(document: Mapping[str, Any]) -> str:
    """Write a document of texts, numbers, lists and tables; None is left out, as TOML has none."""
    return "\n".join(_lines(document, "")) + "\n"


def _lines(table: Mapping[str, Any], path: str) -> Iterator[str]:
    given = {name: value for name, value in table.items() if value is not None}
    inside = {name: value for name, value in given.items() if _is_table(value) or _is_tables(value)}
    for name, value in given.items():
        if name not in inside:
            yield f"{_key(name)} = {_value(value)}"
    for name, value in inside.items():
        where = f"{path}{_key(name)}"
        for one in [value] if _is_table(value) else value:
            yield ""
            yield f"[{where}]" if _is_table(value) else f"[[{where}]]"
            yield from _lines(one, f"{where}.")


def _value(value: Any) -> str:  # noqa: ANN401 - whatever a document holds
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):  # a JSON string is a TOML one, but for DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(one) for one in value)}]"
    return repr(value)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)


def _is_table(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, Mapping)


def _is_tables(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, (list, tuple)) and bool(value) and all(isinstance(one, Mapping) for one in value)
