"""Accepts the connections of the panel's web server. Closes those without a login."""

import asyncio
import socket
import ssl
from typing import Final

from aiohttp import web

from guidance.clock import Clock
from guidance.session.connections import ConnectionLimit

MAX_CONNECTIONS: Final = 256
LOGIN_DEADLINE_S: Final = 10.0
"""Time from a connection's first packet to a request with the cookie, including the TLS handshake."""

_RETRY_S: Final = 0.1


class Listener:
    """Passes accepted connections to a web server.

    aiohttp's own sites neither bound the connections nor the time until a request header is complete.

    Args:
        server: Of an `aiohttp.web.AppRunner`.
        clock: Time of the deadlines.
        tls: TLS context; None for http.
    """

    def __init__(self, server: web.Server, clock: Clock, tls: ssl.SSLContext | None) -> None:
        self._server = server
        self._tls = tls
        self._limit = ConnectionLimit(clock, max_connections=MAX_CONNECTIONS, deadline_s=LOGIN_DEADLINE_S)
        self._connecting: dict[web.RequestHandler, asyncio.Task[None]] = {}
        self._known: set[web.RequestHandler] = set()

    async def run(self, listening: socket.socket) -> None:
        """Accept connections until cancelled."""
        loop = asyncio.get_running_loop()
        listening.setblocking(False)
        while True:
            try:
                accepted, _ = await loop.sock_accept(listening)
            except OSError:  # out of file descriptors, or the peer has gone
                await asyncio.sleep(_RETRY_S)
                continue
            self.close_late()
            self._add(accepted)

    def admit(self, handler: web.RequestHandler) -> None:
        """Remove the deadline of a connection that showed the cookie."""
        self._limit.admit(handler)

    def close_late(self) -> None:
        """Close the connections that missed the deadline, and forget those that ended."""
        self._limit.close_late()
        for handler in self._known - self._connecting.keys() - set(self._server.connections):
            self._known.discard(handler)
            self._limit.remove(handler)

    def _add(self, accepted: socket.socket) -> None:
        handler = self._server()
        if not self._limit.add(handler, lambda: self._close(handler)):
            accepted.close()
            return
        self._known.add(handler)
        task = asyncio.create_task(self._connect(handler, accepted))
        self._connecting[handler] = task
        task.add_done_callback(lambda _: self._connecting.pop(handler, None))

    async def _connect(self, handler: web.RequestHandler, accepted: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        limit_s = None if self._tls is None else LOGIN_DEADLINE_S
        try:
            await loop.connect_accepted_socket(lambda: handler, accepted, ssl=self._tls, ssl_handshake_timeout=limit_s)
        except OSError:  # no TLS, or the peer has gone
            accepted.close()

    def _close(self, handler: web.RequestHandler) -> None:
        task = self._connecting.get(handler)
        if task is not None:
            task.cancel()
        handler.force_close()
