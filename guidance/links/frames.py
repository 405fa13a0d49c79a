"""MAVLink frames: found in bytes, decoded, numbered, signed and checked.

pymavlink defines the messages. The search for frames, their decoding, packing and signatures are our own. pymavlink's
stream parser takes twice as long, and after a false start mark it drops as many bytes as that mark announces, together
with the valid frames among them. The search here is linear in the number of bytes for any input. Its decoder and its
packing take three times as long as ours.
Sources: MAVLink 2 serialisation (mavlink.io/en/guide/serialization.html) and signing
(mavlink.io/en/guide/message_signing.html).
"""

import hashlib
import hmac
import itertools
import re
import struct
from collections import namedtuple
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from operator import itemgetter
from types import ModuleType
from typing import Any, Final, NamedTuple

from fastcrc import crc16
from pymavlink.dialects.v20 import common

from guidance.errors import ConfigError
from guidance.links.port import Clock

Fields = Any
"""A named tuple of a message's fields, by MAVLink's names; text as str, arrays as tuples. Its type has the name."""

KNOWN: Final = frozenset(common.mavlink_map)
"""Ids of the messages in MAVLink's common dialect."""

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_SHORTEST: Final = 8
_BUFFER_BYTES: Final = 8192
_HEAD: Final = struct.Struct("<BBxBBB3s")
"""Behind the magic: payload length, incompatibility flags, compatibility flags, sequence, system, component, id."""

_START: Final = re.compile(b"[\xfd\xfe]")
_MAX_BROKEN: Final = 128
"""The rest of a piece is skipped after this many frames with a wrong checksum."""


KEY_BYTES: Final = 32
_EPOCH_UNIX_S: Final = 1_420_070_400.0  # 1 January 2015 UTC
_TICKS_PER_S: Final = 1e5
_NEW_STREAM_TICKS: Final = 60 * 100_000


class Frame(NamedTuple):
    """One received message: its name, sender, sequence number, fields and bytes."""

    name: str
    system_id: int
    component_id: int
    sequence: int
    fields: Fields
    data: bytes


_UNUSED: Final = Frame("", 0, 0, 0, None, b"")
_frame: Final = partial(tuple.__new__, Frame)
"""Makes a frame from its values in half the time."""


class FrameReader:
    """Finds and decodes the frames in pieces of bytes. Never raises.

    The length of an unknown message cannot be checked. It is counted in `unknown`, and known frames are searched within
    it. All other bytes that belong to no frame are counted in `garbage_bytes`.

    Args:
        names: Messages that are returned; other valid frames are counted in `unused`. None returns all.
        dialect: The module of pymavlink that defines the messages.
    """

    def __init__(self, names: Collection[str] | None = None, dialect: ModuleType = common) -> None:
        self._known = dialect.mavlink_map
        used = {number for number, message in self._known.items() if names is None or message.msgname in names}
        self._unused = frozenset(self._known.keys() - used)
        self._buffer = bytearray()
        self._unknown_left = 0
        self.garbage_bytes = self.unknown = self.unused = 0

    def read(self, data: bytes, *, stream: bool = True) -> list[Frame]:
        """Return the frames that `data` completes. With `stream` False an incomplete frame is dropped."""
        if not self._buffer and len(data) >= _SHORTEST and frame_length(data) == len(data):
            whole = self._decoded(data)
            if whole is not None:
                return [whole] if whole is not _UNUSED else []
        self._buffer += data
        frames = self._search(stream=stream)
        excess = len(self._buffer) - (_BUFFER_BYTES if stream else 0)
        if excess > 0:
            self._count(excess)
            del self._buffer[:excess]
        return frames

    def first(self, data: bytes) -> Frame | None:
        """Return the frame at the start of a datagram; None if there is none. What `read` has buffered is kept."""
        length = frame_length(data) if len(data) >= _SHORTEST else 0
        frame = self._decoded(data[:length]) if 0 < length <= len(data) else None
        return None if frame is _UNUSED else frame

    def _search(self, *, stream: bool) -> list[Frame]:
        buffer = self._buffer
        frames: list[Frame] = []
        position = broken = 0
        while len(buffer) - position >= _SHORTEST:
            length = frame_length(buffer, position)
            end = position + length
            if stream and end > len(buffer):
                break
            frame = self._decoded(bytes(buffer[position:end])) if position < end <= len(buffer) else None
            if frame is not None:
                if frame is not _UNUSED:
                    frames.append(frame)
                position, self._unknown_left = end, 0
                continue
            broken += length > 0
            start = _START.search(buffer, position + 1) if broken <= _MAX_BROKEN else None
            after = len(buffer) if start is None else start.start()
            self._count(after - position)
            position = after
        del buffer[:position]
        return frames

    def _decoded(self, data: bytes) -> Frame | None:
        """Decode one whole frame; `_UNUSED` if its message is not used, None if it is unknown or damaged."""
        if data[0] == MAGIC_V1:
            begin, end, sender, number = 6, 6 + data[1], data[2:5], data[5]
        else:
            begin, end, sender, number = 10, 10 + data[1], data[4:7], data[7] | data[8] << 8 | data[9] << 16
        message = self._known.get(number)
        if message is None:
            if self._unknown_left == 0:
                self.unknown += 1
                self._unknown_left = len(data)
            return None
        _, _, crc_extra, wire, by_declaration, texts, make, _ = _layout(message)
        if crc16.mcrf4xx(data[1:end] + crc_extra) != data[end] | data[end + 1] << 8:
            return None
        if number in self._unused:
            self.unused += 1
            return _UNUSED
        sequence, system_id, component_id = sender
        # Zeros at the end of a payload may be left out, and extensions that we do not know may follow it.
        size = wire.size
        payload = data[begin:end] if end - begin == size else data[begin : min(end, begin + size)].ljust(size, b"\0")
        values = by_declaration(wire.unpack(payload))
        fields = make(_with_texts(values, texts) if texts else values)
        return _frame((message.msgname, system_id, component_id, sequence, fields, data))

    def _count(self, skipped: int) -> None:
        unknown = min(skipped, self._unknown_left)
        self._unknown_left -= unknown
        self.garbage_bytes += skipped - unknown


class _Layout(NamedTuple):
    """How a message's payload becomes its fields, and the reverse."""

    kind: Any
    number: bytes
    crc_extra: bytes
    wire: struct.Struct
    by_declaration: Callable[[tuple[Any, ...]], tuple[Any, ...]]
    texts: Sequence[int]
    make: Callable[[Iterable[Any]], Fields]
    numbers_of: Callable[[Fields], Iterable[Any]]


@cache
def _layout(message: Any) -> _Layout:  # noqa: ANN401 - a class of pymavlink
    """Return a message's layout. The numbers of an array stand side by side in its unpacked payload, a text is one."""
    names = message.fieldnames
    kind: Any = namedtuple(message.msgname, names, defaults=(0,) * len(names))  # type: ignore[misc]
    ends = list(itertools.accumulate(message.lengths))
    places: list[int | slice] = []
    for index in message.orders:
        end, length = ends[index], message.lengths[index]
        places.append(end - 1 if length == 1 else slice(end - length, end))
    texts = [
        field for field, index in enumerate(message.orders) if message.array_lengths[index] > message.lengths[index]
    ]
    arrays = any(length > 1 for length in message.lengths)
    by_declaration, by_wire = _picking(places), _picking([names.index(name) for name in message.ordered_fieldnames])

    def flat_numbers(fields: Fields) -> Iterable[Any]:
        for value in by_wire(fields):
            if isinstance(value, tuple):
                yield from value
            else:
                yield value.encode() if isinstance(value, str) else value

    return _Layout(
        kind,
        message.id.to_bytes(3, "little"),
        bytes((message.crc_extra,)),
        message.unpacker,
        by_declaration,
        texts,
        partial(tuple.__new__, kind),
        flat_numbers if texts or arrays else by_wire,
    )


def _with_texts(values: tuple[Any, ...], texts: Sequence[int]) -> Iterable[Any]:
    """Decode the texts at these places."""
    decoded = list(values)
    for place in texts:
        decoded[place] = decoded[place].split(b"\0", 1)[0].decode("ascii", errors="replace")
    return decoded


def _picking(places: Sequence[int | slice]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    if len(places) > 1:
        return itemgetter(*places)
    return lambda values: (values[places[0]],)


_CLASSES: Final = {message.msgname: message for message in common.mavlink_map.values()}


def outgoing(name: str, *values: float | str) -> Fields:
    """Return a message to send, with its fields in MAVLink's order; extension fields default to 0."""
    return _layout(_CLASSES[name]).kind(*values)


def frame_length(data: bytes | bytearray, start: int = 0) -> int:
    """Return the length that the header at `start` announces; 0 if no frame starts there. Needs three bytes."""
    magic, payload = data[start], data[start + 1]
    if magic == MAGIC_V1:
        return 6 + payload + 2
    if magic != MAGIC_V2 or data[start + 2] & ~SIGNED:
        return 0
    return 10 + payload + 2 + (_SIGNATURE_BYTES if data[start + 2] & SIGNED else 0)


def header_of(data: bytes) -> tuple[int, int] | None:
    """Return system id and message id from the header of a datagram, unchecked; None if no frame starts there."""
    if len(data) < _SHORTEST or frame_length(data) == 0:
        return None
    if data[0] == MAGIC_V1:
        return data[3], data[5]
    return (data[5], int.from_bytes(data[7:10], "little")) if len(data) >= 10 else None


def is_signed(frame: Frame) -> bool:
    """Return whether a frame carries a signature, right or wrong."""
    return bool(frame.data[0] == MAGIC_V2 and frame.data[2] & SIGNED)


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The shared secret. With a key we sign every frame that we send and refuse every frame without a signature."""

    secret: bytes
    link_id: int = 0

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            ConfigError: If the secret is not 32 bytes long or the link id does not fit in a byte.
        """
        if len(self.secret) != KEY_BYTES:
            raise ConfigError(f"signing key: {len(self.secret)} bytes; it must have {KEY_BYTES}")
        if not 0 <= self.link_id <= 255:
            raise ConfigError(f"signing link_id = {self.link_id}: allowed are 0 to 255")

    def __repr__(self) -> str:
        """Hide the secret."""
        return f"SigningKey(link_id={self.link_id})"

    @classmethod
    def from_hex(cls, text: str, *, link_id: int = 0) -> "SigningKey":
        """Read 64 hexadecimal digits.

        Raises:
            ConfigError: If the text is anything else. The message does not repeat it, because it may be a secret.
        """
        digits = text.strip()
        if re.fullmatch(r"[0-9a-fA-F]{64}", digits) is None:
            raise ConfigError(f"signing key: {len(digits)} characters; it must be 64 hexadecimal digits")
        return cls(bytes.fromhex(digits), link_id)


def ticks(unix_s: float) -> int:
    """Convert Unix time to the timestamps of signing: units of 10 µs since 1 January 2015."""
    return int((unix_s - _EPOCH_UNIX_S) * _TICKS_PER_S)


class SignatureCheck:
    """Accepts a frame if its signature is right and its timestamp is later than the last one of its stream.

    A stream is a link id, system id and component id. The first frame of a stream may be up to one minute older than
    our own time. Frames with a wrong signature change nothing. pymavlink's own check is not used: it remembers the
    timestamp before it verifies the signature, so one forged frame from the future makes it refuse all genuine ones.

    Args:
        key: The shared secret.
        now_ticks: Our own time, see `ticks`.
    """

    def __init__(self, key: SigningKey, now_ticks: int) -> None:
        self._secret = key.secret
        self._last: dict[tuple[int, int, int], int] = {}
        self.latest = now_ticks
        """Our time at the start, or the latest timestamp accepted since."""

    def problem(self, frame: Frame) -> str | None:
        """Return "unsigned", "refused" (wrong or old), or None if the frame is genuine; then remember its timestamp."""
        if not is_signed(frame):
            return "unsigned"
        data = frame.data
        time = int.from_bytes(data[-12:-6], "little")
        stream = data[-13], frame.system_id, frame.component_id
        last = self._last.get(stream, self.latest - _NEW_STREAM_TICKS - 1)
        signature = hashlib.sha256(self._secret + data[:-6]).digest()[:6]
        if time <= last or not hmac.compare_digest(signature, data[-6:]):
            return "refused"
        self._last[stream] = time
        self.latest = max(self.latest, time)
        return None


class Station:
    """One sender of frames. It numbers them and, with a key, signs them and checks the signatures of others."""

    def __init__(
        self,
        system_id: int,
        component_id: int,
        *,
        signing_key: SigningKey | None = None,
        clock: Clock = lambda: 0.0,
        unix_s: float = 0.0,
    ) -> None:
        """Start at sequence number 0. `clock` and `unix_s`, the Unix time now, are needed for signing only."""
        self._sender = system_id, component_id
        self._sequence = 0
        self._clock = clock
        self._unix_offset_s = unix_s - clock()
        self._key = signing_key
        self._check = None if signing_key is None else SignatureCheck(signing_key, ticks(unix_s))
        self._signed_at = 0

    def pack(self, message: Fields) -> bytes:
        """Return a message as our next frame.

        Raises:
            struct.error: If a field does not fit.
        """
        _, number, crc_extra, wire, *_, numbers_of = _layout(_CLASSES[type(message).__name__])
        payload = wire.pack(*numbers_of(message)).rstrip(b"\0") or b"\0"  # zeros at the end are left out
        flags = 0 if self._key is None else SIGNED
        body = _HEAD.pack(len(payload), flags, self._sequence, *self._sender, number) + payload
        frame = b"\xfd" + body + crc16.mcrf4xx(body + crc_extra).to_bytes(2, "little")
        self._sequence = (self._sequence + 1) % 256
        return frame if self._key is None or self._check is None else self._signed(frame, self._key, self._check)

    def _signed(self, frame: bytes, key: SigningKey, check: SignatureCheck) -> bytes:
        now = ticks(self._unix_offset_s + self._clock())
        self._signed_at = max(self._signed_at + 1, check.latest, now)
        frame += bytes((key.link_id,)) + self._signed_at.to_bytes(6, "little")
        return frame + hashlib.sha256(key.secret + frame).digest()[:6]

    def problem(self, frame: Frame) -> str | None:
        """Return "unsigned" or "refused" if there is a key and the frame's signature fails, else None."""
        return None if self._check is None else self._check.problem(frame)
