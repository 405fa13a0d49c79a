"""What the panel serves of flights that are over: their list, and what is made of one."""

import json
from typing import Final

from aiohttp import web

from guidance.errors import OutputError
from guidance.viz.panel.records import EXPORTS, RecordFolder

_KINDS: Final = {"frames": "application/json", "events": "text/plain", "report": "text/html"}
_REPORT_POLICY: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; frame-ancestors 'none'"


class Past:
    """Routes under `/records`.

    Args:
        records: Of the folder that the panel was told of.
    """

    def __init__(self, records: RecordFolder) -> None:
        self._records = records

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [web.get("/records", self._list), web.get("/records/{what}", self._one)]

    async def _list(self, _: web.Request) -> web.StreamResponse:
        try:
            rows = await self._records.listed()
        except (OutputError, TimeoutError, OSError, ValueError) as error:
            return web.json_response({"folder": str(self._records.folder), "error": str(error), "records": []})
        said = {"folder": str(self._records.folder), "exports": EXPORTS, "records": rows}
        return web.Response(text=json.dumps(said), content_type="application/json")

    async def _one(self, request: web.Request) -> web.StreamResponse:
        what, name = request.match_info["what"], request.query.get("record", "")
        try:
            made = await self._records.made(name, what)
        except (OutputError, TimeoutError, OSError) as error:
            return web.Response(status=500, text=str(error) or "it took too long")
        if made is None:
            return web.Response(status=404)
        kind = _KINDS.get(what, "application/octet-stream")
        answer = web.Response(body=made.path.read_bytes(), content_type=kind)
        if what in EXPORTS:
            answer.headers["Content-Disposition"] = f'attachment; filename="{made.name}"'
        elif what == "report":
            answer.headers["Content-Security-Policy"] = _REPORT_POLICY
        else:
            answer.enable_compression()
        return answer
