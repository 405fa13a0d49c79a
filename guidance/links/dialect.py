"""MAVLink's common messages as pymavlink defines them: payloads to fields, fields to frames.

Reading is done from the definitions' own tables, since a whole pymavlink message costs five times as much and a link
hears hundreds a second; writing is pymavlink's.
"""

import struct
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common

from guidance.links.arrivals import Clock
from guidance.links.framing import MAGIC_V2, Frame, checksum
from guidance.links.signing import Signatures, SigningKey, ticks

CRC_EXTRA: Final = {number: message.crc_extra for number, message in common.mavlink_map.items()}
NAMES: Final = {number: message.msgname for number, message in common.mavlink_map.items()}
IDS: Final = {name: number for number, name in NAMES.items()}
_PARAM_VALUE: Final = IDS["PARAM_VALUE"]


class _Layout(NamedTuple):
    """A payload's fields in the order of the wire; `counts` are their numbers of elements, None without arrays."""

    struct: struct.Struct
    names: tuple[str, ...]
    counts: tuple[int, ...] | None
    texts: tuple[str, ...]


def _layout(message: type[common.MAVLink_message]) -> _Layout:
    names = tuple(message.ordered_fieldnames)
    texts = tuple(name for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True) if kind == "char")
    counts = tuple(1 if name in texts else count for name, count in zip(names, message.lengths, strict=True))
    return _Layout(message.unpacker, names, counts if max(counts) > 1 else None, texts)


_LAYOUTS: Final = {number: _layout(message) for number, message in common.mavlink_map.items()}


def fields_of(frame: Frame) -> dict[str, Any]:
    """The fields of a frame of this dialect, by name: numbers, lists of numbers, text up to its first zero.

    Zeros that were cut off the payload's end are there again; what a later dialect appends is left out. PARAM_VALUE's
    float is there once more as the integer in its bytes, `param_integer`: as a float a negative one is a NaN, which
    loses bits.
    """
    layout = _LAYOUTS[frame.message_id]
    size = layout.struct.size
    payload = frame.payload[:size].ljust(size, b"\0")
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


class Station:
    """One sender of frames: they are numbered and, with a key, signed; then what others say is believed only signed."""

    def __init__(
        self,
        system_id: int,
        component_id: int,
        *,
        signing_key: SigningKey | None = None,
        clock: Clock = lambda: 0.0,
        unix_s: float = 0.0,
    ) -> None:
        """Start at sequence number 0. `clock` and `unix_s`, the calendar's time now, are needed for signing only."""
        self._mavlink = common.MAVLink(None, system_id, component_id)
        self._signatures = None if signing_key is None else Signatures(signing_key, unix_s)
        if signing_key is not None:
            self._mavlink.signing.secret_key = signing_key.secret
            self._mavlink.signing.link_id = signing_key.link_id
            self._mavlink.signing.sign_outgoing = True
        self._clock = clock
        self._unix_offset_s = unix_s - clock()

    def pack(self, name: str, fields: Mapping[str, Any]) -> bytes:
        """The next frame."""
        packed = {key: value.encode() if isinstance(value, str) else value for key, value in fields.items()}
        if self._signatures is not None:
            signing = self._mavlink.signing  # counts on by itself with every frame
            now_ticks = ticks(self._unix_offset_s + self._clock())
            self._signatures.time = signing.timestamp = max(signing.timestamp, self._signatures.time, now_ticks)
        frame = bytes(common.mavlink_map[IDS[name]](**packed).pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame

    def renumber(self, frame: Frame) -> bytes:
        """Another sender's frame of the same address, numbered as our next: who hears both counts none as lost."""
        data = bytearray(frame.data)
        data[4 if data[0] == MAGIC_V2 else 2] = self._mavlink.seq
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        data[-2:] = checksum(data[1:-2], CRC_EXTRA[frame.message_id])
        return bytes(data)

    def doubts(self, frame: Frame) -> str | None:
        """Why a frame is not believed: "unsigned", or "refused" for a wrong or an old signature; None if it is."""
        if self._signatures is None:
            return None
        if not frame.signed:
            return "unsigned"
        return None if self._signatures.believes(frame) else "refused"
