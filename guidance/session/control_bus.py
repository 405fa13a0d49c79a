"""Control of a daemon: orders over Zenoh on loopback, and by a socket on this computer, to the loop and back.

A liveliness token says that the vehicle has an owner. It vanishes with the owner's process, however that ends.
"""

import contextlib
import json
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from guidance.errors import LinkError
from guidance.links.wires.zenoh import is_over
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.log.broadcast import Broadcast
from guidance.session import control_token
from guidance.session.control_client import control_key, join_session
from guidance.session.control_socket import ANSWER_LIMIT_S, ControlSocket, late_answer, name_in
from guidance.session.control_token import ControlToken
from guidance.session.orders import MOST_ORDERS, MOST_QUERIES, QUERIES, Answer, Mailbox, Question

_LOOK_EVERY_S: Final = 0.5


def hosting_config(endpoint: str, token: ControlToken | None = None) -> zenoh.Config:
    """Return the configuration of a router that listens at one endpoint only and asks for the token."""
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "router",
                "listen": {"endpoints": [endpoint], "timeout_ms": 0, "exit_on_failure": True},
                "connect": {"endpoints": []},
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                "transport": {
                    "shared_memory": {"enabled": False},
                    **({} if token is None else {"auth": token.for_server()}),
                },
            }
        )
    )


def host_session(endpoint: str, token: ControlToken | None = None) -> "zenoh.Session":
    """Listen at an endpoint; without a token every user of this computer may join.

    Raises:
        LinkError: If it cannot listen there; probably another daemon owns the vehicle.
    """
    try:
        return zenoh.open(hosting_config(endpoint, token))
    except zenoh.ZError as error:
        raise LinkError(
            f"control.endpoint = {endpoint!r}: cannot listen there; does another daemon own this vehicle? "
            "`guidance ctl status` asks it"
        ) from error


class OwnerToken:
    """A claim on the vehicle, until it is closed.

    Args:
        session: A bus shared by all possible owners.
        vehicle: Key of the vehicle on it.

    Raises:
        LinkError: If another daemon owns it already.
    """

    def __init__(self, session: "zenoh.Session", vehicle: str) -> None:
        mine = f"{vehicle}/owner/{session.zid()}"
        liveliness = session.liveliness()
        # Claim first, then look: of two that start together at least one sees the other.
        self._token = liveliness.declare_token(mine)
        replies = liveliness.get(f"{vehicle}/owner/*", timeout=1.0)
        others = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        others = [key for key in others if key != mine]
        if others:
            self.close()
            raise LinkError(
                f"{vehicle}: another daemon owns this vehicle ({', '.join(others)}); end it first, only one may fly it"
            )

    def close(self) -> None:
        """Give the vehicle up."""
        with contextlib.suppress(zenoh.ZError):
            self._token.undeclare()  # type: ignore[no-untyped-call]


class _Given(NamedTuple):
    """A query of the bus, the question put to the loop, and when."""

    query: Any
    question: Question
    since_s: float


class ControlBus:
    """Takes orders to the mailbox, and answers back, on a thread of its own.

    Args:
        name: The vehicle's.
        mailbox: Where orders go.
        endpoint: The Zenoh endpoint, on loopback.
        host: Listen there; otherwise connect to a router that is there.
        token_file: Path of the token; the default is the one that `guidance ctl` uses.
        credentials: For a router that judges certificates.

    Raises:
        OutputError: If the token cannot be written.
        LinkError: If no session can be opened, or another daemon owns the vehicle.
    """

    def __init__(
        self,
        name: str,
        mailbox: Mailbox,
        *,
        endpoint: str,
        host: bool,
        token_file: Path | None = None,
        credentials: Credentials = NO_CREDENTIALS,
    ) -> None:
        self._name = name
        self._mailbox = mailbox
        self._orders: deque[Any] = deque(maxlen=MOST_ORDERS)
        self._queries: deque[Any] = deque(maxlen=MOST_QUERIES)
        self._asked = threading.Event()
        self._stop = threading.Event()
        self._issued: ControlToken | None = None
        self._socket: ControlSocket | None = None
        if host:
            self._session, self._issued = _hosted(endpoint, token_file)
        else:
            self._session = join_session(endpoint, token_file, credentials)
        self._closed = False
        try:
            self._token = OwnerToken(self._session, f"guidance/{name}")
            self._queryable = self._session.declare_queryable(control_key(name, "*"), self._hear)
            if self._issued is not None:
                self._socket = ControlSocket(name, mailbox, self._issued)
        except BaseException:
            self._session.close()  # type: ignore[no-untyped-call]
            raise
        self._thread = threading.Thread(target=self._serve, name="control")
        self._thread.start()

    @property
    def session(self) -> "zenoh.Session":
        """The Zenoh session, for the broadcast. It is closed with this."""
        return self._session

    def _hear(self, query: "zenoh.Query") -> None:
        """On Zenoh's thread, which must not wait: only queue it."""
        word = str(query.key_expr).rpartition("/")[2]
        (self._queries if word in QUERIES else self._orders).append(query)
        self._asked.set()

    def _serve(self) -> None:
        """Orders come first, and none waits for the answer to another: an abort does not wait for an engage order."""
        given: list[_Given] = []
        while not is_over(self._stop):
            self._asked.wait(_LOOK_EVERY_S)
            self._asked.clear()
            while self._orders or self._queries:
                given.append(self._give((self._orders or self._queries).popleft()))
            given = [one for one in given if not self._is_answered(one)]

    def _give(self, query: "zenoh.Query") -> _Given:
        order = str(query.key_expr).rpartition("/")[2]
        by = "" if query.payload is None else name_in(query.payload.to_bytes())
        return _Given(query, self._mailbox.ask(order, by, self._asked.set), time.monotonic())

    def _is_answered(self, given: _Given) -> bool:
        order, answer = given.question.order, given.question.wait(0.0)
        if answer is None and time.monotonic() - given.since_s < ANSWER_LIMIT_S:
            return False
        self._reply(given.query, order, late_answer(order, self._name) if answer is None else answer)
        return True

    def _reply(self, query: "zenoh.Query", order: str, answer: Answer) -> None:
        with contextlib.suppress(zenoh.ZError):  # who asked may be gone
            # Under our own key: one query may be answered by several daemons.
            query.reply(control_key(self._name, order), json.dumps(answer), encoding=zenoh.Encoding.APPLICATION_JSON)
            query.drop()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Take no more orders and give the vehicle up. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self._stop.set()
        self._asked.set()
        self._thread.join()
        if self._socket is not None:
            self._socket.close()
        self._token.close()
        with contextlib.suppress(zenoh.ZError):
            self._queryable.undeclare()  # type: ignore[no-untyped-call]
            self._session.close()  # type: ignore[no-untyped-call]
        if self._issued is not None:
            control_token.discard(self._issued)


def _hosted(endpoint: str, token_file: Path | None) -> tuple["zenoh.Session", ControlToken]:
    """Listen at an endpoint with a new token; publish the token once that works."""
    path = control_token.default_path(endpoint) if token_file is None else token_file
    drawn = control_token.draw(path)
    try:
        session = host_session(endpoint, drawn)
    except LinkError:
        control_token.discard(drawn)
        raise
    return session, control_token.publish(drawn, path)


@contextlib.contextmanager
def opened(
    name: str, mailbox: Mailbox, endpoint: str | None, on_open: Callable[[str], None] = lambda _: None
) -> Iterator[ControlBus | None]:
    """Take orders at an endpoint, or at a free one if another process listens there.

    Args:
        name: The vehicle's.
        mailbox: Where orders go.
        endpoint: The wanted one; None takes no orders.
        on_open: Called with the endpoint.

    Raises:
        OutputError: If the token or the socket cannot be written.
        LinkError: If it cannot listen at any endpoint.
    """
    if endpoint is None:
        yield None
        return
    try:
        control = ControlBus(name, mailbox, endpoint=endpoint, host=True)
    except LinkError:
        endpoint = free_endpoint()
        control = ControlBus(name, mailbox, endpoint=endpoint, host=True)
    with contextlib.closing(control):
        on_open(endpoint)
        yield control


@contextlib.contextmanager
def broadcasting(name: str, control: ControlBus | None, metadata: Mapping[str, str]) -> Iterator[Broadcast | None]:
    """Broadcast a flight on its control bus, if it has one."""
    if control is None:
        yield None
        return
    with contextlib.closing(Broadcast(name, control.session, metadata)) as broadcast:
        yield broadcast


def free_endpoint() -> str:
    """Return a control endpoint on a free loopback port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
