"""The viewer's servers, all on loopback: the recording over gRPC from here, the page's files from a child process.

Rerun's own functions for this listen on all interfaces, so they are not used.
"""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final
from urllib.parse import quote

import rerun as rr
import rerun_cli

from guidance.errors import LinkError
from guidance.viz.view.front import LOOPBACK, Front

MEMORY_LIMIT: Final = "512MB"
"""What the server keeps for those who look in later; then the oldest is dropped."""

START_LIMIT_S: Final = 30.0
STOP_LIMIT_S: Final = 3.0

# Linux ends the child when we are gone, however that comes about (PR_SET_PDEATHSIG, SIGTERM); elsewhere we must do it.
_UNTIL_WE_END: Final = """
import ctypes, os, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, 15)
os.execv(sys.argv[1], sys.argv[1:])
"""


class WebPage:
    """The viewer as a web page: Rerun's own program serves it, and `Front` passes it on.

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
        # Rerun counts its users unless told not to; told so in a folder of ours, the user's own choice stays as it is.
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
            [sys.executable, "-c", _UNTIL_WE_END, *map(str, serve)],
            env=environment,
            stdin=nothing,
            stdout=nothing,
            stderr=nothing,
        )
        self._closing.callback(_end, child)
        return child

    def _wait_until_served(self, port: int) -> None:
        """Wait until the page can be fetched.

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
    """Return a port of loopback that nobody listens on."""
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
