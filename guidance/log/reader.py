"""Read a flight record, whole, torn or still growing: what a killed process left is read up to its last whole chunk.

A record may be a stranger's. No length in it is believed before it is bounded, and whatever in it cannot be made sense
of ends in one clear error.
"""

import contextlib
import json
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from guidance.errors import ConfigError
from guidance.flight import FlightSettings
from guidance.log.codec import Codec
from guidance.log.entries import CYCLE, CYCLE_TOPIC, EVADER_TOPIC, EVENT, EVENT_TOPIC, REPORT, CycleEntry, EventEntry
from guidance.log.writer import PART, part_path
from guidance.messages import EvaderReport

T = TypeVar("T")

_LONGEST_RECORD_BYTES: Final = 64 * 1024 * 1024
_LARGEST_CHUNK_BYTES: Final = 16 * 1024 * 1024
"""A length that is torn or a lie must not make us ask for gigabytes. Ours are 8 KiB, other writers' 1 to 4 MiB."""

_RECORD: Final = struct.Struct("<BQ")
"""How each of MCAP's records begins: opcode and length."""
_MESSAGE: Final = struct.Struct("<HIQQ")
"""How its messages begin: channel, sequence, log time and publish time in ns."""

_TORN: Final = (McapError, ValueError, struct.error, zstandard.ZstdError, EOFError, MemoryError, OverflowError)

_SENSELESS: Final = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError, MemoryError)

RUN: Final = "run"
"""Name of the metadata record: what flew, with which settings and versions."""

SCENARIO: Final = "scenario"
CONFIG: Final = "config"
"""Keys of the metadata: a mocked flight's scenario and a daemon's vehicle file, as JSON."""

SettingsOf = Callable[[Mapping[str, str]], FlightSettings]
"""What makes a flight's settings of a record's metadata (`guidance.session.flight_files.recorded_settings`)."""


class Item(NamedTuple):
    """One message of the record: log time, channel and bytes."""

    now_s: float
    topic: str
    encoding: str
    data: bytes


@dataclass(slots=True)
class Survey:
    """What a record holds.

    Attributes:
        metadata: What was written at the start.
        messages: How many, by topic.
        data_bytes: How long they are, by topic.
        first_s: The earliest log time.
        last_s: The latest log time.
        sequence: Number of the last message.
        missing: Messages whose number is jumped over: the chunk that held them is damaged.
        torn: Why reading ended early; None where the file was finished properly.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    messages: Counter[str] = field(default_factory=Counter)
    data_bytes: Counter[str] = field(default_factory=Counter)
    first_s: float | None = None
    last_s: float | None = None
    sequence: int = -1
    missing: int = 0
    torn: str | None = None

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message."""
        return 0.0 if self.first_s is None or self.last_s is None else self.last_s - self.first_s


Idle = Callable[[], bool]
"""Called where a growing record has nothing more to read for now: waits a little; True ends the reading."""


@contextlib.contextmanager
def making_sense_of(path: Path) -> Iterator[None]:
    """Turn whatever a damaged or foreign record leads to into one error that names it.

    Raises:
        ConfigError: In place of what the content led to; that is its cause.
    """
    try:
        yield
    except _SENSELESS as error:
        said = str(error).splitlines()
        reason = f"{type(error).__name__}: {said[0][:200]}" if said else type(error).__name__
        raise ConfigError(
            f"{path}: cannot be made sense of ({reason}); it is damaged, or another program or version wrote it"
        ) from error


def scan(path: Path, survey: Survey | None = None, idle: Idle | None = None) -> Iterator[Item]:
    """Yield the messages of a record in the order they were written.

    Args:
        path: The MCAP file. A long flight's first file stands for all of them, a later one for itself.
        survey: Filled along the way, complete after the last item.
        idle: The file is still being written: its end is waited for. The writer knows nothing of it.

    Raises:
        ConfigError: If the file cannot be read or is no MCAP file. A torn one is no error: `survey.torn` says so.
    """
    seen = Survey() if survey is None else survey
    yield from _scan_file(path, seen, seen.metadata, idle)
    part = 2
    while PART not in seen.metadata and (following := part_path(path, part)).exists():
        yield from _scan_file(following, seen, {}, idle)
        part += 1


def _scan_file(path: Path, seen: Survey, metadata: dict[str, str], idle: Idle | None) -> Iterator[Item]:
    channels: dict[int, Channel] = {}
    for record in _records(path, seen, idle):
        if isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata) and record.name == RUN:
            metadata.update(record.metadata)
        elif isinstance(record, Message) and record.channel_id in channels:
            yield _noted(seen, channels[record.channel_id], record)


def survey_of(path: Path) -> Survey:
    """Read a whole record for what it holds.

    Raises:
        ConfigError: As `scan`.
    """
    survey = Survey()
    for _ in scan(path, survey):
        pass
    return survey


def metadata_of(path: Path, idle: Idle | None = None) -> Mapping[str, str]:
    """Read what was written at the start: configuration, versions, seed; `idle` as for `scan`.

    Raises:
        ConfigError: As `scan`, or if the record is torn before its metadata.
    """
    survey = Survey()
    next(scan(path, survey, idle), None)
    if not survey.metadata:
        raise ConfigError(f"{path}: is torn before its first message: nothing in it can be read")
    return survey.metadata


def cycles_of(path: Path, survey: Survey | None = None) -> Iterator[CycleEntry]:
    """Yield the cycles of a record.

    Raises:
        ConfigError: As `scan`, or if a cycle is not what this version writes.
    """
    return _entries(CYCLE, CYCLE_TOPIC, path, survey)


def events_of(path: Path) -> Iterator[EventEntry]:
    """Yield the events of a record.

    Raises:
        ConfigError: As `cycles_of`.
    """
    return _entries(EVENT, EVENT_TOPIC, path)


def reports_of(path: Path) -> Iterator[EvaderReport]:
    """Yield the reports of the evader as their source had them, in order of arrival.

    Raises:
        ConfigError: As `cycles_of`.
    """
    return _entries(REPORT, EVADER_TOPIC, path)


def entry_of(codec: Codec[T], item: Item, source: Path) -> T:
    """Read one message of a channel that is JSON.

    Raises:
        ConfigError: If it is none, or not what this version writes.
    """
    try:
        return codec.decode(item.data)
    except ConfigError as error:
        raise ConfigError(f"{source}: {item.topic} at {item.now_s:.3f} s: {error}") from error


def _entries(codec: Codec[T], topic: str, path: Path, survey: Survey | None = None) -> Iterator[T]:
    return (entry_of(codec, item, path) for item in scan(path, survey) if item.topic == topic)


def title_of(metadata: Mapping[str, str]) -> str:
    """What the flight is called."""
    for kind, key in ((SCENARIO, "title"), (CONFIG, "name")):
        if kind in metadata:
            return str(json.loads(metadata[kind]).get(key, ""))
    return "flight"


def _records(path: Path, seen: Survey, idle: Idle | None) -> Iterator[McapRecord]:
    """Yield the file's records, one after the other, up to its end or to where it is torn."""
    try:
        with path.open("rb") as file:
            stream: Any = _BoundedFile(file if idle is None else _Growing(file, idle))
            reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=_LONGEST_RECORD_BYTES)
            yield from _untorn(reader, seen)
    except InvalidMagic as error:
        raise ConfigError(f"{path}: is no MCAP file; give a record.mcap that a flight wrote") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error


class _BoundedFile:
    """A file of which nothing longer than a record is read at once, whatever a length inside a record says."""

    def __init__(self, file: Any) -> None:  # noqa: ANN401 - a file, or what waits for one
        self._file = file

    def read(self, length: int) -> bytes:
        """Read so many bytes.

        Raises:
            ValueError: If no record is as long as that.
        """
        if length > _LONGEST_RECORD_BYTES:
            raise ValueError(f"a length of {length} bytes in it cannot be")
        data: bytes = self._file.read(length)
        return data


class _Growing:
    """A file that is waited for where it is too short."""

    def __init__(self, file: IO[bytes], idle: Idle) -> None:
        self._file = file
        self._idle = idle

    def read(self, length: int) -> bytes:
        """Read so many bytes; fewer only where the reading is ended."""
        data = self._file.read(length)
        while len(data) < length and not self._idle():
            data += self._file.read(length - len(data))
        return data


def _untorn(reader: StreamReader, seen: Survey) -> Iterator[McapRecord]:
    finished = False
    try:
        for record in reader.records:
            if isinstance(record, Chunk):
                yield from _inside(record)
            else:
                yield record
            finished = finished or isinstance(record, Footer)
    except InvalidMagic:
        if not finished:
            raise
        seen.torn = "its end mark is wrong"
    except _TORN as error:
        seen.torn = str(error) or "it ends in the middle"


def _inside(chunk: Chunk) -> list[McapRecord]:
    """Take a chunk apart; one that says it is larger than it may be, or is, is torn."""
    if chunk.uncompressed_size > _LARGEST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes cannot be")
    if chunk.compression == "zstd":
        # One more than it says: the frame's own word for its size is not believed.
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(chunk.uncompressed_size + 1)
        chunk = replace(chunk, compression="", data=data)
    if len(chunk.data) != chunk.uncompressed_size and not chunk.compression:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes has others")
    checked, length = get_chunk_data_stream(chunk, validate_crc=True)
    return list(_parted(checked.read(length)))


def _parted(data: bytes) -> Iterator[McapRecord]:
    """Yield the channels and messages of a chunk; messages, nearly all of it, without a stream of the library's."""
    at = 0
    while at < len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        begin = at + _RECORD.size
        at = begin + length
        if at > len(data):
            raise ValueError(f"a record of {length} bytes goes beyond its chunk")
        record = data[begin:at]
        if opcode == Opcode.MESSAGE:
            channel, sequence, logged, published = _MESSAGE.unpack_from(record)
            yield Message(channel, logged, record[_MESSAGE.size :], published, sequence)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(record)))


def _noted(survey: Survey, channel: Channel, message: Message) -> Item:
    now_s = message.log_time * 1e-9
    survey.missing += max(0, message.sequence - survey.sequence - 1)
    survey.sequence = message.sequence
    survey.messages[channel.topic] += 1
    survey.data_bytes[channel.topic] += len(message.data)
    survey.first_s = now_s if survey.first_s is None else min(survey.first_s, now_s)
    survey.last_s = now_s if survey.last_s is None else max(survey.last_s, now_s)
    return Item(now_s, channel.topic, channel.message_encoding, message.data)
