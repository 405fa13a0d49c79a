"""Orders over a Zenoh bus, the daemon's side: a query on `guidance/<name>/ctl/<order>`, and JSON back.

`control_client` is the client's side.

A liveliness token says that the vehicle has an owner. It vanishes with the owner's process, however that ends.
"""

import contextlib
import socket
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from typing import Any, Final

import zenoh

from guidance.errors import GuidanceError, LinkError
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.session import Session, close_all, direct_session, is_small
from guidance.session.orders.control_client import (
    TEAM_PARAMETER,
    control_key,
    join_session,
    order_team,
)
from guidance.session.orders.control_socket import ControlSocket, begin_exchange
from guidance.session.orders.control_token import (
    ControlToken,
    discard_token,
    draw_token,
    token_path,
)
from guidance.session.orders.mailbox import MOST_ORDERS, MOST_QUERIES, QUERIES, Mailbox
from guidance.session.orders.replies import written
from guidance.session.orders.socket_client import ask_here
from guidance.session.orders.words import STATUS, TEAM_ANSWER_LIMIT_S, name_in
from guidance.session.orders_section import Control

_MAX_SENDER_BYTES: Final = 4096
"""Longest name of a sender that is read; of a longer one, the sender is unknown."""


def host_session(endpoint: str, token: ControlToken) -> Session:
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
            answer = ask_here(STATUS, endpoint=endpoint, name=None)
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
        small = is_small(query)
        mailbox.oversized += not small
        if not small or query.parameters.get(TEAM_PARAMETER) not in {None, team}:
            query.drop()  # type: ignore[no-untyped-call]
            return
        word = str(query.key_expr).rpartition("/")[2]
        begin_exchange(queries if word in QUERIES else orders, reply, query, word)

    def reply(query: "zenoh.Query", order: str) -> None:
        by = ""
        if query.payload is not None and len(query.payload) <= _MAX_SENDER_BYTES:
            by = name_in(query.payload.to_bytes())
        answer = written({**about, **mailbox.answer(order, by)})
        with contextlib.suppress(zenoh.ZError):  # the client may be gone
            # Under our own key: one query may be answered by several daemons.
            query.reply(control_key(name, order), answer, encoding=zenoh.Encoding.APPLICATION_JSON)
            query.drop()  # type: ignore[no-untyped-call]

    with contextlib.ExitStack() as closing:
        if control.host:
            path = control.token_file
            if path is None:
                path = token_path(control.endpoint)
            token = draw_token(path)
            closing.callback(lambda: discard_token(token))
            session = host_session(control.endpoint, token)
            closing.callback(close_all, session.close)
            # Put it where others look for it, now that the endpoint is ours and no other daemon's.
            token = token._replace(path=token.path.replace(path))
            pass_on = partial(order_team, session, timeout_s=TEAM_ANSWER_LIMIT_S)
            closing.enter_context(
                contextlib.closing(ControlSocket(name, mailbox.answer, token, pass_on))
            )
        else:
            session = join_session(control.endpoint, control.token_file, credentials)
            closing.callback(close_all, session.close)
        closing.callback(close_all, owner_token(session, f"guidance/{name}").undeclare)
        closing.callback(
            close_all, session.declare_queryable(control_key(name, "*"), hear).undeclare
        )
        yield session


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
