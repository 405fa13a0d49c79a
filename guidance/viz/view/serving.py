"""The viewer's servers on loopback: the recording over gRPC, and the page's files from a child process.

Rerun's own functions listen on all interfaces, so they are not used. Rerun's page would contact the internet for news
and usage reports; a content security policy in the page's headers restricts it to this computer.
"""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Final
from urllib.parse import quote, urlsplit

import rerun as rr
import rerun_cli

from guidance.errors import LinkError

LOOPBACK: Final = "127.0.0.1"
_LIMIT_S: Final = 20.0
_PASSED_ON: Final = ("Content-Type", "Content-Encoding", "Cache-Control", "ETag")

MEMORY_LIMIT: Final = "512MB"
"""Memory limit of the server, for late viewers; the oldest data are dropped first."""

START_LIMIT_S: Final = 30.0
STOP_LIMIT_S: Final = 3.0
# On Linux, PR_SET_PDEATHSIG ends the child with its parent; elsewhere `close` does.
_UNTIL_WE_END: Final = """
import ctypes, os, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, 15)
os.execv(sys.argv[1], sys.argv[1:])
"""


def policy(recording_port: int) -> str:
    """Return the content security policy: the page's own files and the recording's server."""
    ours = f"http://{LOOPBACK}:{recording_port}"
    return "; ".join((
        "default-src 'none'",
        "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "worker-src 'self' blob:",
        f"connect-src 'self' {ours} data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    ))  # fmt: skip


class Front:
    """Serves the content of another loopback port.

    Raises:
        OSError: If the port is in use.
    """

    def __init__(self, port: int, *, behind: int, recording_port: int) -> None:
        self._server = _Server((LOOPBACK, port), _Handler)
        self._server.behind, self._server.policy = behind, policy(recording_port)
        names = (LOOPBACK, "localhost")
        self._server.hosts = frozenset(f"{name}:{self._server.server_port}" for name in names)
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port, also if 0 was given."""
        return self._server.server_port

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    behind = 0
    policy = ""
    hosts: frozenset[str] = frozenset()


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        """Fetch the file and pass it on. Requests for another host name are refused (DNS rebinding)."""
        if self.headers.get("Host", "") not in self.server.hosts:
            self._pass_on(HTTPStatus.MISDIRECTED_REQUEST, {}, b"")
            return
        path = urlsplit(self.path).path
        try:
            with urllib.request.urlopen(f"http://{LOOPBACK}:{self.server.behind}{path}", timeout=_LIMIT_S) as answer:
                self._pass_on(HTTPStatus(answer.status), dict(answer.headers), answer.read())
        except urllib.error.HTTPError as error:
            self._pass_on(HTTPStatus(error.code), {}, b"")
        except OSError:
            self._pass_on(HTTPStatus.BAD_GATEWAY, {}, b"")

    def _pass_on(self, status: HTTPStatus, headers: dict[str, str], body: bytes) -> None:
        self.send_response(status)
        for name in _PASSED_ON:
            if name in headers:
                self.send_header(name, headers[name])
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", self.server.policy)
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Log nothing."""


class WebPage:
    """The viewer's web page. Rerun's program serves it, and `Front` passes it on.

    Raises:
        LinkError: If the port is in use.
    """

    def __init__(self, port: int, recording_url: str, recording_port: int) -> None:
        _check_free(port, "--web-port")
        self.url = f"http://{LOOPBACK}:{port}/?url={quote(recording_url, safe='')}"
        self._closing = contextlib.ExitStack()
        try:
            behind = free_port()
            self._child = self._start(behind, recording_url)
            self._wait_until_served(behind)
            self._closing.callback(Front(port, behind=behind, recording_port=recording_port).close)
        except (OSError, subprocess.SubprocessError) as error:
            self._closing.close()
            raise LinkError(f"the viewer's page could not be served: {error}") from error
        except BaseException:
            self._closing.close()
            raise

    def _start(self, port: int, recording_url: str) -> "subprocess.Popen[bytes]":
        program = Path(rerun_cli.__file__).with_name("rerun")
        # Turn off Rerun's usage reports in a folder of our own, so the user's setting stays unchanged.
        folder = self._closing.enter_context(tempfile.TemporaryDirectory(prefix="guidance-view-"))
        environment = {**os.environ, "XDG_CONFIG_HOME": folder, "XDG_DATA_HOME": folder}
        nothing = subprocess.DEVNULL
        subprocess.run(
            [program, "analytics", "disable"],
            env=environment,
            stdout=nothing,
            stderr=nothing,
            check=True,
            timeout=START_LIMIT_S,
        )
        serve = [program, "--serve-web", "--bind", LOOPBACK, "--web-viewer-port", str(port), recording_url]
        child = subprocess.Popen(
            [sys.executable, "-P", "-c", _UNTIL_WE_END, *map(str, serve)],
            env=environment,
            stdin=nothing,
            stdout=nothing,
            stderr=nothing,
        )
        self._closing.callback(_end, child)
        return child

    def _wait_until_served(self, port: int) -> None:
        """Wait until the page is available.

        Raises:
            LinkError: If it cannot in time.
        """
        for _ in range(round(START_LIMIT_S / 0.05)):
            if self._child.poll() is not None:
                raise LinkError(f"the viewer's page could not be served (exit code {self._child.returncode})")
            with contextlib.suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1.0):
                return
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.wait(0.05)
        raise LinkError(f"the viewer's page was not served within {START_LIMIT_S:g} s")

    def close(self) -> None:
        """End the child. May be called twice."""
        self._closing.close()


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.terminate()
    try:
        child.wait(STOP_LIMIT_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def recording_server(port: int) -> rr.GrpcServerSink:
    """Serve a recording on loopback.

    Raises:
        LinkError: If the port is in use.
    """
    _check_free(port, "--port")
    return rr.GrpcServerSink(bind_ip=LOOPBACK, port=port, server_memory_limit=MEMORY_LIMIT)


def free_port() -> int:
    """Return a free loopback port."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def _check_free(port: int, option: str) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise LinkError(f"{option} {port}: {error.strerror}; choose another, or 0 for a free one") from error
