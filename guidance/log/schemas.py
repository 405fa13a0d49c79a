"""JSON Schemas of a record's channels, generated from the types whose values are in them.

Written so that a validator and the viewers both can use them. Foxglove and Lichtblick read one plain `type` for each
field, the `properties` of every object and the `items` of every array, and refuse the whole channel otherwise. So what
may be unknown is not required (`guidance.log.known` leaves it out), and an array that may hold null says so in
`prefixItems`, which they pass over.
"""

import types
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

from guidance.certificate import Certificate
from guidance.clock import Timing
from guidance.flight import Event, State
from guidance.log.scene import TYPES as DRAWN
from guidance.messages import EvaderReport, Message, Request, Setpoint
from guidance.monitor import Alarm

Schema = dict[str, Any]

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"

_PLAIN: Final[Mapping[Any, str]] = {float: "number", int: "integer", bool: "boolean", str: "string"}


def schema_of(kind: Any) -> Schema:  # noqa: ANN401 - a type annotation can be any object
    """Describe a type: a named tuple, a tuple of numbers or of named tuples, an enumeration, a number or text.

    Raises:
        TypeError: If viewers could not read it: an array of arrays, or of different things.
    """
    kind = inside(kind)
    if kind in _PLAIN:
        return {"type": _PLAIN[kind]}
    if get_origin(kind) is tuple:
        return _array(get_args(kind))
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return {"type": "string", "enum": [str(item) for item in kind]}
    if hasattr(kind, "_fields"):
        return _object([kind], required=sorted(set(kind._fields) - optional_in(kind)))
    raise TypeError(f"{kind}: no viewer could read it")


def optional_in(kind: Any) -> set[str]:  # noqa: ANN401
    """Return the fields of a named tuple that may be absent: NaN, None, or younger than the record."""
    hints = get_type_hints(kind)
    unknown = {name for name, hint in hints.items() if hint is float or inside(hint) is not hint}
    return unknown | set(kind._field_defaults)


def inside(hint: Any) -> Any:  # noqa: ANN401
    """Return X for X | None, and everything else as it is."""
    if get_origin(hint) in {types.UnionType, Union}:
        parts = [part for part in get_args(hint) if part is not types.NoneType]
        return parts[0] if len(parts) == 1 else hint
    return hint


def _array(kinds: tuple[Any, ...]) -> Schema:
    first, endless = kinds[0], kinds[-1] is Ellipsis
    if get_origin(inside(first)) is tuple or len(set(kinds) - {Ellipsis}) > 1:
        raise TypeError(f"tuple{list(kinds)}: no viewer could read an array of arrays, or of different things")
    items = schema_of(first)
    if endless:
        return {"type": "array", "items": items}
    each = {"type": [items["type"], "null"]} if first is float else items
    return {"type": "array", "items": items, "prefixItems": [each] * len(kinds), "maxItems": len(kinds)}


def _object(kinds: Iterable[Any], required: Iterable[str], **more: Schema) -> Schema:
    """Describe an object of any of several kinds: with the fields of all of them."""
    properties: dict[str, Schema] = dict(more)
    for kind in kinds:
        for name, hint in get_type_hints(kind).items():
            schema = schema_of(hint)
            if properties.setdefault(name, schema) != schema:
                raise TypeError(f"{kind.__name__}.{name}: is something else in another kind of the same array")
    return {
        "type": "object",
        "properties": properties,
        "required": [*more, *required],
        "additionalProperties": False,
    }


def _channel(name: str, schema: Schema) -> Schema:
    return {"$schema": DIALECT, "title": name, **schema}


def _text(values: type[StrEnum] | None = None) -> Schema:
    return {"type": "string"} if values is None else schema_of(values)


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_INPUTS: Final = {
    "type": "object",
    "properties": {
        "messages": _list(
            _object(
                get_args(Message), ["received_s"], kind={"enum": [one.__name__ for one in get_args(Message)], **_text()}
            )
        ),
        "reports": _list(schema_of(EvaderReport)),
        "orders": _list(_text(Event)),
        "refusals": _list(_text()),
    },
    "required": ["messages", "reports", "orders", "refusals"],
    "additionalProperties": False,
}

CYCLE: Final = _channel(
    "guidance.Cycle",
    {
        "type": "object",
        "properties": {
            "now_s": {"type": "number"},
            "state": _text(State),
            "inputs": _INPUTS,
            "requests": _list(_object(get_args(Request), ())),
            "setpoint": schema_of(Setpoint),
            "certificate": schema_of(Certificate),
            "alarm": schema_of(Alarm),
            "timing": schema_of(Timing),
        },
        "required": ["now_s", "state", "inputs", "requests"],
        "additionalProperties": False,
    },
)

EVENT: Final = _channel(
    "guidance.Event",
    {
        "type": "object",
        "properties": {"now_s": {"type": "number"}, "event": _text(), "detail": _text()},
        "required": ["now_s", "event", "detail"],
        "additionalProperties": False,
    },
)

SCHEMAS: Final[Mapping[str, Schema]] = {
    "guidance.Cycle": CYCLE,
    "guidance.Event": EVENT,
    **{
        name: _channel(name, schema_of(kind))
        for name, kind in (("guidance.EvaderReport", EvaderReport), *DRAWN.items())
    },
}
"""Every JSON channel's schema, by its name."""
