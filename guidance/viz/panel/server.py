"""The operator's page: its web server, a WebSocket per page for its data, and one URL for orders."""

import asyncio
import contextlib
import json
import signal
import socket
import traceback
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from aiohttp import WSCloseCode, WSMsgType, web

from guidance.errors import GuidanceError
from guidance.viz.panel.access import PAGE, Access, Listener, map_of
from guidance.viz.panel.hub import Hub
from guidance.viz.panel.records import RecordFolder

PANEL_NICE: Final = 5
"""Lower priority than the flight, but not the lowest: orders pass through the panel."""

SEND_INTERVAL_S: Final = 0.1
MAX_PAGES: Final = 64
MAX_QUEUED: Final = 20
"""Unsent messages of a page, two seconds of them. A page with more is disconnected; it reconnects by itself."""

KEEPALIVE_S: Final = 15.0
"""Idle time of a connection between two requests; then it is closed."""

_MAX_BYTES: Final = 4096


class OpenPage(NamedTuple):
    """A page that is open: its messages, and the task that sends them."""

    queue: asyncio.Queue[str]
    sending: asyncio.Task[None]


class PanelServer:
    """Serves the pages of one panel.

    Args:
        hub: Source of the data; receives the orders.
        access: Access rules.
        look: Whether orders are refused.
        records: Folder of the records; None shows none.
        tiles: Folder or server of the map tiles.

    Raises:
        ConfigError: As `map_of`.
    """

    def __init__(
        self, hub: Hub, access: Access, *, look: bool, records: Path | None, tiles: str
    ) -> None:
        self._hub = hub
        self._access = access
        self._look = look
        self._records = records
        self._tiles = tiles
        self._pages: dict[web.WebSocketResponse, OpenPage] = {}
        self._order_threads = ThreadPoolExecutor(16, thread_name_prefix="order")
        self._tile_url, tile_origin = map_of(tiles)
        images = f"img-src 'self' data: {tile_origin}".rstrip()
        policy = (
            f"default-src 'none'; script-src 'self'; style-src 'self'; {images}; connect-src 'self'"
        )
        self._headers = {
            "Content-Security-Policy": f"{policy}; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
            "Referrer-Policy": "same-origin",  # with "no-referrer", browsers send no Origin with the login form
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }

    async def serve(self, listening: socket.socket) -> None:
        """Serve until SIGINT or SIGTERM; see `serving`."""
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, ended.set)
        async with self.serving(listening):
            await ended.wait()

    @contextlib.asynccontextmanager
    async def serving(self, listening: socket.socket) -> AsyncIterator[None]:
        """Serve on a listening TCP socket, which the caller closes, and print the address of the page."""
        path = self._access.path
        application = web.Application(middlewares=[self._access.guard], client_max_size=_MAX_BYTES)
        application.on_response_prepare.append(self._harden)
        application.add_routes([
            web.get("/", self._access.enter),
            web.post("/login", self._access.login),
            web.get("/door.css", _file),
            web.get(path, _file),
            web.get(f"{path}replay", _file),
            web.static(f"{path}page", PAGE),
            web.get(rf"{path}tiles/{{tile:\d+/\d+/\d+}}.png", self._tile),
            web.get(f"{path}in", self._access.take_ticket),
            web.get(f"{path}invite", self._access.invite),
            web.get(f"{path}alive", self._alive),
            web.get(f"{path}live", self._live),
            web.post(f"{path}order", self._order),
        ])  # fmt: skip
        if self._records is not None:
            records = RecordFolder(self._records)
            application.add_routes(records.routes(path))
            application.on_shutdown.append(records.close)
        application.on_shutdown.append(self._shut_down)
        runner = web.AppRunner(
            application, access_log=None, shutdown_timeout=1.0, keepalive_timeout=KEEPALIVE_S
        )
        await runner.setup()
        assert runner.server is not None
        listener = Listener(runner.server, self._access.clock, self._access.tls)
        self._access.listener = listener
        tasks = [
            asyncio.create_task(listener.run(listening)),
            asyncio.create_task(self._send_changes()),
        ]
        self._access.announce()
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await runner.cleanup()

    async def _harden(self, _: web.Request, answer: web.StreamResponse) -> None:
        """Add the security headers."""
        for name, value in self._headers.items():
            answer.headers.setdefault(name, value)

    async def _tile(self, request: web.Request) -> web.StreamResponse:
        """Return a map tile of the local folder."""
        tile = _inside(Path(self._tiles), f"{request.match_info['tile']}.png")
        return web.Response(status=404) if tile is None else web.FileResponse(tile)

    async def _alive(self, request: web.Request) -> web.StreamResponse:
        """Return the page's options, and whether its origin is ours: only such pages get the WebSocket."""
        origin = request.query.get("origin", "")
        about = {
            "look": self._look,
            "records": self._records is not None,
            "tiles": self._tile_url,
            "here": self._access.is_own_origin(request, origin),
        }
        return web.json_response(about)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send data to one page until it closes: everything, then changes. It returns the operator's signs of life."""
        if len(self._pages) >= MAX_PAGES:
            return web.Response(status=503)
        page = web.WebSocketResponse(heartbeat=15.0, max_msg_size=_MAX_BYTES)
        await page.prepare(request)
        self._send()  # the others get the changes up to now: then everything is the same for all
        queue: asyncio.Queue[str] = asyncio.Queue(MAX_QUEUED)
        queue.put_nowait(self._hub.message(whole=True))
        sending = asyncio.create_task(_send_queued(page, queue))
        self._pages[page] = OpenPage(queue, sending)
        try:
            async for message in page:
                if message.type is WSMsgType.TEXT and not self._look:
                    # The key of the daemon that the page shows
                    self._hub.note_operator(str(message.data))
        finally:
            self._pages.pop(page, None)
            sending.cancel()
        return page

    async def _order(self, request: web.Request) -> web.StreamResponse:
        """Send an order to a daemon, or to its `team`, and return the list of answers."""
        if self._look:
            return web.json_response(
                [{"accepted": False, "reason": "this panel takes no orders (--look)"}], status=403
            )
        try:
            form = json.loads(await request.read())
            daemon, order, name = (str(form[key]) for key in ("daemon", "order", "by"))
            send = partial(self._hub.order, team=bool(form.get("team")))
        except (ValueError, KeyError, TypeError, RecursionError):
            return web.Response(status=400)
        by = f"panel, {name[:24]} at {request.remote}"
        loop = asyncio.get_running_loop()
        try:
            answers: Any = await loop.run_in_executor(self._order_threads, send, daemon, order, by)
        except GuidanceError as error:
            answers = [{"accepted": False, "order": order, "reason": str(error)}]
        return web.json_response(answers)

    async def _send_changes(self) -> None:
        """Send changes until cancelled. An error of our own is printed once and ends nothing."""
        printed = set[str]()
        while True:
            try:
                self._access.listener.close_late()
                self._hub.receive()
                if self._pages:
                    self._send()
            except Exception as error:
                if repr(error) not in printed:
                    printed.add(repr(error))
                    traceback.print_exception(error)
            await asyncio.sleep(SEND_INTERVAL_S)

    def _send(self) -> None:
        """Queue the changes for all pages. A page with a full queue is closed."""
        changes = self._hub.message()
        for connection, page in list(self._pages.items()):
            if page.queue.full():
                del self._pages[connection]
                page.sending.cancel()
            else:
                page.queue.put_nowait(changes)

    async def _shut_down(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.close(code=WSCloseCode.GOING_AWAY, message=b"the panel ends")
        self._order_threads.shutdown(wait=False, cancel_futures=True)


def _inside(folder: Path, name: str) -> Path | None:
    """Return a file of a folder; None if there is none, or it is a link that leads out of the folder."""
    file = (folder / name).resolve()
    return file if file.is_relative_to(folder.resolve()) and file.is_file() else None


async def _file(request: web.Request) -> web.StreamResponse:
    return web.FileResponse(PAGE / ("door.css" if request.path == "/door.css" else "index.html"))


async def _send_queued(page: web.WebSocketResponse, queue: asyncio.Queue[str]) -> None:
    """Send the messages of a queue until cancelled: the page has gone, or it was too slow."""
    with contextlib.suppress(ConnectionError):
        try:
            while True:
                await page.send_str(await queue.get())
        finally:
            await page.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
