"""What protocol pieces take and give: decoded messages in, plain tuples out.

A piece knows no link and no clock. It is asked with ``handle(now_s, message)`` when a message has come and, if it has
something to say later, with ``advance(now_s)`` once in every cycle. It answers with replies for the link that it
serves. Each link has pieces of its own (transfers, pacing and rates belong to a link); what belongs to the vehicle is
in the stores they share.
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
        """Take a message meant for this vehicle and return what is to be sent at once."""
        ...


@runtime_checkable
class LatePiece(Piece, Protocol):
    """One protocol on one link that also speaks without being asked at that moment."""

    def advance(self, now_s: float) -> list[Reply]:
        """Return what is due by now: late answers, paced lists, re-requests."""
        ...


def addressed(message: Message, system_id: int, component_id: int) -> bool:
    """Whether a message is meant for this component: by its own ids, by broadcast, or for want of a target field."""
    target_system = getattr(message, "target_system", 0)
    if target_system not in {0, system_id}:
        return False
    return getattr(message, "target_component", ALL_COMPONENTS) in {ALL_COMPONENTS, component_id}


def source_of(message: Message) -> tuple[int, int]:
    """Return the sender's (system id, component id)."""
    return message.get_srcSystem(), message.get_srcComponent()
