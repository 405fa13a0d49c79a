"""The other end of the control bus: ask a daemon, get its answer."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.session.control_bus import control_key, join_session
from guidance.session.daemon import STATUS, WORDS

TIMEOUT_S: Final = 4.0


def ask(
    order: str, *, endpoint: str, name: str | None, timeout_s: float = TIMEOUT_S, token_file: Path | None = None
) -> Mapping[str, Any]:
    """Give an order to the daemon called `name`; without a name, to the only one there is.

    Raises:
        ConfigError: If there is no such order, several daemons and no name, or the token may not be read.
        LinkError: If nobody answers, or the daemon does not let us in.
    """
    if order not in WORDS:
        raise ConfigError(f"order = {order!r}: allowed are {', '.join(WORDS)}")
    session = join_session(endpoint, token_file)
    try:
        if name is None:
            # Never an order to all: first find out who is there.
            there = _answers(session, control_key("*", STATUS), timeout_s)
            names = sorted(str(answer["name"]) for answer in there)
            if len(names) != 1:
                known = ", ".join(names) or "none"
                raise ConfigError(f"--name: which vehicle? daemons at {endpoint}: {known}")
            name = names[0]
        answers = _answers(session, control_key(name, order), timeout_s)
    finally:
        session.close()  # type: ignore[no-untyped-call]
    if not answers:
        raise LinkError(f"{name} at {endpoint}: no answer within {timeout_s:g} s; is its daemon running?")
    return answers[0]


def _answers(session: Any, key: str, timeout_s: float) -> list[dict[str, Any]]:  # noqa: ANN401 - zenoh.Session
    replies = session.get(key, timeout=timeout_s, target=zenoh.QueryTarget.ALL)
    return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
