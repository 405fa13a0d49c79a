"""The flight's record: one MCAP file with the raw frames of every link and a JSON row for every cycle and event.

A long flight goes on in a next file from time to time, `NAME.002.mcap` and so on: each can be read by itself, and what
the writer has to remember for a file's index stays bounded. Only their owner reads them. Written through an unbuffered
file in small chunks, so that a killed process loses at most the last fraction of a second. A record that cannot be
written never disturbs the flight: recording stops and `failed` says why.
"""

import calendar
import json
import math
import time
from collections.abc import Mapping
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any, TypeVar

from mcap.writer import CompressionType, Writer
from typing_extensions import Buffer

from guidance.files import private_file, private_folder
from guidance.log.codec import Codec
from guidance.log.entries import CYCLE, CYCLE_TOPIC, EVADER_TOPIC, EVENT, EVENT_TOPIC, REPORT, CycleEntry, EventEntry
from guidance.log.scene import Scene
from guidance.messages import EvaderReport

T = TypeVar("T")

CHUNK_BYTES = 32 * 1024
CHUNK_S = 0.1
"""A chunk is written when it is this long or this old: what a killed process had not written is lost."""

ROTATED_S = 600.0
ROTATED_BYTES = 256_000_000
"""A file is finished and the next one begun when it is this long or this large.

Until then the writer remembers where each of its chunks is: a megabyte in 100 s.
"""

PART = "part"
"""Key of a file's number in its metadata; the first has none."""


class Recorder:
    """Writes MCAP files. Times are those of the injected clock, in nanoseconds of the file's log time.

    Args:
        path: Where to write; files that follow are named after it (`guidance.log.writer.part_path`).
        metadata: Name -> text, written at the start of each file: configuration, versions, seed.
        rotate_s: How long a file may be.
        rotate_bytes: How large it may be.

    Raises:
        OSError: If the file cannot be opened; nothing has flown yet.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        *,
        rotate_s: float = ROTATED_S,
        rotate_bytes: int = ROTATED_BYTES,
    ) -> None:
        self.path = path
        self.failed: str | None = None
        self._metadata = dict(metadata)
        self._rotate_s, self._rotate_bytes = rotate_s, rotate_bytes
        self._scene = Scene()
        self._sequence = 0
        self._part = 0
        private_folder(path.parent)
        self._open_part()

    def _open_part(self) -> None:
        self._part += 1
        self._stream = private_file(part_path(self.path, self._part)).open("wb", buffering=0)
        self._writer = Writer(_Whole(self._stream), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="guidance")
        self._writer.add_metadata("run", {**self._metadata, **({} if self._part == 1 else {PART: str(self._part)})})
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._chunk_began_s = math.inf
        self._part_began_s: float | None = None

    def _rotate(self) -> None:
        """Go on in the next file; it is there before the one before is finished, so that who follows finds it."""
        stream, writer = self._stream, self._writer
        try:
            self._open_part()
        finally:
            with stream:
                writer.finish()

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Keep one raw MAVLink frame as it went over the wire; `topic` is the Zenoh key."""
        self._write(now_s, topic, frame, encoding="mavlink", codec=None)

    def cycle(self, entry: CycleEntry) -> None:
        """Keep one guidance cycle, and what viewers draw of it."""
        self._keep(entry.now_s, CYCLE_TOPIC, CYCLE, entry)
        for drawn in self._scene.of(entry):
            self._keep(entry.now_s, drawn.topic, drawn.codec, drawn.message)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""
        self._keep(now_s, EVENT_TOPIC, EVENT, EventEntry(now_s, event, detail))

    def report(self, report: EvaderReport) -> None:
        """Keep one report of the evader."""
        self._keep(report.received_s, EVADER_TOPIC, REPORT, report)

    def close(self) -> None:
        """Finish the file; may be called twice."""
        if self._stream.closed:
            return
        try:
            if self.failed is None:
                self._writer.finish()
        except OSError as error:
            self.failed = str(error)
        finally:
            self._stream.close()

    def _keep(self, now_s: float, topic: str, codec: Codec[T], entry: T) -> None:
        self._write(now_s, topic, codec.encode(entry), encoding="json", codec=codec)

    def _write(self, now_s: float, topic: str, data: bytes, *, encoding: str, codec: Codec[Any] | None) -> None:
        if self.failed is not None or self._stream.closed:
            return
        try:
            if self._part_began_s is None:
                self._part_began_s = now_s
            elif now_s - self._part_began_s >= self._rotate_s or self._stream.tell() >= self._rotate_bytes:
                self._rotate()
                self._part_began_s = now_s
            if topic not in self._channels:
                schema_id = 0 if codec is None else self._schema(codec)
                self._channels[topic] = self._writer.register_channel(topic, encoding, schema_id)
            time_ns = round(now_s * 1e9)
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._sequence)
            self._sequence += 1
            self._chunk_began_s = min(self._chunk_began_s, now_s)
            if now_s - self._chunk_began_s >= CHUNK_S:
                self._writer.flush()
                self._chunk_began_s = math.inf
        except OSError as error:
            self.failed = str(error)

    def _schema(self, codec: Codec[Any]) -> int:
        if codec.title not in self._schemas:
            described = json.dumps(codec.schema, separators=(",", ":")).encode()
            self._schemas[codec.title] = self._writer.register_schema(codec.title, "jsonschema", described)
        return self._schemas[codec.title]


def part_path(path: Path, part: int) -> Path:
    """Return the name of a record's file: the first is `path` itself, the second NAME.002.mcap."""
    return path if part == 1 else path.with_name(f"{path.stem}.{part:03d}{path.suffix}")


class _Whole(BytesIO):
    """Every write goes to the file at once and whole; the library would put a buffer around a raw file."""

    def __init__(self, raw: FileIO) -> None:
        super().__init__()
        self._raw = raw

    def write(self, data: Buffer) -> int:
        """Write all of it, or raise OSError."""
        rest = memoryview(data).cast("B")
        while rest:
            rest = rest[self._raw.write(rest) or 0 :]
        return memoryview(data).nbytes

    def tell(self) -> int:
        """Where the file stands."""
        return self._raw.tell()


def started_utc(now_s: float) -> str:
    """Return when a clock of real time that shows `now_s` was at zero: ISO 8601, to the second."""
    return time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime(calendar.timegm(time.gmtime()) - now_s))
