"""Whole MAVLink frames out of bytes: the checksum is checked, garbage is skipped and counted.

Only the header is looked at here; decoding is left for the few frames that are wanted.
Source: MAVLink 2 serialisation (mavlink.io/en/guide/serialization.html).
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

from fastcrc import crc16

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_SHORTEST: Final = 8
_MOST_BUFFERED: Final = 8192


class Frame(NamedTuple):
    """One frame whose checksum is right."""

    data: bytes
    message_id: int
    system_id: int
    component_id: int
    signed: bool


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
        position = 0
        while len(buffer) - position >= _SHORTEST:
            length = _frame_length(buffer, position)
            if stream and len(buffer) - position < length:
                break
            frame = self._frame_at(position, length)
            if frame is None:
                position += 1
                self._pass_over(1)
            else:
                frames.append(frame)
                position += length
                self._unknown_left = 0
        del buffer[:position]
        self._forget(stream=stream)
        return frames

    def _frame_at(self, position: int, length: int) -> Frame | None:
        end = position + length
        if length == 0 or end > len(self._buffer):
            return None
        frame = _header(bytes(self._buffer[position:end]))
        extra = self._crc_extra.get(frame.message_id)
        if extra is None:
            if self._unknown_left == 0:
                self.unknown += 1
                self._unknown_left = length
            return None
        return frame if _is_whole(frame, extra) else None

    def _pass_over(self, count: int) -> None:
        unknown = min(count, self._unknown_left)
        self._unknown_left -= unknown
        self.garbage_bytes += count - unknown

    def _forget(self, *, stream: bool) -> None:
        excess = len(self._buffer) - (_MOST_BUFFERED if stream else 0)
        if excess > 0:
            self._pass_over(excess)
            del self._buffer[:excess]


def _is_whole(frame: Frame, extra: int) -> bool:
    body_end = len(frame.data) - (_SIGNATURE_BYTES if frame.signed else 0) - 2
    expected = crc16.mcrf4xx(frame.data[1:body_end] + bytes((extra,)))
    return expected == int.from_bytes(frame.data[body_end : body_end + 2], "little")


def _frame_length(buffer: bytearray, position: int) -> int:
    magic, payload = buffer[position], buffer[position + 1]
    if magic == MAGIC_V1:
        return 6 + payload + 2
    if magic != MAGIC_V2 or buffer[position + 2] & ~SIGNED:
        return 0
    return 10 + payload + 2 + (_SIGNATURE_BYTES if buffer[position + 2] & SIGNED else 0)


def _header(data: bytes) -> Frame:
    if data[0] == MAGIC_V1:
        return Frame(data, data[5], data[3], data[4], signed=False)
    message_id = int.from_bytes(data[7:10], "little")
    return Frame(data, message_id, data[5], data[6], signed=bool(data[2] & SIGNED))
