"""A command of ours beside a flight, as a process of its own: the flight does not know of it, and it ends with us.

It ends with us however we end, since its standard input is then closed.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Final

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
