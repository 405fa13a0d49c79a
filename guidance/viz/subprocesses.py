"""A command of ours beside a flight, as a process of its own: the flight does not know of it, and it ends with us.

It ends with us however we end, since its standard input is then closed. One that hangs or dies is not noticed.
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
        arguments: Of the command line, the command's name first. The command ends with its parent.
        stdout: Where it speaks to, as `subprocess` has it; None for where we do.
    """

    def __init__(self, *arguments: str, stdout: int | None = None) -> None:
        # A session of its own: Ctrl-C is for us.
        self.child: Final = subprocess.Popen(
            command(arguments), stdin=subprocess.PIPE, stdout=stdout, start_new_session=True
        )

    def wait(self) -> None:
        """Wait until it ends by itself."""
        self.child.wait()

    def close(self) -> None:
        """End it: politely, then not. May be called twice."""
        if self.child.stdin is not None:
            self.child.stdin.close()
        try:
            self.child.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()


def command(arguments: Sequence[str]) -> list[str]:
    """Return the command line of a command of ours that ends with its parent."""
    return [sys.executable, "-c", "from guidance.cli import main; main()", *arguments, "--with-parent"]


def end_with_parent(end: Callable[[], object]) -> None:
    """In the child: call `end` on a thread of its own when the parent is gone."""
    threading.Thread(target=_read_to_the_end, args=(end,), name="parent", daemon=True).start()


def _read_to_the_end(end: Callable[[], object]) -> None:
    # By its number: a thread that waits in a buffered reader keeps the interpreter from ending.
    while os.read(0, 1024):
        pass
    end()


class PanelBeside(CommandBeside):
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
        super().__init__("panel", "--endpoint", endpoint, *options)


def options_of(token_file: Path | None, records: Path | None) -> Sequence[str]:
    """Return the panel's options for a daemon whose token and records lie there, on a free port."""
    token = () if token_file is None else ("--token-file", str(token_file))
    return ("--port", "0", *token, *(() if records is None else ("--records", str(records))))


class ViewerBeside:
    """Starts `guidance view --follow` on a record.

    Args:
        options: Of that command.
        say: Is told every line that it says, on a thread of its own: a flight's live line stays whole.

    Raises:
        ConfigError: If Rerun is not installed.
    """

    def __init__(self, *options: str, say: Callable[[str], None]) -> None:
        require("the view", "viz")
        self._options = options
        self._say = say
        self._beside: CommandBeside | None = None

    def start(self, record: Path) -> None:
        """Look at a record that is being written from now on."""
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
