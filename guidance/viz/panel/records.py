"""The records of a folder: a list, and reports, exports and replays of each.

Child processes of low priority make them.
"""

import asyncio
import contextlib
import json
import os
import sys
import tempfile
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from aiohttp import web

from guidance.errors import OutputError

MAX_LISTED: Final = 60
MAX_KEPT: Final = 24
"""Results kept on disk, the most recently used. A replay is a few megabytes."""

TIME_LIMIT_S: Final = 180.0
NICE: Final = 15
EXPORTS: Final = ("tlog", "csv", "parquet", "geojson", "kml")

_GUIDANCE: Final = "from guidance.cli import main; main()"
_PLAYBACK: Final = "guidance.viz.panel.playback"

_KINDS: Final = {"frames": "application/json", "events": "text/plain", "report": "text/html"}
_REPORT_POLICY: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'"


class Product(NamedTuple):
    """A file made from a record, and its name for downloads."""

    path: Path
    name: str


class RecordFolder:
    """The records of one folder: its `*.mcap` files and those of its subfolders.

    Args:
        folder: Folder of the records; it need not exist yet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._temporary = tempfile.TemporaryDirectory(prefix="guidance-panel-")
        self._outcomes: dict[tuple[str, int, int], Mapping[str, Any]] = {}
        self._products: OrderedDict[tuple[str, int, int, str], Path] = OrderedDict()
        self._one_at_a_time = asyncio.Lock()

    def paths(self) -> Mapping[str, Path]:
        """Return the records by name, newest first."""
        found = [*self.folder.glob("*.mcap"), *self.folder.glob("*/*.mcap")]
        dated = sorted(((path.stat().st_mtime, path) for path in found if path.is_file()), reverse=True)
        return {path.relative_to(self.folder).as_posix(): path for _, path in dated[:MAX_LISTED]}

    async def listed(self) -> Sequence[Mapping[str, Any]]:
        """List the records with their outcomes. Unchanged files are not read again.

        Raises:
            OutputError: If reading failed.
        """
        async with self._one_at_a_time:
            paths = self.paths()
            keys = {name: _key(name, path) for name, path in paths.items()}
            unread = [name for name, key in keys.items() if key not in self._outcomes]
            if unread:
                out = await self._run("-m", _PLAYBACK, "outcomes", *(str(paths[name]) for name in unread))
                outcomes = json.loads(out)
                fresh = {keys[name]: outcomes[str(paths[name])] for name in unread}
                known = {key: self._outcomes[key] for key in keys.values() if key in self._outcomes}
                self._outcomes = {**known, **fresh}
            rows = [{"record": name, "megabytes": _megabytes(path)} for name, path in paths.items()]
            return [{**row, **self._outcomes[keys[str(row["record"])]]} for row in rows]

    async def product(self, name: str, what: str) -> Product | None:
        """Make `frames`, `events`, `report` or one of `EXPORTS` from a record; None if the record or kind is unknown.

        Raises:
            OutputError: If making it failed.
        """
        path = self.paths().get(name)
        if path is None or what not in {"frames", "events", "report", *EXPORTS}:
            return None
        key = (*_key(name, path), what)
        async with self._one_at_a_time:
            if key not in self._products:
                self._products[key] = await self._make(path, what)
            self._products.move_to_end(key)
            while len(self._products) > MAX_KEPT:
                self._products.popitem(last=False)[1].unlink(missing_ok=True)
            stem = path.parent.name if path.stem == "record" else path.stem
            return Product(self._products[key], f"{stem}{self._products[key].suffix}")

    async def _make(self, path: Path, what: str) -> Path:
        folder = Path(tempfile.mkdtemp(dir=self._temporary.name))
        if what == "report":
            await self._run("-c", _GUIDANCE, "report", str(path), "--out", str(folder))
            return folder / "report.html"
        if what in EXPORTS:
            await self._run("-c", _GUIDANCE, "log", "export", str(path), str(folder / f"flight.{what}"))
            return folder / f"flight.{what}"
        arguments = ("-m", _PLAYBACK, "frames") if what == "frames" else ("-c", _GUIDANCE, "log", "events")
        made = folder / ("frames.json" if what == "frames" else "events.txt")
        made.write_bytes(await self._run(*arguments, str(path)))
        return made

    async def _run(self, *arguments: str) -> bytes:
        child = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",
            *arguments,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        with contextlib.suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, child.pid, NICE)
        try:
            out, err = await asyncio.wait_for(child.communicate(), TIME_LIMIT_S)
        except BaseException:
            if child.returncode is None:
                child.kill()
                await child.wait()
            raise
        if child.returncode != 0:
            raise OutputError(err.decode(errors="replace").strip()[-500:] or f"ended with {child.returncode}")
        return out

    def close(self) -> None:
        """Remove the files made here. May be called twice."""
        self._temporary.cleanup()


def _key(name: str, path: Path) -> tuple[str, int, int]:
    found = path.stat()
    return name, found.st_mtime_ns, found.st_size


def _megabytes(path: Path) -> float:
    return round(path.stat().st_size / 1e6, 2)


class RecordRoutes:
    """Routes under `records`.

    Args:
        records: The folder.
    """

    def __init__(self, records: RecordFolder) -> None:
        self._records = records

    def routes(self, path: str) -> list[web.RouteDef]:
        """Return the routes below a path that ends with a slash."""
        return [web.get(f"{path}records", self._list), web.get(f"{path}records/{{what}}", self._one)]

    async def _list(self, _: web.Request) -> web.StreamResponse:
        try:
            rows = await self._records.listed()
        except (OutputError, TimeoutError, OSError, ValueError) as error:
            return web.json_response({"folder": str(self._records.folder), "error": str(error), "records": []})
        listing = {"folder": str(self._records.folder), "exports": EXPORTS, "records": rows}
        return web.Response(text=json.dumps(listing), content_type="application/json")

    async def _one(self, request: web.Request) -> web.StreamResponse:
        what, name = request.match_info["what"], request.query.get("record", "")
        try:
            product = await self._records.product(name, what)
        except (OutputError, TimeoutError, OSError) as error:
            return web.Response(status=500, text=str(error) or f"not ready within {TIME_LIMIT_S:g} s")
        if product is None:
            return web.Response(status=404)
        kind = _KINDS.get(what, "application/octet-stream")
        answer = web.Response(body=product.path.read_bytes(), content_type=kind)
        if what in EXPORTS:
            answer.headers["Content-Disposition"] = f'attachment; filename="{product.name}"'
        elif what == "report":
            answer.headers["Content-Security-Policy"] = _REPORT_POLICY
        else:
            answer.enable_compression()
        return answer
