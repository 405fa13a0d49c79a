"""All protocols of one link, and which message goes to which."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sitl_mock.protocols.reply import Piece, Reply, addressed

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

MESSAGES: dict[str, tuple[str, ...]] = {
    "command": ("COMMAND_LONG", "COMMAND_INT"),
    "parameters": ("PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_SET"),
    "missions": (
        "MISSION_COUNT",
        "MISSION_ITEM",
        "MISSION_ITEM_INT",
        "MISSION_WRITE_PARTIAL_LIST",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "MISSION_CLEAR_ALL",
        "MISSION_ACK",
        "MISSION_SET_CURRENT",
    ),
    "streams": ("REQUEST_DATA_STREAM",),
    "time": ("TIMESYNC", "PING"),
    "home": ("SET_GPS_GLOBAL_ORIGIN", "SET_HOME_POSITION"),
    "ftp": ("FILE_TRANSFER_PROTOCOL",),
    "signing": ("SETUP_SIGNING",),
}
"""Which messages each protocol takes."""


class Session:
    """The protocols of one link.

    Args:
        system_id: Own system id.
        component_id: Own component id.
        pieces: Protocols by their name in ``MESSAGES``; those left out ignore their messages.

    Raises:
        KeyError: A name that is not in ``MESSAGES``.
    """

    def __init__(self, system_id: int, component_id: int, **pieces: Piece) -> None:
        self._ids = (system_id, component_id)
        self._pieces: tuple[Piece, ...] = tuple(pieces.values())
        self._by_message = {kind: piece for name, piece in pieces.items() for kind in MESSAGES[name]}

    def handle(self, now_s: float, message: Message) -> list[Reply] | None:
        """Take one message; None if it belongs to no protocol here, [] if it is for another vehicle."""
        piece = self._by_message.get(message.get_type())
        if piece is None:
            return None
        return piece.handle(now_s, message) if addressed(message, *self._ids) else []

    def advance(self, now_s: float) -> list[Reply]:
        """Return what is due by now from all protocols."""
        return [reply for piece in self._pieces for reply in piece.advance(now_s)]
