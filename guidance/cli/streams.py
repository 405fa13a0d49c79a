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
from typing import Final

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


def printable(text: str) -> str:
    """Escape control characters of untrusted text, which could command the terminal."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def _in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    """Replace one letter by ASCII, as the error handler "plain-letters"."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    bare = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return _PLAIN.get(letter) or bare or f"\\u{ord(letter):04x}", error.start + 1


codecs.register_error("plain-letters", _in_plain_letters)


class Outlet(io.TextIOWrapper):
    """A text stream over another stream's buffer.

    Raises:
        OutputError: From write and flush, if the output cannot be written.
        SystemExit: From write and flush, if the reader is gone.
    """

    def write(self, text: str) -> int:
        """Write text."""
        try:
            return super().write(text)
        except OSError as error:
            raise self._ended(error) from None

    def flush(self) -> None:
        """Flush the buffer."""
        try:
            super().flush()
        except OSError as error:
            raise self._ended(error) from None

    def _ended(self, error: OSError) -> BaseException:
        # The rest of the buffer is written when the process ends; send it to /dev/null, or it would fail again.
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self.fileno())
        os.close(nothing)
        if error.errno == errno.EPIPE:
            return SystemExit(PIPE_CLOSED)
        name = str(self.name).strip("<>")
        return OutputError(f"{name}: cannot be written ({error.strerror}); redirect it elsewhere")


def open_outlets() -> None:
    """Replace standard output by an `Outlet`, and let both streams replace unknown characters."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain-letters")
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper):
        sys.stdout = Outlet(out.buffer, out.encoding, out.errors, line_buffering=out.line_buffering)
