"""Access to the page: by a one-time URL on loopback, by a password over TLS on other addresses.

Connections without a login are bounded in number and time.

Both give a cookie for a secret path. Browsers send the cookies of a host to each of its ports, so a server of another
program on 127.0.0.1 could receive ours. They do not send it to other paths, and that program does not know this one.
Orders and the WebSocket must also come from a page of this origin.

A reverse proxy may put the page below a path of its own, which the panel does not know. All its addresses are therefore
relative, and the cookie is set by an answer below the secret path, without naming it: a ticket leads there.
"""

import asyncio
import contextlib
import hmac
import ipaddress
import math
import re
import secrets
import socket
import ssl
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

from aiohttp import web

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.files import text_of
from guidance.links.port import is_loopback

MIN_PASSWORD_LENGTH: Final = 12
PASSWORD_INTERVAL_S: Final = 1.0
"""For this time after a wrong password, answers to its address are delayed by the same time, for every password.

The right password is always accepted. Each guess needs its own connection meanwhile: at most
`MAX_OPEN_CONNECTIONS` guesses in this time.
"""

MAX_OPEN_CONNECTIONS: Final = 256
LOGIN_DEADLINE_S: Final = 10.0
"""Time from a connection's first packet to a request with the cookie, including the TLS handshake."""

PAGE: Final = Path(__file__).with_name("page")
_STYLE: Final = "/door.css"
_PUBLIC: Final = frozenset({"/", "/login", _STYLE})
_MAX_ADDRESSES: Final = 1024
_MAX_TICKETS: Final = 16
_TICKET_S: Final = 30.0

_DOORS: Final = {403: "denied.html", 421: "elsewhere.html"}
"""The page that explains a refusal to a person."""

_LOGIN: Final = "login.html"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


Remote = tuple[ssl.SSLContext, str]
"""TLS and the password: required where other computers can reach the page."""


class Access:
    """Access rules of one panel, and its door: the pages that exchange a token or the password for the cookie.

    Args:
        host: Address of the page.
        port: Its port.
        remote: TLS and password; None for loopback.
        clock: Time of password attempts and login deadlines.
        say: Prints the URL of the page.

    Attributes:
        token: Opens the page once on loopback; replaced when it is used or an open page asks for another.
        path: Secret path of the page, with both slashes.
        tls: TLS context of the server; None for http, where no password is set.
        scheme: http or https.
        listener: Passes on the connections; set when they are served.
        clock: As given.
        pause: Waits for some seconds.
    """

    listener: "Listener"
    tls: ssl.SSLContext | None

    def __init__(
        self, host: str, port: int, remote: Remote | None, clock: Clock, say: Callable[[str], None]
    ) -> None:
        self.token = secrets.token_urlsafe(24)
        self._session = secrets.token_urlsafe(24)
        self.path = f"/{secrets.token_urlsafe(18)}/"
        self._cookie = f"guidance-panel-{port}"
        self.tls = None
        self._password = ""
        if remote is not None:
            (tls, password) = remote
            self.tls = tls
            self._password = password
        self._tickets = dict[str, float]()
        self.scheme = "http" if remote is None else "https"
        self._hosts = frozenset(f"{name}:{port}" for name in ("127.0.0.1", "localhost", "[::1]"))
        self._address = f"{self.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"
        self.clock = clock
        self.pause: Callable[[float], Awaitable[None]] = asyncio.sleep
        self._say = say
        self._late_until_s = dict[str, float]()  # by network, after a wrong password

    def announce(self) -> None:
        """Print the URL of the page, once: a later reader of the output finds no token that still works."""
        with contextlib.suppress(OSError):  # the output is closed
            self._say(f"panel    {self._door_url()}")

    def _door_url(self) -> str:
        query = f"?token={self.token}" if self.tls is None else "  (asks for the password)"
        return f"{self._address}{query}"

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Explain a refusal to a person; scripts get the status only."""
        status = self._refusal(request)
        if status is None:
            return await handler(request)
        if status in _DOORS and (
            request.method == "GET" and request.headers.get("Accept", "").startswith("text/html")
        ):
            return self._door(request, status)
        return web.Response(status=status)

    def _refusal(self, request: web.Request) -> int | None:
        """Return the status of a refused request, None if it is allowed."""
        cookie = request.cookies.get(self._cookie, "")
        # Over TLS the browser checks the certificate's name
        if self.tls is None and request.host not in self._hosts and request.path != _STYLE:
            return 421
        if _is_same_secret(cookie, self._session):
            self.listener.admit(request.protocol)
        elif request.path not in _PUBLIC and request.path != f"{self.path}in":
            return 403
        is_same_origin = self.is_own_origin(request, request.headers.get("Origin", ""))
        protected = request.method != "GET" or request.path == f"{self.path}live"
        return 403 if protected and not is_same_origin else None

    def is_own_origin(self, request: web.Request, origin: str) -> bool:
        """True if a page of this origin is the panel's, by the host that the request names."""
        return bool(request.host) and origin == f"{self.scheme}://{request.host}"

    def _door(self, request: web.Request, status: int, reason: str = "") -> web.Response:
        """Return the login page, or the page that says what to open instead."""
        name = _DOORS.get(status, _LOGIN)
        if status == 403 and self.tls is not None:
            name = _LOGIN
        text = (PAGE / name).read_text(encoding="utf-8")
        up = "../" * (request.path.count("/") - 1)
        text = text.replace('href="door.css"', f'href="{up}door.css"')
        text = text.replace('action="login"', f'action="{up}login"')
        if reason:
            text = text.replace(" hidden></p>", f">{reason}</p>", 1)
        return web.Response(status=status, text=text, content_type="text/html")

    async def enter(self, request: web.Request) -> web.StreamResponse:
        """Exchange the token of the URL for the cookie."""
        if self.tls is not None:
            return self._door(request, 200)
        if not _is_same_secret(request.query.get("token", ""), self.token):
            return self._door(request, 403)
        self.token = secrets.token_urlsafe(24)  # this one was never shown
        return self._let_in()

    async def invite(self, _request: web.Request) -> web.Response:
        """Show an open page the URL for another browser; the URL before it works no more."""
        self.token = secrets.token_urlsafe(24)
        icon = '<!doctype html><link rel="icon" href="data:,">'  # no browser then asks for one
        words = f"{icon}<p>For another browser, once: {self._door_url()}\n"
        return web.Response(text=words, content_type="text/html")

    async def login(self, request: web.Request) -> web.StreamResponse:
        """Exchange the password for the cookie."""
        if self.tls is None:
            return web.Response(status=404)
        sender = str(request.remote)
        form = parse_qs((await request.read()).decode(errors="replace"))
        if self.is_late(sender):
            await self.pause(PASSWORD_INTERVAL_S)
        if _is_same_secret(form.get("password", [""])[0], self._password):
            return self._let_in()
        self.note_wrong(sender)
        return self._door(request, 403, "That was not the password.")

    def _let_in(self) -> web.Response:
        ticket = secrets.token_urlsafe(24)
        self._tickets[ticket] = self.clock.now_s() + _TICKET_S
        if len(self._tickets) > _MAX_TICKETS:
            del self._tickets[next(iter(self._tickets))]
        return web.Response(status=303, headers={"Location": f".{self.path}in?ticket={ticket}"})

    async def take_ticket(self, request: web.Request) -> web.StreamResponse:
        """Exchange a ticket, which works once, for the cookie of the path below which this request arrived."""
        until_s = self._tickets.pop(request.query.get("ticket", ""), -math.inf)
        if self.clock.now_s() >= until_s:
            return self._door(request, 403)
        answer = web.Response(status=303, headers={"Location": "./"})
        # With Strict, a URL that was clicked in a terminal inside a browser would lose the cookie on the redirect.
        # Without a path, the browser takes the folder of the requested address, also behind a proxy.
        is_secure = self.tls is not None
        answer.set_cookie(
            self._cookie, self._session, path="", httponly=True, samesite="Lax", secure=is_secure
        )
        return answer

    def is_late(self, address: str) -> bool:
        """True if an address sent a wrong password just now."""
        return self.clock.now_s() < self._late_until_s.get(_network(address), 0.0)

    def note_wrong(self, address: str) -> None:
        """Note a wrong password of an address."""
        network = _network(address)
        self._late_until_s.pop(network, None)
        self._late_until_s[network] = self.clock.now_s() + PASSWORD_INTERVAL_S
        if len(self._late_until_s) > _MAX_ADDRESSES:
            del self._late_until_s[next(iter(self._late_until_s))]


def _bytes_of(text: str) -> bytes:
    """Return the bytes of a text from a request, which may have any."""
    return text.encode(errors="backslashreplace")


def _is_same_secret(claimed: str, secret: str) -> bool:
    return hmac.compare_digest(_bytes_of(claimed), _bytes_of(secret))


def _network(address: str) -> str:
    """Return an IPv4 address as it is, and the /64 network of an IPv6 address, which usually is one computer."""
    return (
        str(ipaddress.ip_interface(f"{address.partition('%')[0]}/64").network)
        if ":" in address
        else address
    )


def remote_access(
    host: str, certificate: Path | None, key: Path | None, password_file: Path | None
) -> Remote | None:
    """Return None on loopback; load TLS and password for any other host.

    Args:
        host: Address of the page.
        certificate: Certificate chain, PEM.
        key: Private key, PEM.
        password_file: The password is its first line.

    Raises:
        ConfigError: If a file is missing or cannot be used, others may read the password, or it is too short.
    """
    if certificate is None and key is None and password_file is None and is_loopback(host):
        return None
    if certificate is None or key is None or password_file is None:
        raise ConfigError(
            f"--host {host}: anyone who reaches the page can command the vehicle. Addresses other than loopback need "
            "--certificate, --key and --password-file, all three. To make a certificate: openssl req -x509 "
            "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 365 -keyout key.pem -out cert.pem "
            f"-subj /CN={host}"
        )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key)
    except OSError as error:  # ssl.SSLError is one
        problem = f"--certificate {certificate}, --key {key}: cannot be used"
        raise ConfigError(f"{problem} ({error}); give PEM files") from error
    password = (
        text_of(password_file, f"--password-file {password_file}", secret=True)
        .partition("\n")[0]
        .strip()
    )
    if len(password) < MIN_PASSWORD_LENGTH:
        problem = (
            f"its first line has {len(password)} characters; give at least {MIN_PASSWORD_LENGTH}"
        )
        raise ConfigError(f"--password-file {password_file}: {problem}")
    return context, password


def map_of(tiles: str) -> tuple[str, str]:
    """Return the page's address of the map tiles, and scheme://host[:port] of a tile server; empty without one.

    Args:
        tiles: A folder, or the address of a tile server. The default folder need not exist.

    Raises:
        ConfigError: If the address is not of the form https://host/{z}/{x}/{y}.
    """
    if tiles and Path(tiles).is_dir():
        return "tiles/{z}/{x}/{y}.png", ""
    if tiles in {"", "tiles"}:
        return "", ""
    parts = urlsplit(tiles)
    host = re.fullmatch(r"[A-Za-z0-9.-]+(:\d+)?", parts.netloc)
    if (
        parts.scheme not in {"http", "https"}
        or host is None
        or any(key not in tiles for key in ("{z}", "{x}", "{y}"))
    ):
        raise ConfigError(
            f"--tiles {tiles}: must be a folder, or like https://tiles.example/{{z}}/{{x}}/{{y}}.png"
        )
    return tiles, f"{parts.scheme}://{parts.netloc}"


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a listening TCP socket.

    Raises:
        LinkError: If the address cannot be used.
    """
    try:
        return socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET
        )
    except OSError as error:
        remedy = "choose another, or port 0 for a free one"
        raise LinkError(f"--host {host} --port {port}: {error.strerror}; {remedy}") from error


class Stranger(NamedTuple):
    """A connection without the cookie.

    Attributes:
        until_s: Its deadline.
        connecting: The task that accepts it, including the TLS handshake.
    """

    until_s: float
    connecting: asyncio.Task[None]


class Listener:
    """Passes accepted connections to a web server, which does not bound their number and the time of a request's head.

    A connection without the cookie is closed after `LOGIN_DEADLINE_S`. At `MAX_OPEN_CONNECTIONS`, a new one takes the
    place of the oldest without the cookie, so idle connections never keep a person out.

    Args:
        server: Of an `aiohttp.web.AppRunner`.
        clock: Time of the deadlines.
        tls: TLS context; None for http.
    """

    def __init__(self, server: web.Server, clock: Clock, tls: ssl.SSLContext | None) -> None:
        self._server = server
        self._clock = clock
        self._tls = tls
        # Connections without the cookie, oldest first
        self._strangers: dict[web.RequestHandler, Stranger] = {}

    async def run(self, listening: socket.socket) -> None:
        """Accept connections until cancelled."""
        loop = asyncio.get_running_loop()
        listening.setblocking(False)
        while True:
            try:
                accepted, _ = await loop.sock_accept(listening)
            except OSError:  # out of file descriptors, or the peer has gone
                await asyncio.sleep(0.1)
                continue
            self.close_late()
            if len(self._strangers.keys() | self._server.connections) >= MAX_OPEN_CONNECTIONS:
                if not self._strangers:
                    accepted.close()
                    continue
                self._close(next(iter(self._strangers)))
            handler = self._server()
            until_s = self._clock.now_s() + LOGIN_DEADLINE_S
            connecting = asyncio.create_task(self._connect(handler, accepted))
            self._strangers[handler] = Stranger(until_s, connecting)

    def admit(self, handler: web.RequestHandler) -> None:
        """Remove the deadline of a connection that showed the cookie."""
        self._strangers.pop(handler, None)

    def close_late(self) -> None:
        """Close the connections that missed the deadline, and those that ended."""
        now_s = self._clock.now_s()
        connected = set(self._server.connections)
        for handler, stranger in list(self._strangers.items()):
            has_ended = stranger.connecting.done() and handler not in connected
            if stranger.until_s <= now_s or has_ended:
                self._close(handler)

    async def _connect(self, handler: web.RequestHandler, accepted: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        limit_s = None if self._tls is None else LOGIN_DEADLINE_S
        try:
            await loop.connect_accepted_socket(
                lambda: handler, accepted, ssl=self._tls, ssl_handshake_timeout=limit_s
            )
        except OSError:  # no TLS, or the peer has gone
            accepted.close()

    def _close(self, handler: web.RequestHandler) -> None:
        self._strangers.pop(handler).connecting.cancel()
        handler.force_close()
