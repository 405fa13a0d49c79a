"""Files and folders that only their owner reads: they say where people and vehicles were.

Whatever the process's umask is, a file has mode 0600 and a folder that is made for it 0700. A folder that is there
already keeps the rights that a person gave it. What the system refuses is said with the file's name.
"""

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from guidance.errors import OutputError

_FILE: Final = stat.S_IRUSR | stat.S_IWUSR
_FOLDER: Final = stat.S_IRWXU


def private_folder(path: Path) -> Path:
    """Make a folder, and those above it that are missing, for us alone; return it.

    Raises:
        OSError: If it cannot be made.
    """
    for folder in reversed((path, *path.parents)):
        if not folder.exists():
            with contextlib.suppress(FileExistsError):  # somebody else has made it meanwhile
                folder.mkdir(mode=_FOLDER)
                folder.chmod(_FOLDER)  # a umask takes away only
    path.mkdir(exist_ok=True)
    return path


def private_file(path: Path) -> Path:
    """Make an empty file for us alone, or empty the one there and make it ours alone; return it, to be written.

    Raises:
        OSError: If it cannot be written.
    """
    opened = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, _FILE)
    try:
        if stat.S_ISREG(os.fstat(opened).st_mode):  # not /dev/null
            path.chmod(_FILE)
    finally:
        os.close(opened)
    return path


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
