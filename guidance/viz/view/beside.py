"""A viewer beside a flight, as a process of its own that reads the record while it is written.

The flight does not know of it: a viewer that hangs or dies is not noticed. It ends with us, however we end, since its
standard input is then closed.
"""

import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final

from guidance.viz.view.command import require_rerun

STOP_LIMIT_S: Final = 5.0


class ViewerBeside:
    """Starts `guidance view --follow` on a record.

    Args:
        options: Of that command.
        say: Is told every line that it says, on a thread of its own: a flight's live line stays whole.

    Raises:
        ConfigError: If Rerun is not installed.
    """

    def __init__(self, *options: str, say: Callable[[str], None]) -> None:
        require_rerun()
        self._options = options
        self._say = say
        self._child: subprocess.Popen[bytes] | None = None

    def start(self, record: Path) -> None:
        """Look at a record that is being written from now on."""
        self._child = subprocess.Popen(
            command(record, self._options), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        threading.Thread(target=self._relay, args=(self._child.stdout,), name="view", daemon=True).start()

    def _relay(self, lines: IO[bytes]) -> None:
        for line in lines:
            self._say(line.decode(errors="replace").rstrip())
        lines.close()

    def wait(self) -> None:
        """Wait until the viewer ends."""
        if self._child is not None:
            self._child.wait()

    def close(self) -> None:
        """End the viewer. May be called twice."""
        child, self._child = self._child, None
        if child is None or child.stdin is None:
            return
        child.stdin.close()
        try:
            child.wait(STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def command(record: Path, options: Sequence[str]) -> list[str]:
    """Return the command line of the viewer."""
    program = "from guidance.cli import main; main()"
    return [sys.executable, "-c", program, "view", str(record), "--follow", "--with-parent", *options]
