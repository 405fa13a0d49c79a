"""Messages of the dialect, prepared for packing and unpacking.

Field order, lengths and CRC seed come from pymavlink's message classes; packing and unpacking are this package's own.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from pymavlink.dialects.v20 import all as dialect

from sitl_mock.mavlink.newer import NEWER

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence


Message = Any
"""A pymavlink message object; its fields are attributes without static types."""

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
        message_class: pymavlink's class of decoded messages.
        field_names: Names in the order of declaration (that of the class's arguments).
        id_bytes: The id as in a MAVLink 2 header.
        crc_extra: The seed byte that closes the CRC.
        size: Payload length in bytes before trailing zeros go.
        count: Number of fields.
        arrange: Converts values from declaration order to wire order with arrays as bytes; None if they are equal.
        pack: Arranged values to the whole payload.
        unpack_payload: Whole payload to values in the order of declaration.
    """

    name: str
    message_id: int
    message_class: type[Any]
    field_names: tuple[str, ...]
    id_bytes: bytes
    crc_extra: bytes
    size: int
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
    wire: struct.Struct, to_declared: tuple[int, ...], kinds: tuple[tuple[str, int], ...]
) -> Callable[[bytes], Sequence[Any]]:
    unpack = wire.unpack
    if all(length == 0 and kind != "char" for kind, length in kinds):
        if to_declared == tuple(range(len(to_declared))):
            return unpack
        reorder = itemgetter(*to_declared)
        return lambda payload: reorder(unpack(payload))
    starts: list[slice | int] = []
    at = 0
    for kind, length in kinds:
        starts.append(slice(at, at + length) if length and kind != "char" else at)
        at += length if length and kind != "char" else 1
    plan = tuple(starts[wire_index] for wire_index in to_declared)

    def unpack_nested(payload: bytes) -> Sequence[Any]:
        flat = unpack(payload)
        return [
            list(flat[part]) if isinstance(part, slice) else _stripped(flat[part]) for part in plan
        ]

    return unpack_nested


def _stripped(value: FieldValue) -> FieldValue:
    return value.rstrip(b"\0") if isinstance(value, bytes) else value


def _spec(message_class: type[Any]) -> MessageSpec:
    names = tuple(message_class.fieldnames)
    declared_index = {name: index for index, name in enumerate(names)}
    wire_names = tuple(message_class.ordered_fieldnames)
    to_wire = tuple(declared_index[name] for name in wire_names)
    wire_index = {name: index for index, name in enumerate(wire_names)}
    to_declared = tuple(wire_index[name] for name in names)
    kinds = tuple(
        (message_class.fieldtypes[declared_index[name]], length)
        for name, length in zip(wire_names, message_class.array_lengths, strict=True)
    )
    wire = struct.Struct(message_class.unpacker.format)
    tokens = re.findall(r"\d*[a-zA-Z]", message_class.unpacker.format)
    converters = tuple(
        (index, _text_bytes if kind == "char" else _array_bytes(token))
        for index, ((kind, length), token) in enumerate(zip(kinds, tokens, strict=True))
        if length or kind == "char"
    )
    sized = "".join(
        f"{struct.calcsize(f'<{token}')}s" if length else token
        for (_, length), token in zip(kinds, tokens, strict=True)
    )
    return MessageSpec(
        name=message_class.msgname,
        message_id=message_class.id,
        message_class=message_class,
        field_names=names,
        id_bytes=message_class.id.to_bytes(3, "little"),
        crc_extra=bytes((message_class.crc_extra,)),
        size=wire.size,
        count=len(names),
        arrange=_arranger(to_wire, converters),
        pack=struct.Struct(f"<{sized}").pack,
        unpack_payload=_unpacker(wire, to_declared, kinds),
    )


SPEC_BY_ID: Final[dict[int, MessageSpec]] = {
    message_id: _spec(message_class)
    for message_id, message_class in {**dialect.mavlink_map, **NEWER}.items()
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
