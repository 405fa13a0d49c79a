"""The viewer's servers on loopback: the recording over gRPC, and the page's files from a child process.

Rerun's own functions listen on all interfaces, so they are not used. Its servers answer requests for any host name. A
web page of a stranger could read the flight from them by DNS rebinding: its host name would lead to 127.0.0.1. They
therefore listen on a random address in 127.0.0.0/8 and a random port. Two relays on 127.0.0.1 forward requests for this
host only. Rerun's page would contact the internet for news and usage reports; a content security policy in the page's
headers restricts it to this computer.
"""

import contextlib
import os
import secrets
import socket
import socketserver
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Final
from urllib.parse import quote

import rerun as rr
import rerun_cli

from guidance.errors import LinkError

_LOOPBACK: Final = "127.0.0.1"
MEMORY_LIMIT: Final = "512MB"
"""Memory limit of the server, for late viewers; the oldest data are dropped first."""

START_LIMIT_S: Final = 30.0
_PIECE_BYTES: Final = 65_536
_HTTP_2: Final = b"PRI * HTTP/2.0\r\n"
"""First line of native viewers. Browsers use HTTP/2 with TLS only."""

# On Linux, PR_SET_PDEATHSIG ends the child with its parent; elsewhere `close` does.
_UNTIL_WE_END: Final = """
import ctypes, os, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, 15)
os.execv(sys.argv[1], sys.argv[1:])
"""

_HEADERS: Final = (
    "Content-Security-Policy: default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; img-src 'self' "
    "data: blob:; font-src 'self' data:; worker-src 'self' blob:; connect-src 'self' {recording} data: blob:\r\n"
    "Referrer-Policy: no-referrer\r\n"
)
"""Headers of the page: it may load its own files, and connect to the recording's server only."""

_Address = tuple[str, int]


class Relay(socketserver.ThreadingTCPServer):
    """A relay on 127.0.0.1 to a server behind, for requests with its own host name and port.

    The first request of a connection decides: browsers never share a connection between host names.
    """

    daemon_threads = allow_reuse_address = True
    block_on_close = False

    def __init__(self, option: str, port: int, behind: _Address, headers: str = "") -> None:
        try:
            super().__init__((_LOOPBACK, port), _Connection)
        except OSError as error:
            raise LinkError(
                f"{option} {port}: {error.strerror}; choose another, or 0 for a free one"
            ) from error
        self.port = int(self.server_address[1])
        self.behind = behind
        self.headers = headers
        self.hosts = {f"{name}:{self.port}" for name in (_LOOPBACK, "localhost")}
        threading.Thread(target=self.serve_forever, name=f"port {self.port}", daemon=True).start()

    def close(self) -> None:
        """Stop the relay."""
        self.shutdown()
        self.server_close()


class _Connection(socketserver.BaseRequestHandler):
    """One connection: a stream in both directions, or, with headers of our own, one request and its answer."""

    server: Relay

    def handle(self) -> None:
        """Check the first request, then forward."""
        outer: socket.socket = self.request
        with contextlib.suppress(OSError):
            outer.settimeout(20.0)
            head = _head_from(outer)
            native = head.startswith(_HTTP_2) and not self.server.headers
            if not (native or host_of(head) in self.server.hosts):
                outer.sendall(_refusal_response(HTTPStatus.MISDIRECTED_REQUEST))
                return
            try:
                inner = socket.create_connection(self.server.behind)
            except OSError:
                outer.sendall(_refusal_response(HTTPStatus.BAD_GATEWAY))
                return
            with inner:
                if not self.server.headers:
                    outer.settimeout(None)
                    inner.sendall(head)
                    threading.Thread(target=_copy, args=(outer, inner), daemon=True).start()
                else:
                    inner.sendall(
                        b"GET %b HTTP/1.1\r\nHost: behind\r\nConnection: close\r\n\r\n"
                        % head.split()[1]
                    )
                    status, _, headers = _head_from(inner).partition(b"\r\n")
                    outer.sendall(b"%b\r\n%b%b" % (status, self.server.headers.encode(), headers))
                _copy(inner, outer)


def _head_from(source: socket.socket) -> bytes:
    """Receive a request or an answer up to the end of its headers."""
    head = b""
    while (
        b"\r\n\r\n" not in head
        and len(head) < _PIECE_BYTES
        and (piece := source.recv(_PIECE_BYTES))
    ):
        head += piece
    return head


def _refusal_response(status: HTTPStatus) -> bytes:
    return f"HTTP/1.1 {status} {status.phrase}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode()


def host_of(head: bytes) -> str:
    """Return the Host of an HTTP/1 request; empty unless there is exactly one."""
    lines = head.partition(b"\r\n\r\n")[0].split(b"\r\n")[1:]
    hosts = [
        line.partition(b":")[2] for line in lines if line.partition(b":")[0].lower() == b"host"
    ]
    return hosts[0].strip().decode("latin-1") if len(hosts) == 1 else ""


def _copy(source: socket.socket, to: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while piece := source.recv(_PIECE_BYTES):
            to.sendall(piece)
    for stream in (source, to):
        with contextlib.suppress(OSError):
            stream.shutdown(socket.SHUT_RDWR)


@contextlib.contextmanager
def recording_server(port: int) -> Iterator[tuple[int, rr.GrpcServerSink]]:
    """Serve a recording on loopback; yield the port and the sink.

    At the end no further viewers are accepted; the recording's own server ends with its last use.

    Raises:
        LinkError: If the port is in use.
    """
    behind = hidden_address()
    with contextlib.closing(Relay("--port", port, behind)) as front:
        yield (
            front.port,
            rr.GrpcServerSink(bind_ip=behind[0], port=behind[1], server_memory_limit=MEMORY_LIMIT),
        )


def recording_uri(port: int) -> str:
    """Return the address of a recording for viewers."""
    return f"rerun+http://{_LOOPBACK}:{port}/proxy"


@contextlib.contextmanager
def web_page(port: int, recording_port: int) -> Iterator[str]:
    """Serve the viewer's web page, Rerun's program behind a relay; yield its address.

    Raises:
        LinkError: If the port is in use, or the page is not served in time.
    """
    behind = hidden_address()
    uri = recording_uri(recording_port)
    headers = _HEADERS.format(recording=f"http://{_LOOPBACK}:{recording_port}")
    with (
        contextlib.closing(Relay("--web-port", port, behind, headers)) as front,
        contextlib.ExitStack() as closing,
    ):
        try:
            _serve_page(closing, behind, uri)
        except (OSError, subprocess.SubprocessError) as error:
            raise LinkError(f"the viewer's page could not be served: {error}") from error
        yield f"http://{_LOOPBACK}:{front.port}/?url={quote(uri, safe='')}"


def _serve_page(closing: contextlib.ExitStack, behind: _Address, recording: str) -> None:
    program = str(Path(rerun_cli.__file__).with_name("rerun"))
    # Turn off Rerun's usage reports in a folder of our own, so the user's setting stays unchanged.
    folder = closing.enter_context(tempfile.TemporaryDirectory(prefix="guidance-view-"))
    environment = {**os.environ, "XDG_CONFIG_HOME": folder, "XDG_DATA_HOME": folder}
    none = subprocess.DEVNULL
    silent = [program, "analytics", "disable"]
    subprocess.run(
        silent, env=environment, stdout=none, stderr=none, check=True, timeout=START_LIMIT_S
    )
    serve = [
        program,
        "--serve-web",
        "--bind",
        behind[0],
        "--web-viewer-port",
        str(behind[1]),
        recording,
    ]
    words = [sys.executable, "-P", "-c", _UNTIL_WE_END, *serve]
    child = subprocess.Popen(words, env=environment, stdin=none, stdout=none, stderr=none)
    closing.callback(child.wait)
    closing.callback(child.kill)
    for _ in range(round(START_LIMIT_S / 0.05)):
        with contextlib.suppress(OSError), socket.create_connection(behind, timeout=1.0):
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            raise LinkError(f"the viewer's page could not be served (exit code {child.wait(0.05)})")
    raise LinkError(f"the viewer's page was not served within {START_LIMIT_S:g} s")


def hidden_address() -> _Address:
    """Return a random loopback address and a free port; 127.0.0.1 on systems with only this one."""
    numbers = (1 + secrets.randbelow(254) for _ in range(3))
    address = ".".join(map(str, (127, *numbers))) if sys.platform == "linux" else _LOOPBACK
    with socket.socket() as probe:
        probe.bind((address, 0))
        return address, int(probe.getsockname()[1])
