"""SETUP_SIGNING: a ground station gives the vehicle a key, or takes it away with a key of zeros.

Source: https://mavlink.io/en/guide/message_signing.html#secret_key. Once a key that is required is set, an unsigned
SETUP_SIGNING does not get past the decoder.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message, Signing
    from sitl_mock.protocols.reply import Reply


class SigningSetup:
    """Key setup on one link.

    Args:
        signing: The vehicle's signing, shared by its links.
        allowed: Whether this link may set the key; a vehicle takes it only over a link it trusts.
    """

    def __init__(self, signing: Signing, *, allowed: bool = True) -> None:
        self._signing = signing
        self._allowed = allowed

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take SETUP_SIGNING; it is never answered, so that the key cannot echo."""
        if message.get_type() == "SETUP_SIGNING" and self._allowed and message.target_system != 0:
            key = bytes(message.secret_key)
            self._signing.set_key(key if any(key) else None, message.initial_timestamp)
        return []
