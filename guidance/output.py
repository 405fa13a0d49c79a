"""Files that are written: what the system refuses is said with the file's name."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from guidance.errors import OutputError


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say what cannot be written, and why, where the system only refuses.

    Raises:
        OutputError: For an OSError of the body.
    """
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); choose another place") from error
