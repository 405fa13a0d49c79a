"""Orders by the socket on this computer, the client's side: one JSON line to the daemon, and one back.

`control_socket` is the daemon's side. `guidance ctl` uses the socket first. It needs no Zenoh session, which takes most
of a second to import and open. This module imports nothing heavy on purpose.
"""

import json
import socket
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.errors import ConfigError, LinkError
from guidance.session.orders.control_token import reachable, read_token, socket_path, token_path
from guidance.session.orders.replies import MAX_REPLY_BYTES, Reply, read_reply, written
from guidance.session.orders.words import REPLY_TIMEOUT_S, TEAM_TIMEOUT_S, WORDS
from guidance.texts import printable

_LONGEST_ANSWER: Final = 32 * MAX_REPLY_BYTES


class SilentDaemonError(LinkError):
    """A daemon listens at its socket and does not answer."""


def ask_here(
    order: str, *, endpoint: str, name: str | None, token_file: Path | None = None, by: str = ""
) -> Reply | None:
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
    data = _exchanged(request, endpoint, token_file, REPLY_TIMEOUT_S)
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
) -> Sequence[Reply] | None:
    """Give an order to a team by the socket of the daemon that hosts its endpoint on this computer.

    Args:
        order: One of `WORDS`.
        team: Its name.
        names: Of vehicles; empty for all.
        endpoint: The control endpoint that the daemons share.
        token_file: Where its token lies, if not in the usual place.
        by: Name of the person or program, for log and record.

    Returns:
        An answer for each vehicle; None if no daemon listens at such a socket, or if it forwards no orders.

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
            reachable(socket_path(path)) as address,
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
