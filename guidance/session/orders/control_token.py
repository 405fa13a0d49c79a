"""The secret of a control endpoint, in a file: anyone who can read the file may send orders.

By default only its owner can. Any user of a computer can reach a loopback port, so the Zenoh control bus requires the
same name and secret as the socket. Each start draws a new secret and writes it to a file of mode 0600. An existing file
with another mode (for a group, for example) is used as it is. The folder must not be writable for others. Source:
Zenoh's user and password authentication.
"""

import contextlib
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.errors import ConfigError
from guidance.files import private_file, read_text, writing

_LONGEST_PATH: Final = 100
"""Bytes of a socket's path that the kernel takes, with some to spare."""

USER: Final = "guidance"

_LARGEST_TOKEN_BYTES: Final = 4096

_LINE: Final = re.compile(rf"{USER}:([0-9a-f]{{32,}})\n?")


class ControlToken(NamedTuple):
    """A secret and its file, in the format of Zenoh's user dictionary."""

    path: Path
    secret: str

    def auth(self, **dictionary: str) -> dict[str, Any]:
        """Return Zenoh's `transport.auth` of the joining side; the listening side adds its `dictionary_file`."""
        return {"usrpwd": {"user": USER, "password": self.secret, **dictionary}}


def token_path(endpoint: str) -> Path:
    """Return where the token of a control endpoint lies: in the daemon's or the user's runtime folder.

    Raises:
        ConfigError: If there is no runtime folder, and another user owns or may write to the fallback.
    """
    runtime_folder = os.environ.get("RUNTIME_DIRECTORY")
    user = os.environ.get("XDG_RUNTIME_DIR")
    if runtime_folder:
        folder = Path(runtime_folder.split(":")[0])
    elif user:
        folder = Path(user) / "guidance"
    else:
        folder = Path(tempfile.gettempdir()) / f"guidance-{os.getuid()}"
        if folder.exists():
            _check_folder(folder, {os.getuid()})
    return folder / (re.sub(r"[^A-Za-z0-9.]+", "-", endpoint) + ".token")


def draw_token(path: Path) -> ControlToken:
    """Draw a secret for `path` and write it to a file beside it, to be renamed once the endpoint is ours.

    An existing file with another mode than 0600 was made by a person for others to read: it is used.

    Raises:
        ConfigError: If another user owns or may write to the folder, or the existing file is no token.
        OutputError: If the file or its folder cannot be written.
    """
    with writing(f"control.token_file = {str(path)!r}"):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(path.parent, {os.getuid(), 0})
        token_of_person = read_token(path) if path.exists() and not _is_private(path) else None
        if token_of_person is not None:
            return token_of_person
        token = ControlToken(path.with_name(f".{path.name}.{os.getpid()}"), secrets.token_hex(32))
        private_file(token.path).write_bytes(f"{USER}:{token.secret}\n".encode())
    return token


def discard_token(token: ControlToken) -> None:
    """Remove a token that we drew; one that another daemon has published since, or a person made, stays."""
    with contextlib.suppress(OSError, ConfigError):
        if _is_private(token.path) and read_token(token.path) == token:
            token.path.unlink()


def read_token(path: Path) -> ControlToken | None:
    """Read a token; None where there is none.

    Raises:
        ConfigError: If others may write to its folder, we may not read it, or it is no token.
    """
    try:
        match = _LINE.fullmatch(read_text(path, _LARGEST_TOKEN_BYTES))
        _check_folder(path.parent, {path.parent.stat().st_uid})
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ConfigError(
            f"control token {path}: cannot be read ({reason}); only who can read it may order"
        ) from error
    if match is None:
        raise ConfigError(
            f"control token {path}: not a token file: expected one line, {USER}:<hexadecimal digits>"
        )
    return ControlToken(path, match[1])


def _is_private(path: Path) -> bool:
    return stat.S_IMODE(path.stat().st_mode) == 0o600


def _check_folder(folder: Path, owners: Collection[int]) -> None:
    """Refuse a folder if another user could put or replace a token file in it; a sticky bit does not help."""
    status = folder.stat()
    if status.st_uid not in owners or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ConfigError(
            f"control.token_file: others may write to {folder}; run chmod go-w on it, or give another path"
        )


def socket_path(token: Path) -> Path:
    """Return the path of the socket that belongs to a token file."""
    return token.with_suffix(".sock")


@contextlib.contextmanager
def reachable(path: Path) -> Iterator[str]:
    """Yield a socket address for a path; a path too long for the kernel is reached by its folder's descriptor."""
    if len(os.fsencode(path)) <= _LONGEST_PATH:
        yield str(path)
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
