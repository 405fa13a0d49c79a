"""Orders over a Zenoh bus, the client's side: joins it, asks a daemon or a team, and reads the answers.

`control_bus` is the daemon's side. This module imports nothing heavy: with it, an order by a router takes a tenth of a
second of processor time.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.session import Session, open_session
from guidance.session.orders.control_token import read_token, token_path
from guidance.session.orders.replies import (
    MAX_REPLY_BYTES,
    NAME_RULE,
    Reply,
    bad_reply,
    is_vehicle_name,
    read_reply,
    refused,
)
from guidance.session.orders.words import ALIVE, REPLY_TIMEOUT_S, STATUS

TEAM_PARAMETER: Final = "team"
"""Parameter of a query: only vehicles of this team follow it."""

_MAX_VEHICLES: Final = 64
"""Most vehicles in the answer of a team."""

_ALL_OR_NONE: Final = frozenset({"start", "engage"})
"""Orders that a team gets only if every vehicle of it would accept."""


def join_session(
    endpoint: str,
    token_file: Path | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    *,
    timeout_s: float = 3.0,
) -> Session:
    """Join the control bus of a daemon, with its token where it has one, or by a router that knows our certificate.

    Raises:
        ConfigError: If the token may not be read by us.
        LinkError: If no daemon listens at the endpoint, or the token is wrong.
    """
    if credentials.tls is not None:
        return open_session(endpoint, timeout_s=timeout_s, credentials=credentials)
    path = token_path(endpoint) if token_file is None else token_file
    token = read_token(path)
    try:
        by_token = Credentials(auth=None if token is None else token.auth())
        return open_session(endpoint, timeout_s=timeout_s, credentials=by_token)
    except LinkError as error:
        token_words = (
            f"there is no token in {path}" if token is None else f"the token in {path} was shown"
        )
        raise LinkError(
            f"control {endpoint}: no session within {timeout_s:g} s: no daemon is there, or it does not let us in "
            f"({token_words}); is `guidance run` running, by the same user? --token-file says where another daemon's "
            "token lies"
        ) from error


def ask(
    session: Session,
    order: str,
    name: str | None,
    *,
    endpoint: str,
    by: str = "",
    timeout_s: float = REPLY_TIMEOUT_S,
) -> Reply:
    """Give an order to the daemon called `name`; without a name, to the only one there is.

    Args:
        session: On the bus of the daemons.
        order: One of `WORDS`.
        name: The daemon's; None takes the only one there is.
        endpoint: Where the daemon listens for orders, for the message.
        by: Name of the person or program, for log and record.
        timeout_s: Time limit for the answer.

    Raises:
        ConfigError: If there are several daemons and no name.
        LinkError: If no answer comes.
    """
    if name is None:
        # Never an order to all: first find out who is there.
        names = sorted(str(answer["name"]) for answer in answers(session, "*", STATUS, timeout_s))
        if not names:
            raise LinkError(f"{endpoint}: no daemon answers there; is `guidance run` running?")
        if len(names) > 1:
            raise ConfigError(f"--name: which vehicle? daemons at {endpoint}: {', '.join(names)}")
        name = names[0]
    answered = answers(session, name, order, timeout_s, by)
    if not answered:
        raise LinkError(
            f"{name} at {endpoint}: no answer within {timeout_s:g} s; is its daemon running?"
        )
    return answered[0]


def order_team(
    session: Session,
    order: str,
    team: str,
    names: Collection[str],
    *,
    by: str = "",
    timeout_s: float = REPLY_TIMEOUT_S,
) -> list[Reply]:
    """Give an order to a team on a session; return an answer for each vehicle.

    `start` and `engage` are given only if every one of them would accept it now.

    Args:
        session: On the bus of the daemons.
        order: One of `WORDS`.
        team: Its name.
        names: Of vehicles; empty for all.
        by: Name of the person or program, for log and record.
        timeout_s: Time limit for the answers.

    Raises:
        LinkError: If no vehicle of the team answers.
    """

    def asked(word: str) -> dict[str, Reply]:
        return _team_answers(session, word, team, names, by, timeout_s)

    if order not in _ALL_OR_NONE:
        return list(asked(order).values())
    statuses = asked(STATUS)
    reasons = {}
    for name, status in statuses.items():
        if status.get("reason"):
            reasons[name] = str(status["reason"])
        else:
            foreseen = status.get("refused_orders")
            if foreseen is None or order not in foreseen:
                reasons[name] = "its status does not say whether it would follow"
            else:
                reasons[name] = str(foreseen[order])
    if not any(reasons.values()):
        return list(asked(order).values())
    others = f"waits for {', '.join(name for name, reason in reasons.items() if reason)}"
    return [
        refused(name, order, str(statuses[name].get("state", "")), reason or others)
        for name, reason in reasons.items()
    ]


def _team_answers(
    session: Session, order: str, team: str, names: Collection[str], by: str, timeout_s: float
) -> dict[str, Reply]:
    """Return an answer for each vehicle of a team, or for each of `names`, sorted; some may say "not heard"."""
    answers = dict[str, Reply]()
    targets: Collection[str] = names
    if not names:
        targets = ("*",)
    # All orders are sent before the first answer is awaited, so a silent vehicle delays no order to another.
    awaited = [replies(session, name, order, timeout_s, by, team) for name in targets]
    # The end is known to Zenoh, not from the vehicles' lists of mates: a list that is too short would hide a refusal.
    for answer in itertools.chain.from_iterable(awaited):
        answers.setdefault(answer["name"], answer)
    if not answers:
        raise LinkError(f"--team {team}: no vehicle of it answers; is `guidance run` running?")
    expected = set(names)
    if not names:
        # Each vehicle lists the team: an incomplete list hides no vehicle that another one lists.
        for answer in answers.values():
            listed = filter(is_vehicle_name, answer.get("vehicles", ()))
            expected |= {answer["name"], *listed}
    silence = f"no answer in {timeout_s:g} s"
    return {
        name: answers.get(name, refused(name, order, "not heard", silence))
        for name in sorted(expected)[:_MAX_VEHICLES]
    }


def replies(
    session: Session, name: str, order: str, timeout_s: float, by: str = "", team: str = ""
) -> Iterator[Reply]:
    """Ask a daemon, or all for the name "*", at once; return an iterator that yields each answer when it arrives.

    The vehicle's name comes from the key of its reply. A reply that cannot be used becomes a refusal in its name.

    Args:
        session: On the bus of the daemons.
        name: The daemon's.
        order: One of `WORDS`.
        timeout_s: Time limit for the answers.
        by: Name of the person or program who orders.
        team: Name of a team: only its vehicles answer.

    Raises:
        ConfigError: If no vehicle or no team can have such a name.
    """
    for option, value in (("--name", name), ("--team", team)):
        if value not in {"", "*"} and not is_vehicle_name(value):
            raise ConfigError(f"{option} {value!r}: {NAME_RULE}")
    key = control_key(name, order) + (f"?{TEAM_PARAMETER}={team}" if team else "")
    payload = by.encode() if by else None
    received = session.get(key, timeout=timeout_s, target=zenoh.QueryTarget.ALL, payload=payload)
    return _valid_answers(received, name, order)


def _valid_answers(received: Iterable[zenoh.Reply], name: str, order: str) -> Iterator[Reply]:
    answered = set[str]()
    for reply in received:
        if reply.ok is None:
            continue
        sender = str(reply.ok.key_expr).split("/")[1]
        if sender in answered or not is_vehicle_name(sender) or name not in {"*", sender}:
            continue
        answered.add(sender)
        if len(reply.ok.payload) > MAX_REPLY_BYTES:
            yield bad_reply(sender, order, f"{len(reply.ok.payload)} bytes")
        else:
            yield read_reply(reply.ok.payload.to_bytes(), sender, order)


def answers(
    session: Session, name: str, order: str, timeout_s: float, by: str = "", team: str = ""
) -> Sequence[Reply]:
    """Ask a daemon, or all for the name "*", and return every answer; arguments as of `replies`."""
    return list(replies(session, name, order, timeout_s, by, team))


def say_alive(session: Session, name: str) -> None:
    """Send an operator's sign of life to a daemon, without waiting for the answer."""
    session.get(control_key(name, ALIVE), lambda _: None, timeout=REPLY_TIMEOUT_S)


def control_key(name: str, order: str) -> str:
    """Return the query key of an order."""
    return f"guidance/{name}/ctl/{order}"
