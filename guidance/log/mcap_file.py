"""Writes one MCAP file: messages in compressed chunks, and an index of them at its end."""

import json
import os
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from guidance.files import private_file
from guidance.log.codec import Codec
from guidance.log.scene import Shape

_MESSAGE: Final = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time and publish time in ns
_MESSAGE_OPCODE: Final = int(Opcode.MESSAGE)
_MESSAGE_HEAD: Final = _MESSAGE.size - 9
_INDEX: Final = struct.Struct("<BQHI")  # opcode, length, channel, length of the (time, offset) pairs


class McapFile:
    """Writes one MCAP file.

    The writer of the `mcap` package takes 9 µs a message, this one 2 µs, and a cycle has ten. It packs messages and
    their indexes itself; all other records are the package's.

    Raises:
        OSError: Here and from all methods, if the file cannot be written or was deleted.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self._path = path
        self._stream = private_file(path).open("wb", buffering=0)
        self.size = 0
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._described: list[records.Schema | records.Channel] = []
        self._statistics = records.Statistics(0, 0, Counter(), 0, 0, 0, 2**64 - 1, metadata_count=1, schema_count=0)
        self._chunk = bytearray()
        self._entries: dict[int, list[int]] = {}  # channel -> time, offset, time, offset ...
        self._chunk_indexes = bytearray()
        head = MCAP0_MAGIC + _packed(records.Header("", "guidance"))
        run = _packed(records.Metadata("run", dict(metadata)))
        self._metadata_index = records.MetadataIndex(len(head), len(run), "run")
        self._put(head + run)

    def add(self, topic: str, shape: Shape | Codec[Any] | None, time_ns: int, sequence: int, data: bytes) -> int:
        """Add a message, JSON if it has a shape, else a MAVLink frame; return the size of the chunk in progress."""
        channel = self._channels.get(topic) or self._channel(topic, shape)
        chunk = self._chunk
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = []
        entries += (time_ns, len(chunk))
        chunk += _MESSAGE.pack(_MESSAGE_OPCODE, _MESSAGE_HEAD + len(data), channel, sequence, time_ns, time_ns)
        chunk += data
        return len(chunk)

    def flush(self) -> None:
        """Write the chunk in progress."""
        if not self._entries:
            return
        if os.fstat(self._stream.fileno()).st_nlink == 0:
            raise FileNotFoundError(f"{self._path} was deleted")
        times = [time_ns for entries in self._entries.values() for time_ns in entries[::2]]
        begin_ns, end_ns = min(times), max(times)
        data = bytes(self._chunk)
        packed = self._compressor.compress(data)
        chunk = _packed(records.Chunk("zstd", packed, end_ns, begin_ns, zlib.crc32(data), len(data)))
        statistics, offsets, indexes = self._statistics, {}, bytearray()
        for channel_id, entries in self._entries.items():
            statistics.channel_message_counts[channel_id] += len(entries) // 2
            offsets[channel_id] = self.size + len(chunk) + len(indexes)
            length = 8 * len(entries)
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX.size - 9 + length, channel_id, length)
            indexes += struct.pack(f"<{len(entries)}Q", *entries)
        self._chunk_indexes += _packed(
            records.ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=self.size,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=end_ns,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=begin_ns,
                uncompressed_size=len(data),
            )
        )
        statistics.chunk_count += 1
        statistics.message_count += len(times)
        statistics.message_start_time = min(statistics.message_start_time, begin_ns)
        statistics.message_end_time = max(statistics.message_end_time, end_ns)
        self._put(chunk + indexes)
        self._chunk, self._entries = bytearray(), {}

    def close(self, *, finish: bool) -> None:
        """Close the file, with its index if `finish`; may be called twice."""
        if self._stream.closed:
            return
        with self._stream:
            if finish:
                self.flush()
                self._finish()

    def _finish(self) -> None:
        """Write the index of the file, which readers need to find a moment."""
        statistics = self._statistics
        statistics.channel_count, statistics.schema_count = len(self._channels), len(self._schemas)
        statistics.message_start_time = min(statistics.message_start_time, statistics.message_end_time)
        self._put(_packed(records.DataEnd(0)))
        summary = _packed(*self._described, statistics, self._metadata_index)
        summary += self._chunk_indexes
        footer = records.Footer(summary_start=self.size, summary_offset_start=0, summary_crc=0)
        checked = zlib.crc32(summary + _packed(footer)[:-4])
        self._put(summary + _packed(replace(footer, summary_crc=checked)) + MCAP0_MAGIC)

    def _channel(self, topic: str, shape: Shape | Codec[Any] | None) -> int:
        """Describe a new channel, and its schema if that is new; return its number."""
        channel_id = self._channels[topic] = len(self._channels) + 1
        if shape is not None and shape.title not in self._schemas:
            schema_id = self._schemas[shape.title] = len(self._schemas) + 1
            described = json.dumps(shape.schema, separators=(",", ":")).encode()
            self._described.append(records.Schema(schema_id, described, "jsonschema", shape.title))
            self._chunk += _packed(self._described[-1])
        encoding, schema_id = ("mavlink", 0) if shape is None else ("json", self._schemas[shape.title])
        self._described.append(records.Channel(channel_id, topic, encoding, {}, schema_id))
        self._chunk += _packed(self._described[-1])
        return channel_id

    def _put(self, data: bytes) -> None:
        """Write all bytes; an unbuffered file may accept only some per call."""
        rest = memoryview(data)
        while rest:
            rest = rest[self._stream.write(rest) or 0 :]
        self.size += len(data)


def _packed(*contents: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    for content in contents:
        content.write(builder)
    return bytes(builder.end())
