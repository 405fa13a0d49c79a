"""Where a command writes: in letters that the terminal knows, and with one meaning for each way of failing to write.

Output that ends early (`| head`) ends the command in silence, as SIGPIPE would; a full disk ends it with a message.
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
"""The exit code of a command whose reader went away."""

_PLAIN: Final = {
    "δ": "delta", "τ": "tau", "Δ": "Delta", "σ": "sigma", "π": "pi", "μ": "u", "×": "x", "·": "*", "°": " deg",
    "±": "+-", "−": "-", "–": "-", "—": "-", "…": "...", "→": "->", "←": "<-", "≤": "<=", "≥": ">=", "≠": "!=",
    "≈": "~", "✓": "yes", "✗": "no", "•": "*", "●": "*", "“": '"', "”": '"', "‘": "'", "’": "'", "²": "^2",
    "─": "-", "━": "-", "│": "|", "┃": "|", "\u00a0": " ",
}  # fmt: skip
"""What is written for a letter that an encoding does not have."""


def plain(text: str) -> str:
    """Return text in ASCII, as close to it as that can be."""
    return "".join(letter if letter.isascii() else _plain(letter) for letter in text)


def _plain(letter: str) -> str:
    if letter in _PLAIN:
        return _PLAIN[letter]
    bare = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return bare or f"\\u{ord(letter):04x}"


def _in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return plain(error.object[error.start : error.end]), error.end


codecs.register_error("plain-letters", _in_plain_letters)


class Outlet(io.TextIOWrapper):
    """A text stream over another's buffer; see the module.

    Raises:
        OutputError: Where it cannot be written, from every write and flush.
        SystemExit: Where nobody reads any more.
    """

    def write(self, text: str) -> int:
        """Write text."""
        try:
            return super().write(text)
        except OSError as error:
            raise self._ended(error) from None

    def flush(self) -> None:
        """Hand what waits to the system."""
        try:
            super().flush()
        except OSError as error:
            raise self._ended(error) from None

    def _ended(self, error: OSError) -> BaseException:
        # What waits in the buffer is written when the process ends: into nothing, or it would fail again.
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self.fileno())
        os.close(nothing)
        if error.errno == errno.EPIPE:
            return SystemExit(PIPE_CLOSED)
        name = str(self.name).strip("<>")
        return OutputError(f"{name}: cannot be written ({error.strerror}); send it somewhere else")


def open_outlets() -> None:
    """Put an outlet in the place of standard output, and let both streams write letters that their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="plain-letters")
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper):
        sys.stdout = Outlet(
            out.buffer, encoding=out.encoding, errors=out.errors, line_buffering=out.line_buffering, write_through=False
        )
