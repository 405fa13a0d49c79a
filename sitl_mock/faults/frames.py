"""Edit MAVLink frames: read or change fields, relabel, sign, downgrade to MAVLink 1; the CRC is renewed.

Only the bytes of the named fields change, so integers in float fields (PX4's parameters) stay intact. A signed frame is
signed again with the vehicle's key and its original timestamp.
"""

from __future__ import annotations

import hashlib
import struct
from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from sitl_mock.mavlink import SPEC_BY_ID, MessageSpec

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.mavlink import Signing

V1: Final = 0xFE
V2: Final = 0xFD
_HEADER: Final = {V1: 6, V2: 10}
_RANGE: Final = {"b": 8, "h": 16, "i": 32, "q": 64, "B": 8, "H": 16, "I": 32, "Q": 64}


class PayloadField(NamedTuple):
    """A field's location in a payload: offset, format of one element, number of elements (1 for a scalar)."""

    at: int
    format: str
    length: int

    @property
    def whole(self) -> bool:
        """True if the field holds integers."""
        return self.format in _RANGE

    @property
    def most(self) -> int:
        """The largest integer that fits."""
        bits = _RANGE[self.format]
        return int(2 ** (bits - 1) - 1) if self.format.islower() else int(2**bits - 1)


def message_id(frame: bytes) -> int:
    """Return a frame's message id, or -1 unless it is one complete, valid frame of the dialect.

    A damaged frame has no id, because renewing its CRC would repair it.
    """
    if len(frame) < 8 or frame[0] not in _HEADER:
        return -1
    if frame[0] == V1:
        number = frame[5]
        crc_at = 6 + frame[1]
        end = 8 + frame[1]
    elif len(frame) >= 12 and not frame[2] & ~1:
        number = frame[7] | frame[8] << 8 | frame[9] << 16
        crc_at = 10 + frame[1]
        end = crc_at + (15 if frame[2] else 2)
    else:
        return -1
    spec = SPEC_BY_ID.get(number)
    if spec is None or end != len(frame):
        return -1
    crc = frame[crc_at] | frame[crc_at + 1] << 8
    return number if mcrf4xx(frame[1:crc_at] + spec.crc_extra) == crc else -1


@cache
def payload_fields(message: int) -> Mapping[str, PayloadField]:
    """Return the fields of a message by name."""
    fields = {}
    at = 0
    for field in SPEC_BY_ID[message].wire_fields:
        fields[field.name] = PayloadField(at, field.letter, max(1, field.length))
        at += field.size
    return fields


def value(frame: bytes, name: str) -> Any:  # noqa: ANN401 - number or bytes, by the field's type
    """Return one field of a frame: a number, a text, or the first element of an array."""
    number = message_id(frame)
    payload = _payload(frame, SPEC_BY_ID[number])
    field = payload_fields(number)[name]
    if field.format == "c":
        return bytes(payload[field.at : field.at + field.length]).rstrip(b"\0")
    return struct.unpack_from("<" + field.format, payload, field.at)[0]


def changed(frame: bytes, changes: Mapping[str, float], key: bytes | None = None) -> bytes:
    """Return the frame with new values in some fields (in every element of an array).

    Integers wrap around, as the sender's counters do.
    """
    number = message_id(frame)
    spec = SPEC_BY_ID[number]
    payload = _payload(frame, spec)
    for name, new in changes.items():
        field = payload_fields(number)[name]
        value: float = new
        if field.whole:
            bits = _RANGE[field.format]
            value = int(new) & (2**bits - 1)
            if value > field.most:
                value -= 2**bits
        for index in range(field.length):
            at = field.at + index * struct.calcsize(field.format)
            struct.pack_into("<" + field.format, payload, at, value)
    return _closed(frame, payload, spec, key)


def relabelled(
    frame: bytes, *, system: int | None = None, component: int | None = None, key: bytes | None
) -> bytes:
    """Return the frame with another sender.

    Args:
        frame: A whole MAVLink frame.
        system: The other system; None keeps its own.
        component: The other component; None keeps its own.
        key: Signs it again; None leaves it unsigned.
    """
    spec = SPEC_BY_ID[message_id(frame)]
    head = bytearray(frame)
    at = 3 if frame[0] == V1 else 5
    head[at] = frame[at] if system is None else system
    head[at + 1] = frame[at + 1] if component is None else component
    return _closed(bytes(head), _payload(frame, spec), spec, key)


def as_v1(frame: bytes) -> bytes | None:
    """Return the frame as MAVLink 1, without signature and extensions; None if its id does not fit."""
    number = message_id(frame)
    if frame[0] == V1:
        return frame
    if number > 0xFF:
        return None
    spec = SPEC_BY_ID[number]
    payload = bytes(_payload(frame, spec)[: spec.base_size])
    body = bytes((len(payload), *frame[4:7], number)) + payload
    return b"\xfe" + body + struct.pack("<H", mcrf4xx(body + spec.crc_extra))


def signed(frame: bytes, signing: Signing, link_id: int = 0) -> bytes:
    """Return the frame signed with a key; MAVLink 1 frames stay unsigned."""
    if frame[0] == V1:
        return frame
    spec = SPEC_BY_ID[message_id(frame)]
    body = bytes((frame[1], frame[2] | 1)) + frame[3 : 10 + frame[1]]
    closed = b"\xfd" + body + struct.pack("<H", mcrf4xx(body + spec.crc_extra))
    return closed + signing.block(closed, link_id)


def _payload(frame: bytes, spec: MessageSpec) -> bytearray:
    start = _HEADER[frame[0]]
    return bytearray(frame[start : start + frame[1]].ljust(spec.size, b"\0"))


def _closed(frame: bytes, payload: bytearray, spec: MessageSpec, key: bytes | None) -> bytes:
    """Join header, payload, CRC and, if there was one, signature."""
    if frame[0] == V1:
        body = bytes(frame[1:6]) + bytes(payload[: frame[1]])
        return b"\xfe" + body + struct.pack("<H", mcrf4xx(body + spec.crc_extra))
    short = bytes(payload[:1]) + bytes(payload[1:]).rstrip(b"\0")  # at least one byte
    body = bytes((len(short),)) + frame[2:10] + short
    closed = b"\xfd" + body + struct.pack("<H", mcrf4xx(body + spec.crc_extra))
    if not frame[2] & 1:
        return closed
    head = frame[-13:-6]
    secret = b"" if key is None else key
    return closed + head + hashlib.sha256(secret + closed + head).digest()[:6]
