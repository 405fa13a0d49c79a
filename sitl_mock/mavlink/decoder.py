"""Decode MAVLink 1 and 2; invalid bytes are counted and dropped, without exceptions.

After an invalid frame the search continues one byte after its magic, so that a good frame inside a false start is still
found; bytes of the invalid frame are not counted twice. The buffer holds at most one unfinished frame.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from sitl_mock.mavlink.dialect import SPEC_BY_ID
from sitl_mock.mavlink.message import Message
from sitl_mock.mavlink.signing import BLOCK_LENGTH, Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.mavlink.dialect import MessageSpec
    from sitl_mock.mavlink.signing import Signing

_HEAD: Final = struct.Struct("<BBB4xHB").unpack_from
"""Magic, length and incompatibility flags of a MAVLink 2 frame, and the id of its message."""
_MAGIC: Final = re.compile(rb"[\xfd\xfe]")
_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_SIGNED: Final = 0x01
_HEADER_V2: Final = 10
_HEADER_V1: Final = 6
MAX_FRAME: Final = _HEADER_V2 + 255 + 2 + BLOCK_LENGTH


@dataclass(slots=True)
class Counts:
    """Counts of a decoder.

    Attributes:
        frames: Valid frames.
        garbage_bytes: Bytes before a magic byte.
        crc: Frames whose CRC does not match.
        length: MAVLink 1 frames longer than their message.
        incompatible: MAVLink 2 frames with an unknown incompatibility flag.
        unknown_id: Frames whose message id is not in the dialect.
        truncated: Frames cut off by the end of a datagram.
        unsigned: Frames without the required signature.
        wrong_key: Signatures that do not match the key.
        replayed: Timestamps that do not rise.
        too_many_streams: Signed streams beyond the table's size.
    """

    frames: int = 0
    garbage_bytes: int = 0
    crc: int = 0
    length: int = 0
    incompatible: int = 0
    unknown_id: int = 0
    truncated: int = 0
    unsigned: int = 0
    wrong_key: int = 0
    replayed: int = 0
    too_many_streams: int = 0

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def add(self, kind: str) -> None:
        """Count one frame of a kind (one of the names above)."""
        setattr(self, kind, getattr(self, kind) + 1)


class _Frame(NamedTuple):
    """The extent and head of one candidate frame."""

    end: int
    header_end: int
    payload_end: int
    signed: bool
    sequence: int
    system: int
    component: int
    message_id: int
    incompat: int


class Decoder:
    """One receiving side of one link.

    Args:
        signing: The vehicle's signing, which judges every frame.
        is_trusted: Frames that it refuses are taken too.
    """

    __slots__ = ("_is_trusted", "_reject_end", "_rest", "counts", "signing")

    def __init__(self, *, signing: Signing | None = None, is_trusted: bool = False) -> None:
        self.signing = signing
        self._is_trusted = is_trusted
        self.counts = Counts()
        self._rest = b""
        self._reject_end = 0  # end of the last counted invalid frame in the present data

    @property
    def pending(self) -> int:
        """Bytes of an unfinished frame held back; never more than one frame."""
        return len(self._rest)

    def feed(self, data: bytes | bytearray | memoryview, *, whole: bool = False) -> list[Message]:
        """Take bytes and return the messages completed by them.

        Args:
            data: Any bytes.
            whole: The data end a datagram or a sample: an unfinished frame is counted as truncated and dropped
                instead of being held back for the next call.
        """
        if whole and not self._rest:
            message = self._usual(bytes(data))
            if message is not None:
                return [message]
        buffer = self._rest + bytes(data) if self._rest else bytes(data)
        size = len(buffer)
        messages: list[Message] = []
        at = 0
        while at < size:
            if buffer[at] not in {0xFD, 0xFE}:
                magic = _MAGIC.search(buffer, at)
                end = magic.start() if magic else len(buffer)
                self.counts.garbage_bytes += max(0, end - max(at, self._reject_end))
                at = end
                continue
            frame = _frame_at(buffer, at, size)
            if frame is None:
                if not whole:
                    break
                self._fail("truncated", at, size)
                at += 1
                continue
            outcome = self._judge(buffer, at, frame)
            if isinstance(outcome, str):
                self._fail(outcome, at, frame.end)
                at = at + 1 if outcome in _RESCAN else frame.end
                continue
            messages.append(outcome)
            self.counts.frames += 1
            at = frame.end
        self._rest = buffer[at:]
        self._reject_end = max(0, self._reject_end - at)
        return messages

    def _usual(self, data: bytes) -> Message | None:
        """Fast path: the message of one valid unsigned MAVLink 2 frame while no key is set, otherwise None."""
        size = len(data)
        signing = self.signing
        if size < _HEADER_V2 + 2 or (signing is not None and signing.secret_key is not None):
            return None
        magic, held, incompatible, low, high = _HEAD(data)
        spec = SPEC_BY_ID.get(low | high << 16)
        if magic != _MAGIC_V2 or held + _HEADER_V2 + 2 != size or incompatible or spec is None:
            return None
        if mcrf4xx(data[1:-2] + spec.crc_extra) != data[-2] | data[-1] << 8:
            return None
        self.counts.frames += 1
        values = _values(spec, data[_HEADER_V2:-2])
        return Message(spec, values, data)

    def _fail(self, kind: str, at: int, end: int) -> None:
        if at >= self._reject_end:
            self.counts.add(kind)
            self._reject_end = end

    def _judge(self, buffer: bytes, at: int, frame: _Frame) -> Message | str:
        """Return the message, or the name of the count for the fault."""
        if frame.incompat & ~_SIGNED:
            return "incompatible"
        spec = SPEC_BY_ID.get(frame.message_id)
        if spec is None:
            return "unknown_id"
        crc = buffer[frame.payload_end] | buffer[frame.payload_end + 1] << 8
        if mcrf4xx(buffer[at + 1 : frame.payload_end] + spec.crc_extra) != crc:
            return "crc"
        if buffer[at] == _MAGIC_V1 and frame.payload_end - frame.header_end > spec.size:
            return "length"
        verdict = Verdict.UNCHECKED
        signing = self.signing
        if signing is not None and signing.secret_key is not None:
            verdict = signing.check(
                buffer[at : frame.end],
                signed=frame.signed,
                system=frame.system,
                component=frame.component,
                message_id=frame.message_id,
            )
            if not (verdict.accepted or self._is_trusted):
                return verdict.value
        return Message(
            spec,
            _values(spec, buffer[frame.header_end : frame.payload_end]),
            buffer[at : frame.end],
            signed=verdict is Verdict.GOOD,
        )


_RESCAN: Final = frozenset({"incompatible", "unknown_id", "crc"})
"""Faults after which the frame's length is unreliable."""


def _frame_at(buffer: bytes, at: int, size: int) -> _Frame | None:
    """Return the frame that starts at a magic byte, or None while it is incomplete."""
    if buffer[at] == _MAGIC_V1:
        if size - at < _HEADER_V1:
            return None
        payload_end = at + _HEADER_V1 + buffer[at + 1]
        end = payload_end + 2
        if end > size:
            return None
        return _Frame(
            end,
            at + _HEADER_V1,
            payload_end,
            False,
            buffer[at + 2],
            buffer[at + 3],
            buffer[at + 4],
            buffer[at + 5],
            0,
        )
    if size - at < _HEADER_V2:
        return None
    incompat = buffer[at + 2]
    payload_end = at + _HEADER_V2 + buffer[at + 1]
    end = payload_end + 2 + (BLOCK_LENGTH if incompat & _SIGNED else 0)
    if end > size:
        return None
    message_id = buffer[at + 7] | buffer[at + 8] << 8 | buffer[at + 9] << 16
    return _Frame(
        end,
        at + _HEADER_V2,
        payload_end,
        bool(incompat & _SIGNED),
        buffer[at + 4],
        buffer[at + 5],
        buffer[at + 6],
        message_id,
        incompat,
    )


def _values(spec: MessageSpec, payload: bytes) -> Sequence[Any]:
    """Return the fields of a payload that may be shorter or longer than the message."""
    size = spec.size
    held = len(payload)
    if held == size:
        return spec.unpack_payload(payload)
    if held < size:
        return spec.unpack_payload(payload.ljust(size, b"\0"))
    return spec.unpack_payload(payload[:size])
