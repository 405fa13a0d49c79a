"""The panel's web server: the page, one socket a page for what is seen, one address for orders."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from typing import Any, Final

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from guidance.errors import LinkError
from guidance.viz.panel.access import Access, origin_of
from guidance.viz.panel.hub import Hub
from guidance.viz.panel.records import Past, RecordFolder

TOLD_EVERY_S: Final = 0.1
MOST_PAGES: Final = 64
MOST_UNTAKEN: Final = 20
"""Messages that a page may leave untaken, two seconds of them: then it is let go, and comes back by itself."""

WRONG_PASSWORD_S: Final = 1.0
"""One wrong password a second, whoever gives it."""

_MOST_BYTES: Final = 4096
_LONGEST_NAME: Final = 24
_AT_ONCE: Final = 16
_DOOR: Final = frozenset({"/", "/login", "/page/door.css"})
"""What anybody is answered who asks this host for it."""

_KINDS: Final = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Pages:
    """All open pages: what is told goes to each, and none holds up another."""

    def __init__(self) -> None:
        self._joining: list[asyncio.Queue[str | None]] = []
        self._open: dict[asyncio.Queue[str | None], web.WebSocketResponse] = {}

    def __len__(self) -> int:
        return len(self._open)

    def add(self, socket: web.WebSocketResponse) -> "asyncio.Queue[str | None]":
        """Let a page in: it is told everything first."""
        queue: asyncio.Queue[str | None] = asyncio.Queue(MOST_UNTAKEN)
        self._open[queue] = socket
        self._joining.append(queue)
        return queue

    def remove(self, queue: "asyncio.Queue[str | None]") -> None:
        """Let it go."""
        self._open.pop(queue, None)

    def tell(self, hub: Hub) -> None:
        """Tell those that know what went before what is new, and those that have just come everything."""
        joining, self._joining = self._joining, []
        if len(self._open) > len(joining):
            news = hub.message()
            for queue in self._open:
                if queue not in joining:
                    self._put(queue, news)
        else:
            hub.settle()
        if joining:
            everything = hub.message(whole=True)
            for queue in joining:
                self._put(queue, everything)

    @staticmethod
    def _put(queue: "asyncio.Queue[str | None]", message: str | None) -> None:
        if queue.full():
            while not queue.empty():
                queue.get_nowait()
            message = None
        queue.put_nowait(message)

    async def close(self) -> None:
        """Say goodbye to all."""
        for socket in list(self._open.values()):
            await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the panel ends")


class PanelServer:
    """The pages of one panel.

    Args:
        hub: What is seen, and where orders go.
        access: Who may open it.
        look: Take no orders.
        records: The flights that are over; None where no folder of them is known.
        tiles: Address of map tiles with {z}, {x} and {y} in it; none by default.
    """

    def __init__(
        self,
        hub: Hub,
        access: Access,
        *,
        look: bool = False,
        records: RecordFolder | None = None,
        tiles: str = "",
    ) -> None:
        self._hub = hub
        self._access = access
        self._look = look
        self._records = records
        self._tiles = tiles
        self._pages = Pages()
        self._guessing = asyncio.Lock()
        self._ordering = ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="order")
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
            "Referrer-Policy": "same-origin",  # with none, a browser does not say that a form is our own
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }  # fmt: skip

    def application(self) -> web.Application:
        """Return the application, ready to be served."""

        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guarded(request, handler)

        application = web.Application(middlewares=[guarded], client_max_size=_MOST_BYTES)
        application.add_routes([
            web.get("/", self._index),
            web.get("/replay", self._index),
            web.post("/login", self._login),
            web.get("/page/{name}", self._file),
            web.get("/alive", self._alive),
            web.get("/live", self._live),
            web.post("/order", self._order),
        ])  # fmt: skip
        if self._records is not None:
            application.add_routes(Past(self._records).routes())
        application.cleanup_ctx.append(self._telling)
        application.on_shutdown.append(self._shut_down)
        return application

    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Let in who may come in; whatever is answered carries the page's policy."""
        status = self._refused(request)
        try:
            answer: web.StreamResponse = web.Response(status=status) if status else await handler(request)
        except web.HTTPException as error:
            answer = web.Response(status=error.status)
        if not answer.prepared:
            for name, value in self._headers.items():
                answer.headers.setdefault(name, value)
        return answer

    def _refused(self, request: web.Request) -> int | None:
        """Return the status that turns a request away, None where it may pass."""
        access, host = self._access, request.host
        if not access.is_for_us(host):
            return 421
        if request.path not in _DOOR and not access.is_let_in(request.cookies):
            return 403
        changing = request.method != "GET" or request.path == "/live"
        return 403 if changing and not access.is_from_us(host, request.headers.get("Origin", "")) else None

    async def _index(self, request: web.Request) -> web.StreamResponse:
        """The page; who shows the token gets the cookie, and the page takes the token out of its address."""
        given = request.query.get("token")
        if given is not None and not self._access.with_password:
            return self._with_cookie(page("index.html")) if self._access.opens(given) else page("denied.html", 403)
        if self._access.is_let_in(request.cookies):
            return page("index.html")
        return page("login.html") if self._access.with_password else page("denied.html", 403)

    async def _login(self, request: web.Request) -> web.StreamResponse:
        if not self._access.with_password:
            return web.Response(status=404)
        given = (await request.post()).get("password", "")
        async with self._guessing:
            if isinstance(given, str) and self._access.opens(given):
                return self._with_cookie(web.Response(status=303, headers={"Location": "/"}))
            await asyncio.sleep(WRONG_PASSWORD_S)
        refused = page("login.html", 403)
        refused.text = (refused.text or "").replace(" hidden", "", 1)  # it was not the password
        return refused

    def _with_cookie(self, answer: web.Response) -> web.Response:
        answer.set_cookie(
            self._access.cookie,
            self._access.session,
            httponly=True,
            samesite="Strict",
            secure=self._access.scheme == "https",
        )
        return answer

    async def _file(self, request: web.Request) -> web.StreamResponse:
        return page(request.match_info["name"])

    async def _alive(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(
            {"look": self._look, "records": self._records is not None, "tiles": self._tiles},
        )

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Tell one page what there is to see, until it goes."""
        if len(self._pages) >= MOST_PAGES:
            return web.Response(status=503)
        socket = web.WebSocketResponse(heartbeat=15.0, max_msg_size=_MOST_BYTES)
        await socket.prepare(request)
        queue = self._pages.add(socket)
        telling = asyncio.create_task(_tell(socket, queue))
        try:
            async for message in socket:  # orders have an address of their own
                self._see(message)
        finally:
            self._pages.remove(queue)
            telling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await telling
        return socket

    def _see(self, message: WSMessage) -> None:
        """Pass on which daemon a person looks at: it may ask for an operator's sign of life. Who only looks is none."""
        if message.type is WSMsgType.TEXT and not self._look:
            self._hub.vouch(str(message.data))

    async def _order(self, request: web.Request) -> web.StreamResponse:
        """Give an order; the daemon's own answer is what the page gets."""
        if self._look:
            return web.json_response({"accepted": False, "reason": "this panel only looks on (--look)"}, status=403)
        try:
            asked = await request.json()
            daemon, order, name = (str(asked[key]) for key in ("daemon", "order", "by"))
        except (ValueError, KeyError, TypeError):
            return web.Response(status=400)
        by = f"panel, {name[:_LONGEST_NAME]} at {request.remote}"
        loop = asyncio.get_running_loop()
        try:
            answer: Any = await loop.run_in_executor(self._ordering, self._hub.order, daemon, order, by)
        except LinkError as error:
            answer = {"accepted": False, "order": order, "reason": str(error)}
        return web.json_response(answer)

    async def _telling(self, _: web.Application) -> AsyncIterator[None]:
        task = asyncio.create_task(self._tell_all())
        yield
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    async def _tell_all(self) -> None:
        while True:
            self._hub.listen()
            self._pages.tell(self._hub)
            await asyncio.sleep(TOLD_EVERY_S)

    async def _shut_down(self, _: web.Application) -> None:
        await self._pages.close()
        self._ordering.shutdown(wait=False, cancel_futures=True)


async def _tell(socket: web.WebSocketResponse, queue: "asyncio.Queue[str | None]") -> None:
    """Send a page what is told, as fast as it takes it; one that takes nothing is closed."""
    with contextlib.suppress(ConnectionError):
        while (message := await queue.get()) is not None:
            await socket.send_str(message)
        await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")


def page(name: str, status: int = 200) -> web.Response:
    """Return one of the page's own files.

    Raises:
        aiohttp.web.HTTPNotFound: If there is none of that name.
    """
    kind = _KINDS.get(name[name.rfind(".") :])
    file = resources.files("guidance.viz.panel") / "page" / name
    if kind is None or "/" in name or "\\" in name or not file.is_file():
        raise web.HTTPNotFound
    return web.Response(status=status, body=file.read_bytes(), content_type=kind, charset="utf-8")
