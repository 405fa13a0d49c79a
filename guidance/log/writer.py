"""Writes the record of a flight: an MCAP file with the raw frames of every link and a JSON row per cycle and event.

A long flight is continued in further files, `NAME.002.mcap` and so on. Each can be read alone, and only by their
owner. In real time chunks are small and written at once: a killed process loses less than 0.2 s. A record that
cannot be written never disturbs the flight: recording stops and `failed` says why.
"""

import json
import math
import os
import platform
import re
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Final

from mcap.writer import Writer
from pydantic_core import to_json

from guidance.files import private_file, private_folder
from guidance.log.codec import Schema
from guidance.log.entries import CYCLE, EVENT, REPORT, CycleEntry, EventEntry
from guidance.log.scene import Scene
from guidance.log.sink import Entry, Sink

CHUNK_S: Final = 0.1
"""Period of the recorder's thread, which writes a chunk each time. A killed process loses its unwritten entries."""

VIRTUAL_CHUNK_S: Final = 1.0
"""Duration of a chunk without the thread, in virtual time: larger chunks take less time to write."""

PART = "part"
"""Metadata key: the number of a file; absent in the first."""

END_METADATA: Final = "end"
"""Name of the metadata at the end of a finished file."""

LAST: Final = "last"
"""Its key: "yes" in the record's last file, "no" if another one follows."""

MAX_ENTRIES_WAITING: Final = 4096
"""Entries that may wait for the recorder's thread; further ones are dropped and counted."""

PACKAGE: Final = "pursuit-guidance"
_RECORDED: Final = (PACKAGE, "numpy", "pymavlink", "mavsdk", "eclipse-zenoh", "mcap")
_HASH: Final = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")


class Record(Sink):
    """A store for the cycles, events and frames of a flight, which keeps nothing. No method raises or waits.

    Args:
        failed: Why nothing is recorded.

    Attributes:
        failed: Why recording has stopped; None while it works.
        dropped: Entries dropped because the thread was too slow.
    """

    def __init__(self, failed: str | None = None) -> None:
        self.failed = failed
        self.dropped = 0

    def frames(self, passed: Sequence[Entry]) -> None:
        """Keep raw MAVLink frames, or other entries."""

    def cycle(self, entry: CycleEntry) -> None:
        """Keep one guidance cycle, the reports that it read, and its drawings for viewers."""
        self.frames(((entry.now_s, CYCLE.topic, entry),))

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""
        self.frames(((now_s, EVENT.topic, EventEntry(now_s, event, detail)),))

    def close(self) -> None:
        """Finish; may be called twice."""


class Recorder(Record):
    """`Record` that writes MCAP files. Times are those of the injected clock, in nanoseconds.

    Entries wait until a chunk is due and are encoded together, which is faster. With a thread, a slow or full disk does
    not delay the loop. An error of the disk, or a row that cannot be encoded, ends the record, not the flight.

    Args:
        path: The first file; further ones are named by `part_path`.
        metadata: Name -> text, written at the start of each file: configuration, versions, seed.
        threaded: Whether a thread writes, every `CHUNK_S` of real time; else the loop does, in virtual time.
        rotate_s: A new file is begun when the current one reaches this duration.
        rotate_bytes: The same for its size.

    Raises:
        OSError: If the file cannot be opened, before anything flies.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        *,
        threaded: bool = False,
        rotate_s: float = 600.0,
        rotate_bytes: int = 256_000_000,
    ) -> None:
        super().__init__()
        self.path = path
        self._metadata = dict(metadata)
        self._rotate_s = rotate_s
        self._rotate_bytes = rotate_bytes
        self._scene = Scene()
        self._part = 1
        private_folder(path.parent)
        self._file = McapFile(path, self._metadata)
        self._file_ends_s = math.inf
        self._chunk_ends_s = -math.inf
        self._waiting: deque[Entry] = deque()
        self._closed = threading.Event()
        self._thread = (
            threading.Thread(target=self._run, name="recorder", daemon=True) if threaded else None
        )
        if self._thread is not None:
            self._thread.start()

    def frames(self, passed: Sequence[Entry]) -> None:
        """Keep raw MAVLink frames, or other entries."""
        if not passed or self.failed is not None or self._closed.is_set():
            return
        self._waiting.extend(passed)
        now_s = passed[-1][0]
        if self._thread is None and now_s >= self._chunk_ends_s:
            self._chunk_ends_s = now_s + VIRTUAL_CHUNK_S
            self._write()
        while self._thread is not None and len(self._waiting) > MAX_ENTRIES_WAITING:
            self._waiting.pop()
            self.dropped += 1

    def close(self) -> None:
        """Write the waiting entries and finish the file; may be called twice."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
        self._write()
        try:
            self._file.close(finish=self.failed is None, last=True)
        except OSError as error:
            self.failed = str(error)

    def _run(self) -> None:
        while not self._closed.wait(CHUNK_S):
            self._write()

    def _write(self) -> None:
        """Write the waiting entries as a chunk."""
        waiting = self._waiting
        try:
            while waiting and self.failed is None:
                now_s, topic, content = waiting.popleft()
                if now_s >= self._file_ends_s or self._file.size >= self._rotate_bytes:
                    # Open the next file, then finish the previous one: a program that follows the
                    # record always finds a next.
                    before = self._file
                    try:
                        self._file = McapFile(
                            part_path(self.path, self._part + 1),
                            {**self._metadata, PART: str(self._part + 1)},
                        )
                        self._file.sequence = before.sequence
                    finally:
                        before.close(finish=True, last=False)
                    self._part += 1
                    self._file_ends_s = math.inf
                if self._file_ends_s == math.inf:
                    self._file_ends_s = now_s + self._rotate_s
                if isinstance(content, bytes):
                    self._file.add(topic, None, now_s, content)
                elif isinstance(content, CycleEntry):
                    add = self._file.add
                    for report in content.inputs.reports:
                        add(REPORT.topic, REPORT.schema, report.received_s, REPORT.encode(report))
                    add(CYCLE.topic, CYCLE.schema, content.now_s, CYCLE.encode(content))
                    for scene_topic, schema, message in self._scene.of(content):
                        data = to_json(message, inf_nan_mode="null")
                        add(scene_topic, schema, content.now_s, data)
                else:
                    self._file.add(topic, EVENT.schema, now_s, EVENT.encode(content))
                if not waiting:
                    self._file.end_chunk()
        except (OSError, ValueError, TypeError) as error:
            self.failed = str(error)
            waiting.clear()


def part_path(path: Path, part: int) -> Path:
    """Return the name of a file of a record: the first is `path` itself, the second NAME.002.mcap."""
    return path if part == 1 else path.with_name(f"{path.stem}.{part:03d}{path.suffix}")


def started_utc(now_s: float) -> str:
    """Return the UTC time of a real-time clock's zero, ISO 8601 to the millisecond; the clock now shows `now_s`."""
    started_ns = time.time_ns() - round(now_s * 1e9)
    return datetime.fromtimestamp(started_ns * 1e-9, UTC).isoformat(timespec="milliseconds")


def versions() -> dict[str, str]:
    """Return the versions of Python, of the packages that determine the recorded data, and the commit if known."""
    recorded = versions_of(_RECORDED)
    head = commit()
    if head is not None:
        recorded["commit"] = head
    return recorded


def versions_of(packages: Sequence[str]) -> dict[str, str]:
    """Return the versions of Python and of packages."""
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def commit() -> str | None:
    """Return the commit of the installed project, or None if unknown.

    In a checkout it is HEAD; uncommitted changes are not considered. Otherwise it is the commit that pip recorded when
    installing from a repository (PEP 610, `direct_url.json`).
    """
    return commit_of_checkout(Path(__file__).parents[2]) or commit_of_install()


def commit_of_checkout(root: Path) -> str | None:
    """Return the commit of HEAD of the repository at `root`, or None if there is none, or no git."""
    if not (root / "pyproject.toml").is_file() or not (root / ".git").exists():
        return None  # installed inside another repository
    # git refuses a repository of another user, such as a service's, unless it is named safe. Reading HEAD runs no code
    # from the repository.
    words = [
        "git",
        "-c",
        "safe.directory=*",
        f"--git-dir={root / '.git'}",
        "rev-parse",
        "--verify",
        "HEAD",
    ]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        git = subprocess.run(
            words, capture_output=True, text=True, timeout=5.0, check=True, env=environment
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return git.stdout.strip()


def commit_of_install() -> str | None:
    """Return the commit of the repository that pip installed, or None."""
    try:
        commit_id = str(
            json.loads(distribution(PACKAGE).read_text("direct_url.json") or "{}")["vcs_info"][
                "commit_id"
            ]
        )
    except (PackageNotFoundError, OSError, ValueError, KeyError, TypeError):
        return None
    return commit_id if _HASH.fullmatch(commit_id) else None


class McapFile:
    """Writes one MCAP file, chunk by chunk.

    Raises:
        OSError: Here and from all methods, if the file cannot be written or was deleted.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self._path = path
        self._file = private_file(path).open("wb")
        self.size = self.sequence = 0
        self._schemas = dict[str, int]()
        self._channels = dict[str, int]()
        # `end_chunk` ends a chunk, not its size.
        self._writer = Writer(self._file, chunk_size=sys.maxsize, use_summary_offsets=False)
        self._writer.start(library="guidance")
        self._writer.add_metadata("run", dict(metadata))
        self.end_chunk()

    def add(self, topic: str, schema: Schema | None, now_s: float, data: bytes) -> None:
        """Add a message, JSON if it has a schema, else a MAVLink frame."""
        channel = self._channels.get(topic)
        if channel is None:
            # Describe a new channel, and its schema if that is new.
            title = "" if schema is None else schema["title"]
            if title and title not in self._schemas:
                described = json.dumps(schema, separators=(",", ":")).encode()
                self._schemas[title] = self._writer.register_schema(title, "jsonschema", described)
            encoding = "json" if title else "mavlink"
            channel = self._writer.register_channel(topic, encoding, self._schemas.get(title, 0))
            self._channels[topic] = channel
        time_ns = round(now_s * 1e9)
        self._writer.add_message(channel, time_ns, data, time_ns, self.sequence)
        self.sequence += 1

    def end_chunk(self) -> None:
        """Write the chunk in progress."""
        if os.fstat(self._file.fileno()).st_nlink == 0:
            raise FileNotFoundError(f"{self._path} was deleted")
        self._writer.flush()
        self.size = self._file.tell()

    def close(self, *, finish: bool, last: bool) -> None:
        """Close the file, with its index if `finish`; may be called twice. `last`: no further file follows."""
        if self._file.closed:
            return
        with self._file:
            if finish:
                self.end_chunk()
                self._writer.add_metadata(END_METADATA, {LAST: "yes" if last else "no"})
                self._writer.finish()
