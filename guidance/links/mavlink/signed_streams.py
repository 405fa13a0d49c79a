"""A bound on the timestamps of every signed stream, kept in a file across restarts.

A recorded frame has a valid signature. It is refused because it is not newer than the last one of its stream, and a
program that has just started knows that only from this file. The file is ahead: no frame is used before the file has a
bound that is not below its timestamp. After a crash, every frame that was ever used is therefore refused, and so are
the vehicle's own ones until their timestamps pass the bound: for `LEAD_S` at most, since they run with time. A program
that ends in order leaves the last timestamp itself, which avoids this delay.

A thread writes the file, so that no cycle waits for a disk. A disk that does not answer ends no flight: then a stream
is used after `MOST_FRAMES_WAITING` frames, and counted.
"""

import contextlib
import fcntl
import json
import os
import threading
from pathlib import Path
from typing import Final

from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, text_of

SignedStream = tuple[int, int, int]
"""Link id, system id and component id."""

LEAD_S: Final = 5.0
"""The bound is this far ahead of the last timestamp."""

MOST_FRAMES_WAITING: Final = 100
"""So many frames of a stream wait for a bound; the next one is used without."""

_TICKS_PER_S: Final = 100_000
_LEAD: Final = round(LEAD_S * _TICKS_PER_S)
_RENEWED: Final = _LEAD - _TICKS_PER_S
"""The bound is renewed when it is less than this ahead: once a second. A disk may take four seconds."""

_MOST_BYTES: Final = 65536
_MOST_TIMESTAMP: Final = 2**48


def state_folder() -> Path:
    """Return the folder for a program's state: systemd's, or the user's by the XDG rules."""
    systemd = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if systemd:
        return Path(systemd)
    home = os.environ.get("XDG_STATE_HOME", "")
    return (Path(home) if home else Path.home() / ".local" / "state") / "guidance"


class SignedStreams:
    """The bounds of the streams of one key.

    Args:
        path: The file; it need not exist.

    Attributes:
        at_start: Contents of the file when it was opened.
        unsaved: Number of frames that were used although the disk has no bound for them.

    Raises:
        ConfigError: If the file exists and cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.at_start = _read(path)
        self.unsaved = 0
        self._latest: dict[SignedStream, int] = {}
        self._bounds: dict[SignedStream, int] = {}
        self._waited: dict[SignedStream, int] = {}
        self._lock = threading.Lock()
        self._writing = threading.Lock()
        self._due = threading.Event()
        self._ended = False
        self._thread: threading.Thread | None = None

    def may_use(self, stream: SignedStream, timestamp: int) -> bool:
        """True if a genuine frame may be used: the file bounds its timestamp. If not, it is written at once."""
        with self._lock:
            self._latest[stream] = max(timestamp, self._latest.get(stream, 0))
            ahead = self._bounds.get(stream, -1) - timestamp
            if ahead < _RENEWED:
                if self._thread is None and not self._ended:
                    self._thread = threading.Thread(
                        target=self._keep, name="signed streams", daemon=True
                    )
                    self._thread.start()
                self._due.set()
            if ahead >= 0:
                self._waited[stream] = 0
                return True
            waited = self._waited.get(stream, 0) + 1
            self._waited[stream] = waited
            if waited <= MOST_FRAMES_WAITING:
                return False
            self.unsaved += 1
            return True

    def write(self, lead: int = _LEAD) -> None:
        """Write the file now, with bounds `lead` ticks ahead of the last timestamps, unless the disk refuses."""
        with self._writing, contextlib.suppress(OSError, ConfigError):
            with self._lock:
                own = {stream: timestamp + lead for stream, timestamp in self._latest.items()}
            if own == self._bounds:
                return
            private_folder(self.path.parent)
            with private_file(self.path.with_suffix(".lock")).open("w") as alone:
                fcntl.flock(alone, fcntl.LOCK_EX)
                # Other daemons with this key keep their bounds.
                rows = dict(own)
                for stream, bound in _read(self.path).items():
                    if bound != self._bounds.get(stream):
                        rows[stream] = max(bound, rows.get(stream, 0))
                named = {"/".join(map(str, stream)): rows[stream] for stream in sorted(rows)}
                draft = private_file(self.path.with_suffix(".new"))
                with draft.open("w", encoding="utf-8") as file:
                    file.write(json.dumps(named))
                    file.flush()
                    os.fsync(file.fileno())
                draft.replace(self.path)
            with self._lock:
                self._bounds = own

    def close(self) -> None:
        """End the thread and write the last timestamps. May be called twice."""
        self._ended = True
        self._due.set()
        if self._thread is not None:
            self._thread.join()
        if self._latest:
            self.write(lead=0)

    def _keep(self) -> None:
        while not self._ended:
            self._due.wait()
            self._due.clear()
            if not self._ended:
                self.write()


def _read(path: Path) -> dict[SignedStream, int]:
    """Read the file; empty if there is none.

    Raises:
        ConfigError: If it is not such a file.
    """
    if not path.exists():
        return {}
    said = f"timestamps of signed streams, {path}"
    damaged = f"{said}: damaged; see that nobody replays recorded frames, and remove it"
    text = text_of(path, said, secret=True)
    try:
        streams: dict[SignedStream, int] = {}
        for name, timestamp in json.loads(text[:_MOST_BYTES]).items():
            link_id, system_id, component_id = map(int, name.split("/"))
            streams[link_id, system_id, component_id] = timestamp
    except (ValueError, AttributeError, RecursionError) as error:
        raise ConfigError(damaged) from error
    for timestamp in streams.values():
        if type(timestamp) is not int or not 0 <= timestamp < _MOST_TIMESTAMP:
            raise ConfigError(damaged)
    return streams
