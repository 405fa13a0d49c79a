"""A panel beside a flight, as a process of its own: the flight does not know of it, and it ends with us."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from guidance.extras import require

STOP_LIMIT_S: Final = 5.0


class PanelBeside:
    """Starts `guidance panel` for the daemon at an endpoint; it says itself where it can be opened.

    Args:
        endpoint: The daemon's.
        options: More of the panel's options.

    Raises:
        ConfigError: If aiohttp is not installed.
    """

    def __init__(self, endpoint: str, *options: str) -> None:
        require("--panel", "panel")
        self.endpoint = endpoint
        self._child: subprocess.Popen[bytes] | None = subprocess.Popen(
            command(endpoint, options), stdin=subprocess.PIPE, start_new_session=True
        )

    def wait(self) -> None:
        """Wait until the panel ends."""
        if self._child is not None:
            self._child.wait()

    def close(self) -> None:
        """End the panel. May be called twice."""
        child, self._child = self._child, None
        if child is None or child.stdin is None:
            return
        child.stdin.close()
        try:
            child.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def command(endpoint: str, options: Sequence[str]) -> list[str]:
    """Return the command line of the panel."""
    program = "from guidance.cli import main; main()"
    return [sys.executable, "-c", program, "panel", "--endpoint", endpoint, "--with-parent", *options]


def options_of(token_file: Path | None, records: Path | None) -> Sequence[str]:
    """Return the panel's options for a daemon whose token and records lie there, on a free port."""
    token = () if token_file is None else ("--token-file", str(token_file))
    return ("--port", "0", *token, *(() if records is None else ("--records", str(records))))
