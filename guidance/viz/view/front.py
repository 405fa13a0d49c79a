"""The viewer's page as the browser gets it: Rerun's, with the word that it may speak to nobody but this computer.

By itself the page asks the internet for news of Rerun and reports on its use. A content security policy in the page's
own headers is what a browser keeps to, whatever the page's program wants.
"""

import threading
import urllib.error
import urllib.request
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final
from urllib.parse import urlsplit

LOOPBACK: Final = "127.0.0.1"
_LIMIT_S: Final = 20.0
_PASSED_ON: Final = ("Content-Type", "Content-Encoding", "Cache-Control", "ETag")


def policy(recording_port: int) -> str:
    """Return the content security policy: this page's own files, and the recording's server."""
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
    """Passes on, on one port of loopback, what another port serves.

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
        """Where it is served, for port 0."""
        return self._server.server_port

    def close(self) -> None:
        """Serve no more."""
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
        """Fetch the file behind and pass it on; who asks for another host was led here by a name that is not ours."""
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
        """Nothing."""
