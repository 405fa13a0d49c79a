"""Orders over Zenoh, on loopback: `guidance/<name>/ctl/<order>` is asked, JSON is the answer; and who owns the vehicle.

A liveliness token says that the vehicle has an owner. It vanishes with the owner's process, however that ends.
"""

import contextlib
import getpass
import json
import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.wires.zenoh import is_over, open_session
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.session import control_token
from guidance.session.control_token import ControlToken
from guidance.session.orders import STATUS, WORDS, Answer, Mailbox, Question

ANSWER_LIMIT_S: Final = 2.0
JOIN_LIMIT_S: Final = 3.0
LONGEST_NAME: Final = 64
"""Characters of who gave an order: it is said by whoever asks, and kept in the record."""

MOST_WAITING: Final = 16
_LOOK_EVERY_S: Final = 0.5


def control_key(name: str, order: str) -> str:
    """Return the key that an order is asked on."""
    return f"guidance/{name}/ctl/{order}"


def hosting_config(endpoint: str, token: ControlToken | None = None) -> zenoh.Config:
    """Return a router of our own that listens at one endpoint and nowhere else, for those who know the token."""
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
    """Listen at an endpoint; without a token everybody on this computer is let in.

    Raises:
        LinkError: If it cannot be had; then another daemon is likely to own the vehicle.
    """
    try:
        return zenoh.open(hosting_config(endpoint, token))
    except zenoh.ZError as error:
        raise LinkError(
            f"control.endpoint = {endpoint!r}: cannot listen there; does another daemon own this vehicle? "
            "`guidance ctl status` asks it"
        ) from error


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
        LinkError: If nobody listens at the endpoint, or the token is not the daemon's.
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


class OwnerToken:
    """The vehicle is ours, as long as this lives.

    Args:
        session: A bus that all who might own the vehicle share.
        vehicle: Key of the vehicle on it.

    Raises:
        LinkError: If another daemon owns it already.
    """

    def __init__(self, session: "zenoh.Session", vehicle: str) -> None:
        mine = f"{vehicle}/owner/{session.zid()}"
        liveliness = session.liveliness()
        # First claimed, then looked around: of two that start at once, one at least sees the other.
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
    """An order that was asked for on the bus, and given to the loop at that time."""

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
        token_file: Where the token lies that lets others in; by default where `guidance ctl` looks for it.
        credentials: For a router that judges certificates.

    Raises:
        OutputError: If the token cannot be written.
        LinkError: If there is no session to be had, or another daemon owns the vehicle.
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
        self._waiting: deque[Any] = deque(maxlen=MOST_WAITING)
        self._asked = threading.Event()
        self._stop = threading.Event()
        self._issued: ControlToken | None = None
        self._session = self._host(endpoint, token_file) if host else join_session(endpoint, token_file, credentials)
        self._closed = False
        try:
            self._token = OwnerToken(self._session, f"guidance/{name}")
            self._queryable = self._session.declare_queryable(control_key(name, "*"), self._hear)
        except BaseException:
            self._session.close()  # type: ignore[no-untyped-call]
            raise
        self._thread = threading.Thread(target=self._serve, name="control")
        self._thread.start()

    def _host(self, endpoint: str, token_file: Path | None) -> "zenoh.Session":
        path = control_token.default_path(endpoint) if token_file is None else token_file
        drawn = control_token.draw(path)
        try:
            session = host_session(endpoint, drawn)
        except LinkError:
            control_token.discard(drawn)
            raise
        self._issued = control_token.publish(drawn, path)
        return session

    @property
    def session(self) -> "zenoh.Session":
        """The bus itself, for what else is said on it. It is closed with this."""
        return self._session

    def _hear(self, query: "zenoh.Query") -> None:
        """On Zenoh's thread: keep it and be gone."""
        self._waiting.append(query)
        self._asked.set()

    def _serve(self) -> None:
        """Nobody waits for another's answer: an abort is not held up by an engage order that is being looked into."""
        given: list[_Given] = []
        while not is_over(self._stop):
            self._asked.wait(_LOOK_EVERY_S)
            self._asked.clear()
            while self._waiting:
                given.append(self._give(self._waiting.popleft()))
            given = [one for one in given if not self._is_answered(one)]

    def _give(self, query: "zenoh.Query") -> _Given:
        order = str(query.key_expr).rpartition("/")[2]
        by = "" if query.payload is None else name_in(query.payload.to_bytes())
        return _Given(query, self._mailbox.ask(order, by, self._asked.set), time.monotonic())

    def _is_answered(self, given: _Given) -> bool:
        order, answer = given.question.order, given.question.wait(0.0)
        if answer is None and time.monotonic() - given.since_s < ANSWER_LIMIT_S:
            return False
        if answer is None:
            reason = f"the loop did not answer within {ANSWER_LIMIT_S:g} s"
            answer = {"accepted": False, "order": order, "name": self._name, "reason": reason}
        self._reply(given.query, order, answer)
        return True

    def _reply(self, query: "zenoh.Query", order: str, answer: Answer) -> None:
        with contextlib.suppress(zenoh.ZError):  # who asked may be gone
            # Under our own key: answers to one question of several daemons are told apart by theirs.
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
        self._token.close()
        with contextlib.suppress(zenoh.ZError):
            self._queryable.undeclare()  # type: ignore[no-untyped-call]
            self._session.close()  # type: ignore[no-untyped-call]
        if self._issued is not None:
            control_token.discard(self._issued)


TIMEOUT_S: Final = 4.0


def name_in(data: bytes) -> str:
    """Read who gives an order, as printable text of bounded length, whatever was sent."""
    text = data[: 4 * LONGEST_NAME].decode("utf-8", errors="replace")
    return "".join(one for one in text if one.isprintable())[:LONGEST_NAME].strip()


def own_name(program: str) -> str:
    """Return how a program of this user names itself in an order."""
    try:
        return f"{program}, {getpass.getuser()}"
    except (KeyError, OSError):  # a user without a name
        return program


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
        timeout_s: How long an answer is waited for.
        token_file: The secret that lets us in, where it is not the default one.
        credentials: For a router that judges certificates, in place of a token.
        by: Who gives it, for the log and the record.

    Raises:
        ConfigError: If there is no such order, several daemons and no name, or the token may not be read.
        LinkError: If nobody answers, or the daemon does not let us in.
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
        timeout_s: How long they are waited for.
        by: Who gives the order; empty for a question.
    """
    replies = session.get(key, timeout=timeout_s, target=zenoh.QueryTarget.ALL, payload=by.encode() if by else None)
    return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
