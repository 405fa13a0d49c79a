"""Standard output of the commands: replaces characters that the terminal lacks, and handles write errors.

A closed pipe (`| head`) ends the command silently, as SIGPIPE would. A full disk ends it with a message.
"""

import codecs
import errno
import io
import os
import signal
import sys
import unicodedata
from typing import Any, Final

from guidance.errors import OutputError

PIPE_CLOSED: Final = 128 + signal.SIGPIPE if hasattr(signal, "SIGPIPE") else 141
"""Exit code when the reader of the output is gone."""

_PLAIN: Final = {
    "δ": "delta", "τ": "tau", "Δ": "Delta", "σ": "sigma", "π": "pi", "μ": "u", "×": "x", "·": "*", "°": " deg",
    "±": "+-", "−": "-", "–": "-", "—": "-", "…": "...", "→": "->", "←": "<-", "≤": "<=", "≥": ">=", "≠": "!=",
    "≈": "~", "✓": "yes", "✗": "no", "•": "*", "●": "*", "“": '"', "”": '"', "‘": "'", "’": "'", "²": "^2",
    "─": "-", "━": "-", "│": "|", "┃": "|", "\u00a0": " ",
}  # fmt: skip
"""Replacements for characters that an encoding lacks."""


def _in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    """Replace one letter by ASCII, as the error handler "plain-letters"."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    plain = _PLAIN.get(letter)
    if not plain:
        plain = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    if not plain:
        plain = f"\\u{ord(letter):04x}"
    return plain, error.start + 1


codecs.register_error("plain-letters", _in_plain_letters)


class _Outlet(io.FileIO):
    """A descriptor that is written to.

    Raises:
        OutputError: From write, if it cannot be written.
        SystemExit: From write, if the reader is gone.
    """

    def write(self, b: Any, /) -> int:  # noqa: ANN401 - any buffer
        """Write bytes."""
        try:
            return super().write(b)
        except OSError as error:
            # The rest of the buffer is written when the process ends; send it to /dev/null, or it would fail again.
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self.fileno())
            os.close(nothing)
            if error.errno == errno.EPIPE:
                raise SystemExit(PIPE_CLOSED) from None
            raise OutputError(
                f"stdout: cannot be written ({error.strerror}); redirect it elsewhere"
            ) from None


def open_outlets() -> None:
    """Replace standard output by one over an `_Outlet`, and let both streams replace unknown characters."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain-letters")
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper) and isinstance(
        getattr(out.buffer, "raw", out.buffer), io.FileIO
    ):
        buffer = io.BufferedWriter(_Outlet(out.fileno(), "w", closefd=False))
        sys.stdout = io.TextIOWrapper(
            buffer, out.encoding, out.errors, line_buffering=out.line_buffering
        )
