"""Who speaks on a port that anybody may send to: one address for each MAVLink system, pinned while it is alive.

No checksum proves who sent a frame; signing does (`guidance.links.signing`). What is kept away here is everybody who
does not even speak as the system that is wanted, whoever takes its number while it lives, and bytes without end.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from typing import Final

from guidance.links.dialect import CRC_EXTRA
from guidance.links.framing import first_frame

Address = tuple[str, int]

SILENT_S: Final = 3.0
"""A system may speak from another address once it has been silent at its old one for this long."""

MOST_SYSTEMS: Final = 8
"""How many systems are pinned where any may speak."""

OTHERS_PER_S: Final = 50
"""Frames a second of other systems that get in, so that an error can name who is there instead."""


class Peers:
    """Judges every datagram by its address and its first frame. One cheap look each, whatever its length.

    Args:
        systems: MAVLink system ids that may become peers; None lets any, `MOST_SYSTEMS` at once.
    """

    def __init__(self, systems: Collection[int] | None = None) -> None:
        self._systems = None if systems is None else frozenset(systems)
        self._pinned: dict[int, Address] = {}
        self._heard_s: dict[Address, float] = {}
        self._second, self._others = -1, 0
        self.refused = Counter(garbage=0, impostor=0, stranger=0)

    def __iter__(self) -> Iterator[Address]:
        """Where to send: every peer once."""
        return iter(tuple(self._heard_s))

    def admit(self, now_s: float, address: Address, data: bytes) -> bytes:
        """Return what gets in of a datagram: all of a peer's, one frame of a stranger's now and then, else nothing."""
        if address in self._heard_s:
            self._heard_s[address] = now_s
            return data
        frame = first_frame(data, CRC_EXTRA)
        if frame is None:
            self.refused["garbage"] += 1
            return b""
        if not self._may_be_peer(frame.system_id, now_s):
            return self._other(now_s, frame.data)
        holder = self._pinned.get(frame.system_id)
        if holder is not None and now_s - self._heard_s[holder] < SILENT_S:
            self.refused["impostor"] += 1
            return b""
        self._pin(frame.system_id, address, now_s)
        return data

    def _may_be_peer(self, system_id: int, now_s: float) -> bool:
        if self._systems is not None:
            return system_id in self._systems
        if system_id in self._pinned or len(self._pinned) < MOST_SYSTEMS:
            return True
        longest_silent = min(self._pinned, key=lambda one: self._heard_s[self._pinned[one]])
        if now_s - self._heard_s[self._pinned[longest_silent]] < SILENT_S:
            return False
        self._unpin(longest_silent)
        return True

    def _pin(self, system_id: int, address: Address, now_s: float) -> None:
        if system_id in self._pinned:
            self._unpin(system_id)
        # Another thread may be sending to the peers: they are replaced, never changed in place.
        self._pinned = {**self._pinned, system_id: address}
        self._heard_s = {**self._heard_s, address: now_s}

    def _unpin(self, system_id: int) -> None:
        address = self._pinned[system_id]
        self._pinned = {one: place for one, place in self._pinned.items() if one != system_id}
        self._heard_s = {place: at for place, at in self._heard_s.items() if place != address}

    def _other(self, now_s: float, frame: bytes) -> bytes:
        if int(now_s) != self._second:
            self._second, self._others = int(now_s), 0
        self._others += 1
        if self._others > OTHERS_PER_S:
            self.refused["stranger"] += 1
            return b""
        return frame
