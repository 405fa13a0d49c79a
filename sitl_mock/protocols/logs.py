"""Flight logs on one link: LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END and LOG_ERASE.

Source: https://mavlink.io/en/messages/common.html#LOG_REQUEST_LIST, PX4 1.17's ``mavlink_log_handler.cpp``, ArduPilot
4.5's ``AP_Logger_MAVLinkLogTransfer.cpp``. The pieces of a log are sent in order, as many as a fast link takes;
a client requests missing ones again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.logs import LogBook
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.session import Reply

_PIECE: Final = 90
"""Bytes in one LOG_DATA."""
_PIECES: Final = 100
"""Messages in one cycle."""
_ERROR: Final = 3  # MAV_SEVERITY


@dataclass(frozen=True, slots=True)
class LogRules:
    """Rules of a flavour.

    Attributes:
        first_id: Id of the oldest log.
        list_first: Data is sent only after a list (PX4).
        whole_pieces: The last message of a requested part may go beyond it (PX4).
        says_none: Without a log, one entry tells so (ArduPilot); otherwise nothing is sent.
        disarmed_only: While armed, a text is the only answer (ArduPilot).
    """

    first_id: int
    list_first: bool
    whole_pieces: bool
    says_none: bool
    disarmed_only: bool


PX4_LOG_RULES: Final = LogRules(
    first_id=0, list_first=True, whole_pieces=True, says_none=False, disarmed_only=False
)
ARDUPILOT_LOG_RULES: Final = LogRules(
    first_id=1, list_first=False, whole_pieces=False, says_none=True, disarmed_only=True
)


@dataclass(slots=True)
class _Part:
    """The rest of a requested part of a log."""

    log_id: int
    content: bytes
    at: int
    end: int


class LogProtocol:
    """Flight logs on one link, over the vehicle's logs.

    Args:
        book: The vehicle's logs.
        rules: The flavour's rules.
        is_armed: Whether the vehicle is armed.
    """

    def __init__(
        self, book: LogBook, rules: LogRules, is_armed: Callable[[], bool] = lambda: False
    ) -> None:
        self._book = book
        self._rules = rules
        self._is_armed = is_armed
        self._listed = not rules.list_first
        self._announced = False
        self._part: _Part | None = None

    def handle(self, _now_s: float, message: Message) -> list[Reply]:
        """Take any message of the log protocol."""
        if self._rules.disarmed_only and self._is_armed():
            if self._announced:
                return []
            self._announced = True
            return [("STATUSTEXT", _ERROR, "Disarm for log download", 0, 0)]
        self._announced = False
        kind = message.get_type()
        if kind == "LOG_REQUEST_LIST":
            logs = self._book.logs
            first = self._rules.first_id
            self._listed = True
            if not logs:
                return [("LOG_ENTRY", 0, 0, 0, 0, 0)] if self._rules.says_none else []
            count = len(logs)
            last = min(message.end, count)
            return [
                ("LOG_ENTRY", log_id, count, last, int(log.changed_s), len(log.content))
                for log_id, log in enumerate(logs, start=first)
                if message.start <= log_id and (not first or log_id <= last)
            ]
        self._part = None
        replies: list[Reply] = []
        if kind == "LOG_ERASE":
            self._book.erase()
        elif kind == "LOG_REQUEST_DATA" and self._listed:
            log_id = message.id
            start = message.ofs
            logs = self._book.logs
            index = log_id - self._rules.first_id
            content = logs[index].content if 0 <= index < len(logs) else None
            whole = self._rules.whole_pieces
            if content is not None and start < len(content):
                end = min(start + message.count, len(content))
                upto = min(end + _PIECE, len(content)) if whole else end
                self._part = _Part(log_id, bytes(content[:upto]), start, end)
            elif content is not None and not whole:
                replies = [_piece(log_id, start, b"")]
        return replies

    @property
    def is_idle(self) -> bool:
        """True if no part of a log is being sent."""
        return self._part is None

    def advance(self, _now_s: float) -> list[Reply]:
        """Return the next messages of the requested part."""
        if self._part is None or (self._rules.disarmed_only and self._is_armed()):
            return []
        replies = []
        for _ in range(_PIECES):
            data = self._part.content[self._part.at : self._part.at + _PIECE]
            reply = _piece(self._part.log_id, self._part.at, data)
            self._part.at += len(data)
            replies.append(reply)
            if self._part.at >= self._part.end:
                self._part = None
                break
        return replies


def _piece(log_id: int, start: int, data: bytes) -> Reply:
    return ("LOG_DATA", log_id, start, len(data), data.ljust(_PIECE, b"\0"))
