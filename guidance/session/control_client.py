"""Orders to a daemon over its Zenoh bus: a query on `guidance/<name>/ctl/<order>`, answered with JSON."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.wires.zenoh import open_session
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.session import control_token
from guidance.session.control_socket import STATUS, TIMEOUT_S, WORDS

JOIN_LIMIT_S: Final = 3.0


def control_key(name: str, order: str) -> str:
    """Return the query key of an order."""
    return f"guidance/{name}/ctl/{order}"


def join_session(
    endpoint: str,
    token_file: Path | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    *,
    timeout_s: float = JOIN_LIMIT_S,
) -> "zenoh.Session":
    """Join the control bus of a daemon, with its token where it has one, or by a router that knows our certificate.

    Raises:
        ConfigError: If the token may not be read by us.
        LinkError: If no daemon listens at the endpoint, or the token is wrong.
    """
    if credentials.tls is not None:
        return open_session(endpoint, timeout_s=timeout_s, credentials=credentials)
    path = control_token.default_path(endpoint) if token_file is None else token_file
    token = control_token.read(path)
    try:
        shown = Credentials(auth=None if token is None else token.for_client())
        return open_session(endpoint, timeout_s=timeout_s, credentials=shown)
    except LinkError as error:
        used = f"there is no token in {path}" if token is None else f"the token in {path} was shown"
        raise LinkError(
            f"control {endpoint}: no session within {timeout_s:g} s: no daemon is there, or it does not let us in "
            f"({used}); is `guidance run` running, by the same user? "
            "--token-file says where another daemon's token lies"
        ) from error


def ask(
    order: str,
    *,
    endpoint: str,
    name: str | None,
    timeout_s: float = TIMEOUT_S,
    token_file: Path | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    by: str = "",
) -> Mapping[str, Any]:
    """Give an order to the daemon called `name`; without a name, to the only one there is.

    Args:
        order: One of `WORDS`.
        endpoint: Where the daemon listens for orders.
        name: The daemon's; None takes the only one there is.
        timeout_s: Time limit for the answer.
        token_file: Path of the token, if not the default.
        credentials: For a router that judges certificates, in place of a token.
        by: Name of the person or program, for log and record.

    Raises:
        ConfigError: If there is no such order, several daemons and no name, or the token may not be read.
        LinkError: If no answer comes, or the token is wrong.
    """
    if order not in WORDS:
        raise ConfigError(f"order = {order!r}: allowed are {', '.join(WORDS)}")
    session = join_session(endpoint, token_file, credentials)
    try:
        if name is None:
            # Never an order to all: first find out who is there.
            there = answers(session, control_key("*", STATUS), timeout_s)
            names = sorted(str(answer["name"]) for answer in there)
            if not names:
                raise LinkError(f"{endpoint}: no daemon answers there; is `guidance run` running?")
            if len(names) > 1:
                raise ConfigError(f"--name: which vehicle? daemons at {endpoint}: {', '.join(names)}")
            name = names[0]
        answered = answers(session, control_key(name, order), timeout_s, by)
    finally:
        session.close()  # type: ignore[no-untyped-call]
    if not answered:
        raise LinkError(f"{name} at {endpoint}: no answer within {timeout_s:g} s; is its daemon running?")
    return answered[0]


def answers(session: Any, key: str, timeout_s: float, by: str = "") -> list[dict[str, Any]]:  # noqa: ANN401 - zenoh.Session
    """Ask on a control key and return every answer.

    Args:
        session: A control bus, joined.
        key: Of one daemon's order, or of several.
        timeout_s: Time limit for the answers.
        by: Name of the person or program; empty for a query.
    """
    replies = session.get(key, timeout=timeout_s, target=zenoh.QueryTarget.ALL, payload=by.encode() if by else None)
    return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
