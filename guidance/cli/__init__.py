"""The `guidance` command. Orders take a fast path; all other commands are in `guidance.cli.program`."""

import sys
from typing import Any

from guidance.cli.streams import open_outlets, printable
from guidance.errors import GuidanceError, OutputError

INTERRUPTED = 130
FAULT = 70
"""Exit code of an internal error (EX_SOFTWARE of sysexits.h)."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - typer.Typer, imported lazily
    """Return `app`, which is imported only when needed."""
    if name == "app":
        from guidance.cli.program import app  # noqa: PLC0415

        return app
    raise AttributeError(f"module 'guidance.cli' has no attribute {name!r}")


def main() -> None:
    """Run the command line. Errors that the user can fix end with a message and an exit code (`docs/exit-codes.md`)."""
    open_outlets()
    try:
        _run()
    except KeyboardInterrupt:
        _end("interrupted before anything began", INTERRUPTED)
    except GuidanceError as error:
        _end(str(error), error.exit_code)
    except OSError as error:
        place = f"{error.filename}: " if error.filename is not None else ""
        _end(f"{place}{error.strerror or error}", OutputError.exit_code)
    except Exception:
        import traceback  # noqa: PLC0415 - slow import

        traceback.print_exc()
        _end("internal error of guidance: please report it with the lines above", FAULT)


def _run() -> None:
    try:
        from guidance.cli.short_order import short_order  # noqa: PLC0415 - here a Ctrl-C prints no traceback

        code = short_order(sys.argv[1:])
        if code is None:
            from guidance.cli.program import app  # noqa: PLC0415 - typer takes a third of a second

            app()
        sys.exit(code)
    finally:
        sys.stdout.flush()


def _end(words: str, code: int) -> None:
    lines = "\n".join(map(printable, words.splitlines()))  # the message may quote an untrusted file
    print(f"error: {lines}", file=sys.stderr)  # noqa: T201
    sys.exit(code)
