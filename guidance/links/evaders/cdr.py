"""A reader of CDR (OMG DDS-RTPS 2.x, plain CDR version 1) for the few types needed; every access is checked.

Four bytes of encapsulation header, then values aligned to their own size, counted from after the header.
"""

import struct
from typing import Final

from guidance.links.evaders.refusal import Refused

_ORDERS: Final = {b"\x00\x00": ">", b"\x00\x01": "<"}  # CDR_BE, CDR_LE
LONGEST_STRING: Final = 256


class CdrReader:
    """Reads values one after another.

    Raises:
        Refused: From every method, if the bytes end early or are not plain CDR.
    """

    def __init__(self, data: bytes) -> None:
        order = _ORDERS.get(data[:2])
        if order is None or len(data) < 4:
            raise Refused("encoding")
        self._order = order
        self._body = data[4:]
        self._at = 0

    def _take(self, code: str, size: int, count: int = 1) -> tuple[float, ...]:
        start = -(-self._at // size) * size
        end = start + size * count
        if end > len(self._body):
            raise Refused("length")
        self._at = end
        values: tuple[float, ...] = struct.unpack_from(f"{self._order}{count}{code}", self._body, start)
        return values

    def int32(self) -> int:
        """A signed 32 bit integer."""
        return int(self._take("i", 4)[0])

    def uint32(self) -> int:
        """An unsigned 32 bit integer."""
        return int(self._take("I", 4)[0])

    def float64(self, count: int) -> tuple[float, ...]:
        """A fixed number of doubles, without a length before them."""
        return self._take("d", 8, count)

    def string(self) -> str:
        """A string: length with the closing zero, then the bytes."""
        length = self.uint32()
        if not 1 <= length <= LONGEST_STRING or self._at + length > len(self._body):
            raise Refused("length")
        raw = self._body[self._at : self._at + length]
        self._at += length
        if raw[-1] != 0:
            raise Refused("encoding")
        return raw[:-1].decode(errors="replace")
