"""Authorization: anyone who can read the token file may send orders; by default only its owner.

Anybody on a computer can reach a loopback port, so the control bus asks for a name and a secret before it lets anyone
in. The secret is drawn anew at every start and lies in a file of mode 0600; another file, made beforehand with other
rights (a group that may read it, say), is used as it is. Source: Zenoh's user and password authentication.
"""

import contextlib
import os
import re
import secrets
import stat
import tempfile
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.errors import ConfigError, OutputError

USER: Final = "guidance"
_LINE: Final = re.compile(rf"{USER}:([0-9a-f]{{32,}})\n?")


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
        ConfigError: If there is no runtime folder, and the fallback belongs to another user.
    """
    name = re.sub(r"[^A-Za-z0-9.]+", "-", endpoint) + ".token"
    given = os.environ.get("RUNTIME_DIRECTORY")
    if given:
        return Path(given.split(":")[0]) / name
    user = os.environ.get("XDG_RUNTIME_DIR")
    if user:
        return Path(user) / "guidance" / name
    return Path(tempfile.gettempdir()) / f"guidance-{os.getuid()}" / name


def draw(path: Path) -> ControlToken:
    """Draw a secret for `path` and write it beside it, for its owner's eyes; `publish` puts it in its place.

    A file that is there already with other rights than 0600 was made by a person, for others to read: it is used.

    Raises:
        ConfigError: If others may write there.
        OutputError: If the file or its folder cannot be written.
    """
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(path.parent)
        kept = read(path) if path.exists() and not _is_private(path) else None
        if kept is not None:
            return kept
        token = ControlToken(path.with_name(f".{path.name}.{os.getpid()}"), secrets.token_hex(32))
        token.path.unlink(missing_ok=True)
        opened = os.open(token.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(opened, "w", encoding="ascii") as file:
            file.write(f"{USER}:{token.secret}\n")
    except OSError as error:
        raise OutputError(
            f"control.token_file = {str(path)!r}: cannot be written ({error.strerror}); give a path that can"
        ) from error
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
        ConfigError: If it may not be read by us, or is no token.
    """
    try:
        found = _LINE.fullmatch(path.read_text(encoding="ascii"))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise ConfigError(
            f"control token {path}: cannot be read ({reason}); orders are its owner's, or a group's that may read it"
        ) from error
    if found is None:
        raise ConfigError(f"control token {path}: is none; it has one line, {USER}:<hexadecimal digits>")
    return ControlToken(path, found[1])


def _is_private(path: Path) -> bool:
    return stat.S_IMODE(path.stat().st_mode) == 0o600


def _check_folder(folder: Path) -> None:
    """Refuse a folder in which another user could replace our token file."""
    found = folder.stat()
    theirs = found.st_uid not in (os.getuid(), 0)
    if theirs or (found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not found.st_mode & stat.S_ISVTX):
        raise ConfigError(f"control.token_file: others may write to {folder}; chmod 700 it or give another path")
