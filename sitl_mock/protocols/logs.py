"""LOG_REQUEST_LIST: the mock writes no flight log, and says so as an autopilot without one does.

Source: https://mavlink.io/en/messages/common.html#LOG_REQUEST_LIST; ArduCopter 4.5.7 before its first arming.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.reply import Reply

NO_LOG: Final[Reply] = ("LOG_ENTRY", 0, 0, 0, 0, 0)


class LogProtocol:
    """Flight logs on one link: none."""

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take LOG_REQUEST_LIST; requests for the data of a log that is not there are not answered."""
        return [NO_LOG] if message.get_type() == "LOG_REQUEST_LIST" else []
