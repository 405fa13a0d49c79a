"""JSON back into the named tuples it came from: the inverse of `guidance.log.known`.

JSON has no NaN: where a type says float, what is absent or null is NaN; where it says "or None", it is None. Everything
else comes back bit for bit, since Python writes the shortest digits that read back as the same number.
"""

import math
import types
from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import cache
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

from guidance.errors import ConfigError
from guidance.log.schemas import optional_in

Decoder = Callable[[Any], Any]


@cache
def decoder(kind: Any) -> Decoder:  # noqa: ANN401 - a type annotation can be any object
    """Return what turns JSON into a value of `kind`: a named tuple, a tuple, an enumeration, a number or text.

    The decoder raises ConfigError where the JSON does not fit, as in a record of another version.
    """
    origin = get_origin(kind)
    if origin is tuple:
        return _tuple(*get_args(kind))
    if origin in {types.UnionType, Union}:
        return _optional(kind)
    if kind is float:
        return _number
    if hasattr(kind, "_fields"):
        return _named(kind)
    return _plain(kind)


def _number(value: Any) -> float:  # noqa: ANN401 - any JSON
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ConfigError(f"{value!r} where a number belongs")
    return cast("float", value)


def _plain(kind: type) -> Decoder:
    enumeration = issubclass(kind, StrEnum)

    def read(value: Any) -> Any:  # noqa: ANN401
        if enumeration and value in {str(item) for item in cast("type[StrEnum]", kind)}:
            return kind(value)
        if enumeration or type(value) is not kind:
            raise ConfigError(f"{value!r} where {kind.__name__} belongs")
        return value

    return read


def _optional(kind: Any) -> Decoder:  # noqa: ANN401
    (inside,) = (part for part in get_args(kind) if part is not types.NoneType)
    read = decoder(inside)
    return lambda value: None if value is None else read(value)


def _tuple(*kinds: Any) -> Decoder:  # noqa: ANN401
    endless = kinds[-1] is Ellipsis
    reads = [decoder(kind) for kind in kinds if kind is not Ellipsis]

    def read(value: Any) -> tuple[Any, ...]:  # noqa: ANN401
        if not isinstance(value, list) or not (endless or len(value) == len(reads)):
            raise ConfigError(f"{value!r} where a list of {'any length' if endless else len(reads)} belongs")
        return tuple(one(item) for one, item in zip(reads * len(value) if endless else reads, value, strict=False))

    return read


def _named(kind: Any) -> Decoder:  # noqa: ANN401
    fields = {name: decoder(hint) for name, hint in get_type_hints(kind).items()}
    defaults = kind._field_defaults  # what came later has one, and older records lack it
    absent = {name: defaults[name] if name in defaults else fields[name](None) for name in optional_in(kind)}
    needed = fields.keys() - absent.keys()

    def read(value: Any) -> Any:  # noqa: ANN401
        given = value.keys() - {"kind"} if isinstance(value, Mapping) else frozenset()
        if not needed <= given <= fields.keys():
            keys = ", ".join(sorted(given)) or repr(value)
            raise ConfigError(f"{kind.__name__} with {keys}: this version knows {', '.join(sorted(fields))}")
        return kind(**absent | {name: fields[name](value[name]) for name in given})

    return read
