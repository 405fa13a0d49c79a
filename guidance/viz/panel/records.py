"""The records of a folder: a list, and reports, exports and replays of each.

Child processes of low priority read them. The list appears at once, and the details follow one record at a time.
"""

import asyncio
import contextlib
import json
import os
import re
import sys
import tempfile
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from guidance.errors import OutputError
from guidance.log.export import EXPORTS

MAX_LISTED: Final = 60
MAX_KEPT: Final = 24
"""Results kept on disk, the most recently used. A replay is a few megabytes."""

TIME_LIMIT_S: Final = 180.0
_NICE: Final = 15
_EXPORTS: Final = tuple(ending.removeprefix(".") for ending in EXPORTS)

_GUIDANCE: Final = ("-c", "from guidance.cli import main; main()")
_SNAPSHOTS: Final = ("-m", "guidance.viz.panel.snapshot")
_DOWNLOAD: Final = "application/octet-stream"
_MADE: Final[Mapping[str, tuple[tuple[str, ...], str, str]]] = {
    "frames": ((*_SNAPSHOTS, "frames", "RECORD"), "frames.json", "application/json"),
    "events": ((*_GUIDANCE, "log", "events", "RECORD"), "events.txt", "text/plain"),
    "report": ((*_GUIDANCE, "report", "RECORD", "--out", "FOLDER"), "report.html", "text/html"),
    **{
        end: (
            (*_GUIDANCE, "log", "export", "RECORD", f"FOLDER/flight.{end}"),
            f"flight.{end}",
            _DOWNLOAD,
        )
        for end in _EXPORTS
    },
}
"""Kind -> command, the file that it writes or that gets its output, content type."""

_REPORT_POLICY: Final = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'"
)

FileKey = tuple[str, int, int]
"""Name, modification time (ns) and size of a record: the same key means the same content."""


class RecordFolder:
    """The records of one folder: its `*.mcap` files, those of its flights, and those of the vehicles of team flights.

    Args:
        folder: Folder of the records; it need not exist yet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._temporary = tempfile.TemporaryDirectory(prefix="guidance-panel-")
        self._outcomes: dict[FileKey, Mapping[str, Any]] = {}
        self._products: dict[tuple[FileKey, str], Path] = {}  # the least recently used first
        self._one_at_a_time = asyncio.Lock()
        self._reading: asyncio.Task[None] | None = None

    def routes(self, path: str) -> list[web.RouteDef]:
        """Return the routes below a path that ends with a slash."""
        return [
            web.get(f"{path}records", self._list),
            web.get(f"{path}records/{{what}}", self._product),
        ]

    def paths(self) -> Mapping[str, Path]:
        """Return the records by name, newest first."""
        dated = list[tuple[float, Path]]()
        for depth in ("", "*/", "*/*/"):
            for path in self.folder.glob(f"{depth}*.mcap"):
                if path.is_file():
                    dated.append((path.stat().st_mtime, path))
        dated.sort(reverse=True)
        return {path.relative_to(self.folder).as_posix(): path for _, path in dated[:MAX_LISTED]}

    def listed(self) -> list[dict[str, Any]]:
        """List the records with the outcomes read so far, and begin to read the others."""
        paths = self.paths()
        keys = {name: _file_key(name, path) for name, path in paths.items()}
        self._outcomes = {
            key: self._outcomes[key] for key in keys.values() if key in self._outcomes
        }
        unread = {paths[name]: key for name, key in keys.items() if key not in self._outcomes}
        if unread and (self._reading is None or self._reading.done()):
            self._reading = asyncio.create_task(self._read(unread))
        rows = list[dict[str, Any]]()
        for name, key in keys.items():
            _, _, size_bytes = key
            outcome = self._outcomes.get(key, {"reading": True})
            rows.append({"record": name, "megabytes": round(size_bytes / 1e6, 2), **outcome})
        return rows

    async def listed_whole(self) -> list[dict[str, Any]]:
        """List the records as soon as all outcomes are read."""
        self.listed()
        if self._reading is not None:
            await self._reading
        return self.listed()

    async def _read(self, unread: Mapping[Path, FileKey]) -> None:
        """Read the outcomes in one child, which prints each as a line."""
        with contextlib.suppress(OutputError, TimeoutError, OSError, ValueError):
            async for line in output_lines(*_SNAPSHOTS, "outcomes", *map(str, unread)):
                path, outcome = json.loads(line)
                self._outcomes[unread[Path(path)]] = outcome
        for path, key in unread.items():
            self._outcomes.setdefault(key, {"error": f"{path}: cannot be read"})

    async def product(self, name: str, what: str) -> Path | None:
        """Make a file of a record, of a kind of `_MADE`; None if the record or kind is unknown.

        Raises:
            OutputError: If making it failed.
        """
        path = self.paths().get(name)
        if path is None or what not in _MADE:
            return None
        key = (_file_key(name, path), what)
        async with self._one_at_a_time:
            product = self._products.pop(key, None)
            if product is None:
                folder = Path(tempfile.mkdtemp(dir=self._temporary.name))
                command, written, _ = _MADE[what]
                words = list[str]()
                for word in command:
                    words.append(
                        str(path) if word == "RECORD" else word.replace("FOLDER", str(folder))
                    )
                output = b"".join([line async for line in output_lines(*words)])
                made = folder / written
                if not made.exists():
                    made.write_bytes(output)
                stem = path.parent.name if path.stem == "record" else path.stem
                product = made.rename(folder / f"{stem}{made.suffix}")
            self._products[key] = product
            while len(self._products) > MAX_KEPT:
                oldest = next(iter(self._products))
                self._products.pop(oldest).unlink(missing_ok=True)
        return product

    async def _list(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(
            {"folder": str(self.folder), "exports": _EXPORTS, "records": self.listed()}
        )

    async def _product(self, request: web.Request) -> web.StreamResponse:
        what = request.match_info["what"]
        name = request.query.get("record", "")
        try:
            product = await self.product(name, what)
        except TimeoutError:
            return web.Response(status=500, text=f"not ready within {TIME_LIMIT_S:g} s")
        except (OutputError, OSError) as error:
            return web.Response(status=500, text=str(error))
        if product is None:
            return web.Response(status=404)
        _, _, kind = _MADE[what]
        answer = web.Response(body=product.read_bytes(), content_type=kind)
        if kind == _DOWNLOAD:
            # The name of a file may have any characters.
            plain = re.sub(r"[^A-Za-z0-9._-]", "-", product.name)
            answer.headers["Content-Disposition"] = f'attachment; filename="{plain}"'
        elif what == "report":
            answer.headers["Content-Security-Policy"] = _REPORT_POLICY
        else:
            answer.enable_compression()
        return answer

    async def close(self, _: web.Application | None = None) -> None:
        """Stop reading and remove the files made here."""
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        self._temporary.cleanup()


async def output_lines(*arguments: str) -> AsyncIterator[bytes]:
    """Run Python and yield its output, line by line.

    Raises:
        OutputError: If it fails.
        TimeoutError: After `TIME_LIMIT_S`.
    """
    pipe = asyncio.subprocess.PIPE
    none = asyncio.subprocess.DEVNULL
    words = (sys.executable, "-P", *arguments)
    child = await asyncio.create_subprocess_exec(
        *words, stdin=none, stdout=pipe, stderr=pipe, limit=2**28
    )
    assert child.stdout is not None
    assert child.stderr is not None
    with contextlib.suppress(ProcessLookupError):
        os.setpriority(os.PRIO_PROCESS, child.pid, _NICE)
    try:
        async with asyncio.timeout(TIME_LIMIT_S):
            reading_errors = asyncio.create_task(child.stderr.read())
            async for line in child.stdout:
                yield line
            error = (await reading_errors).decode(errors="replace").strip()
            code = await child.wait()
    finally:
        if child.returncode is None:
            child.kill()
            await child.wait()
    if code != 0:
        raise OutputError(error[-500:] if error else f"ended with {code}")


def _file_key(name: str, path: Path) -> FileKey:
    status = path.stat()
    return name, status.st_mtime_ns, status.st_size
