"""Messages of the dialect, prepared for packing and unpacking."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.mavlink.definitions import read_definitions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sitl_mock.mavlink.definitions import Definition, Field

FieldValue = Any
"""A field of any wire type: number, text, bytes or a sequence of numbers."""


class EncodeError(ValueError):
    """Values that do not fit the message: wrong name, wrong count, or out of the field's range."""


@dataclass(frozen=True, slots=True)
class MessageSpec:
    """One message of the dialect.

    Attributes:
        name: Name as in the MAVLink XML, for example ``LOCAL_POSITION_NED``.
        message_id: 24-bit message id.
        wire_fields: Fields in the order of the payload.
        field_names: Names in the order of declaration (that of the class's arguments).
        wire_names: Names in the order of the payload.
        id_bytes: The id as in a MAVLink 2 header.
        crc_extra: The seed byte that closes the CRC.
        size: Payload length in bytes before trailing zeros go.
        base_size: The same without extension fields, as in a MAVLink 1 frame.
        count: Number of fields.
        arrange: Converts values from declaration order to wire order with arrays as bytes; None if they are equal.
        pack: Arranged values to the whole payload.
        unpack_payload: Whole payload to values in its order.
    """

    name: str
    message_id: int
    wire_fields: tuple[Field, ...]
    field_names: tuple[str, ...]
    wire_names: tuple[str, ...]
    id_bytes: bytes
    crc_extra: bytes
    size: int
    base_size: int
    count: int
    arrange: Callable[[Sequence[Any]], Sequence[Any]] | None
    pack: Callable[..., bytes]
    unpack_payload: Callable[[bytes], Sequence[Any]]


def _text_bytes(value: str | bytes | bytearray | memoryview) -> bytes:
    # join, not bytes(): an int must be refused, not become that many zeros
    return value.encode("utf-8", "replace") if isinstance(value, str) else b"".join((value,))


def _array_bytes(token: str) -> Callable[[Any], bytes]:
    """Return a function that packs an array of numbers; bytes of the right length are passed through."""
    array = struct.Struct(f"<{token}")
    pack = array.pack
    size = array.size
    return lambda value: value if isinstance(value, bytes) and len(value) == size else pack(*value)


def _arranger(
    to_wire: tuple[int, ...], converters: tuple[tuple[int, Callable[[Any], bytes]], ...]
) -> Callable[[Sequence[Any]], Sequence[Any]] | None:
    """Return a function from declaration order to wire order; None if they are equal.

    Args:
        to_wire: For each field on the wire, its index in declaration order.
        converters: Wire index of each array and text, with its packing function.
    """
    if to_wire == tuple(range(len(to_wire))):
        if not converters:
            return None
        take: Callable[[Sequence[Any]], Iterable[Any]] = tuple
    else:
        take = itemgetter(*to_wire)
    if not converters:
        return take  # type: ignore[return-value]  # several fields: an itemgetter of theirs gives a tuple

    def arranged(values: Sequence[Any]) -> Sequence[Any]:
        flat = list(take(values))
        for index, as_bytes in converters:
            flat[index] = as_bytes(flat[index])
        return flat

    return arranged


def _unpacker(
    layout: struct.Struct, wire_fields: tuple[Field, ...]
) -> Callable[[bytes], Sequence[Any]]:
    unpack = layout.unpack
    if all(field.length == 0 and field.kind != "char" for field in wire_fields):
        return unpack
    plan: list[slice | int] = []
    at = 0
    for field in wire_fields:
        count = field.length if field.length and field.kind != "char" else 1
        plan.append(slice(at, at + count) if field.length and field.kind != "char" else at)
        at += count

    def unpack_nested(payload: bytes) -> Sequence[Any]:
        flat = unpack(payload)
        values: list[Any] = []
        for part in plan:
            value = flat[part]
            if isinstance(part, slice):
                value = list(value)
            elif isinstance(value, bytes):  # a text up to its first zero byte
                value = value.split(b"\0", 1)[0].decode("ascii", errors="replace")
            values.append(value)
        return values

    return unpack_nested


def _spec(definition: Definition) -> MessageSpec:
    declared = definition.fields + definition.extensions
    wire_fields = definition.wire_fields
    names = tuple(field.name for field in declared)
    to_wire = tuple(names.index(field.name) for field in wire_fields)
    converters = tuple(
        (index, _text_bytes if field.kind == "char" else _array_bytes(field.format))
        for index, field in enumerate(wire_fields)
        if field.length or field.kind == "char"
    )
    packed = "".join(f"{field.size}s" if field.length else field.format for field in wire_fields)
    layout = struct.Struct("<" + "".join(field.format for field in wire_fields))
    return MessageSpec(
        name=definition.name,
        message_id=definition.message_id,
        wire_fields=wire_fields,
        field_names=names,
        wire_names=tuple(field.name for field in wire_fields),
        id_bytes=definition.message_id.to_bytes(3, "little"),
        crc_extra=bytes((definition.crc_extra,)),
        size=layout.size,
        base_size=sum(field.size for field in definition.fields),
        count=len(names),
        arrange=_arranger(to_wire, converters),
        pack=struct.Struct(f"<{packed}").pack,
        unpack_payload=_unpacker(layout, wire_fields),
    )


SPEC_BY_ID: Final[dict[int, MessageSpec]] = {
    definition.message_id: _spec(definition) for definition in read_definitions()
}
SPEC_BY_NAME: Final[dict[str, MessageSpec]] = {spec.name: spec for spec in SPEC_BY_ID.values()}


def spec_of(message: str | int) -> MessageSpec:
    """Return the message of a name or an id.

    Raises:
        EncodeError: The dialect has no such message.
    """
    spec = SPEC_BY_NAME.get(message) if isinstance(message, str) else SPEC_BY_ID.get(message)
    if spec is None:
        raise EncodeError(
            f"message {message!r} is not in the dialect; use a name such as 'HEARTBEAT' or its id"
        )
    return spec
