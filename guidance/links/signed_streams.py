"""The last timestamp of every signed stream, kept in a file across restarts.

A recorded frame has a valid signature. It is refused because it is not newer than the last one of its stream, and a
program that has just started knows that only from this file. It is written by a thread of its own, once a second while
frames arrive and at the end, so that no cycle waits for a disk.
"""

import contextlib
import json
import os
import threading
from pathlib import Path
from typing import Final

from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, text_of

Stream = tuple[int, int, int]
"""Link id, system id and component id."""

_EVERY_S: Final = 1.0
_MOST_BYTES: Final = 65536
_MOST_TIMESTAMP: Final = 2**48


def state_folder() -> Path:
    """Return the folder for what a program remembers: systemd's, or the user's by the XDG rules."""
    systemd = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if systemd:
        return Path(systemd)
    home = os.environ.get("XDG_STATE_HOME", "")
    return (Path(home) if home else Path.home() / ".local" / "state") / "guidance"


class SignedStreams:
    """The last timestamps of the streams of one key.

    Args:
        path: The file; it need not exist.

    Attributes:
        at_start: What the file had when it was opened.

    Raises:
        ConfigError: If the file exists and cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.at_start = _read(path)
        self._latest = dict(self.at_start)
        self._written = dict(self.at_start)
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def note(self, stream: Stream, timestamp: int) -> None:
        """Remember the timestamp of a genuine frame."""
        with self._lock:
            self._latest[stream] = max(timestamp, self._latest.get(stream, 0))
            if self._thread is None and not self._ended.is_set():
                self._thread = threading.Thread(
                    target=self._keep, name="signed streams", daemon=True
                )
                self._thread.start()

    def write(self) -> None:
        """Write the file now, unless nothing has changed or the disk refuses."""
        with self._lock:
            latest = dict(self._latest)
        if latest == self._written:
            return
        with contextlib.suppress(OSError, ConfigError):
            private_folder(self.path.parent)
            for stream, timestamp in _read(self.path).items():  # another daemon with this key
                latest[stream] = max(timestamp, latest.get(stream, 0))
            draft = private_file(self.path.with_suffix(f".{os.getpid()}"))
            rows = {"/".join(map(str, stream)): latest[stream] for stream in sorted(latest)}
            draft.write_text(json.dumps(rows), encoding="utf-8")
            draft.replace(self.path)
            self._written = latest

    def close(self) -> None:
        """End the thread and write the file. May be called twice."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        self.write()

    def _keep(self) -> None:
        while not self._ended.wait(_EVERY_S):
            self.write()


def _read(path: Path) -> dict[Stream, int]:
    """Read the file; empty if there is none.

    Raises:
        ConfigError: If it is not such a file.
    """
    if not path.exists():
        return {}
    said = f"last timestamps of signed streams, {path}"
    damaged = f"{said}: damaged; see that nobody replays recorded frames, and remove it"
    text = text_of(path, said, secret=True)
    try:
        rows = json.loads(text[:_MOST_BYTES])
        streams = {_stream(name): timestamp for name, timestamp in rows.items()}
    except (ValueError, AttributeError, RecursionError) as error:
        raise ConfigError(damaged) from error
    for timestamp in streams.values():
        if type(timestamp) is not int or not 0 <= timestamp < _MOST_TIMESTAMP:
            raise ConfigError(damaged)
    return streams


def _stream(name: str) -> Stream:
    link_id, system_id, component_id = map(int, name.split("/"))
    return link_id, system_id, component_id
