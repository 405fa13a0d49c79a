"""Runs a `guidance` command in this process and returns its standard output, standard error and exit code.

A separate process takes a second to start; only tests of the process itself need one (`fresh`).
"""

import io
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple
from unittest.mock import patch

from guidance.cli import main


class Done(NamedTuple):
    """Result of a command, with the field names of `subprocess.CompletedProcess`."""

    returncode: int
    stdout: str
    stderr: str


class Kept(io.BytesIO):
    """A buffer that stays readable after close; the command's text stream closes it when it is deleted."""

    def close(self) -> None:
        """Stay open."""


def guidance(*arguments: object, said: str = "") -> Done:
    """Run the command to its end.

    Args:
        arguments: Arguments of the command.
        said: Standard input, one line per prompt.
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


HEAVY = frozenset({"numpy", "mavsdk", "pymavlink", "pydantic", "rich", "typer", "asyncio"})
"""Modules whose import takes longer than an order."""


class Fresh(NamedTuple):
    """What a command did in a process of its own."""

    code: int
    words: str
    modules: set[str]
    processor_time_s: float


def fresh(*arguments: object) -> Fresh:
    """Run the command in a process of its own."""
    code = (
        "import sys, time, atexit; sys.argv[0] = 'guidance'\n"
        "from guidance.cli import main\n"
        "atexit.register(lambda: print(time.process_time(), *sorted(sys.modules), file=sys.stderr))\n"
        "main()"
    )
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    took_s, *modules = done.stderr.split()[-3000:]
    return Fresh(done.returncode, done.stdout, set(modules), float(took_s))
