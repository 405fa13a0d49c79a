"""The `guidance` command. An order goes the short way; everything else is a command of `guidance.cli.program`."""

import sys
from typing import Any

from guidance.cli.short_order import short_order
from guidance.cli.streams import open_outlets
from guidance.errors import GuidanceError, OutputError
from guidance.screen import printable

FAULT = 70
"""Exit code where guidance itself is at fault (EX_SOFTWARE of sysexits.h)."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - typer.Typer, which is not imported for an order
    """Return `app`, the whole program, imported when it is asked for."""
    if name == "app":
        from guidance.cli.program import app  # noqa: PLC0415

        return app
    raise AttributeError(f"module 'guidance.cli' has no attribute {name!r}")


def main() -> None:
    """Run the command line. What the user can mend ends with one message and an exit code, not with a traceback.

    The exit codes are those of `docs/exit-codes.md`.
    """
    open_outlets()
    try:
        _run()
    except GuidanceError as error:
        _end(str(error), error.exit_code)
    except OSError as error:
        place = f"{error.filename}: " if error.filename is not None else ""
        _end(f"{place}{error.strerror or error}", OutputError.exit_code)
    except Exception:
        import traceback  # noqa: PLC0415 - takes a twentieth of a second

        traceback.print_exc()
        _end("this is a fault of guidance itself: please report it, with the lines above", FAULT)


def _run() -> None:
    try:
        code = short_order(sys.argv[1:])
        if code is None:
            from guidance.cli.program import app  # noqa: PLC0415 - typer takes a third of a second

            app()
        sys.exit(code)
    finally:
        sys.stdout.flush()


def _end(words: str, code: int) -> None:
    lines = "\n".join(map(printable, words.splitlines()))  # a message may quote a stranger's file
    print(f"error: {lines}", file=sys.stderr)  # noqa: T201 - the last word of a command
    sys.exit(code)
