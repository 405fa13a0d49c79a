"""STATUSTEXT, in chunks if the text is long, and EVENT.

https://mavlink.io/en/messages/common.html#STATUSTEXT: the chunks of a text share an id that is not 0; the last one
contains a NUL, so it may be empty. https://mavlink.io/en/services/events.html: clients notice missed events through the
stream CURRENT_EVENT_SEQUENCE and request them again.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.session import Reply, source_of

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
        """Number an event and keep it; return its message.

        Args:
            boot_ms: Present time since boot.
            event_id: Id in the autopilot's metadata.
            levels: Log levels, inside and outside, four bits each.
            arguments: As on the wire.
        """
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
        """Send requested events again; for one that is gone, answer with an error and the oldest number."""
        count = (message.last_sequence - message.first_sequence) % _WRAP + 1
        replies: list[Reply] = []
        for offset in range(min(count, KEPT)):
            sequence = (message.first_sequence + offset) % _WRAP
            kept = self._log.find(sequence)
            gone = (
                "RESPONSE_EVENT_ERROR",
                *source_of(message),
                sequence,
                self._log.oldest,
                _UNAVAILABLE,
            )
            replies.append(gone if kept is None else kept)
        return replies


CHUNK: Final = 50
MAX_CHUNKS: Final = 256


class StatusTexts:
    """Texts of one vehicle; counts the ids of long ones."""

    def __init__(self) -> None:
        self._last_id = 0

    def replies(self, severity: int, text: str) -> list[Reply]:
        """Return the messages for one text.

        Args:
            severity: MAV_SEVERITY, 0 (emergency) to 7 (debug).
            text: Of any length; cut after 256 chunks.
        """
        encoded = text.encode()
        if len(encoded) <= CHUNK:
            return [("STATUSTEXT", severity, encoded, 0, 0)]
        self._last_id = self._last_id % 0xFFFF + 1
        encoded = encoded[: CHUNK * MAX_CHUNKS - 1]
        count = len(encoded) // CHUNK + 1
        return [
            (
                "STATUSTEXT",
                severity,
                encoded[index * CHUNK : (index + 1) * CHUNK],
                self._last_id,
                index,
            )
            for index in range(count)
        ]
