"""STATUSTEXT, in chunks where the text is longer than one message.

Source: https://mavlink.io/en/messages/common.html#STATUSTEXT: the chunks of a text share an id that is not 0, and the
last one is the one with a NUL, which may have to be an empty chunk.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sitl_mock.protocols.reply import Reply

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
            text: Any length; what goes beyond 256 chunks is cut off.
        """
        encoded = text.encode()
        if len(encoded) <= CHUNK:
            return [("STATUSTEXT", severity, encoded, 0, 0)]
        self._last_id = self._last_id % 0xFFFF + 1
        encoded = encoded[: CHUNK * MAX_CHUNKS - 1]
        count = len(encoded) // CHUNK + 1
        return [
            ("STATUSTEXT", severity, encoded[index * CHUNK : (index + 1) * CHUNK], self._last_id, index)
            for index in range(count)
        ]
