"""MAVLink 2 signing: the key, and the clock that keeps old frames from being replayed."""

import hashlib
import hmac
import re
from dataclasses import dataclass
from typing import Final

from guidance.errors import ConfigError
from guidance.links.framing import Frame

KEY_BYTES: Final = 32
_EPOCH_UNIX_S: Final = 1_420_070_400.0  # signing counts from 1 January 2015 UTC
_TICKS_PER_S: Final = 1e5  # in 10 microseconds
_NEW_STREAM_TICKS: Final = 60 * 100_000


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


def ticks(unix_s: float) -> int:
    """Calendar time in signing's units."""
    return int((unix_s - _EPOCH_UNIX_S) * _TICKS_PER_S)


class Signatures:
    """Signs frames, each later than the last, and says whose are believed: each later than the last of its stream.

    A stream is a link id, system and component; a new one may be a minute behind our own time at most. A frame whose
    signature is wrong changes nothing, so that a forger cannot make the genuine ones look old.
    Source: mavlink.io/en/guide/message_signing.html.
    """

    def __init__(self, key: SigningKey, unix_s: float) -> None:
        self._key = key
        self._last: dict[tuple[int, int, int], int] = {}
        self.time = ticks(unix_s)
        """Ours, or the latest that was believed."""

    def sign(self, frame: bytes, now: int) -> bytes:
        """What goes behind a frame: link id, time and signature. Its time is counted on, should the clock stand still.

        Args:
            frame: From its start mark to its checksum.
            now: The calendar's time, in `ticks`.
        """
        self.time = max(self.time, now)
        stamp = bytes((self._key.link_id,)) + self.time.to_bytes(6, "little")
        self.time += 1
        return stamp + hashlib.sha256(self._key.secret + frame + stamp).digest()[:6]

    def believes(self, frame: Frame) -> bool:
        """Whether a signed frame is genuine and new; then its time is remembered."""
        link_id, time = frame.data[-13], int.from_bytes(frame.data[-12:-6], "little")
        stream = link_id, frame.system_id, frame.component_id
        last = self._last.get(stream, self.time - _NEW_STREAM_TICKS - 1)
        signature = hashlib.sha256(self._key.secret + frame.data[:-6]).digest()[:6]
        if time <= last or not hmac.compare_digest(signature, frame.data[-6:]):
            return False
        self._last[stream] = time
        self.time = max(self.time, time)
        return True
