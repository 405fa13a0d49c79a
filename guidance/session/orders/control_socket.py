"""Orders on this computer: a Unix-domain socket beside the daemon's token, one JSON line each way.

`guidance ctl` uses it first. It needs no Zenoh session, which takes most of a second to import and open, and other
users cannot reach it: the socket has the token file's rights, and each order shows the token. This module imports
nothing heavy on purpose.

Authorization: anyone who can read the token file may send orders; by default only its owner. Any user of a computer can
reach a loopback port, so the Zenoh control bus requires the same name and secret. Each start draws a new secret and
writes it to a file of mode 0600. An existing file with another mode (for a group, for example) is used as it is. The
folder must not be writable for others. Source: Zenoh's user and password authentication.
"""

import contextlib
import getpass
import hmac
import json
import os
import re
import secrets
import socket
import stat
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from guidance.errors import ConfigError, GuidanceError, LinkError, OutputError
from guidance.files import private_file, read_text, writing
from guidance.session.orders.replies import MAX_REPLY_BYTES, Answer, read_reply, written
from guidance.texts import printable

STATUS = "status"
RESET = "reset"
ALIVE = "alive"
WORDS: Final = ("abort", "engage", "hold", "land", "return", "start", RESET, STATUS, ALIVE)
"""All orders and queries of a daemon."""

ENDPOINT: Final = "tcp/127.0.0.1:7448"
"""Default control endpoint of daemons and flights."""

TIMEOUT_S: Final = 4.0
"""Time limit for the answer, longer than the mailbox waits for the loop."""

LONGEST_NAME: Final = 64
"""Longest name of a sender, in characters; it is recorded."""

TEAM_ANSWER_LIMIT_S: Final = 2.5
"""Time limit for the answers of a team's vehicles, longer than a mailbox waits for its loop."""

TEAM_TIMEOUT_S: Final = 2 * TEAM_ANSWER_LIMIT_S + 1.0
"""Time limit for an order to a team by the socket: `start` and `engage` ask for the status first."""

_ASKED_WITHIN_S: Final = 1.0
_LONGEST_ORDER: Final = 4096
_LONGEST_ANSWER: Final = 32 * MAX_REPLY_BYTES
_BUFFER_BYTES: Final = 65536
"""Read at once: bytes left unread would reset the connection before the answer arrives."""
_MOST_AT_ONCE: Final = 64
_ACCEPT_AGAIN_S: Final = 0.05
_LONGEST_PATH: Final = 100
"""Bytes of a socket's path that the kernel takes, with some to spare."""

USER: Final = "guidance"
_LARGEST_TOKEN_BYTES: Final = 4096
_LINE: Final = re.compile(rf"{USER}:([0-9a-f]{{32,}})\n?")


class SilentDaemonError(LinkError):
    """A daemon listens at its socket and does not answer."""


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
        private_file(token.path).write_text(f"{USER}:{token.secret}\n", encoding="ascii")
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
    """Refuse a folder in which another user could put or replace a token file; a sticky bit does not help."""
    status = folder.stat()
    if status.st_uid not in owners or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mend = "run chmod go-w on it, or give another path"
        raise ConfigError(f"control.token_file: others may write to {folder}; {mend}")


def socket_path(token: Path) -> Path:
    """Return the path of the socket that belongs to a token file."""
    return token.with_suffix(".sock")


def own_name(program: str) -> str:
    """Return how a program of this user names itself in an order."""
    with contextlib.suppress(KeyError, OSError):  # a user without a name
        return f"{program}, {getpass.getuser()}"
    return program


def name_in(data: bytes) -> str:
    """Return the sender's name as printable text of bounded length; the data may be anything."""
    text = data[: 4 * LONGEST_NAME].decode("utf-8", errors="replace")
    return "".join(character for character in text if character.isprintable())[
        :LONGEST_NAME
    ].strip()


def ask_here(
    order: str, *, endpoint: str, name: str | None, token_file: Path | None = None, by: str = ""
) -> Answer | None:
    """Give an order to the daemon of an endpoint by its socket on this computer.

    Args:
        order: One of `WORDS`.
        endpoint: The daemon's control endpoint.
        name: The daemon's; None accepts any.
        token_file: Where its token lies, if not in the usual place.
        by: Name of the person or program, for log and record.

    Returns:
        The answer; None if no daemon listens at such a socket.

    Raises:
        ConfigError: If there is no such order, or we may not read the token.
        LinkError: If the daemon has another name, does not know the token or does not answer.
    """
    request = {"order": _known(order), "name": name, "by": by}
    data = _exchanged(request, endpoint, token_file, TIMEOUT_S)
    if data is None:
        return None
    reply = _opened(data, endpoint)
    unnamed = "the daemon" if name is None else name
    return read_reply(data, str(reply.get("name", unnamed)), order)


def ask_team_here(
    order: str,
    team: str,
    names: Collection[str],
    *,
    endpoint: str,
    token_file: Path | None = None,
    by: str = "",
) -> Sequence[Answer] | None:
    """Give an order to a team by the socket of the daemon that hosts its endpoint on this computer.

    Args:
        order: One of `WORDS`.
        team: Its name.
        names: Of vehicles; empty for all.
        endpoint: The control endpoint that the daemons share.
        token_file: Where its token lies, if not in the usual place.
        by: Name of the person or program, for log and record.

    Returns:
        An answer for each vehicle; None if no daemon listens at such a socket, or none that passes orders on.

    Raises:
        ConfigError: If there is no such order, or we may not read the token.
        LinkError: If no vehicle of the team answers, or the daemon does not.
    """
    # Not named `order`: a daemon of an older version would take it for an order to itself alone.
    request = {"team_order": _known(order), "team": team, "names": list(names), "by": by}
    data = _exchanged(request, endpoint, token_file, TEAM_TIMEOUT_S)
    if data is None:
        return None
    answers = _opened(data, endpoint).get("answers")
    if not isinstance(answers, dict):
        return None
    return [read_reply(written(answer), str(name), order) for name, answer in answers.items()]


def _known(order: str) -> str:
    if order not in WORDS:
        raise ConfigError(f"order = {order!r}: allowed are {', '.join(WORDS)}")
    return order


def _exchanged(
    request: Mapping[str, Any], endpoint: str, token_file: Path | None, timeout_s: float
) -> bytes | None:
    """Send a line to the daemon of an endpoint and return its line; None if no daemon listens there."""
    path = token_path(endpoint) if token_file is None else token_file
    token = read_token(path)
    if token is None:
        return None
    line = json.dumps({"token": token.secret, **request}).encode() + b"\n"
    try:
        with (
            socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection,
            _reachable(socket_path(path)) as address,
        ):
            connection.settimeout(timeout_s)
            connection.connect(address)
            connection.sendall(line)
            return connection.makefile("rb").readline(_LONGEST_ANSWER)
    except (FileNotFoundError, NotADirectoryError, ConnectionRefusedError):
        return None
    except OSError as error:
        raise SilentDaemonError(
            f"control {socket_path(path)}: no answer ({error}); is the daemon running?"
        ) from error


def _opened(data: bytes, endpoint: str) -> Mapping[str, Any]:
    """Return a daemon's line as an object.

    Raises:
        LinkError: If it is none, or an error of the daemon.
    """
    try:
        reply = json.loads(data)
    except (ValueError, RecursionError):
        reply = None
    if not isinstance(reply, dict):
        raise LinkError(f"control {endpoint}: no answer that can be read; is the daemon running?")
    if "error" in reply:
        raise LinkError(f"control {endpoint}: {printable(str(reply['error']))}")
    return reply


def begin_exchange(
    free: threading.BoundedSemaphore, exchange: Callable[..., None], *arguments: object
) -> bool:
    """Start an exchange with a client on a thread of its own; False if `free` says that too many are under way.

    No exchange waits for another one: an abort does not wait until an engage order is answered.
    """
    if not free.acquire(blocking=False):
        return False

    def run() -> None:
        try:
            exchange(*arguments)
        finally:
            free.release()

    try:
        threading.Thread(target=run, name="order", daemon=True).start()
    except RuntimeError:  # no thread is free at the moment
        free.release()
        return False
    return True


class PassOn(Protocol):
    """Gives an order to a team and returns an answer for each vehicle."""

    def __call__(
        self, order: str, team: str, names: Collection[str], *, by: str
    ) -> Sequence[Answer]:
        """Raise LinkError if no vehicle of the team answers."""


class ControlSocket:
    """Takes orders at a socket, and answers. Every connection has a thread for one order.

    Args:
        name: The daemon's.
        answer: Answers an order or a query, given with the name of its sender.
        token: What who orders must know; the socket gets the rights of its file.
        pass_on: Gives an order to a team; None takes no such orders.

    Raises:
        OutputError: If the socket cannot be made.
    """

    def __init__(
        self,
        name: str,
        answer: Callable[[str, str], Answer],
        token: ControlToken,
        pass_on: PassOn | None = None,
    ) -> None:
        self._name = name
        self._answer = answer
        self._token = token
        self._pass_on = pass_on
        self._path = socket_path(token.path)
        self._free = threading.BoundedSemaphore(_MOST_AT_ONCE)
        self._closed = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            # Of a daemon that was killed: the endpoint is ours by now
            self._path.unlink(missing_ok=True)
            with _reachable(self._path) as address:
                self._listener.bind(address)
            rights = token.path.stat()
            with contextlib.suppress(PermissionError):
                os.chown(self._path, -1, rights.st_gid)
            readable = stat.S_IMODE(rights.st_mode) & 0o444
            # Who may read the token may write to the socket
            self._path.chmod(readable | readable >> 1)
            self._listener.listen(_MOST_AT_ONCE)
        except OSError as error:
            self._listener.close()
            raise OutputError(
                f"control socket {self._path}: cannot be made ({error.strerror})"
            ) from error
        self._thread = threading.Thread(target=self._serve, name="control socket")
        self._thread.start()

    def close(self) -> None:
        """Take no more orders. May be called twice."""
        self._closed.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # ends the accept that waits
        self._thread.join()
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _serve(self) -> None:
        while not self._closed.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:  # it was shut down, or no descriptor is free at the moment
                self._closed.wait(_ACCEPT_AGAIN_S)
                continue
            if not begin_exchange(self._free, self._exchange, connection):
                connection.close()

    def _exchange(self, connection: socket.socket) -> None:
        # The data may be anything
        with (
            connection,
            contextlib.suppress(OSError, ValueError, TypeError, AttributeError, RecursionError),
        ):
            connection.settimeout(_ASKED_WITHIN_S)
            request = json.loads(connection.makefile("rb", _BUFFER_BYTES).readline(_LONGEST_ORDER))
            connection.sendall(written(self._answer_to(request)) + b"\n")

    def _answer_to(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        if not hmac.compare_digest(str(request.get("token")).encode(), self._token.secret.encode()):
            return {"error": "the token is not this daemon's"}
        by = name_in(str(request.get("by", "")).encode())
        if self._pass_on is not None and "team_order" in request:
            return self._answer_of_team(request, self._pass_on, by)
        if request.get("name") not in {None, self._name}:
            return {"error": f"--name {request['name']}: the daemon there is {self._name}"}
        answer = self._answer(str(request.get("order")), by)
        return {"name": self._name, **answer} | {"name": self._name}

    def _answer_of_team(
        self, request: Mapping[str, Any], pass_on: PassOn, by: str
    ) -> Mapping[str, Any]:
        order = str(request["team_order"])
        names = [str(name) for name in request.get("names", ())]
        if order not in WORDS:
            return {"error": f"order = {order!r}: allowed are {', '.join(WORDS)}"}
        try:
            answers = pass_on(order, str(request.get("team", "")), names, by=by)
        except GuidanceError as error:
            return {"error": str(error)}
        return {"answers": {answer["name"]: answer for answer in answers}}


@contextlib.contextmanager
def _reachable(path: Path) -> Iterator[str]:
    """Yield a socket address for a path; a path too long for the kernel is reached by its folder's descriptor."""
    if len(os.fsencode(path)) <= _LONGEST_PATH:
        yield str(path)
        return
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
