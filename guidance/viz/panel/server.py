"""The panel's web server: the page, a WebSocket per page for its data, and one URL for orders."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from typing import Any, Final
from urllib.parse import parse_qs

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from guidance.clock import Clock
from guidance.errors import LinkError
from guidance.viz.panel.access import Access, PasswordThrottle, origin_of
from guidance.viz.panel.hub import Hub
from guidance.viz.panel.listener import Listener
from guidance.viz.panel.records import RecordFolder, RecordRoutes

SEND_INTERVAL_S: Final = 0.1
MAX_PAGES: Final = 64
MAX_QUEUED: Final = 20
"""Unsent messages of a page, two seconds of them. A page with more is disconnected; it reconnects by itself."""

KEEPALIVE_S: Final = 15.0
"""Idle time of a connection between two requests; then it is closed."""

_MAX_BYTES: Final = 4096
_MAX_NAME_LENGTH: Final = 24
_MAX_ORDERS_AT_ONCE: Final = 16
_PUBLIC: Final = frozenset({"/", "/login", "/door.css"})
_CONTENT_TYPES: Final = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Pages:
    """All open pages. Each has a queue, so that a slow page does not delay the others."""

    def __init__(self) -> None:
        self._joining: list[asyncio.Queue[str | None]] = []
        self._open: dict[asyncio.Queue[str | None], web.WebSocketResponse] = {}

    def __len__(self) -> int:
        return len(self._open)

    def add(self, page: web.WebSocketResponse) -> "asyncio.Queue[str | None]":
        """Add a page and return its queue. Its first message is a snapshot of everything."""
        queue: asyncio.Queue[str | None] = asyncio.Queue(MAX_QUEUED)
        self._open[queue] = page
        self._joining.append(queue)
        return queue

    def remove(self, queue: "asyncio.Queue[str | None]") -> None:
        """Remove a page."""
        self._open.pop(queue, None)

    def send(self, hub: Hub) -> None:
        """Send changes to the pages that have the previous message, and snapshots to the new ones."""
        joining, self._joining = self._joining, []
        if len(self._open) > len(joining):
            changes = hub.message()
            for queue in self._open:
                if queue not in joining:
                    self._put(queue, changes)
        else:
            hub.mark_sent()
        if joining:
            snapshot = hub.message(whole=True)
            for queue in joining:
                self._put(queue, snapshot)

    @staticmethod
    def _put(queue: "asyncio.Queue[str | None]", message: str | None) -> None:
        if queue.full():
            while not queue.empty():
                queue.get_nowait()
            message = None
        queue.put_nowait(message)

    async def close(self) -> None:
        """Close all pages."""
        for page in list(self._open.values()):
            await page.close(code=WSCloseCode.GOING_AWAY, message=b"the panel ends")


class PanelServer:
    """Serves the pages of one panel.

    Args:
        hub: Source of the data; receives the orders.
        access: Access rules.
        clock: Time of login deadlines and password attempts.
        look: Refuse all orders.
        records: Finished flights; None if no folder is configured.
        tiles: URL of map tiles with {z}, {x} and {y}; empty for no map.
        say: Prints a line.
    """

    def __init__(
        self,
        hub: Hub,
        access: Access,
        clock: Clock,
        *,
        look: bool = False,
        records: RecordFolder | None = None,
        tiles: str = "",
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._hub = hub
        self._access = access
        self._clock = clock
        self._look = look
        self._records = records
        self._tiles = tiles
        self._say = say
        self._address = ""
        self._pages = Pages()
        self._throttle = PasswordThrottle(clock)
        self._listener: Listener | None = None
        self._order_threads = ThreadPoolExecutor(_MAX_ORDERS_AT_ONCE, thread_name_prefix="order")
        self._headers = {
            "Content-Security-Policy": "; ".join((
                "default-src 'none'",
                "script-src 'self'",
                "style-src 'self'",
                f"img-src 'self' data: {origin_of(tiles) if tiles else ''}".rstrip(),
                "connect-src 'self'",
                "base-uri 'none'",
                "form-action 'self'",
                "frame-ancestors 'none'",
            )),
            "Referrer-Policy": "same-origin",  # with "no-referrer", browsers send no Origin with the login form
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }  # fmt: skip

    @contextlib.asynccontextmanager
    async def serving(self, listening: socket.socket, host: str) -> AsyncIterator[None]:
        """Serve on a listening socket, and print the address of the page.

        Args:
            listening: A listening TCP socket. The caller closes it.
            host: Host name of the page's address.
        """
        runner = web.AppRunner(
            self._application(), access_log=None, shutdown_timeout=1.0, keepalive_timeout=KEEPALIVE_S
        )
        await runner.setup()
        assert runner.server is not None
        self._listener = Listener(runner.server, self._clock, self._access.tls)
        tasks = [asyncio.create_task(one) for one in (self._listener.run(listening), self._send_changes())]
        named = f"[{host}]" if ":" in host else host
        self._address = f"{self._access.scheme}://{named}:{listening.getsockname()[1]}/"
        self._print_address()
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await runner.cleanup()

    def _print_address(self, remark: str = "") -> None:
        """Print the URL of the page. Its token works once, so each use prints the next."""
        query = "  (asks for the password)" if self._access.needs_password else f"?token={self._access.token}"
        with contextlib.suppress(OSError):  # the output is closed
            self._say(f"panel    {self._address}{query}{remark}")

    def _application(self) -> web.Application:
        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guarded(request, handler)

        path = self._access.path
        application = web.Application(middlewares=[guarded], client_max_size=_MAX_BYTES)
        application.add_routes([
            web.get("/", self._enter),
            web.post("/login", self._login),
            web.get("/door.css", self._door_style),
            web.get(path, self._index),
            web.get(f"{path}replay", self._index),
            web.get(f"{path}page/{{name}}", self._file),
            web.get(f"{path}alive", self._alive),
            web.get(f"{path}live", self._live),
            web.post(f"{path}order", self._order),
        ])  # fmt: skip
        if self._records is not None:
            application.add_routes(RecordRoutes(self._records).routes(path))
        application.on_shutdown.append(self._shut_down)
        return application

    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Check access, and add the security headers to every answer."""
        status = self._refusal(request)
        try:
            answer = await handler(request) if status is None else self._refused(request, status)
        except web.HTTPException as error:
            answer = web.Response(status=error.status)
        if not answer.prepared:
            for name, value in self._headers.items():
                answer.headers.setdefault(name, value)
        return answer

    def _refusal(self, request: web.Request) -> int | None:
        """Return the status of a refused request, None if it is allowed."""
        access, host = self._access, request.host
        if not access.accepts_host(host):
            return 421
        if access.has_cookie(request.cookies):
            if self._listener is not None:
                self._listener.admit(request.protocol)
        elif request.path not in _PUBLIC:
            return 403
        protected = request.method != "GET" or request.path == f"{access.path}live"
        return 403 if protected and not access.is_same_origin(host, request.headers.get("Origin", "")) else None

    def _refused(self, request: web.Request, status: int) -> web.Response:
        """Explain a refusal to a person; scripts get the status only."""
        is_page = request.method == "GET" and request.headers.get("Accept", "").startswith("text/html")
        return self._door(status) if status == 403 and is_page else web.Response(status=status)

    def _door(self, status: int, reason: str = "") -> web.Response:
        """Return the login page, or the page that asks for a new URL where no password is set."""
        if not self._access.needs_password:
            return page_file("denied.html", status)
        answer = page_file("login.html", status)
        if reason:
            answer.text = (answer.text or "").replace(" hidden></p>", f">{reason}</p>", 1)
        return answer

    async def _enter(self, request: web.Request) -> web.StreamResponse:
        """Exchange the token of the URL for the cookie."""
        if self._access.use_token(request.query.get("token", "")):
            self._print_address("  (for another browser)")
            return self._let_in()
        return self._door(200 if self._access.needs_password else 403)

    async def _login(self, request: web.Request) -> web.StreamResponse:
        """Exchange the password for the cookie."""
        if not self._access.needs_password:
            return web.Response(status=404)
        address = request.remote or ""
        if self._throttle.is_blocked(address):
            return self._door(429, "Wait a second between two passwords.")
        form = parse_qs((await request.read()).decode(errors="replace"))
        if self._access.is_password(form.get("password", [""])[0]):
            return self._let_in()
        self._throttle.block(address)
        return self._door(403, "That was not the password.")

    def _let_in(self) -> web.Response:
        answer = web.Response(status=303, headers={"Location": self._access.path})
        answer.set_cookie(
            self._access.cookie,
            self._access.session,
            path=self._access.path,
            httponly=True,
            # With Strict, a URL that was clicked in a terminal inside a browser would lose the cookie on the redirect.
            samesite="Lax",
            secure=self._access.scheme == "https",
        )
        return answer

    async def _index(self, _: web.Request) -> web.StreamResponse:
        return page_file("index.html")

    async def _door_style(self, _: web.Request) -> web.StreamResponse:
        return page_file("door.css")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        return page_file(request.match_info["name"])

    async def _alive(self, _: web.Request) -> web.StreamResponse:
        return web.json_response({"look": self._look, "records": self._records is not None, "tiles": self._tiles})

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Send data to one page until it closes."""
        if len(self._pages) >= MAX_PAGES:
            return web.Response(status=503)
        page = web.WebSocketResponse(heartbeat=15.0, max_msg_size=_MAX_BYTES)
        await page.prepare(request)
        queue = self._pages.add(page)
        sending = asyncio.create_task(_send_queued(page, queue))
        try:
            async for message in page:
                self._note_operator(message)
        finally:
            self._pages.remove(queue)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sending
        return page

    def _note_operator(self, message: WSMessage) -> None:
        """Pass on an operator's sign of life. The message is the key of the daemon that the page shows."""
        if message.type is WSMsgType.TEXT and not self._look:
            self._hub.note_operator(str(message.data))

    async def _order(self, request: web.Request) -> web.StreamResponse:
        """Send an order, and answer with the daemon's answer."""
        if self._look:
            return web.json_response({"accepted": False, "reason": "this panel takes no orders (--look)"}, status=403)
        try:
            form = json.loads(await request.read())
            daemon, order, name = (str(form[key]) for key in ("daemon", "order", "by"))
        except (ValueError, KeyError, TypeError, RecursionError):
            return web.Response(status=400)
        by = f"panel, {name[:_MAX_NAME_LENGTH]} at {request.remote}"
        loop = asyncio.get_running_loop()
        try:
            answer: Any = await loop.run_in_executor(self._order_threads, self._hub.order, daemon, order, by)
        except LinkError as error:
            answer = {"accepted": False, "order": order, "reason": str(error)}
        return web.json_response(answer)

    async def _send_changes(self) -> None:
        while True:
            if self._listener is not None:
                self._listener.close_late()
            self._hub.receive()
            self._pages.send(self._hub)
            await asyncio.sleep(SEND_INTERVAL_S)

    async def _shut_down(self, _: web.Application) -> None:
        await self._pages.close()
        self._order_threads.shutdown(wait=False, cancel_futures=True)


async def _send_queued(page: web.WebSocketResponse, queue: "asyncio.Queue[str | None]") -> None:
    """Send the messages of a queue. None closes the page: it was too slow."""
    with contextlib.suppress(ConnectionError):
        while (message := await queue.get()) is not None:
            await page.send_str(message)
        await page.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")


def page_file(name: str, status: int = 200) -> web.Response:
    """Return a file of the page.

    Raises:
        aiohttp.web.HTTPNotFound: If there is no such file.
    """
    kind = _CONTENT_TYPES.get(name[name.rfind(".") :])
    file = resources.files("guidance.viz.panel") / "page" / name
    if kind is None or "/" in name or "\\" in name or not file.is_file():
        raise web.HTTPNotFound
    return web.Response(status=status, body=file.read_bytes(), content_type=kind, charset="utf-8")
