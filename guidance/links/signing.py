"""MAVLink 2 signing: the key, and the clock that keeps old frames from being replayed."""

import re
from dataclasses import dataclass
from typing import Final, Protocol

from guidance.errors import ConfigError

KEY_BYTES: Final = 32
_EPOCH_UNIX_S: Final = 1_420_070_400.0  # signing counts from 1 January 2015 UTC
_TICKS_PER_S: Final = 1e5  # in 10 microseconds


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The shared secret. With a key every frame we send is signed, and every frame that is not is refused."""

    secret: bytes
    link_id: int = 0

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            ConfigError: If the secret is not 32 bytes or the link id does not fit a byte.
        """
        if len(self.secret) != KEY_BYTES:
            raise ConfigError(f"signing key of {len(self.secret)} bytes: {KEY_BYTES} are needed")
        if not 0 <= self.link_id <= 255:
            raise ConfigError(f"signing link_id = {self.link_id}: 0 to 255 are allowed")

    def __repr__(self) -> str:
        """Never show the secret in a log."""
        return f"SigningKey(link_id={self.link_id})"

    @classmethod
    def from_hex(cls, text: str, *, link_id: int = 0) -> "SigningKey":
        """Read 64 hexadecimal digits.

        Raises:
            ConfigError: If they are not; the text is not repeated, for it may be a secret.
        """
        digits = text.strip()
        if re.fullmatch(r"[0-9a-fA-F]{64}", digits) is None:
            raise ConfigError(f"signing key: 64 hexadecimal digits are wanted, got {len(digits)} characters")
        return cls(bytes.fromhex(digits), link_id)


class SigningState(Protocol):
    """What pymavlink's MAVLinkSigning holds."""

    secret_key: bytes | None
    link_id: int
    timestamp: int
    sign_outgoing: bool


class SigningCodec(Protocol):
    """A pymavlink codec, as far as signing goes."""

    signing: SigningState


def ticks(unix_s: float) -> int:
    """Calendar time in signing's units."""
    return int((unix_s - _EPOCH_UNIX_S) * _TICKS_PER_S)


def arm(mavlink: SigningCodec, key: SigningKey, unix_s: float) -> None:
    """Make a pymavlink codec sign all it packs and refuse all that is unsigned."""
    mavlink.signing.secret_key = key.secret
    mavlink.signing.link_id = key.link_id
    mavlink.signing.timestamp = max(mavlink.signing.timestamp, ticks(unix_s))
    mavlink.signing.sign_outgoing = True
