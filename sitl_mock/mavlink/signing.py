"""MAVLink 2 message signing: 13 bytes at the end of a frame.

The block is link id (1), timestamp (6, units of 10 µs since 2015-01-01 UTC) and the first 6 bytes of
SHA-256(secret key + frame up to and including the timestamp). A receiver keeps the last timestamp of every stream
(link id, system, component) and refuses timestamps that do not increase. Source: https://mavlink.io/en/guide/message_signing.html
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

BLOCK_LENGTH: Final = 13
KEY_LENGTH: Final = 32
EPOCH_2015_UNIX_S: Final = 1_420_070_400.0
UNITS_PER_S: Final = 100_000
LAST_TIMESTAMP: Final = 2**48 - 1
NEW_STREAM_WINDOW: Final = 60 * UNITS_PER_S  # a new stream may start at most a minute behind
MAX_STREAMS: Final = (
    16  # MAVLINK_MAX_SIGNING_STREAMS of the C library: a flood of ids cannot grow the table
)
# RADIO_STATUS comes from the radio itself, which has no key
UNSIGNED_ALWAYS: Final = frozenset({109})


class Verdict(StrEnum):
    """Result of checking one frame."""

    GOOD = "good"
    UNCHECKED = "unchecked"
    UNSIGNED = "unsigned"
    WRONG_KEY = "wrong_key"
    REPLAYED = "replayed"
    TOO_MANY_STREAMS = "too_many_streams"

    @property
    def accepted(self) -> bool:
        """True if the frame is accepted."""
        return self in {Verdict.GOOD, Verdict.UNCHECKED}


@dataclass(slots=True)
class Signing:
    """Key, clock and streams of one system; shared by all its links.

    Attributes:
        secret_key: 32 bytes, or None: sign nothing and let every frame pass unchecked.
        require: With a key, refuse unsigned frames (RADIO_STATUS excepted). Without, they pass; a frame that claims
            a signature is checked either way.
        timestamp: Own clock in units of 10 µs since 2015-01-01; rises by one with each signed frame.
        streams: Last accepted timestamp of every (link id, system, component).
        trusted_links: Ids of own links that take every frame, unsigned or not.
    """

    secret_key: bytes | None = None
    require: bool = True
    timestamp: int = 0
    streams: dict[tuple[int, int, int], int] = field(default_factory=dict)
    trusted_links: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        """Check the key.

        Raises:
            ValueError: The key has not 32 bytes.
        """
        if self.secret_key is not None:
            self.set_key(self.secret_key)

    @property
    def active(self) -> bool:
        """True if outgoing frames are signed."""
        return self.secret_key is not None

    def set_key(self, secret_key: bytes | None, timestamp: int = 0) -> None:
        """Take a new key (None switches signing off) and forget the streams of the old one.

        Args:
            secret_key: 32 bytes or None.
            timestamp: Units of 10 µs since 2015-01-01; the clock never goes back.

        Raises:
            ValueError: The key has not 32 bytes.
        """
        if secret_key is not None and len(secret_key) != KEY_LENGTH:
            raise ValueError(
                f"signing key has {len(secret_key)} bytes; it needs exactly {KEY_LENGTH}"
            )
        self.secret_key = secret_key
        self.timestamp = max(self.timestamp, min(timestamp, LAST_TIMESTAMP))
        self.streams.clear()

    def advance_to(self, unix_s: float) -> None:
        """Raise the clock to a wall time, as an autopilot does when GPS or SYSTEM_TIME gives one."""
        self.timestamp = max(self.timestamp, int((unix_s - EPOCH_2015_UNIX_S) * UNITS_PER_S))

    def block(self, frame: bytes, link_id: int) -> bytes:
        """Return the 13 bytes to append to a frame that ends with its CRC, and move the clock on by one."""
        if self.secret_key is None:
            return b""
        self.timestamp = min(self.timestamp + 1, LAST_TIMESTAMP)
        head = bytes((link_id,)) + self.timestamp.to_bytes(6, "little")
        return head + _digest(self.secret_key, frame + head)

    def check(
        self, frame: bytes, *, signed: bool, system: int, component: int, message_id: int
    ) -> Verdict:
        """Judge one frame; only an accepted one moves the clock and the streams.

        Args:
            frame: From the magic byte to the end, with the block if there is one.
            signed: Whether the header says that there is one.
            system: System id of the sender.
            component: Component id of the sender.
            message_id: Message id.
        """
        if self.secret_key is None:
            return Verdict.UNCHECKED
        if not signed:
            return (
                Verdict.UNSIGNED
                if self.require and message_id not in UNSIGNED_ALWAYS
                else Verdict.UNCHECKED
            )
        if _digest(self.secret_key, frame[:-6]) != frame[-6:]:
            return Verdict.WRONG_KEY
        # The signature is right. A stream's timestamps have to rise, and a new stream may not begin long ago.
        stream = (frame[-13], system, component)
        timestamp = int.from_bytes(frame[-12:-6], "little")
        last = self.streams.get(stream)
        if last is None and len(self.streams) >= MAX_STREAMS:
            return Verdict.TOO_MANY_STREAMS
        if timestamp <= (self.timestamp - NEW_STREAM_WINDOW - 1 if last is None else last):
            return Verdict.REPLAYED
        self.streams[stream] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        return Verdict.GOOD


def _digest(secret_key: bytes, signed_part: bytes) -> bytes:
    return hashlib.sha256(secret_key + signed_part).digest()[:6]
