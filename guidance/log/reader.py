"""Reads a flight record that is whole, cut off, or still being written.

The file may come from a stranger. The `mcap` package parses it, but only after the limits below are checked: on the
length of every read, on the size of an uncompressed chunk, and on expansion and message count relative to the file.
"""

import contextlib
import os
import re
import struct
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Final, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
)
from mcap.stream_reader import breakup_chunk

from guidance.errors import ConfigError
from guidance.files import open_regular
from guidance.log.codec import Codec
from guidance.log.entries import CYCLE, EVENT, REPORT, RUN, CycleEntry, EventEntry, Idle, Item
from guidance.log.writer import END_METADATA, LAST, PART, part_path
from guidance.messages import EvaderReport

_Read = TypeVar("_Read")

MAX_RECORD_BYTES: Final = 16 * 2**20
"""Largest MCAP record, and largest uncompressed chunk. Our chunks are 32 KiB, those of other writers 1 to 4 MiB."""

MAX_EXPANSION: Final = 100
FREE_BYTES: Final = 2**20
"""A file may expand to 1 MiB plus 100 times the bytes read. Flights compress to a third, at most to a tenth."""

BYTES_PER_RECORD: Final = 8
FREE_RECORDS: Final = 10_000
"""Chunks may hold 10,000 messages plus one per 8 bytes read. Ours take 16 bytes in the index alone."""

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")  # opcode and length of a record
_FOOTER_CONTENT_BYTES: Final = 20
_FOOTER_BYTES: Final = _HEAD.size + _FOOTER_CONTENT_BYTES + len(_MAGIC)
_KNOWN_KINDS: Final = frozenset(Opcode)
_LISTED: Final[Mapping[int, type[Channel | ChunkIndex | MetadataIndex]]] = {
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}
"""Records at the end of a file that say where its parts are."""

_DAMAGE: Final = (
    McapError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
    EOFError,
    MemoryError,
    OverflowError,
)
_CONTENT: Final = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    MemoryError,
)


@dataclass(slots=True)
class Survey:
    """Summary of a record.

    Attributes:
        metadata: Written at the start.
        messages: Number of messages by topic.
        data_bytes: Size of their data by topic.
        first_s: Earliest log time.
        last_s: Latest log time.
        sequence: Number of the last message.
        missing: Number of messages lost to damage or a missing file, as far as later messages show it.
        damaged_chunks: Number of chunks that were skipped because their content is damaged.
        damage: Why the first of them was skipped.
        missing_files: Names of the record's files that are gone; of several at the end, the first.
        torn: Why reading ended early; None if the file was finished properly.
    """

    metadata: dict[str, str] = field(default_factory=dict)
    messages: Counter[str] = field(default_factory=Counter)
    data_bytes: Counter[str] = field(default_factory=Counter)
    first_s: float | None = None
    last_s: float | None = None
    sequence: int = -1
    missing: int = 0
    damaged_chunks: int = 0
    damage: str | None = None
    missing_files: list[str] = field(default_factory=list)
    torn: str | None = None

    @property
    def faults(self) -> list[str]:
        """Faults of the record, a phrase each; empty if it is whole."""
        faults = []
        if self.torn is not None:
            faults.append(f"torn ({self.torn}): counted up to there")
        faults += [f"{name} is missing" for name in self.missing_files]
        if self.damaged_chunks:
            faults.append(f"damaged chunks were skipped: {self.damaged_chunks} ({self.damage})")
        if self.missing:
            faults.append(f"{self.missing} messages are missing")
        return faults

    @property
    def duration_s(self) -> float:
        """Time between the first and the last message."""
        return 0.0 if self.first_s is None or self.last_s is None else self.last_s - self.first_s

    def add(self, channel: Channel, message: Message) -> Item:
        """Count one message and return it."""
        now_s = message.log_time * 1e-9
        self.missing += max(0, message.sequence - self.sequence - 1)
        self.sequence = message.sequence
        self.messages[channel.topic] += 1
        self.data_bytes[channel.topic] += len(message.data)
        self.first_s = now_s if self.first_s is None else min(self.first_s, now_s)
        self.last_s = now_s if self.last_s is None else max(self.last_s, now_s)
        return Item(now_s, channel.topic, channel.message_encoding, message.data)


@contextlib.contextmanager
def record_errors(path: Path) -> Iterator[None]:
    """Turn every error that the content of a damaged or foreign record can cause into one that names the file.

    Raises:
        ConfigError: In place of the error, which is its cause.
    """
    try:
        yield
    except _CONTENT as error:
        lines = str(error).splitlines()
        reason = f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
        remedy = "it is damaged, or written by another program or version"
        raise ConfigError(f"{path}: cannot be read as a record ({reason}); {remedy}") from error


def scan(path: Path, survey: Survey | None = None, idle: Idle | None = None) -> Iterator[Item]:
    """Yield the messages of a record in the order they were written.

    Args:
        path: The MCAP file. The first file of a long flight continues with all others; a later file is read alone.
        survey: Filled while reading; complete after the last item.
        idle: Wait for more at the end of the file, which is still being written.

    Raises:
        ConfigError: If the file cannot be read, is not MCAP, or exceeds a limit. A cut-off file is not an error:
            `survey.torn` gives the reason.
    """
    survey = Survey() if survey is None else survey
    ends = yield from _scan_file(path, survey, survey.metadata, idle)
    if PART in survey.metadata:
        return
    number = 1
    while (following := _next_part(path, number)) is not None:
        for lost in range(number + 1, following):
            survey.missing_files.append(part_path(path, lost).name)
        number = following
        ends = yield from _scan_file(part_path(path, number), survey, {}, idle)
    if ends.get(LAST) == "no":
        survey.missing_files.append(part_path(path, number + 1).name)


def _next_part(path: Path, number: int) -> int | None:
    """Return the number of the record's next file after `number` that exists."""
    if part_path(path, number + 1).exists():
        return number + 1
    name = re.compile(rf"{re.escape(path.stem)}\.(\d{{3,6}}){re.escape(path.suffix)}")
    with contextlib.suppress(OSError):
        names = (name.fullmatch(neighbour.name) for neighbour in path.parent.iterdir())
        numbers = [int(match[1]) for match in names if match is not None]
        return min((later for later in numbers if later > number), default=None)
    return None


def _scan_file(
    path: Path, survey: Survey, metadata: dict[str, str], idle: Idle | None
) -> Generator[Item, None, dict[str, str]]:
    """Yield the messages of one file; return its end mark, which is empty in a file that was cut off."""
    channels: dict[int, Channel] = {}
    ends: dict[str, str] = {}
    try:
        with open_regular(path) as file:
            for record in _records(_LimitedFile(path, file, idle), survey):
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Metadata) and record.name == RUN:
                    metadata.update(record.metadata)
                elif isinstance(record, Metadata) and record.name == END_METADATA:
                    ends.update(record.metadata)
                elif isinstance(record, Message) and record.channel_id in channels:
                    yield survey.add(channels[record.channel_id], record)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    return ends


def survey_of(path: Path) -> Survey:
    """Read a whole record and return its summary.

    Raises:
        ConfigError: As `scan`.
    """
    survey = Survey()
    for _ in scan(path, survey):
        pass
    return survey


def metadata_of(path: Path, idle: Idle | None = None) -> Mapping[str, str]:
    """Read the metadata: configuration, versions, seed; `idle` as for `scan`.

    Raises:
        ConfigError: As `scan`, or if the record ends before its metadata.
    """
    survey = Survey()
    next(scan(path, survey, idle), None)
    if not survey.metadata:
        raise ConfigError(f"{path}: ends before its first message: nothing can be read")
    return survey.metadata


def cycles_of(path: Path, survey: Survey | None = None) -> Iterator[CycleEntry]:
    """Yield the cycles of a record.

    Raises:
        ConfigError: As `scan`, or if a cycle does not match this version.
    """
    return _entries(CYCLE, path, survey)


def events_of(path: Path, survey: Survey | None = None) -> Iterator[EventEntry]:
    """Yield the events of a record.

    Raises:
        ConfigError: As `cycles_of`.
    """
    return _entries(EVENT, path, survey)


def reports_of(path: Path, survey: Survey | None = None) -> Iterator[EvaderReport]:
    """Yield the evader's reports as received, in order of arrival.

    Raises:
        ConfigError: As `cycles_of`.
    """
    return _entries(REPORT, path, survey)


def entry_of(codec: Codec[_Read], item: Item, source: Path) -> _Read:
    """Decode one message of a JSON channel.

    Raises:
        ConfigError: If it is not JSON or does not match this version; the message gives file, topic and time.
    """
    try:
        return codec.decode(item.data)
    except ConfigError as error:
        raise ConfigError(f"{source}: {item.topic} at {item.now_s:.3f} s: {error}") from error


def row_of(item: Item, source: Path) -> CycleEntry | EventEntry | None:
    """Decode a cycle or an event; None for other messages.

    Raises:
        ConfigError: As `entry_of`.
    """
    if item.topic == CYCLE.topic:
        return entry_of(CYCLE, item, source)
    return entry_of(EVENT, item, source) if item.topic == EVENT.topic else None


def _entries(codec: Codec[_Read], path: Path, survey: Survey | None) -> Iterator[_Read]:
    return (entry_of(codec, item, path) for item in scan(path, survey) if item.topic == codec.topic)


class _LimitedFile:
    """A file with bounded reads that counts its expanded bytes; with `idle`, it waits for more data at the end."""

    def __init__(self, path: Path, file: IO[bytes], idle: Idle | None) -> None:
        self.path = path
        self._file = file
        self._idle = idle
        self._read_bytes = 0
        self._expanded_bytes = 0
        self._records = 0
        self._summary: list[Channel | ChunkIndex | MetadataIndex] | None = None

    @property
    def position(self) -> int:
        """Offset of the next read."""
        return self._file.tell()

    def seek(self, offset: int) -> None:
        """Read on at `offset`; from the end if it is negative."""
        self._file.seek(offset, os.SEEK_SET if offset >= 0 else os.SEEK_END)

    def read(self, length: int) -> bytes:
        """Read `length` bytes, fewer only at the end.

        Raises:
            ValueError: If no record is that long.
        """
        if not 0 <= length <= MAX_RECORD_BYTES:
            raise ValueError(f"it gives a length of {length} bytes")
        data = self._file.read(length)
        while self._idle is not None and len(data) < length and not self._idle():
            data += self._file.read(length - len(data))
        self._read_bytes += len(data)
        return data

    def framed(self) -> tuple[int, bytes]:
        """Read the opcode and the content of one record.

        Raises:
            EOFError: If the file ends within it.
            ValueError: If no record is that long.
        """
        head = self.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise EOFError("it ends in the middle")
        opcode, length = _HEAD.unpack(head)
        content = self.read(length)
        if len(content) < length:
            raise EOFError("it ends in the middle")
        return opcode, content

    def summary(self) -> Sequence[Channel | ChunkIndex | MetadataIndex]:
        """Return the channels, chunks and metadata listed at the end of the file; empty if it was cut off."""
        if self._summary is None:
            position = self.position
            self._summary = []
            with contextlib.suppress(OSError, *_DAMAGE):
                self.seek(-_FOOTER_BYTES)
                opcode, content = self.framed()
                if opcode == Opcode.FOOTER:
                    self.seek(Footer.read(ReadDataStream(BytesIO(content))).summary_start)
                    opcode, content = self.framed()
                    while opcode != Opcode.FOOTER:
                        kind = _LISTED.get(opcode)
                        if kind is not None:
                            self._summary.append(kind.read(ReadDataStream(BytesIO(content))))
                        opcode, content = self.framed()
            self.seek(position)
        return self._summary

    def skip_from(self, begin: int) -> bool:
        """Go to the next chunk or metadata record behind `begin`, or to the footer; return whether they are known."""
        offsets = []
        for record in self.summary():
            if isinstance(record, ChunkIndex):
                offsets.append(record.chunk_start_offset)
            elif isinstance(record, MetadataIndex):
                offsets.append(record.offset)
        if not offsets:
            return False
        self.seek(min((offset for offset in offsets if offset > begin), default=-_FOOTER_BYTES))
        return True

    def inside(self, chunk: Chunk) -> list[McapRecord]:
        """Return the records of a chunk.

        Raises:
            ConfigError: If the file expands too much, or holds too many messages.
            ValueError: If the chunk does not have the size that it states.
        """
        size = chunk.uncompressed_size
        if chunk.compression not in {"", "zstd"}:
            raise ValueError(f"a chunk is compressed with {chunk.compression!r}; only zstd is read")
        stated = zstandard.frame_content_size(chunk.data) if chunk.compression else len(chunk.data)
        if size > MAX_RECORD_BYTES or stated != size:
            raise ValueError(f"a chunk of {stated} bytes states {size}")
        self._expanded_bytes += size
        if self._expanded_bytes > FREE_BYTES + MAX_EXPANSION * self._read_bytes:
            raise ConfigError(
                f"{self.path}: expands to more than {MAX_EXPANSION} times its size; no flight wrote it"
            )
        records = breakup_chunk(chunk, validate_crc=True)
        self._records += len(records)
        if self._records > FREE_RECORDS + self._read_bytes // BYTES_PER_RECORD:
            raise ConfigError(
                f"{self.path}: {self._records} messages in {self._read_bytes} bytes; no flight wrote it"
            )
        return records


def _records(file: _LimitedFile, survey: Survey) -> Iterator[McapRecord]:
    """Yield the records of a file up to its end, or to where it is damaged.

    A chunk with a damaged content is skipped. Where the length of a record is damaged, the summary at the end of the
    file says where the next chunk begins.

    Raises:
        ConfigError: If the file is not MCAP, or exceeds a limit.
    """
    magic = file.read(len(_MAGIC))
    if magic != _MAGIC[: len(magic)]:
        raise ConfigError(f"{file.path}: not an MCAP file; give a record.mcap of a flight")
    while True:
        begin = file.position
        framed = False
        try:
            opcode, content = file.framed()
            framed = True
            if opcode == Opcode.FOOTER and len(content) == _FOOTER_CONTENT_BYTES:
                break
            records = _parsed(file, opcode, content)
        except _DAMAGE as error:
            if not file.skip_from(begin) and not framed:
                survey.torn = str(error)
                return
            survey.damaged_chunks += 1
            if not survey.damage:
                survey.damage = str(error)
            # The chunk may have described a channel; the summary describes every channel again.
            records = [record for record in file.summary() if isinstance(record, Channel)]
        yield from records
    if file.read(len(_MAGIC)) != _MAGIC:
        survey.torn = "its end mark is wrong"


def _parsed(file: _LimitedFile, opcode: int, content: bytes) -> Sequence[McapRecord]:
    """Return the record, or those of a chunk; empty for kinds that are not needed."""
    stream = ReadDataStream(BytesIO(content))
    match opcode:
        case Opcode.CHUNK:
            return file.inside(Chunk.read(stream))
        case Opcode.CHANNEL:
            return [Channel.read(stream)]
        case Opcode.METADATA:
            return [Metadata.read(stream)]
        case Opcode.MESSAGE:
            return [Message.read(stream, len(content))]
        case _ if opcode in _KNOWN_KINDS:
            return []
        case _:
            raise ValueError(f"a record of the unknown kind {opcode}")
