"""A viewer beside a flight, as a process of its own that reads the record while it is written.

A viewer that hangs or dies is not noticed.
"""

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

from guidance.viz.beside import CommandBeside
from guidance.viz.view.command import require_rerun


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
