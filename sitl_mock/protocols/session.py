"""The interface of protocols, and the session, which holds all protocols of one link.

A protocol has no I/O and no clock. ``handle(now_s, message)`` takes a decoded message and returns replies;
``advance(now_s)``, called in every cycle, returns delayed ones. Each link has its own protocol objects (transfers,
pacing and rates belong to a link); they share the vehicle's stores. A session passes each message to its protocol.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

Reply = tuple[Any, ...]
"""Name of the message, then every field in the order of declaration: ``encoder.pack(*reply)``."""

ALL_COMPONENTS: Final = 0


class Piece(Protocol):
    """One protocol on one link."""

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take a message for this vehicle and return the immediate replies."""
        ...


@runtime_checkable
class LatePiece(Piece, Protocol):
    """One protocol on one link that also sends delayed messages."""

    @property
    def is_idle(self) -> bool:
        """True if it has nothing to send before it takes another message."""
        ...

    def advance(self, now_s: float) -> list[Reply]:
        """Return the messages that are due: delayed answers, paced lists, repeated requests."""
        ...


def addressed(message: Message, system_id: int, component_id: int) -> bool:
    """True if a message is for this component: its ids, broadcast, or a message without target."""
    target_system = getattr(message, "target_system", 0)
    if target_system and target_system != system_id:
        return False
    target_component = getattr(message, "target_component", ALL_COMPONENTS)
    return not target_component or target_component == component_id


def source_of(message: Message) -> tuple[int, int]:
    """Return the sender's (system id, component id)."""
    return message.get_srcSystem(), message.get_srcComponent()


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
    "logs": ("LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"),
    "log_stream": ("LOGGING_ACK",),
    "shell": ("SERIAL_CONTROL",),
    "signing": ("SETUP_SIGNING",),
    "events": ("REQUEST_EVENT",),
}
"""Messages handled by each protocol."""

PX4_OWN_ID_ONLY: frozenset[str] = frozenset({"parameters", "missions", "ftp"})
"""Protocols of PX4 that ignore messages to system 0."""


class Session:
    """The protocols of one link.

    Args:
        system_id: Own system id.
        component_id: Own component id.
        own_id_only: Protocols, by name, that ignore messages to system 0.
        pieces: Protocols by their name in ``MESSAGES``; those left out ignore their messages.

    Attributes:
        is_idle: No protocol has anything to send before the next message.

    Raises:
        KeyError: A name that is not in ``MESSAGES``.
    """

    def __init__(
        self,
        system_id: int,
        component_id: int,
        *,
        own_id_only: frozenset[str] = frozenset(),
        **pieces: Piece,
    ) -> None:
        self._ids = (system_id, component_id)
        self._own_id_only = frozenset[str]().union(*(MESSAGES[name] for name in own_id_only))
        self._late = [piece for piece in pieces.values() if isinstance(piece, LatePiece)]
        self.is_idle = False
        self._by_message: dict[str, Piece] = {}
        for name, piece in pieces.items():
            self._by_message |= dict.fromkeys(MESSAGES[name], piece)

    def handle(self, now_s: float, message: Message) -> list[Reply] | None:
        """Take one message; None if no protocol handles it, [] if it is for another vehicle."""
        kind = message.get_type()
        piece = self._by_message.get(kind)
        if piece is None:
            return None
        if not addressed(message, *self._ids) or (
            kind in self._own_id_only and message.target_system == 0
        ):
            return []
        self.is_idle = False
        return piece.handle(now_s, message)

    def advance(self, now_s: float) -> list[Reply]:
        """Return the messages that are due from all protocols."""
        replies: list[Reply] = []
        if self.is_idle:
            return replies
        for piece in self._late:
            replies += piece.advance(now_s)
        self.is_idle = all(piece.is_idle for piece in self._late)
        return replies
