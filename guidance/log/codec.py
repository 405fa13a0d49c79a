"""Values of a record as JSON, back again, and as the JSON Schema of their channel: all three made from their types.

JSON has no NaN, and viewers of records know no nullable type: Foxglove and Lichtblick want one plain `type` for each
field, the `properties` of every object and the `items` of every array. So a field that is not known (None, NaN,
infinite) is left out of its object and is not required; in an array, which must keep its places, it is null, and the
schema says so in `prefixItems`, which viewers pass over. Read back, an absent number is NaN and an absent "or None" is
None. Everything else comes back bit for bit: the shortest digits of a number read back as the same number.
"""

import json
import math
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from functools import cache
from typing import Any, Final, Generic, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic_core import CoreSchema, SchemaValidator, ValidationError
from pydantic_core import core_schema as cs

from guidance.errors import ConfigError
from guidance.messages import Message

Schema = dict[str, Any]
T = TypeVar("T")

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_PLAIN: Final[Mapping[Any, tuple[str, CoreSchema]]] = {
    int: ("integer", cs.int_schema(strict=True)),
    bool: ("boolean", cs.bool_schema(strict=True)),
    str: ("string", cs.str_schema(strict=True)),
}
_NUMBER: Final = cs.union_schema(
    [cs.float_schema(strict=True), cs.no_info_after_validator_function(lambda _: math.nan, cs.none_schema())],
    mode="left_to_right",
    custom_error_type="number",
    custom_error_message="must be a number",
)
_REASONS: Final = {
    "missing_keyword_only_argument": "is missing",
    "unexpected_keyword_argument": "is unknown to this version",
}


class Form(NamedTuple):
    """One type: what turns a value into JSON (None leaves it out), what reads it, and how viewers are told of it."""

    write: Callable[[Any], Any]
    read: CoreSchema
    schema: Schema


class Codec(Generic[T]):
    """Writes and reads values of one type.

    Args:
        title: What viewers know the type by.
        kind: A named tuple of numbers, text, enumerations, tuples of those, and other named tuples.

    Raises:
        TypeError: If viewers could not read it: an array of arrays, or of different things.
    """

    def __init__(self, title: str, kind: Callable[..., T]) -> None:
        self.title = title
        self._name = kind.__name__
        self._form = form_of(kind)
        self._read = SchemaValidator(self._form.read)

    @property
    def schema(self) -> Schema:
        """The JSON Schema of a channel of such values."""
        return {"$schema": DIALECT, "title": self.title, **self._form.schema}

    def plain(self, value: T) -> Any:  # noqa: ANN401 - any JSON
        """Return a value as what JSON can hold."""
        return self._form.write(value)

    def encode(self, value: T) -> bytes:
        """Lay a value out as JSON."""
        return json.dumps(self._form.write(value), separators=(",", ":"), allow_nan=False).encode()

    def decode(self, data: bytes | str) -> T:
        """Read a value back.

        Raises:
            ConfigError: If it is no JSON, or does not fit the type, as in a record of another version.
        """
        try:
            value: T = self._read.validate_json(data)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, (self._name, *first["loc"])))
            given = "" if isinstance(first["input"], (dict, list, bytes)) else f" = {first['input']!r}"
            raise ConfigError(f"{place}{given}: {_REASONS.get(first['type'], first['msg'])}") from error
        return value


@cache
def form_of(kind: Any) -> Form:  # noqa: ANN401 - a type annotation can be any object
    """Return how values of a type are written, read and described.

    Raises:
        TypeError: As for `Codec`.
    """
    if kind is float:
        return Form(_finite, _NUMBER, {"type": "number"})
    if kind in _PLAIN:
        name, read = _PLAIN[kind]
        return Form(_same, read, {"type": name})
    origin = get_origin(kind)
    if origin in {types.UnionType, Union}:
        return _union(kind)
    if origin in {tuple, Sequence}:
        return _array(get_args(kind) if origin is tuple else (*get_args(kind), ...))
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        members = list(kind)
        return Form(str, cs.enum_schema(kind, members), {"type": "string", "enum": [str(one) for one in members]})
    if hasattr(kind, "_fields"):
        return _named(kind)
    raise TypeError(f"{kind}: no viewer could read it")


def optional_in(kind: Any) -> set[str]:  # noqa: ANN401
    """Return the fields of a named tuple that may be absent: NaN, None, or younger than the record."""
    hints = get_type_hints(kind)
    unknown = {name for name, hint in hints.items() if hint is float or inside(hint) is not hint}
    return (unknown | set(kind._field_defaults)) - {"now_s"}  # an entry's own time is always known


def inside(hint: Any) -> Any:  # noqa: ANN401
    """Return X for X | None, and everything else as it is."""
    if get_origin(hint) in {types.UnionType, Union}:
        parts = [part for part in get_args(hint) if part is not types.NoneType]
        return parts[0] if len(parts) == 1 else hint
    return hint


def _same(value: Any) -> Any:  # noqa: ANN401
    return value


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _named(kind: Any) -> Form:  # noqa: ANN401
    hints = get_type_hints(kind)
    writes = [(name, form_of(hint).write) for name, hint in hints.items()]

    def write(value: Any) -> dict[str, Any]:  # noqa: ANN401
        return {
            name: said
            for (name, put), item in zip(writes, value, strict=True)
            if item is not None and (said := put(item)) is not None
        }

    return Form(write, cs.call_schema(_fields(kind), kind), _object([kind], sorted(set(hints) - optional_in(kind))))


def _fields(kind: Any, *more: cs.ArgumentsParameter) -> CoreSchema:  # noqa: ANN401
    """Read an object's fields as arguments of its type; what came later has a default, and older records lack it."""
    optional = optional_in(kind)
    parameters = list(more)
    for name, hint in get_type_hints(kind).items():
        read = form_of(hint).read
        if name == "now_s":
            read = cs.float_schema(strict=True, allow_inf_nan=False)
        if name in optional:
            absent = kind._field_defaults.get(name, math.nan if hint is float else None)
            read = cs.with_default_schema(read, default=absent)
        parameters.append(cs.arguments_parameter(name, read, mode="keyword_only"))
    return cs.arguments_schema(parameters)


def _array(kinds: tuple[Any, ...]) -> Form:
    first, endless = kinds[0], kinds[-1] is Ellipsis
    if get_origin(inside(first)) is tuple or len(set(kinds) - {Ellipsis}) > 1:
        raise TypeError(f"tuple{list(kinds)}: no viewer could read an array of arrays, or of different things")
    put, read, items = form_of(first)
    write = list if put is _same else lambda value: [put(item) for item in value]
    if endless:
        return Form(write, cs.tuple_schema([read], variadic_item_index=0), {"type": "array", "items": items})
    each = {"type": [items["type"], "null"]} if first is float else items
    schema = {"type": "array", "items": items, "prefixItems": [each] * len(kinds), "maxItems": len(kinds)}
    return Form(write, cs.tuple_schema([read] * len(kinds)), schema)


def _union(kind: Any) -> Form:  # noqa: ANN401
    """X | None, or one of several kinds of object: messages say which in `kind`, others are told by their fields."""
    if kind == Message:
        return _messages(get_args(kind))
    if (one := inside(kind)) is not kind:
        form = form_of(one)
        return form._replace(read=cs.nullable_schema(form.read))
    kinds = get_args(kind)
    if not all(hasattr(one, "_fields") for one in kinds):
        raise TypeError(f"{kind}: no viewer could read it")
    writes = {one: form_of(one).write for one in kinds}
    read = cs.union_schema([form_of(one).read for one in kinds], mode="left_to_right")
    return Form(lambda value: writes[type(value)](value), read, _object(kinds, ()))


def _messages(kinds: Sequence[Any]) -> Form:
    names = {one.__name__: one for one in kinds}
    writes = {one: form_of(one).write for one in kinds}

    def write(value: Any) -> dict[str, Any]:  # noqa: ANN401
        kind = type(value)
        return {"kind": kind.__name__, **writes[kind](value)}

    def read_as(kind: Any) -> CoreSchema:  # noqa: ANN401
        tag = cs.arguments_parameter("kind", cs.any_schema(), mode="keyword_only")
        return cs.call_schema(_fields(kind, tag), lambda *, kind, _of=kind, **fields: _of(**fields))  # noqa: ARG005

    read = cs.tagged_union_schema({name: read_as(one) for name, one in names.items()}, discriminator="kind")
    return Form(write, read, _object(kinds, ["received_s"], kind={"enum": list(names), "type": "string"}))


def _object(kinds: Iterable[Any], required: Iterable[str], **more: Schema) -> Schema:
    """Describe an object of any of several kinds: with the fields of all of them."""
    properties: dict[str, Schema] = dict(more)
    for kind in kinds:
        for name, hint in get_type_hints(kind).items():
            schema = form_of(hint).schema
            if properties.setdefault(name, schema) != schema:
                raise TypeError(f"{kind.__name__}.{name}: is something else in another kind of the same array")
    return {
        "type": "object",
        "properties": properties,
        "required": [*more, *required],
        "additionalProperties": False,
    }


def plain(value: Any) -> Any:  # noqa: ANN401 - any value
    """Turn a value of no known type into what JSON can hold: named tuples by field, NaN and infinities as null."""
    if isinstance(value, float):
        return _finite(value)
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value
