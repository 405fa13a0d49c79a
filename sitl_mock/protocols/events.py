"""The events protocol: EVENT as things happen, and again when a client asks for those it missed.

Source: https://mavlink.io/en/services/events.html. CURRENT_EVENT_SEQUENCE, by which clients notice gaps, is a stream.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.reply import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

KEPT: Final = 20
_UNAVAILABLE: Final = 0
_WRAP: Final = 0x10000


class EventLog:
    """The last events of one vehicle.

    Attributes:
        latest: Sequence number of the last event.
    """

    def __init__(self) -> None:
        self.latest = _WRAP - 1
        self._kept: deque[Reply] = deque(maxlen=KEPT)

    def __len__(self) -> int:
        return len(self._kept)

    def add(self, boot_ms: int, event_id: int, levels: int, arguments: bytes) -> Reply:
        """Number an event and keep it; return its message."""
        self.latest = (self.latest + 1) % _WRAP
        reply = ("EVENT", 0, 0, event_id, boot_ms, self.latest, levels, arguments)
        self._kept.append(reply)
        return reply

    def find(self, sequence: int) -> Reply | None:
        """Return an event that is still kept."""
        return next((reply for reply in self._kept if reply[5] == sequence), None)

    @property
    def oldest(self) -> int:
        """Sequence number of the oldest event kept."""
        return int(self._kept[0][5]) if self._kept else self.latest


class EventProtocol:
    """REQUEST_EVENT on one link."""

    def __init__(self, log: EventLog) -> None:
        self._log = log

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Send what is asked for again; of the first that is gone, say so and which is the oldest."""
        count = (message.last_sequence - message.first_sequence) % _WRAP + 1
        replies: list[Reply] = []
        for offset in range(min(count, KEPT)):
            sequence = (message.first_sequence + offset) % _WRAP
            kept = self._log.find(sequence)
            gone = ("RESPONSE_EVENT_ERROR", *source_of(message), sequence, self._log.oldest, _UNAVAILABLE)
            replies.append(gone if kept is None else kept)
        return replies
