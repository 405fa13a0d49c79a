"""Where a flight's files go, and its record."""

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from guidance.errors import ConfigError
from guidance.log.background import BackgroundRecorder
from guidance.log.writer import Recorder

RECORD: Final = "record.mcap"
PICTURE: Final = "flight.png"
OUTCOME: Final = "outcome.json"


def next_folder(parent: Path, stem: str) -> Path:
    """Return the first of `parent/stem-001`, `-002`, … that is not there yet."""
    return next(folder for number in itertools.count(1) if not (folder := parent / f"{stem}-{number:03d}").exists())


@contextlib.contextmanager
def recording(path: Path, metadata: Mapping[str, str], *, real_time: bool) -> Iterator[Recorder | BackgroundRecorder]:
    """Open the record. In real time it is written from a thread of its own: a slow disk holds up no cycle."""
    try:
        written = Recorder(path, metadata)
    except OSError as error:
        raise ConfigError(
            f"--out {path.parent}: cannot be written ({error.strerror}); choose another folder"
        ) from error
    recorder = BackgroundRecorder(written) if real_time else written
    try:
        yield recorder
    finally:
        recorder.close()
