"""Whole MAVLink frames out of bytes, and the fields out of a frame.

The checksum is checked, garbage is skipped and counted. Only the header is looked at for that; fields are taken out of
the few frames that are wanted, by the tables of pymavlink's definitions of the common messages, since a whole pymavlink
message costs five times as much and a link hears hundreds a second. The work is linear in the bytes, whatever they are:
what is no frame is passed over by a search for the next start, and a piece that promises frame after frame and keeps
none is given up.
Source: MAVLink 2 serialisation (mavlink.io/en/guide/serialization.html).
"""

import re
import struct
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common

CRC_EXTRA: Final = {number: message.crc_extra for number, message in common.mavlink_map.items()}
NAMES: Final = {number: message.msgname for number, message in common.mavlink_map.items()}
IDS: Final = {name: number for number, name in NAMES.items()}
_PARAM_VALUE: Final = IDS["PARAM_VALUE"]

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_SHORTEST: Final = 8
_MOST_BUFFERED: Final = 8192
_START: Final = re.compile(b"[\xfd\xfe]")
_MOST_BROKEN_PROMISES: Final = 128
"""Checksums of one piece that may be wrong before the rest of it is given up."""


class Frame(NamedTuple):
    """One frame whose checksum is right."""

    data: bytes
    message_id: int
    system_id: int
    component_id: int
    signed: bool

    @property
    def sequence(self) -> int:
        """Its sender's count of frames, modulo 256."""
        return self.data[4 if self.data[0] == MAGIC_V2 else 2]


class Framer:
    """Feed pieces of a byte stream, get frames. `crc_extra` maps a message id to MAVLink's seed for its checksum.

    A message that is not in the map cannot be checked, so that its length may be a lie: it is counted as unknown and
    searched through for frames that can.
    """

    def __init__(self, crc_extra: Mapping[int, int]) -> None:
        self._crc_extra = crc_extra
        self._buffer = bytearray()
        self._unknown_left = 0
        self.garbage_bytes = 0
        self.unknown = 0

    def feed(self, data: bytes, *, stream: bool = True) -> list[Frame]:
        """Return the frames completed by `data`. A datagram (`stream` False) leaves nothing behind for the next one."""
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        position = broken = 0
        while len(buffer) - position >= _SHORTEST:
            length = _frame_length(buffer, position)
            if stream and len(buffer) - position < length:
                break
            frame = self._frame_at(position, length)
            if frame is None:
                broken += length > 0
                start = _START.search(buffer, position + 1) if broken <= _MOST_BROKEN_PROMISES else None
                after = len(buffer) if start is None else start.start()
                self._pass_over(after - position)
                position = after
            else:
                frames.append(frame)
                position += length
                self._unknown_left = 0
        del buffer[:position]
        excess = len(buffer) - (_MOST_BUFFERED if stream else 0)
        if excess > 0:
            self._pass_over(excess)
            del buffer[:excess]
        return frames

    def _frame_at(self, position: int, length: int) -> Frame | None:
        end = position + length
        if length == 0 or end > len(self._buffer):
            return None
        frame, known = _frame(bytes(self._buffer[position:end]), self._crc_extra)
        if not known and self._unknown_left == 0:
            self.unknown += 1
            self._unknown_left = length
        return frame

    def _pass_over(self, count: int) -> None:
        unknown = min(count, self._unknown_left)
        self._unknown_left -= unknown
        self.garbage_bytes += count - unknown


def first_frame(data: bytes, crc_extra: Mapping[int, int]) -> Frame | None:
    """Return the frame that a datagram begins with; None where it begins with anything else."""
    length = _frame_length(data, 0) if len(data) >= _SHORTEST else 0
    if not 0 < length <= len(data):
        return None
    return _frame(bytes(data[:length]), crc_extra)[0]


def claimed_system(data: bytes) -> int | None:
    """Who a datagram says it is from, before its checksum is asked; None where it does not begin like a frame."""
    if len(data) < _SHORTEST or _frame_length(data, 0) == 0:
        return None
    return data[3] if data[0] == MAGIC_V1 else data[5]


def checksum(body: bytes | bytearray, extra: int) -> bytes:
    """The checksum of a frame's bytes from behind the start mark to the payload's end."""
    return crc16.mcrf4xx(bytes(body) + bytes((extra,))).to_bytes(2, "little")


def _frame_length(buffer: bytes | bytearray, position: int) -> int:
    magic, payload = buffer[position], buffer[position + 1]
    if magic == MAGIC_V1:
        return 6 + payload + 2
    if magic != MAGIC_V2 or buffer[position + 2] & ~SIGNED:
        return 0
    return 10 + payload + 2 + (_SIGNATURE_BYTES if buffer[position + 2] & SIGNED else 0)


def _frame(data: bytes, crc_extra: Mapping[int, int]) -> tuple[Frame | None, bool]:
    """Read a frame's header and check its checksum: the frame, None where that is wrong; whether its message is known.

    Args:
        data: A whole frame, by its own length.
        crc_extra: MAVLink's seed for the checksum, by message id.
    """
    if data[0] == MAGIC_V1:
        frame = Frame(data, data[5], data[3], data[4], signed=False)
    else:
        message_id = int.from_bytes(data[7:10], "little")
        frame = Frame(data, message_id, data[5], data[6], signed=bool(data[2] & SIGNED))
    extra = crc_extra.get(frame.message_id)
    if extra is None:
        return None, False
    body_end = len(data) - (_SIGNATURE_BYTES if frame.signed else 0) - 2
    is_whole = checksum(data[1:body_end], extra) == data[body_end : body_end + 2]
    return frame if is_whole else None, True


class Layout(NamedTuple):
    """A payload's fields in the order of the wire; `counts` are their numbers of elements, None without arrays.

    `texts` are those that are text, `extensions` what is sent in the fields that MAVLink appended where nobody says.
    """

    struct: struct.Struct
    names: tuple[str, ...]
    counts: tuple[int, ...] | None
    texts: tuple[str, ...]
    extensions: Mapping[str, Any]


def _layout(message: type[common.MAVLink_message]) -> Layout:
    names = tuple(message.ordered_fieldnames)
    texts = tuple(name for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True) if kind == "char")
    counts = tuple(1 if name in texts else count for name, count in zip(names, message.lengths, strict=True))
    appended = message.__init__.__defaults__ or ()  # pymavlink's definitions mark them by nothing else
    extensions = dict(zip(message.fieldnames[-len(appended) :], appended, strict=True)) if appended else {}
    return Layout(message.unpacker, names, counts if max(counts) > 1 else None, texts, extensions)


LAYOUTS: Final = {number: _layout(message) for number, message in common.mavlink_map.items()}


def fields_of(frame: Frame) -> dict[str, Any]:
    """The fields of a frame of this dialect, by name: numbers, lists of numbers, text up to its first zero.

    Zeros that were cut off the payload's end are there again; what a later dialect appends is left out. PARAM_VALUE's
    float is there once more as the integer in its bytes, `param_integer`: as a float a negative one is a NaN, which
    loses bits.
    """
    layout = LAYOUTS[frame.message_id]
    size = layout.struct.size
    start = 10 if frame.data[0] == MAGIC_V2 else 6
    payload = frame.data[start : start + min(size, frame.data[1])].ljust(size, b"\0")
    values = layout.struct.unpack(payload)
    if layout.counts is None:
        fields = dict(zip(layout.names, values, strict=True))
    else:
        fields, start = {}, 0
        for name, count in zip(layout.names, layout.counts, strict=True):
            fields[name] = values[start] if count == 1 else list(values[start : start + count])
            start += count
    for name in layout.texts:
        fields[name] = fields[name].partition(b"\0")[0].decode("ascii", errors="replace")
    if frame.message_id == _PARAM_VALUE:
        (fields["param_integer"],) = struct.unpack_from("<i", payload)
    return fields
