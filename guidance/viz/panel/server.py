"""The operator's page: its web server, a WebSocket per page for its data, and one URL for orders."""

import asyncio
import contextlib
import json
import os
import signal
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qs

from aiohttp import WSCloseCode, WSMsgType, web

from guidance.clock import Clock, MonotonicClock
from guidance.errors import LinkError
from guidance.links.zenoh_access import read_credentials
from guidance.viz.panel.access import DEFAULT_TILES, Access, Listener, PasswordThrottle, listen, map_of, remote_access
from guidance.viz.panel.hub import DaemonBus, Hub
from guidance.viz.panel.records import RecordFolder

NICE: Final = 5
"""Lower priority than the flight, but not the lowest: orders pass through the panel."""

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
_PAGE: Final = Path(__file__).with_name("page")

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class PanelOptions(NamedTuple):
    """Options of `guidance panel`; see its `--help`."""

    endpoints: Sequence[str]
    token_file: Path | None = None
    host: str = "127.0.0.1"
    port: int = 8088
    look: bool = False
    records: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    password_file: Path | None = None
    tiles: str = DEFAULT_TILES
    zenoh: Path | None = None


def serve_panel(options: PanelOptions, say: Callable[[str], None]) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        options: Options of the command line.
        say: Prints a line.

    Raises:
        ConfigError: If an option is not allowed.
        LinkError: If the port is in use.
    """
    map_of(options.tiles)
    credentials = read_credentials(options.zenoh)
    security = remote_access(options.host, options.certificate, options.key, options.password_file)
    with listen(options.host, options.port) as listening:
        access = Access(listening.getsockname()[1], security)
        os.nice(NICE)
        clock = MonotonicClock()
        buses = [DaemonBus(one, options.token_file, clock, credentials) for one in options.endpoints]
        with contextlib.closing(Hub(buses, clock)) as hub:
            asyncio.run(_serve(PanelServer(hub, access, clock, options, say), listening))


async def _serve(server: "PanelServer", listening: socket.socket) -> None:
    ended, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    async with server.serving(listening):
        await ended.wait()


class PanelServer:
    """Serves the pages of one panel.

    Args:
        hub: Source of the data; receives the orders.
        access: Access rules.
        clock: Time of login deadlines and password attempts.
        options: Host, records, map tiles, and whether orders are refused.
        say: Prints a line.
    """

    def __init__(
        self, hub: Hub, access: Access, clock: Clock, options: PanelOptions, say: Callable[[str], None]
    ) -> None:
        self._hub, self._access, self._clock, self._options, self._say = hub, access, clock, options, say
        self._address = ""
        self._pages: dict[web.WebSocketResponse, tuple[asyncio.Queue[str], asyncio.Task[None]]] = {}
        self._throttle = PasswordThrottle(clock)
        self._listener: Listener  # since `serving`
        self._order_threads = ThreadPoolExecutor(_MAX_ORDERS_AT_ONCE, thread_name_prefix="order")
        self._tile_url, tile_origin = map_of(options.tiles)
        images = f"img-src 'self' data: {tile_origin}".rstrip()
        policy = f"default-src 'none'; script-src 'self'; style-src 'self'; {images}; connect-src 'self'"
        self._headers = {
            "Content-Security-Policy": f"{policy}; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
            "Referrer-Policy": "same-origin",  # with "no-referrer", browsers send no Origin with the login form
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }

    @contextlib.asynccontextmanager
    async def serving(self, listening: socket.socket) -> AsyncIterator[None]:
        """Serve on a listening TCP socket, which the caller closes, and print the address of the page."""
        runner = web.AppRunner(
            self._application(), access_log=None, shutdown_timeout=1.0, keepalive_timeout=KEEPALIVE_S
        )
        await runner.setup()
        assert runner.server is not None
        self._listener = Listener(runner.server, self._clock, self._access.tls)
        tasks = [asyncio.create_task(one) for one in (self._listener.run(listening), self._send_changes())]
        host = f"[{self._options.host}]" if ":" in self._options.host else self._options.host
        self._address = f"{self._access.scheme}://{host}:{listening.getsockname()[1]}/"
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
        path = self._access.path
        application = web.Application(middlewares=[self._guarded], client_max_size=_MAX_BYTES)
        application.on_response_prepare.append(self._harden)
        application.add_routes([
            web.get("/", self._enter),
            web.post("/login", self._login),
            web.get("/door.css", _file),
            web.get(path, _file),
            web.get(f"{path}replay", _file),
            web.static(f"{path}page", _PAGE),
            web.get(rf"{path}tiles/{{tile:\d+/\d+/\d+}}.png", self._tile),
            web.get(f"{path}alive", self._alive),
            web.get(f"{path}live", self._live),
            web.post(f"{path}order", self._order),
        ])  # fmt: skip
        if self._options.records is not None:
            records = RecordFolder(self._options.records)
            application.add_routes(records.routes(path))
            application.on_shutdown.append(records.close)
        application.on_shutdown.append(self._shut_down)
        return application

    async def _harden(self, _: web.Request, answer: web.StreamResponse) -> None:
        """Add the security headers."""
        for name, value in self._headers.items():
            answer.headers.setdefault(name, value)

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Explain a refusal to a person; scripts get the status only."""
        status = self._refusal(request)
        if status is None:
            return await handler(request)
        is_page = request.method == "GET" and request.headers.get("Accept", "").startswith("text/html")
        return self._door(status) if status == 403 and is_page else web.Response(status=status)

    def _refusal(self, request: web.Request) -> int | None:
        """Return the status of a refused request, None if it is allowed."""
        access, host = self._access, request.host
        if not access.accepts_host(host):
            return 421
        if access.has_cookie(request.cookies):
            self._listener.admit(request.protocol)
        elif request.path not in _PUBLIC:
            return 403
        protected = request.method != "GET" or request.path == f"{access.path}live"
        return 403 if protected and not access.is_same_origin(host, request.headers.get("Origin", "")) else None

    def _door(self, status: int, reason: str = "") -> web.Response:
        """Return the login page, or the page that asks for a new URL where no password is set."""
        text = (_PAGE / ("login.html" if self._access.needs_password else "denied.html")).read_text(encoding="utf-8")
        if reason:
            text = text.replace(" hidden></p>", f">{reason}</p>", 1)
        return web.Response(status=status, text=text, content_type="text/html")

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
        access, secure = self._access, self._access.needs_password
        answer = web.Response(status=303, headers={"Location": access.path})
        # With Strict, a URL that was clicked in a terminal inside a browser would lose the cookie on the redirect.
        answer.set_cookie(access.cookie, access.session, path=access.path, httponly=True, samesite="Lax", secure=secure)
        return answer

    async def _tile(self, request: web.Request) -> web.StreamResponse:
        """Return a map tile of the local folder."""
        return web.FileResponse(Path(self._options.tiles, f"{request.match_info['tile']}.png"))

    async def _alive(self, _: web.Request) -> web.StreamResponse:
        look, records = self._options.look, self._options.records is not None
        return web.json_response({"look": look, "records": records, "tiles": self._tile_url})

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
        self._pages[page] = queue, sending
        try:
            async for message in page:
                if message.type is WSMsgType.TEXT and not self._options.look:
                    self._hub.note_operator(str(message.data))  # the key of the daemon that the page shows
        finally:
            self._pages.pop(page, None)
            sending.cancel()
        return page

    async def _order(self, request: web.Request) -> web.StreamResponse:
        """Send an order to a daemon, or to its `team`, and return the list of answers."""
        if self._options.look:
            return web.json_response([{"accepted": False, "reason": "this panel takes no orders (--look)"}], status=403)
        try:
            form = json.loads(await request.read())
            daemon, order, name = (str(form[key]) for key in ("daemon", "order", "by"))
            send = partial(self._hub.order, team=bool(form.get("team")))
        except (ValueError, KeyError, TypeError, RecursionError):
            return web.Response(status=400)
        by = f"panel, {name[:_MAX_NAME_LENGTH]} at {request.remote}"
        loop = asyncio.get_running_loop()
        try:
            answers: Any = await loop.run_in_executor(self._order_threads, send, daemon, order, by)
        except LinkError as error:
            answers = [{"accepted": False, "order": order, "reason": str(error)}]
        return web.json_response(answers)

    async def _send_changes(self) -> None:
        while True:
            self._listener.close_late()
            self._hub.receive()
            if self._pages:
                self._send()
            await asyncio.sleep(SEND_INTERVAL_S)

    def _send(self) -> None:
        """Queue the changes for all pages. A page with a full queue is closed."""
        changes = self._hub.message()
        for page, (queue, sending) in list(self._pages.items()):
            if queue.full():
                del self._pages[page]
                sending.cancel()
            else:
                queue.put_nowait(changes)

    async def _shut_down(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.close(code=WSCloseCode.GOING_AWAY, message=b"the panel ends")
        self._order_threads.shutdown(wait=False, cancel_futures=True)


async def _file(request: web.Request) -> web.StreamResponse:
    return web.FileResponse(_PAGE / ("door.css" if request.path == "/door.css" else "index.html"))


async def _send_queued(page: web.WebSocketResponse, queue: asyncio.Queue[str]) -> None:
    """Send the messages of a queue until cancelled: the page has gone, or it was too slow."""
    with contextlib.suppress(ConnectionError):
        try:
            while True:
                await page.send_str(await queue.get())
        finally:
            await page.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
