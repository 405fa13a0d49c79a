"""A sweep on disk: a manifest, and one Parquet file for each chunk.

A file is written under a temporary name, synchronised to the disk and then renamed. So a chunk is complete or missing,
also after a crash or a power failure, and missing chunks are computed again.
"""

import fcntl
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, text_of, writing
from guidance.log.writer import commit, versions_of
from guidance.sweeps.plan import ROW, Plan, plan_of_manifest
from guidance.sweeps.rows import DETERMINING, refuse_without_games

MANIFEST: Final = "sweep.json"
ROWS_FOLDER: Final = "rows"
"""Folder of the Parquet files only, so that other tools can read it as one table."""

END: Final = "end"
CAPTURED: Final = "captured"
PAIR = "pair"
POINT_NUMBER = "point"
SEED = "case_seed"
"""Columns that `Folder.columns` adds: number of the pair of policies, of the grid point, and the seed.

`CAPTURED` is 1 or 0, and NaN in an invalid row.
"""

Columns = dict[str, NDArray[Any]]
"""Columns of some rows, by name, (n,) each; texts are objects."""

_FORMAT: Final = 1
_CHUNKS_A_WORKER: Final = 4
_LARGEST_CHUNK: Final = {"maths": 4096, "teams": 512, "fast": 1}
"""Rows of a chunk at most: 2 to 20 s of work. Larger batches of games are slower, because they leave the cache."""


def write_whole(path: Path, content: bytes) -> None:
    """Write a complete file, or none.

    Raises:
        OSError: If it cannot be written; no partial file is left.
    """
    partial = path.with_name(f".{path.name}.partial")  # hidden from tools that read the folder
    try:
        with private_file(partial).open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


@dataclass(frozen=True)
class Folder:
    """A sweep's folder.

    Attributes:
        path: Of the folder.
        plan: Of the sweep.
        chunk_rows: Rows of a chunk.
    """

    path: Path
    plan: Plan
    chunk_rows: int

    def part(self, chunk: int) -> Path:
        """Return the path of a chunk's file."""
        name = f"part-{chunk:06d}.parquet"
        return self.path / ROWS_FOLDER / name

    def rows(self, chunk: int) -> range:
        """Return the numbers of a chunk's rows."""
        first = chunk * self.chunk_rows
        end = min(self.plan.rows, first + self.chunk_rows)
        return range(first, end)

    def has(self, chunk: int) -> bool:
        """Return True if a chunk's file has all rows: one for each game, with teams one for each evader."""
        games = len(self.rows(chunk))
        try:
            count = parquet.read_metadata(self.part(chunk)).num_rows
        except (FileNotFoundError, pa.ArrowInvalid):  # missing or damaged
            return False
        return bool(count >= games if self.plan.teams else count == games)

    @cached_property
    def missing(self) -> list[int]:
        """The chunks without a complete file at the first access."""
        chunks = math.ceil(self.plan.rows / self.chunk_rows)
        return [chunk for chunk in range(chunks) if not self.has(chunk)]

    @property
    def rows_there(self) -> int:
        """Number of rows in the other chunks."""
        missing = sum(len(self.rows(chunk)) for chunk in self.missing)
        return self.plan.rows - missing

    def keep(self, chunk: int, content: bytes) -> None:
        """Write a chunk's file.

        Raises:
            OutputError: If it cannot be written. Earlier chunks are kept.
        """
        with writing(
            self.part(chunk),
            "earlier rows are kept: make room, then run the same command to continue",
        ):
            write_whole(self.part(chunk), content)

    @property
    def parts(self) -> list[Path]:
        """The existing files, in the order of their rows."""
        return sorted((self.path / ROWS_FOLDER).glob("part-*.parquet"))

    def columns(self, names: Sequence[str]) -> Columns:
        """Read `ROW`, `END` and other columns of all rows, and add `PAIR`, `POINT_NUMBER`, `SEED` and `CAPTURED`."""
        table = parquet.read_table(self.parts, columns=[ROW, END, *names])
        read = {name: table[name].to_numpy() for name in table.column_names}
        pair, point, seed = self.plan.places(read[ROW])
        end = read[END]
        read[PAIR] = pair
        read[POINT_NUMBER] = point
        read[SEED] = seed
        read[CAPTURED] = np.where(end == "invalid", math.nan, end == CAPTURED)
        return read


def begin_or_continue(path: Path, plan: Plan, chunk_rows: int | None, workers: int = 1) -> Folder:
    """Begin a sweep in a folder, or continue the one in it.

    Args:
        path: The folder.
        plan: Of the sweep.
        chunk_rows: Rows of a chunk; None takes those of the folder, or the default.
        workers: Number of processes; a new folder has four chunks or more for each of several.

    Raises:
        ConfigError: If the folder holds another sweep, or other files, or all rows are invalid.
        OutputError: If it cannot be written.
    """
    refuse_without_games(plan)
    with writing(f"--out {path}"):
        private_folder(path)
        if (path / MANIFEST).is_file():
            return _resumed(path, plan, chunk_rows)
        visible = [child.name for child in path.iterdir() if not child.name.startswith(".")]
        if any(name != ROWS_FOLDER for name in visible):
            raise ConfigError(
                f"--out {path}: has files but no sweep ({MANIFEST}); choose a new folder"
            )
        private_folder(path / ROWS_FOLDER)
        largest = _LARGEST_CHUNK["teams" if plan.teams else plan.way]
        if workers == 1:
            default_rows = min(plan.rows, largest)
        else:
            chunks = _CHUNKS_A_WORKER * workers
            even_rows = math.ceil(plan.rows / chunks)
            default_rows = min(even_rows, largest)
        rows = chunk_rows if chunk_rows else default_rows
        manifest = {
            "format": _FORMAT,
            "digest": plan.digest,
            "rows": plan.rows,
            "chunk_rows": rows,
            "versions": versions_of(DETERMINING),
            "commit": commit(),
            **plan.document,
        }
        text = json.dumps(manifest, indent=1)
        write_whole(path / MANIFEST, text.encode())
    return Folder(path, plan, rows)


def read_folder(path: Path) -> Folder:
    """Open the folder of a sweep for reading.

    Raises:
        ConfigError: If it is not one, or has no rows yet.
    """
    manifest = _manifest(path)
    folder = Folder(path, plan_of_manifest(manifest), manifest["chunk_rows"])
    if not folder.parts:
        raise ConfigError(
            f"{path}: this sweep has no rows yet; continue it with guidance sweep … --out {path}"
        )
    return folder


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock a folder against a second process that writes into it.

    Raises:
        ConfigError: If another process has locked it.
        OutputError: If the folder cannot be written.
    """
    with writing(f"--out {path}"):
        lock = private_file(private_folder(path) / ".lock").open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            fault = "another process is writing this sweep; wait until it ends, or stop it"
            raise ConfigError(f"--out {path}: {fault}") from None
        yield


def _resumed(path: Path, plan: Plan, chunk_rows: int | None) -> Folder:
    manifest = _manifest(path)
    was = plan_of_manifest(manifest).decisive
    now = plan.decisive
    differing = [name for name in {**was, **now} if was.get(name) != now.get(name)]
    if differing:
        verb = "differs" if len(differing) == 1 else "differ"
        differ = f"{', '.join(differing)} {verb}"
        raise ConfigError(f"--out {path}: holds another sweep ({differ}); choose another folder")
    recorded = manifest["versions"]
    present = versions_of(DETERMINING)
    if recorded != present:
        changed = [package for package in present if recorded.get(package) != present[package]]
        words = [
            f"{package} {recorded.get(package)}, now {present[package]}" for package in changed
        ]
        raise ConfigError(
            f"--out {path}: was begun with {'; '.join(words)}: rows could differ; choose another folder"
        )
    if chunk_rows not in {None, manifest["chunk_rows"]}:
        raise ConfigError(
            f"--chunk {chunk_rows}: this sweep was begun with {manifest['chunk_rows']}; omit the option"
        )
    return Folder(path, plan, manifest["chunk_rows"])


def _manifest(path: Path) -> Mapping[str, Any]:
    if not (path / MANIFEST).is_file():
        raise ConfigError(f"{path}: not the folder of a sweep: it has no {MANIFEST}")
    manifest = read_json(path / MANIFEST)
    if manifest.get("format") != _FORMAT:
        raise ConfigError(f"{path / MANIFEST}: must be the manifest of a sweep, format {_FORMAT}")
    return manifest


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file; empty if it holds something else.

    Raises:
        ConfigError: If it cannot be read, or is not JSON.
    """
    try:
        document = json.loads(text_of(path, str(path), secret=False))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid JSON ({error})") from error
    if not isinstance(document, dict):
        return {}
    return document
