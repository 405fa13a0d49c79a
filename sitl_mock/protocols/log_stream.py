"""A log streamed to a client: MAV_CMD_LOGGING_START and _STOP, LOGGING_DATA_ACKED, LOGGING_ACK and LOGGING_DATA.

The definitions at the beginning are sent one message at a time and again until the client acknowledges them; then data
is sent without. Source: PX4 1.17's ``mavlink_ulog.cpp``.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.logs import LogBook
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.session import Reply

_PIECE: Final = 249
"""Bytes in one message."""
NO_BEGINNING: Final = 255
"""first_message_offset of a piece in which no message of the log begins."""
_AGAIN_S: Final = 0.05
_MOST_TRIES: Final = 50


class LogStream:
    """The streamed log on one link.

    Args:
        book: The vehicle's logs; one stream at a time listens to them.
    """

    def __init__(self, book: LogBook) -> None:
        self._book = book
        self._target = (0, 0)
        self._sequence = 0
        self._head_pieces = 0
        self._buffer = bytearray()
        self._beginnings: deque[int] = deque()
        self._unanswered: Reply | None = None
        self._tries = 0
        self._sent_s = 0.0

    @property
    def is_idle(self) -> bool:
        """True unless this link's stream runs."""
        return self._book.listener != self._take

    def start(self, now_s: float, target: tuple[int, int], head: Sequence[bytes]) -> list[Reply]:
        """Begin to stream to a client; `head` is the beginning of the log, message by message."""
        self._target = target
        self._sequence = 0
        self._buffer.clear()
        self._beginnings.clear()
        self._book.listener = self._take
        self._append(head)
        self._head_pieces = -(-len(self._buffer) // _PIECE)
        self._tries = 0
        return self._reliable(now_s)

    def stop(self) -> None:
        """End the stream."""
        self._book.listener = None
        self._unanswered = None

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take LOGGING_ACK: the next piece of the definitions follows."""
        if self._unanswered is None or message.sequence != self._unanswered[3]:
            return []
        self._unanswered = None
        self._tries = 0
        return self._reliable(now_s) if self._head_pieces else []

    def advance(self, now_s: float) -> list[Reply]:
        """Return what is due: an unanswered piece again, or the data since the last call."""
        if self.is_idle:
            return []
        if self._unanswered is not None:
            # What is not acknowledged is sent again, some times.
            if now_s - self._sent_s < _AGAIN_S:
                return []
            self._tries += 1
            self._sent_s = now_s
            if self._tries >= _MOST_TRIES:
                self.stop()
                return []
            return [self._unanswered]
        replies = []
        while len(self._buffer) >= _PIECE:
            replies.append(self._piece("LOGGING_DATA", _PIECE))
        return replies

    def _take(self, messages: Sequence[bytes]) -> None:
        """Take messages of the log; those before the client has the definitions are dropped."""
        if not self._head_pieces and self._unanswered is None:
            self._append(messages)

    def _append(self, messages: Sequence[bytes]) -> None:
        for message in messages:
            self._beginnings.append(len(self._buffer))
            self._buffer += message

    def _reliable(self, now_s: float) -> list[Reply]:
        self._head_pieces -= 1
        self._sent_s = now_s
        self._unanswered = self._piece("LOGGING_DATA_ACKED", min(_PIECE, len(self._buffer)))
        return [self._unanswered]

    def _piece(self, name: str, size: int) -> Reply:
        data = bytes(self._buffer[:size])
        del self._buffer[:size]
        first = NO_BEGINNING
        if self._beginnings and self._beginnings[0] < size:
            first = self._beginnings[0]
        while self._beginnings and self._beginnings[0] < size:
            self._beginnings.popleft()
        self._beginnings = deque(place - size for place in self._beginnings)
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFFFF
        padded = data.ljust(_PIECE, b"\0")
        return (name, *self._target, sequence, size, first, padded)
