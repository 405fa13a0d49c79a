"""TCP where the vehicle calls (`tcpin`): the newest caller that sends a valid frame is the vehicle.

A caller that is silent, or that sends no valid frame of an expected system, blocks no other caller. With a signing key
the frame must be validly signed, and newer than every one before it. Connections whose other end has vanished are ended
by the kernel's keepalive.
"""

import os
import select
import socket
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from guidance.errors import LinkError
from guidance.links.mavlink.frames import FrameReader, SignatureCheck
from guidance.links.port import Clock
from guidance.links.wires.streams import StreamWire

MOST_CALLERS: Final = 8
"""Callers that have not sent a valid frame yet; the oldest one has to go."""

MOST_UNPROVEN_BYTES: Final = 65536
"""A caller that sends more without a valid frame is no vehicle."""

_WAIT_MS: Final = 100
_BYTES: Final = 16384
_KEEPALIVE: Final = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 3),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
)
"""A connection without its other end is over after 6 s."""


class _Caller:
    """A connection: its socket, its frames, and its bytes until the first valid frame."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.reader = FrameReader(())
        self.unproven = b""


class TcpInWire(StreamWire):
    """A listening port.

    Args:
        clock: Stamps arrivals.
        host: Where to listen.
        port: Where to listen; 0 takes a free one.
        systems: MAVLink system ids whose frames are valid; None accepts any.
        checks: Signature checks by system id; such a system's frame must be signed.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        host: str,
        port: int,
        systems: Collection[int | None] | None = None,
        checks: Mapping[int | None, SignatureCheck] | None = None,
    ) -> None:
        """Begin to listen.

        Raises:
            LinkError: If the port cannot be bound.
        """
        name = f"tcp {host}:{port}"
        self._systems = systems
        self._checks = {} if checks is None else checks
        self._callers: list[_Caller] = []
        self._proven: _Caller | None = None
        try:
            self._server = socket.create_server((host, port), backlog=MOST_CALLERS)
        except OSError as error:
            busy = "choose another port or end the program that uses it"
            raise LinkError(f"{name}: {error}; {busy}") from error
        self._server.setblocking(False)
        super().__init__(clock, name, self._accept, None)

    @property
    def port(self) -> int:
        """The port of this computer, also where the system has chosen it (port 0)."""
        return int(self._server.getsockname()[1])

    def _accept(self) -> socket.socket:
        connection = self._server.accept()[0]
        for level, option, value in _KEEPALIVE:
            connection.setsockopt(level, option, value)
        connection.setblocking(False)
        return connection

    def _read_once(self) -> None:
        """Wait for callers and bytes, on the reader thread."""
        poll = select.poll()
        poll.register(self._server, select.POLLIN)
        callers = {caller.connection.fileno(): caller for caller in self._all()}
        for descriptor in callers:
            poll.register(descriptor, select.POLLIN)
        for descriptor, _ in poll.poll(_WAIT_MS):
            if descriptor in callers:
                self._read(callers[descriptor])
                continue
            try:
                caller = _Caller(self._accept())
            except BlockingIOError:
                continue  # the caller has gone
            self._callers.append(caller)
            if len(self._callers) > MOST_CALLERS:
                self._callers.pop(0).connection.close()
            if self._proven is None:
                self._speak_to(caller)

    def _all(self) -> Sequence[_Caller]:
        if self._proven is None:
            return self._callers
        return [*self._callers, self._proven]

    def _speak_to(self, caller: _Caller | None) -> None:
        """Send to this connection from now on, beginning with a whole frame; an unproven one stays open."""
        with self._lock:
            self._peer = None if caller is None else caller.connection
            self._rest = b""

    def _read(self, caller: _Caller) -> None:
        if caller is not self._proven and caller not in self._callers:
            return  # closed in this round
        try:
            data = os.read(caller.connection.fileno(), _BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(caller)
            return
        # Judge all frames, even after one that proves the caller, so the checks remember every timestamp.
        frames = caller.reader.split(data)
        verdicts = []
        for frame in frames:
            if self._systems is not None and frame.system_id not in self._systems:
                verdicts.append(False)
            else:
                check = self._checks.get(frame.system_id)
                verdicts.append(check is None or check.problem(frame) is None)
        is_valid = any(verdicts)
        if caller is self._proven:
            self._arrivals.put((self._clock(), data))
            return
        caller.unproven += data
        if is_valid:
            # The caller is the vehicle; the one before it has to go.
            before = self._proven
            self._callers.remove(caller)
            self._proven = caller
            self._speak_to(caller)
            if before is not None:
                before.connection.close()
            self._arrivals.put((self._clock(), caller.unproven))
            caller.unproven = b""
        elif len(caller.unproven) > MOST_UNPROVEN_BYTES:
            self._drop(caller)

    def _drop(self, caller: _Caller) -> None:
        if caller is self._proven:
            self._proven = None
        else:
            self._callers.remove(caller)
        if self._peer is caller.connection:
            self._speak_to(self._callers[-1] if self._callers else None)
        caller.connection.close()

    def _release(self) -> None:
        self._reader.close()
        self._speak_to(None)
        for caller in self._all():
            caller.connection.close()
        self._server.close()
