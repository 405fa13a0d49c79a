"""Orders over a Zenoh bus, the daemon's side and the client's: a query on `guidance/<name>/ctl/<order>`, and JSON back.

A liveliness token says that the vehicle has an owner. It vanishes with the owner's process, however that ends.
"""

import contextlib
import socket
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import zenoh

from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.flight import Event
from guidance.links.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.links.zenoh_wire import (
    Session,
    close_all,
    direct_session,
    is_small,
    open_session,
)
from guidance.session.orders import control_socket as local
from guidance.session.orders.mailbox import MOST_ORDERS, MOST_QUERIES, QUERIES, Mailbox
from guidance.session.orders.replies import (
    MAX_REPLY_BYTES,
    NAME_RULE,
    Answer,
    bad_reply,
    is_vehicle_name,
    read_reply,
    refused,
    written,
)
from guidance.session.vehicle_file import Control

_TEAM: Final = "team"
"""Parameter of a query: only vehicles of this team follow it."""

_MAX_SENDER_BYTES: Final = 4096
"""Longest name of a sender that is read; of a longer one, the sender is unknown."""

_MAX_VEHICLES: Final = 64
"""Most vehicles of a team that an order waits for."""


def host_session(endpoint: str, token: local.ControlToken) -> Session:
    """Listen as a router at one endpoint only, for those who know the token.

    Raises:
        LinkError: If it cannot listen there.
    """
    listening = {"endpoints": [endpoint], "timeout_ms": 0, "exit_on_failure": True}
    auth = token.auth(dictionary_file=str(token.path))
    try:
        return direct_session("router", {"listen": listening}, auth=auth)
    except zenoh.ZError as error:
        holder = "another program has the port"
        with contextlib.suppress(GuidanceError):
            answer = local.ask_here(local.STATUS, endpoint=endpoint, name=None)
            if answer is not None:
                holder = f"a daemon or `guidance fly` has it and flies {answer.get('name')!r}"
        words = (
            f"cannot listen there: {holder}; end it, or choose another port with control.endpoint"
        )
        raise LinkError(f"control.endpoint = {endpoint!r}: {words}") from error


def owner_token(session: Session, vehicle: str) -> zenoh.LivelinessToken:
    """Claim a vehicle, by its key on a bus that all possible owners share, until the token is undeclared.

    Raises:
        LinkError: If another daemon owns it already.
    """
    owner_key = f"{vehicle}/owner/{session.zid()}"
    liveliness = session.liveliness()
    # Claim first, then look: of two that start together at least one sees the other.
    token = liveliness.declare_token(owner_key)
    claims = liveliness.get(f"{vehicle}/owner/*", timeout=1.0)
    others = {str(claim.ok.key_expr) for claim in claims if claim.ok is not None} - {owner_key}
    if others:
        close_all(token.undeclare)
        owned = f"another daemon owns this vehicle ({', '.join(sorted(others))})"
        raise LinkError(f"{vehicle}: {owned}; end it first, only one may fly it")
    return token


@contextlib.contextmanager
def control_bus(
    name: str,
    mailbox: Mailbox,
    control: Control,
    credentials: Credentials,
    team: str,
    mates: Collection[str],
) -> Iterator[Session]:
    """Take orders to the mailbox and answers back; on this computer by a socket too.

    Args:
        name: The vehicle's.
        mailbox: Where orders go.
        control: The endpoint, whether to listen there or to connect to a router, and the token's file.
        credentials: For a router that judges certificates.
        team: Name of its team, empty without one; orders to another team are not for this vehicle.
        mates: The vehicles of the team.

    Yields:
        The Zenoh session, for the broadcast and the team; closed in the end, when the vehicle is given up.

    Raises:
        OutputError: If the token cannot be written.
        LinkError: If no session can be opened, or another daemon owns the vehicle.
    """
    about: dict[str, Any] = {"name": name}
    if team:
        about["team"] = team
        about["vehicles"] = sorted({name, *mates})
    orders = threading.BoundedSemaphore(MOST_ORDERS)
    queries = threading.BoundedSemaphore(MOST_QUERIES)

    def hear(query: "zenoh.Query") -> None:
        """On Zenoh's thread, which must not wait. Queries never keep an order out."""
        if not _is_read(query, mailbox) or query.parameters.get(_TEAM) not in {None, team}:
            query.drop()  # type: ignore[no-untyped-call]
            return
        word = str(query.key_expr).rpartition("/")[2]
        local.begin(queries if word in QUERIES else orders, reply, query, word)

    def reply(query: "zenoh.Query", order: str) -> None:
        by = ""
        if query.payload is not None and len(query.payload) <= _MAX_SENDER_BYTES:
            by = local.name_in(query.payload.to_bytes())
        answer = written({**about, **mailbox.answer(order, by)})
        with contextlib.suppress(zenoh.ZError):  # who asked may be gone
            # Under our own key: one query may be answered by several daemons.
            query.reply(control_key(name, order), answer, encoding=zenoh.Encoding.APPLICATION_JSON)
            query.drop()  # type: ignore[no-untyped-call]

    with contextlib.ExitStack() as closing:
        if control.host:
            path = control.token_file
            if path is None:
                path = local.token_path(control.endpoint)
            token = local.draw_token(path)
            closing.callback(lambda: local.discard_token(token))
            session = host_session(control.endpoint, token)
            closing.callback(close_all, session.close)
            # Put it where others look for it, now that the endpoint is ours and no other daemon's.
            token = token._replace(path=token.path.replace(path))
            pass_on = partial(order_team, session, timeout_s=local.TEAM_ANSWER_LIMIT_S)
            closing.enter_context(
                contextlib.closing(local.ControlSocket(name, mailbox.answer, token, pass_on))
            )
        else:
            session = join_session(control.endpoint, control.token_file, credentials)
            closing.callback(close_all, session.close)
        closing.callback(close_all, owner_token(session, f"guidance/{name}").undeclare)
        closing.callback(
            close_all, session.declare_queryable(control_key(name, "*"), hear).undeclare
        )
        yield session


def _is_read(query: "zenoh.Query", mailbox: Mailbox) -> bool:
    if is_small(query):
        return True
    mailbox.oversized += 1
    return False


@contextlib.contextmanager
def opened(
    mailboxes: Mapping[str, Mailbox],
    endpoint: str | None,
    on_open: Callable[[str], None],
    team: str,
) -> Iterator[Mapping[str, Session]]:
    """Take orders for vehicles at an endpoint, or at a free one if another process listens there; None takes none.

    The first vehicle listens, and the others join. `on_open` is called with the endpoint. Without a team its name is
    empty.

    Raises:
        OutputError: If the token or the socket cannot be written.
        LinkError: If it cannot listen at any endpoint.
    """
    buses: dict[str, Session] = {}
    with contextlib.ExitStack() as closing:
        if endpoint is None:
            yield buses
            return
        for name, mailbox in mailboxes.items():
            bus = partial(
                control_bus, name, mailbox, credentials=NO_CREDENTIALS, team=team, mates=mailboxes
            )
            try:
                buses[name] = closing.enter_context(bus(Control(endpoint=endpoint, host=not buses)))
            except LinkError:
                if buses:
                    raise
                endpoint = free_endpoint()
                buses[name] = closing.enter_context(bus(Control(endpoint=endpoint)))
        on_open(endpoint)
        yield buses


def free_endpoint() -> str:
    """Return a control endpoint on a free loopback port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


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
    path = local.token_path(endpoint) if token_file is None else token_file
    token = local.read_token(path)
    try:
        by_token = Credentials(auth=None if token is None else token.auth())
        return open_session(endpoint, timeout_s=timeout_s, credentials=by_token)
    except LinkError as error:
        token_words = (
            f"there is no token in {path}" if token is None else f"the token in {path} was shown"
        )
        silence = f"no session within {timeout_s:g} s: no daemon is there, or it does not let us in ({token_words})"
        mend = "is `guidance run` running, by the same user? --token-file says where another daemon's token lies"
        raise LinkError(f"control {endpoint}: {silence}; {mend}") from error


def ask(
    session: Session,
    order: str,
    name: str | None,
    *,
    endpoint: str,
    by: str = "",
    timeout_s: float = local.TIMEOUT_S,
) -> Answer:
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
        names = sorted(
            str(answer["name"]) for answer in answers(session, "*", local.STATUS, timeout_s)
        )
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
    timeout_s: float = local.TIMEOUT_S,
) -> list[Answer]:
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

    def asked(word: str) -> dict[str, Answer]:
        return _team_answers(session, word, team, names, by, timeout_s)

    if order not in {Event.START, Event.ENGAGE}:
        return list(asked(order).values())
    statuses = asked(local.STATUS)
    reasons = {name: _reason_against(order, status) for name, status in statuses.items()}
    if not any(reasons.values()):
        return list(asked(order).values())
    others = f"waits for {', '.join(name for name, reason in reasons.items() if reason)}"
    return [
        refused(name, order, str(statuses[name].get("state", "")), reason or others)
        for name, reason in reasons.items()
    ]


def _team_answers(
    session: Session, order: str, team: str, names: Collection[str], by: str, timeout_s: float
) -> dict[str, Answer]:
    """Return an answer for each vehicle of a team, or for each of `names`, sorted; some may say "not heard"."""
    answers = dict[str, Answer]()
    targets: Collection[str] = names
    if not names:
        targets = ("*",)
    for name in targets:
        for answer in replies(session, name, order, timeout_s, by, team):
            answers.setdefault(answer["name"], answer)
    if not answers:
        raise LinkError(f"--team {team}: no vehicle of it answers; is `guidance run` running?")
    expected = set(names)
    if not names:
        # Each vehicle names the team: one that leaves names out hides nobody that another one names.
        for answer in answers.values():
            listed = filter(is_vehicle_name, answer.get("vehicles", ()))
            expected |= {answer["name"], *listed}
    silence = f"no answer in {timeout_s:g} s"
    return {
        name: answers.get(name, refused(name, order, "not heard", silence))
        for name in sorted(expected)[:_MAX_VEHICLES]
    }


def _reason_against(order: str, status: Answer) -> str:
    """Say why a vehicle would refuse an order, by its status; empty if it would follow."""
    if status.get("reason"):
        return str(status["reason"])
    foreseen = status.get("refused_orders")
    if foreseen is None or order not in foreseen:
        return "its status does not say whether it would follow"
    return str(foreseen[order])


def replies(
    session: Session, name: str, order: str, timeout_s: float, by: str = "", team: str = ""
) -> Iterator[Answer]:
    """Ask a daemon, or all for the name "*", and yield each answer when it arrives.

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
    key = control_key(name, order) + (f"?{_TEAM}={team}" if team else "")
    payload = by.encode() if by else None
    answered = set[str]()
    for reply in session.get(key, timeout=timeout_s, target=zenoh.QueryTarget.ALL, payload=payload):
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
) -> Sequence[Answer]:
    """Ask a daemon, or all for the name "*", and return every answer; arguments as of `replies`."""
    return list(replies(session, name, order, timeout_s, by, team))


def say_alive(session: Session, name: str) -> None:
    """Send an operator's sign of life to a daemon, without waiting for the answer."""
    session.get(control_key(name, local.ALIVE), lambda _: None, timeout=local.TIMEOUT_S)


def control_key(name: str, order: str) -> str:
    """Return the query key of an order."""
    return f"guidance/{name}/ctl/{order}"
