"""Authorization: anyone who can read the token file may send orders; by default only its owner.

Any user of a computer can reach a loopback port, so the control bus requires a name and a secret. Each start draws a
new secret and writes it to a file of mode 0600. An existing file with another mode (for a group, for example) is used
as it is. The folder must not be writable for others. Source: Zenoh's user and password authentication.
"""

import contextlib
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.errors import ConfigError
from guidance.files import private_file, writing

USER: Final = "guidance"
_LINE: Final = re.compile(rf"{USER}:([0-9a-f]{{32,}})\n?")
_OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH


class ControlToken(NamedTuple):
    """A secret and its file, in the format of Zenoh's user dictionary."""

    path: Path
    secret: str

    def for_server(self) -> dict[str, Any]:
        """Return Zenoh's `transport.auth` of the listening side."""
        return {"usrpwd": {**self.for_client()["usrpwd"], "dictionary_file": str(self.path)}}

    def for_client(self) -> dict[str, Any]:
        """Return Zenoh's `transport.auth` of the joining side."""
        return {"usrpwd": {"user": USER, "password": self.secret}}


def default_path(endpoint: str) -> Path:
    """Return where the token of a control endpoint lies: in the daemon's or the user's runtime folder.

    Raises:
        ConfigError: If there is no runtime folder, and another user owns or may write to the fallback.
    """
    given, user = os.environ.get("RUNTIME_DIRECTORY"), os.environ.get("XDG_RUNTIME_DIR")
    if given:
        folder = Path(given.split(":")[0])
    elif user:
        folder = Path(user) / "guidance"
    else:
        folder = Path(tempfile.gettempdir()) / f"guidance-{os.getuid()}"
        if folder.exists():
            _check_folder(folder, {os.getuid()})
    return folder / (re.sub(r"[^A-Za-z0-9.]+", "-", endpoint) + ".token")


def draw(path: Path) -> ControlToken:
    """Draw a secret for `path` and write it to a file beside it; `publish` renames that file.

    An existing file with another mode than 0600 was made by a person for others to read: it is used.

    Raises:
        ConfigError: If another user owns or may write to the folder, or the existing file is no token.
        OutputError: If the file or its folder cannot be written.
    """
    with writing(f"control.token_file = {str(path)!r}"):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(path.parent, {os.getuid(), 0})
        if path.exists() and not _is_private(path) and (kept := read(path)) is not None:
            return kept
        token = ControlToken(path.with_name(f".{path.name}.{os.getpid()}"), secrets.token_hex(32))
        private_file(token.path).write_text(f"{USER}:{token.secret}\n", encoding="ascii")
    return token


def publish(drawn: ControlToken, path: Path) -> ControlToken:
    """Put a drawn token where others look for it, once the endpoint is ours and no other daemon's."""
    drawn.path.replace(path)
    return drawn._replace(path=path)


def discard(token: ControlToken) -> None:
    """Remove a token that we drew; one that another daemon has published since, or a person made, stays."""
    with contextlib.suppress(OSError, ConfigError):
        if _is_private(token.path) and read(token.path) == token:
            token.path.unlink()


def read(path: Path) -> ControlToken | None:
    """Read a token; None where there is none.

    Raises:
        ConfigError: If others may write to its folder, we may not read it, or it is no token.
    """
    try:
        found = _LINE.fullmatch(path.read_text(encoding="ascii"))
        _check_folder(path.parent, {path.parent.stat().st_uid})
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ConfigError(f"control token {path}: cannot be read ({reason}); only who can read it may order") from error
    if found is None:
        raise ConfigError(f"control token {path}: not a token file: expected one line, {USER}:<hexadecimal digits>")
    return ControlToken(path, found[1])


def _is_private(path: Path) -> bool:
    return stat.S_IMODE(path.stat().st_mode) == 0o600


def _check_folder(folder: Path, owners: Collection[int]) -> None:
    """Refuse a folder in which another user could put or replace a token file; a sticky bit does not help."""
    found = folder.stat()
    if found.st_uid not in owners or found.st_mode & _OTHERS_WRITE:
        raise ConfigError(
            f"control.token_file: others may write to {folder}; run chmod go-w on it, or give another path"
        )
