"""Writes MCAP files, byte for byte as `mcap.writer.Writer`, in a quarter of the time for each message.

A record is mostly small messages, twenty in a cycle, and the package packs every number of each of them alone. Here a
message's header and a chunk's index are packed at once; all other records are the package's own.
Source: the MCAP format specification (mcap.dev/spec).
"""

import struct
import zlib
from collections import defaultdict
from collections.abc import Mapping
from typing import BinaryIO, Final

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

_MESSAGE: Final = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence number, log time and publish time; the data follow."""

_MESSAGE_HEAD_BYTES: Final = 2 + 4 + 8 + 8
"""The part of it that the length counts."""

_FOOTER: Final = struct.Struct("<BQQQ")
_FOOTER_BYTES: Final = 8 + 8 + 4


class McapWriter:
    """Writes chunks, compressed with Zstandard, their indexes, and a summary at the end.

    Messages, and the channels and schemas that they need, wait for `flush`, which writes them as one chunk.

    Args:
        file: Open for writing, at its start; it is not closed.
        library: Who writes, for the header.

    Raises:
        OSError: Here and from `flush`, `add_metadata` and `finish`, if the file cannot be written.
    """

    def __init__(self, file: BinaryIO, library: str) -> None:
        self._file = file
        self._schemas = list[Schema]()
        self._channels = list[Channel]()
        self._chunk = bytearray()
        self._waiting: dict[int, list[int]] = defaultdict(list)
        """By channel, log time and place of each message in the chunk: the numbers of its index."""
        self._chunk_indexes = list[ChunkIndex]()
        self._metadata_indexes = list[MetadataIndex]()
        self._messages: dict[int, int] = defaultdict(int)
        """Number of messages written, by channel."""
        self._file.write(MCAP0_MAGIC + _bytes_of(Header("", library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe a new schema; return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk += _bytes_of(schema)
        return schema.id

    def register_channel(self, topic: str, encoding: str, schema: int) -> int:
        """Describe a new channel with a schema's number, 0 for none; return its own."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata={},
            schema_id=schema,
        )
        self._channels.append(channel)
        self._chunk += _bytes_of(channel)
        return channel.id

    def add_message(self, channel: int, time_ns: int, data: bytes, sequence: int) -> None:
        """Add a message to the chunk; it was logged and published at the same time."""
        chunk = self._chunk
        place = len(chunk)
        length = _MESSAGE_HEAD_BYTES + len(data)
        chunk += _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, time_ns, time_ns)
        chunk += data
        self._waiting[channel] += (time_ns, place)

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write metadata at once, before the chunk in progress."""
        offset = self._file.tell()
        record = _bytes_of(Metadata(name=name, metadata=dict(metadata)))
        self._file.write(record)
        self._metadata_indexes.append(MetadataIndex(offset=offset, length=len(record), name=name))

    def flush(self) -> None:
        """Write the chunk in progress, if it has messages, and flush the file."""
        if self._waiting:
            self._write_chunk()
        self._file.flush()

    def _write_chunk(self) -> None:
        data = bytes(self._chunk)
        waiting = self._waiting
        times_ns = [time_ns for numbers in waiting.values() for time_ns in numbers[::2]]
        chunk = Chunk(
            compression="zstd",
            data=zstandard.compress(data),
            message_start_time=min(times_ns),
            message_end_time=max(times_ns),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        chunk_offset = self._file.tell()
        chunk_record = _bytes_of(chunk)
        index_offset = chunk_offset + len(chunk_record)
        indexes = bytearray()
        index_offsets = dict[int, int]()
        for channel, numbers in waiting.items():
            index_offsets[channel] = index_offset + len(indexes)
            indexes += _message_index(channel, numbers)
            self._messages[channel] += len(numbers) // 2
        self._file.write(chunk_record)
        self._file.write(indexes)
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=chunk_offset,
                chunk_length=len(chunk_record),
                message_index_offsets=index_offsets,
                message_index_length=len(indexes),
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self._chunk.clear()
        waiting.clear()

    def finish(self) -> None:
        """Write the chunk in progress, and the summary."""
        self.flush()
        self._file.write(_bytes_of(DataEnd(data_section_crc=0)))
        summary_offset = self._file.tell()
        summary = _bytes_of(
            *self._schemas,
            *self._channels,
            self._statistics(),
            *self._chunk_indexes,
            *self._metadata_indexes,
        )
        footer = _FOOTER.pack(Opcode.FOOTER, _FOOTER_BYTES, summary_offset, 0)
        self._file.write(summary)
        self._file.write(
            _bytes_of(
                Footer(
                    summary_start=summary_offset,
                    summary_offset_start=0,
                    summary_crc=zlib.crc32(summary + footer),
                )
            )
        )
        self._file.write(MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        chunks = self._chunk_indexes
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._messages,
            chunk_count=len(chunks),
            message_count=sum(self._messages.values()),
            metadata_count=len(self._metadata_indexes),
            message_start_time=min((chunk.message_start_time for chunk in chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in chunks), default=0),
            schema_count=len(self._schemas),
        )


def _message_index(channel: int, numbers: list[int]) -> bytes:
    """Return the index of a channel's messages in one chunk: log time and place of each."""
    pairs = struct.pack(f"<{len(numbers)}Q", *numbers)
    length = 2 + 4 + len(pairs)
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, length, channel, len(pairs)) + pairs


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())
