"""Converts named tuples to JSON and back, and describes them as JSON Schema.

JSON has no NaN, and viewers such as Foxglove accept one plain `type` per schema field, without null. A field that is
None, NaN or infinite is therefore left out of its object. In an array, which must keep its length, an unknown number is
null. On reading, an absent number becomes NaN and an absent optional value becomes None. All other values are read back
bit for bit.
"""

import json
import types
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from functools import cache
from math import isfinite, nan
from typing import (
    Any,
    Final,
    Generic,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic_core import (
    CoreSchema,
    PydanticSerializationError,
    SchemaValidator,
    ValidationError,
    to_json,
)
from pydantic_core import core_schema as cs

from guidance.errors import ConfigError
from guidance.frames import Enu, Ned
from guidance.messages import Message

Schema = dict[str, Any]
Value = TypeVar("Value")

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_TAG: Final = "kind"
_NUMBER: Final = cs.union_schema(
    [
        cs.float_schema(strict=True),
        cs.no_info_after_validator_function(lambda _: nan, cs.none_schema()),
    ],
    mode="left_to_right",
    custom_error_type="number",
    custom_error_message="must be a number",
)
_REASONS: Final = {"missing": "is missing", "extra_forbidden": "is unknown to this version"}


class Form(NamedTuple):
    """Reader (pydantic core schema), description (JSON Schema) and writer of one type.

    `write` turns a value into dictionaries and lists of numbers and text; None for values that are written as they are.
    """

    core: Any
    schema: Schema
    write: Callable[[Any], Any] | None = None


_PLAIN: Final[Mapping[Any, Form]] = {
    float: Form(_NUMBER, {"type": "number"}),
    int: Form(cs.int_schema(strict=True), {"type": "integer"}),
    bool: Form(cs.bool_schema(strict=True), {"type": "boolean"}),
    str: Form(cs.str_schema(strict=True), {"type": "string"}),
}


class Codec(Generic[Value]):
    """Converts values of one type.

    Args:
        title: Name of the type in the record.
        kind: A named tuple of numbers, text, enumerations, tuples of those, and other named tuples.
        topic: Of its messages in a record.

    Raises:
        TypeError: If viewers cannot read the type.
    """

    def __init__(self, title: str, kind: Callable[..., Value], topic: str = "") -> None:
        self.title = title
        self.topic = topic
        self._name = kind.__name__
        core, schema, self._write = form_of(kind)
        self.schema: Schema = {"$schema": DIALECT, "title": title, **schema}
        self._validator = SchemaValidator(core)

    def encode(self, value: Value) -> bytes:
        """Return a value as JSON; text that is not valid Unicode is written with question marks."""
        written = value if self._write is None else self._write(value)
        try:
            return to_json(written, inf_nan_mode="null")
        except PydanticSerializationError:  # a lone surrogate, which a sender of JSON can produce
            return json.dumps(plain(written), ensure_ascii=False).encode("utf-8", "replace")

    def plain(self, value: Value) -> Any:  # noqa: ANN401 - any JSON
        """Return a value as the dictionaries, lists and numbers of its JSON."""
        return json.loads(self.encode(value))

    def decode(self, data: bytes | str) -> Value:
        """Read a value.

        Raises:
            ConfigError: If it is not JSON or does not match the type, for example in a record of another version.
        """
        try:
            value: Value = self._validator.validate_json(data)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, (self._name, *first["loc"])))
            given = (
                "" if isinstance(first["input"], (dict, list, bytes)) else f" = {first['input']!r}"
            )
            raise ConfigError(
                f"{key}{given}: {_REASONS.get(first['type'], first['msg'])}"
            ) from error
        return value


@cache
def form_of(kind: Any) -> Form:  # noqa: ANN401 - a type annotation can be any object
    """Return how a type is converted and described.

    Raises:
        TypeError: As for `Codec`.
    """
    if kind in _PLAIN:
        return _PLAIN[kind]
    if kind in {Ned, Enu}:
        numbers = _array((float, float, float))
        core = cs.no_info_after_validator_function(kind, numbers.core)
        # pydantic_core writes a plain tuple in a third of the time
        return numbers._replace(core=core, write=tuple)
    if (inner := inside(kind)) is not kind:
        return form_of(inner)._replace(core=cs.nullable_schema(form_of(inner).core))
    origin = get_origin(kind)
    parts = get_args(kind)
    if origin in {tuple, Sequence}:
        return _array(parts if origin is tuple else (*parts, ...))
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        words = [str(member) for member in kind]
        return Form(
            cs.enum_schema(kind, list(kind)), {"type": "string", "enum": words}, str.__str__
        )
    kinds = parts or (kind,)
    if not all(hasattr(member, "_fields") for member in kinds):
        raise TypeError(f"{kind}: viewers cannot read this type")
    return _object(kinds, tagged=kind == Message)


def inside(hint: Any) -> Any:  # noqa: ANN401
    """Return X for X | None, and everything else unchanged."""
    if get_origin(hint) in {types.UnionType, Union}:
        parts = [part for part in get_args(hint) if part is not types.NoneType]
        return parts[0] if len(parts) == 1 else hint
    return hint


def _array(kinds: tuple[Any, ...]) -> Form:
    core, items, write = form_of(kinds[0])
    if kinds[-1] is Ellipsis:
        writes = None if write is None else lambda values: list(map(write, values))
        return Form(
            cs.tuple_schema([core], variadic_item_index=0),
            {"type": "array", "items": items},
            writes,
        )
    if kinds[0] is float:
        element = {"type": [items["type"], "null"]}
    else:
        element = items
    schema = {
        "type": "array",
        "items": items,
        "prefixItems": [element] * len(kinds),
        "maxItems": len(kinds),
    }
    return Form(cs.tuple_schema([core] * len(kinds)), schema)


def _object(kinds: Sequence[Any], *, tagged: bool) -> Form:
    """One of several named tuples: messages name theirs in `kind`, others differ in their fields."""
    if tagged:
        tag = {_TAG: cs.typed_dict_field(cs.any_schema(), required=True)}
    else:
        tag = {}
    fields = {kind: tag | {name: _field(kind, name) for name in kind._fields} for kind in kinds}
    if tag:
        properties: dict[str, Schema] = {
            _TAG: {"enum": [kind.__name__ for kind in kinds], "type": "string"}
        }
    else:
        properties = {}
    for kind in kinds:
        properties |= {name: form_of(hint).schema for name, hint in get_type_hints(kind).items()}
    required = set.intersection(
        *(
            {name for name, spec in properties.items() if spec["required"]}
            for properties in fields.values()
        )
    )
    choices = {kind.__name__: _built(kind, fields[kind]) for kind in kinds}
    either: list[Any] = [*choices.values()]
    core = (
        cs.tagged_union_schema(choices, _TAG)
        if tagged
        else cs.union_schema(either, mode="left_to_right")
    )
    writers = {kind: _dictionary_writer(kind, tagged=tagged) for kind in kinds}
    schema = {
        "type": "object",
        "properties": properties,
        "required": sorted(required),
        "additionalProperties": False,
    }
    write = writers[kinds[0]] if len(kinds) == 1 else lambda value: writers[type(value)](value)
    return Form(core, schema, write)


def _dictionary_writer(kind: Any, *, tagged: bool) -> Callable[[Any], dict[str, Any]]:  # noqa: ANN401
    """Return a function that makes a dictionary of a named tuple, without unknown values."""
    keys = kind._fields
    tag: tuple[str, ...] = ()
    if tagged:
        keys = (_TAG, *keys)
        tag = (kind.__name__,)
    hints = get_type_hints(kind)
    # The fields that can be None or are not written as they are, each with its writer.
    parts = list[tuple[str, Callable[[Any], Any] | None]]()
    for name in kind._fields:
        write_field = form_of(hints[name]).write
        is_optional = inside(hints[name]) is not hints[name]
        if is_optional or write_field is not None:
            parts.append((name, write_field))
    numbers = [name for name in kind._fields if inside(hints[name]) is float]

    def write(value: Any) -> dict[str, Any]:  # noqa: ANN401
        fields: dict[str, Any] = dict(zip(keys, tag + value, strict=True))
        for name, write_part in parts:
            part = fields[name]
            if part is None:
                del fields[name]
            elif write_part is not None:
                fields[name] = write_part(part)
        for name in numbers:
            if name in fields and not isfinite(fields[name]):
                del fields[name]
        return fields

    return write


def _field(kind: Any, name: str) -> cs.TypedDictField:  # noqa: ANN401
    """Describe one field: numbers, optional values and fields with a default may be absent."""
    hint = get_type_hints(kind)[name]
    if name == "now_s":  # the time of an entry is always known
        return cs.typed_dict_field(cs.float_schema(strict=True, allow_inf_nan=False), required=True)
    core = form_of(hint).core
    if hint is not float and inside(hint) is hint and name not in kind._field_defaults:
        return cs.typed_dict_field(core, required=True)
    default = kind._field_defaults.get(name, nan if hint is float else None)
    return cs.typed_dict_field(cs.with_default_schema(core, default=default), required=False)


def _built(kind: Any, fields: dict[str, cs.TypedDictField]) -> CoreSchema:  # noqa: ANN401
    def build(values: dict[str, Any]) -> Any:  # noqa: ANN401
        values.pop(_TAG, None)
        return kind._make(values.values())  # the fields are in their order

    return cs.no_info_after_validator_function(
        build, cs.typed_dict_schema(fields, extra_behavior="forbid")
    )


def plain(value: Any) -> Any:  # noqa: ANN401 - any value
    """Return a value of any type as dictionaries, lists and numbers for JSON; NaN and infinity become None."""
    if isinstance(value, float):
        return value if isfinite(value) else None
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value
