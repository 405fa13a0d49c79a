"""`guidance` as a person types it, in this process: what it prints, what it says beside it, and its exit code.

A process of its own takes a second to start: one where that is what is tested, and not to read a message.
"""

import io
import os
import signal
import sys
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple
from unittest.mock import patch

from guidance.cli import main


class Done(NamedTuple):
    """What became of a command, by the names of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


class Kept(io.BytesIO):
    """What was written stays, whoever closes it: the stream that the command puts in front of it does, as it goes."""

    def close(self) -> None:
        """Stay open."""


def guidance(*arguments: object, said: str = "") -> Done:
    """Run the command to its end.

    Args:
        arguments: Of the command.
        said: What the person types when asked, line by line.
    """
    ends = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    out, err = (io.TextIOWrapper(Kept(), encoding="utf-8") for _ in range(2))
    with (
        patch.object(sys, "argv", ["guidance", *map(str, arguments)]),
        patch.object(sys, "stdin", io.StringIO(said)),
        patch.dict(os.environ, COLUMNS="200"),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code
        finally:
            for number, handler in ends.items():
                signal.signal(number, handler)
    out.flush()
    err.flush()
    return Done(int(code or 0), *(stream.buffer.getvalue().decode() for stream in (out, err)))
