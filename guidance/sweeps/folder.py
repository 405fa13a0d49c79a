"""A sweep on disk: a manifest that says what it is, and one Parquet file for each chunk, there whole or not at all.

A file is written under another name, brought to the disk and then renamed, so that whatever happens to the process or
to the power, a chunk that is there is complete and one that is not is computed again.
"""

import errno
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from pyarrow import parquet

from guidance.errors import ConfigError, OutputError
from guidance.files import private_file, private_folder
from guidance.log.provenance import PACKAGE, commit
from guidance.sweeps.chunk import chunks_of, rows_of
from guidance.sweeps.plan import Plan, plan_of

MANIFEST: Final = "sweep.json"
ROWS: Final = "rows"
"""Folder of the Parquet files, and of nothing else: every tool reads it as one table."""

_FORMAT: Final = 1
_PARTIAL: Final = ".partial"

Write = Callable[[Path, bytes], None]


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all.

    Raises:
        OSError: If it cannot be written; then nothing of it is left.
    """
    partial = path.with_name(f".{path.name}{_PARTIAL}")  # hidden, so that nobody takes it for rows
    try:
        with private_file(partial).open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


@dataclass(frozen=True, slots=True)
class Folder:
    """A sweep's folder.

    Attributes:
        path: Where it is.
        plan: What it is a sweep of.
        chunk_rows: Rows of a chunk.
        write: How a file is written.
    """

    path: Path
    plan: Plan
    chunk_rows: int
    write: Write = write_whole

    @property
    def chunks(self) -> int:
        """How many chunks the whole sweep has."""
        return chunks_of(self.plan, self.chunk_rows)

    def part(self, chunk: int) -> Path:
        """Return where a chunk's rows are, or will be."""
        return self.path / ROWS / f"part-{chunk:06d}.parquet"

    def rows(self, chunk: int) -> range:
        """Return the numbers of a chunk's rows."""
        return rows_of(self.plan, chunk, self.chunk_rows)

    def _whole(self, count: int, chunk: int) -> bool:
        """Say whether so many rows are a chunk's: one for each game, or in games of teams one for each evader."""
        games = len(self.rows(chunk))
        return count >= games if self.plan.teams else count == games

    def has(self, chunk: int) -> bool:
        """Whether a chunk is there with all of its rows."""
        part = self.part(chunk)
        try:
            return part.is_file() and self._whole(parquet.read_metadata(part).num_rows, chunk)
        except pa.ArrowInvalid:  # damaged by something else than a sweep
            return False

    def keep(self, chunk: int, content: bytes) -> None:
        """Write a chunk's file.

        Raises:
            OutputError: If it cannot be written. All chunks written before stay.
        """
        try:
            self.write(self.part(chunk), content)
        except OSError as error:
            reason = "the disk is full" if error.errno == errno.ENOSPC else error.strerror or str(error)
            raise OutputError(
                f"{self.part(chunk)}: cannot be written ({reason}); all rows written before are kept: make room, and "
                "the same command goes on from there"
            ) from error

    @property
    def parts(self) -> list[Path]:
        """The files of the chunks that are there, in the order of their rows."""
        return [self.part(chunk) for chunk in range(self.chunks) if self.part(chunk).is_file()]


def opened(path: Path, plan: Plan, chunk_rows: int | None, default_rows: Callable[[], int]) -> Folder:
    """Begin a sweep in a folder, or go on with the one that is there.

    Args:
        path: The folder.
        plan: What is swept.
        chunk_rows: Rows of a chunk as asked for, None if not.
        default_rows: Tells the rows of a chunk where nothing was asked for and nothing is there.

    Raises:
        ConfigError: If the folder holds another sweep, or something else.
        OutputError: If it cannot be written.
    """
    try:
        private_folder(path)
        if (path / MANIFEST).is_file():
            return _resumed(path, plan, chunk_rows)
        if any(child for child in path.iterdir() if not child.name.startswith(".") and child.name != ROWS):
            raise ConfigError(f"--out {path}: holds files and no sweep ({MANIFEST}); give a new folder")
        private_folder(path / ROWS)
        rows = chunk_rows or default_rows()
        manifest = {
            "format": _FORMAT,
            "digest": plan.digest,
            "rows": plan.rows,
            "chunk_rows": rows,
            "versions": _versions(),
            "commit": commit(),
            **plan.document,
        }
        write_whole(path / MANIFEST, json.dumps(manifest, indent=1).encode())
    except OSError as error:
        raise OutputError(f"--out {path}: cannot be written ({error.strerror}); choose another folder") from error
    return Folder(path, plan, rows)


def read_folder(path: Path) -> Folder:
    """Open the folder of a sweep to read it.

    Raises:
        ConfigError: If it is none.
    """
    manifest = _manifest(path)
    folder = Folder(path, plan_of(manifest), manifest["chunk_rows"])
    if not folder.parts:
        raise ConfigError(
            f"{path}: no row of this sweep has been written yet; go on with guidance sweep … --out {path}"
        )
    return folder


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Keep a second process from writing into a folder.

    Raises:
        ConfigError: If one does already.
        OutputError: If the folder cannot be written.
    """
    if sys.platform == "win32":  # has no advisory locks on files; both would write the same bytes there
        yield
        return
    import fcntl  # noqa: PLC0415 - not on every system

    try:
        lock = private_file(private_folder(path) / ".lock").open("w")
    except OSError as error:
        raise OutputError(f"--out {path}: cannot be written ({error.strerror}); choose another folder") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ConfigError(f"--out {path}: another process is writing this sweep; wait for it, or end it") from None
        yield


def _resumed(path: Path, plan: Plan, chunk_rows: int | None) -> Folder:
    manifest = _manifest(path)
    if manifest["digest"] != plan.digest:
        was = plan_of(manifest).decisive
        differing = [name for name, value in plan.decisive.items() if was[name] != value]
        raise ConfigError(
            f"--out {path}: holds another sweep ({', '.join(differing)} differ{'s' * (len(differing) == 1)}); "
            "give another folder"
        )
    if manifest["versions"] != _versions():
        was, now = manifest["versions"], _versions()
        changed = [f"{name} {was.get(name)}, now {now[name]}" for name in now if was.get(name) != now[name]]
        raise ConfigError(f"--out {path}: was begun with {'; '.join(changed)}: rows could differ; give another folder")
    if chunk_rows not in {None, manifest["chunk_rows"]}:
        raise ConfigError(f"--chunk {chunk_rows}: this sweep was begun with {manifest['chunk_rows']}; leave it out")
    return Folder(path, plan, manifest["chunk_rows"])


def _manifest(path: Path) -> Mapping[str, Any]:
    try:
        manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: is no sweep's folder; it has no {MANIFEST}") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path / MANIFEST}: cannot be read ({error})") from error
    if not isinstance(manifest, dict) or manifest.get("format") != _FORMAT:
        raise ConfigError(f"{path / MANIFEST}: must be a sweep's, of format {_FORMAT}")
    return manifest


def _versions() -> dict[str, str]:
    """What the numbers depend on."""
    return {"python": platform.python_version(), **{name: version(name) for name in (PACKAGE, "numpy", "pyarrow")}}
