"""Runs our commands (page, viewer) as child processes of a flight, which does not depend on them.

A child ends when its standard input closes, so it ends with its parent.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final

from guidance.extras import require

STOP_LIMIT_S: Final = 5.0


class CommandBeside:
    """Runs `guidance ARGUMENTS` until it is closed.

    Args:
        arguments: Command name, then its arguments.
        stdout: As in `subprocess`; None inherits ours.
    """

    def __init__(self, *arguments: str, stdout: int | None = None) -> None:
        # A separate session, so that Ctrl-C reaches only the parent.
        self.child: Final = subprocess.Popen(
            command(arguments), stdin=subprocess.PIPE, stdout=stdout, start_new_session=True
        )

    def wait(self) -> None:
        """Wait until it ends."""
        self.child.wait()

    def close(self) -> None:
        """End it, by force after `STOP_LIMIT_S`. May be called twice."""
        if self.child.stdin is not None:
            self.child.stdin.close()
        try:
            self.child.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()


def command(arguments: Sequence[str]) -> list[str]:
    """Return the command line of a child command. `-P` keeps the current folder off the import path."""
    return [sys.executable, "-P", "-c", "from guidance.cli import main; main()", *arguments, "--with-parent"]


def end_with_parent(end: Callable[[], object]) -> None:
    """In the child: call `end` from a thread when the parent is gone."""
    threading.Thread(target=_read_to_the_end, args=(end,), name="parent", daemon=True).start()


def _read_to_the_end(end: Callable[[], object]) -> None:
    # os.read, because a thread that waits in a buffered reader would keep the interpreter from ending.
    while os.read(0, 1024):
        pass
    end()


class PanelBeside(CommandBeside):
    """Starts `guidance panel` for the daemon at an endpoint. The command prints its address.

    Args:
        endpoint: The daemon's control endpoint.
        options: Further options of the panel.

    Raises:
        ConfigError: If aiohttp is not installed.
    """

    def __init__(self, endpoint: str, *options: str) -> None:
        require("--panel", "panel")
        super().__init__("panel", "--endpoint", endpoint, *options)


def options_of(token_file: Path | None, records: Path | None) -> Sequence[str]:
    """Return the panel's options for a daemon's token and records, on a free port."""
    token = () if token_file is None else ("--token-file", str(token_file))
    return ("--port", "0", *token, *(() if records is None else ("--records", str(records))))


class ViewerBeside:
    """Starts `guidance view --follow` on a record.

    Args:
        options: Options of the command.
        say: Receives every line of its output, on a separate thread.

    Raises:
        ConfigError: If Rerun is not installed.
    """

    def __init__(self, *options: str, say: Callable[[str], None]) -> None:
        require("the view", "viz")
        self._options = options
        self._say = say
        self._beside: CommandBeside | None = None

    def start(self, record: Path) -> None:
        """Start the viewer on a growing record."""
        self._beside = CommandBeside("view", str(record), "--follow", *self._options, stdout=subprocess.PIPE)
        threading.Thread(target=self._relay, args=(self._beside.child.stdout,), name="view", daemon=True).start()

    def _relay(self, lines: IO[bytes]) -> None:
        for line in lines:
            self._say(line.decode(errors="replace").rstrip())
        lines.close()

    def wait(self) -> None:
        """Wait until the viewer ends."""
        if self._beside is not None:
            self._beside.wait()

    def close(self) -> None:
        """End the viewer. May be called twice."""
        if self._beside is not None:
            self._beside.close()
