"""Private files and folders: flight data show where people and vehicles were.

Files get mode 0600 and new folders 0700, independent of the umask. Existing folders keep their mode. Errors name the
file.
"""

import contextlib
import errno
import os
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from guidance.errors import ConfigError, OutputError

_FILE: Final = stat.S_IRUSR | stat.S_IWUSR
_FOLDER: Final = stat.S_IRWXU


def private_folder(path: Path) -> Path:
    """Create a folder and its missing parents with mode 0700; return it.

    Raises:
        OSError: If it cannot be created.
    """
    for folder in reversed((path, *path.parents)):
        if not folder.exists():
            with contextlib.suppress(FileExistsError):  # another process created it
                folder.mkdir(mode=_FOLDER)
                folder.chmod(_FOLDER)  # the umask can only remove permissions
    path.mkdir(exist_ok=True)
    return path


def private_file(path: Path) -> Path:
    """Create an empty file with mode 0600, or empty an existing one of ours and set that mode; return it.

    Raises:
        OSError: If it cannot be written, belongs to another user or is a symbolic link, whose target stays as it is.
    """
    with os.fdopen(
        os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, _FILE), "wb"
    ) as file:
        status = os.fstat(file.fileno())
        if stat.S_ISREG(status.st_mode):  # not /dev/null
            if status.st_uid != os.geteuid():
                raise PermissionError(errno.EPERM, f"{path} belongs to another user")
            os.fchmod(file.fileno(), _FILE)
            file.truncate(0)
    return path


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a private file for writing. It takes the place of `path` when the body ends, and is removed if that fails.

    A device such as /dev/stdout is written directly.

    Raises:
        OSError: If it cannot be written, or `path` is a symbolic link, whose target stays as it is.
    """
    if path.exists() and not (path.is_file() or path.is_symlink()):
        yield private_file(path)
        return
    if path.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield private_file(unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield the name of a folder that the body creates, with the same last part. It becomes `path` when the body ends.

    The folder, and the files in it, are private then. If the body fails, it is removed.

    Raises:
        OSError: If it cannot be written, or `path` exists.
    """
    if path.exists() or path.is_symlink():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    parent = private_folder(path.with_name(f".{path.name}.{os.getpid()}"))
    unfinished = parent / path.name
    try:
        yield unfinished
        for file in unfinished.iterdir():
            file.chmod(_FILE)
        unfinished.chmod(_FOLDER)
        unfinished.replace(path)
    finally:
        shutil.rmtree(parent, ignore_errors=True)


def open_regular(path: Path) -> BinaryIO:
    """Open a file to read it; a pipe without a writer must not block.

    Raises:
        OSError: If it cannot be read, or is not a regular file (a device or a pipe may have no end).
    """
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return file


LARGEST_TEXT_BYTES: Final = 4 * 2**20
"""Largest plan, track or key. A track of ten hours at 1 Hz takes 2 MB."""


def read_text(path: Path, most_bytes: int = LARGEST_TEXT_BYTES) -> str:
    """Read a text file of limited size; a byte order mark is left out.

    Raises:
        OSError: If it cannot be read, is not a regular file (a device or a pipe may have no end), or is too large.
        UnicodeDecodeError: If it is not UTF-8.
    """
    with open_regular(path) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"larger than {most_bytes} bytes", str(path))
    return content.decode("utf-8-sig")


def text_of(path: Path, said: str, *, secret: bool) -> str:
    """Read a text file; `said` names it in errors.

    Raises:
        ConfigError: If it cannot be read or is not text, or it is secret and others may read it.
    """
    try:
        mode = path.stat().st_mode
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ConfigError(f"{said}: cannot be read ({reason})") from error
    if secret and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{said}: others may read it; chmod 600 it")
    return text


@contextlib.contextmanager
def writing(path: Path | str, advice: str = "choose another place") -> Iterator[None]:
    """Turn an OSError of the body into an error that names the file, or the key and the file, and says what to do.

    Raises:
        OutputError: If the body raises OSError.
    """
    try:
        yield
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); {advice}") from error
