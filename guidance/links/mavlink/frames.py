"""MAVLink frames: found in bytes, checked, numbered and signed.

pymavlink defines and packs the messages. The search for frames is our own: after a false start mark pymavlink's stream
parser drops as many bytes as that mark announces, together with the valid frames among them. The search here is linear
in the number of bytes for any input.
Sources: MAVLink 2 serialisation (mavlink.io/en/guide/serialization.html) and signing
(mavlink.io/en/guide/message_signing.html).
"""

import functools
import hashlib
import hmac
import re
import struct
import time
from collections import namedtuple
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common

from guidance.errors import ConfigError
from guidance.links.mavlink.signed_streams import SignedStream, SignedStreams
from guidance.links.port import Clock, Wire

Fields = Any
"""The fields of a message, with MAVLink's names as attributes; `msgname` is its name."""

KNOWN: Final = frozenset(common.mavlink_map)
"""Ids of the messages in MAVLink's common dialect."""

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_SHORTEST: Final = 8
_HEADER_V2: Final = struct.Struct("<xBxxBBBHB")
"""Length, sequence number, system id, component id, and the message's number as 16 and 8 bits; flags are left out."""

_START: Final = re.compile(b"[\xfd\xfe]")
_MAX_BROKEN: Final = 128
"""The rest of a piece is skipped after this many frames with a wrong checksum."""

KEY_BYTES: Final = 32
_EPOCH_UNIX_S: Final = 1_420_070_400.0  # 1 January 2015 UTC
_TICKS_PER_S: Final = 1e5
_NEW_STREAM_TICKS: Final = 60 * 100_000


class Frame(NamedTuple):
    """One received message: its name, sender, sequence number, pymavlink's class of it, and bytes."""

    name: str
    system_id: int
    component_id: int
    sequence: int
    kind: Any
    data: bytes

    @property
    def fields(self) -> Fields:
        """Its fields, as pymavlink decodes them, in a fraction of the time. Decoded anew each time.

        Zeros at the end of a payload may be left out, and extensions that we do not know may follow it.
        """
        data = self.data
        kind = self.kind
        begin = 10 if data[0] == MAGIC_V2 else 6
        size = kind.unpacker.size
        payload = data[begin : begin + data[1]]
        values: Sequence[Any] = kind.unpacker.unpack(payload.ljust(size, b"\0")[:size])
        if len(values) > len(kind.lengths):  # the numbers of an array stand side by side
            rest = iter(values)
            values = [
                next(rest) if length == 1 else [*islice(rest, length)] for length in kind.lengths
            ]
        if "char" in kind.fieldtypes:
            values = [
                value.split(b"\0", 1)[0].decode("ascii", errors="replace")
                if isinstance(value, bytes)
                else value
                for value in values
            ]
        return _record_of(kind)(*values)


@functools.cache
def _record_of(kind: Any) -> Callable[..., Fields]:  # noqa: ANN401 - one of pymavlink's classes
    """Return the class that makes a tuple of a message's fields, in the order of its payload."""
    base = (namedtuple(kind.msgname, kind.ordered_fieldnames),)
    return type(kind.msgname, base, {"__slots__": (), "msgname": kind.msgname})


@functools.cache
def _crc_extra(dialect: ModuleType) -> dict[int, bytes]:
    return {number: bytes((one.crc_extra,)) for number, one in dialect.mavlink_map.items()}


class CheckedBytes(bytes):
    """Valid frames, each checked by a wire; `frames` lists them."""

    frames: Sequence[Frame]


class _Suspect(NamedTuple):
    """A possible beginning of a frame, and the counts before it."""

    position: int
    garbage_bytes: int
    unknown_left: int


class FrameReader:
    """Finds the frames of one sender in pieces of bytes, which may be cut anywhere. Never raises.

    A frame that is not complete waits for the next piece, whether pieces are datagrams or parts of a stream: bridges
    from a serial line to UDP cut datagrams anywhere. A beginning found among bytes
    that are no frame may be a false one, so it delays no whole frame behind it.

    The length of an unknown message cannot be checked. It is counted in `unknown`, and known frames are searched within
    it. All other bytes that belong to no frame are counted in `garbage_bytes`.

    Args:
        names: Messages that are returned; other valid frames are counted in `unused`. None returns all.
        dialect: The module of pymavlink that defines the messages.
    """

    def __init__(self, names: Collection[str] | None = None, dialect: ModuleType = common) -> None:
        self._known = dialect.mavlink_map
        self._used = names
        self._crc_extra = _crc_extra(dialect)
        self._buffer = bytearray()
        self._aligned = True
        self._unknown_left = 0
        self.garbage_bytes = self.unknown = self.unused = 0

    def read(self, data: bytes) -> list[Frame]:
        """Return the used frames that `data` completes."""
        frames = data.frames if isinstance(data, CheckedBytes) else self.split(data)
        if self._used is None:
            return [*frames]
        used = [frame for frame in frames if frame.name in self._used]
        self.unused += len(frames) - len(used)
        return used

    def split(self, data: bytes) -> list[Frame]:
        """Return the frames as `read` does, including the unused ones."""
        unknown_left = self._unknown_left
        begins = self.first(data)
        if begins is not None:
            if self._buffer:  # the waiting frame has lost its end
                self._unknown_left = unknown_left
                self._skip(len(self._buffer))
                self._buffer.clear()
                self._unknown_left = 0
                self._aligned = True
            if len(begins.data) == len(data):
                return [begins]  # usually a piece is one whole frame
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        position = 0
        broken = 0
        suspect: _Suspect | None = None
        while len(buffer) - position >= _SHORTEST:
            length = frame_length(buffer, position)
            end = position + length
            frame = None
            if end > len(buffer):
                if self._aligned:
                    break
                # Perhaps no frame: its beginning was found among other bytes
                if suspect is None:
                    suspect = _Suspect(position, self.garbage_bytes, self._unknown_left)
            elif length > 0:
                frame = self._checked(bytes(buffer[position:end]))
            if frame is None:
                broken += length > 0
                start = _START.search(buffer, position + 1) if broken <= _MAX_BROKEN else None
                end = len(buffer) if start is None else start.start()
                self._skip(end - position)
            else:
                frames.append(frame)
                suspect = None
            self._aligned = frame is not None
            position = end
        if suspect is not None:
            position, self.garbage_bytes, self._unknown_left = suspect
        del buffer[:position]
        self._aligned |= not buffer
        return frames

    def first(self, data: bytes) -> Frame | None:
        """Return the frame at the start of a datagram; None if there is none. What `read` has buffered is kept."""
        length = frame_length(data) if len(data) >= _SHORTEST else 0
        if not 0 < length <= len(data):
            return None
        return self._checked(data if length == len(data) else data[:length])

    def _checked(self, data: bytes) -> Frame | None:
        """Check one whole frame; None if its message is unknown or it is damaged."""
        if data[0] == MAGIC_V2:
            begin = 10
            size, sequence, system_id, component_id, low, high = _HEADER_V2.unpack_from(data)
            number = low | high << 16
        else:
            begin = 6
            _, size, sequence, system_id, component_id, number = data[:6]
        message = self._known.get(number)
        end = begin + size
        if message is None:
            if self._unknown_left == 0:
                self.unknown += 1
                self._unknown_left = len(data)
            return None
        checksum = data[end] | data[end + 1] << 8
        if crc16.mcrf4xx(data[1:end] + self._crc_extra[number]) != checksum:
            return None
        self._unknown_left = 0
        return Frame(message.msgname, system_id, component_id, sequence, message, data)

    def _skip(self, count: int) -> None:
        unknown = min(count, self._unknown_left)
        self._unknown_left -= unknown
        self.garbage_bytes += count - unknown


def frame_length(data: bytes | bytearray, start: int = 0) -> int:
    """Return the length that the header at `start` announces; 0 if no frame starts there. Needs three bytes."""
    magic = data[start]
    payload = data[start + 1]
    if magic == MAGIC_V1:
        return 6 + payload + 2
    if magic != MAGIC_V2 or data[start + 2] & ~SIGNED:
        return 0
    return 10 + payload + 2 + (_SIGNATURE_BYTES if data[start + 2] & SIGNED else 0)


def header_of(data: bytes) -> tuple[int, int] | None:
    """Return system id and message id from the header of a datagram, unchecked; None if no frame starts there."""
    if len(data) >= _SHORTEST and data[0] == MAGIC_V1:
        return data[3], data[5]
    if len(data) >= 10 and data[0] == MAGIC_V2:
        return (data[5], int.from_bytes(data[7:10], "little"))
    return None


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The shared secret. With a key we sign every frame that we send and refuse every frame without a signature.

    Args:
        secret: 32 bytes.
        unix_s: The Unix time of the first use; None reads it then.
        streams: Bounds on the timestamps of earlier runs; None for none.
    """

    secret: bytes = field(repr=False)
    unix_s: float | None = None
    streams: SignedStreams | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the size.

        Raises:
            ConfigError: If the secret is not 32 bytes long.
        """
        if len(self.secret) != KEY_BYTES:
            raise ConfigError(f"signing key: {len(self.secret)} bytes; it must have {KEY_BYTES}")

    @classmethod
    def from_hex(cls, text: str, streams: Path | None = None) -> "SigningKey":
        """Read 64 hexadecimal digits.

        Args:
            text: The digits.
            streams: Folder for the bounds on timestamps of this key; None remembers none.

        Raises:
            ConfigError: If the text is anything else. The message does not repeat it, because it may be a secret.
        """
        digits = text.strip()
        if re.fullmatch(r"[0-9a-fA-F]{64}", digits) is None:
            raise ConfigError(
                f"signing key: {len(digits)} characters; it must be 64 hexadecimal digits"
            )
        secret = bytes.fromhex(digits)
        if streams is None:
            return cls(secret)
        name = hashlib.sha256(b"streams" + secret).hexdigest()[:16]
        return cls(secret, streams=SignedStreams(streams / f"signed-{name}.json"))


def ticks(unix_s: float) -> int:
    """Convert Unix time to the timestamps of signing: units of 10 µs since 1 January 2015."""
    return int((unix_s - _EPOCH_UNIX_S) * _TICKS_PER_S)


class SignatureCheck:
    """Accepts a frame if its signature is right and its timestamp is later than the last one of its stream.

    A stream is a link id, system id and component id. The first frame of a stream that no earlier run has heard may be
    up to one minute older than our own time. Frames with a wrong signature change nothing. pymavlink's own check is not
    used: it remembers the timestamp before it verifies the signature, so one forged frame from the future makes it
    refuse all genuine ones.

    Args:
        key: The shared secret.
    """

    def __init__(self, key: SigningKey) -> None:
        self._secret = key.secret
        self._streams = key.streams
        self._last: dict[SignedStream, int] = {}
        if key.streams is not None:
            self._last.update(key.streams.at_start)
        self.latest = ticks(time.time_ns() / 1e9 if key.unix_s is None else key.unix_s)
        """Our time at the start, or the latest timestamp accepted since."""

    @property
    def unsaved(self) -> int:
        """Number of frames that were used although the disk keeps no bound for their timestamps."""
        return 0 if self._streams is None else self._streams.unsaved

    def problem(self, frame: Frame, *, remember: bool = True) -> str | None:
        """Return "unsigned", "refused" (wrong or old), "unsaved" (no bound on disk yet), or None if it is genuine.

        With `remember`, the timestamp of a genuine frame is kept, so a copy of the frame is old.
        """
        data = frame.data
        if data[0] != MAGIC_V2 or not data[2] & SIGNED:
            return "unsigned"
        sent_at = int.from_bytes(data[-12:-6], "little")
        stream = data[-13], frame.system_id, frame.component_id
        last = self._last.get(stream, self.latest - _NEW_STREAM_TICKS - 1)
        if sent_at <= last:
            return "refused"
        signature = hashlib.sha256(self._secret + data[:-6]).digest()[:6]
        if not hmac.compare_digest(signature, data[-6:]):
            return "refused"
        if self._streams is not None and not self._streams.may_use(stream, sent_at):
            return "unsaved"
        if remember:
            self._last[stream] = sent_at
            self.latest = max(self.latest, sent_at)
        return None


class Station:
    """One sender on a wire. It numbers its frames and, with a key, signs them and checks the signatures of others."""

    def __init__(
        self,
        wire: Wire,
        system_id: int,
        component_id: int,
        *,
        signing_key: SigningKey | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Start at sequence number 0. The clock is used for signing only."""
        self._wire = wire
        self._mavlink = common.MAVLink(None, system_id, component_id)
        self._clock: Clock = (lambda: 0.0) if clock is None else clock
        self._begun_s = self._clock()
        self.check: SignatureCheck | None = None
        """Checks the signatures of others; None without a key."""
        if signing_key is not None:
            self.check = SignatureCheck(signing_key)
            self._begun_ticks = self.check.latest
            signing = self._mavlink.signing
            signing.secret_key = signing_key.secret
            signing.sign_outgoing = True

    def send(self, message: Any) -> None:  # noqa: ANN401 - a message of pymavlink
        """Send a message of pymavlink as our next frame.

        Raises:
            struct.error: If a field does not fit; it is not sent and takes no number then.
        """
        if self.check is not None:
            signing = self._mavlink.signing
            now = self._begun_ticks + int((self._clock() - self._begun_s) * _TICKS_PER_S)
            signing.timestamp = max(signing.timestamp, self.check.latest, now)
        frame = bytes(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        self._wire.send(frame)
