"""The panel's end of a control bus: who is there is heard, status is asked for, orders are given, on own threads.

A daemon may come, go and come again, with another token each time: the bus is joined anew whenever nobody answers.
What is heard is put into bounded queues; the page's own thread takes it from there.
"""

import contextlib
import json
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from guidance.clock import Clock
from guidance.errors import GuidanceError, LinkError
from guidance.links.wires.zenoh import is_over
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.log.broadcast import FLIGHT, TOPICS, broadcast_key
from guidance.log.entries import CYCLE_TOPIC
from guidance.log.reader import Item
from guidance.session.control_client import JOIN_LIMIT_S, answers, control_key, join_session
from guidance.session.control_socket import ALIVE, STATUS

MOST_WAITING: Final = 1024
"""Cycles and events that are kept for the page: twenty seconds of one daemon's."""

ASKED_EVERY_S: Final = 0.5
"""How often who is there is asked where it stands: readiness is judged twice a second."""

HERE_WITHIN_S: Final = 1.5
"""A session on this computer: a try cannot be cut short, and a panel that ends waits for it."""

ANSWERED_WITHIN_S: Final = 1.5
ORDERED_WITHIN_S: Final = 4.0
VOUCHED_FOR_S: Final = 2.0
"""How long a page that said that a person is there is believed: it says so every second."""

SILENT_AFTER: Final = 3
"""So many questions in a row without any answer, and the bus is joined anew."""


class Joined(NamedTuple):
    """A daemon that was found: its name, its flight's metadata, and what was last heard of each kind before we came."""

    name: str
    metadata: Mapping[str, str]
    heard: Item | None


class Said(NamedTuple):
    """A daemon's answer to being asked where it stands, and when it came (of the panel's clock)."""

    name: str
    at_s: float
    status: Mapping[str, Any]


class Arrived(NamedTuple):
    """One cycle or event of a daemon, as it was broadcast, and when it came (of the panel's clock)."""

    name: str
    at_s: float
    item: Item


News = Joined | Said | Arrived


class DaemonBus:
    """One control endpoint, whoever is on it.

    Args:
        endpoint: Of the daemons, on loopback.
        token_file: Where their token lies, if not where it is looked for.
        clock: The panel's.
        credentials: What a router lets us in by, where the endpoint is one's.
    """

    def __init__(
        self, endpoint: str, token_file: Path | None, clock: Clock, credentials: Credentials = NO_CREDENTIALS
    ) -> None:
        self.endpoint = endpoint
        self.reason = "looking for a daemon"
        self._token_file = token_file
        self._clock = clock
        self._credentials = credentials
        self._news: deque[News] = deque(maxlen=MOST_WAITING)
        self._session: zenoh.Session | None = None
        self._known: set[str] = set()
        self._silent = 0
        self._vouched: dict[str, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"bus {endpoint}")
        self._thread.start()

    def news(self) -> Sequence[News]:
        """Return what came since the last call, oldest first."""
        taken = []
        with contextlib.suppress(IndexError):
            while True:
                taken.append(self._news.popleft())
        return taken

    def order(self, name: str, order: str, by: str) -> Mapping[str, Any]:
        """Give an order and return the daemon's answer. Waits for it: call it from a thread that may.

        Raises:
            LinkError: If nobody answers.
        """
        session = self._session
        if session is None:
            raise LinkError(f"no daemon at {self.endpoint}: {self.reason}")
        try:
            answered = answers(session, control_key(name, order), ORDERED_WITHIN_S, by)
        except (zenoh.ZError, ValueError) as error:
            raise LinkError(f"{name} at {self.endpoint}: the order could not be given ({error})") from error
        if not answered:
            raise LinkError(
                f"{name} at {self.endpoint}: no answer within {ORDERED_WITHIN_S:g} s; give it again, or fly"
            )
        return answered[0]

    def vouch(self, name: str) -> None:
        """A person is there and looks at this daemon: it is told so, for the next two seconds."""
        self._vouched[name] = self._clock.now_s()

    def close(self) -> None:
        """Leave the bus. May be called twice."""
        self._ended.set()
        self._leave()  # ends the question that is waited for
        self._thread.join()

    def _run(self) -> None:
        while not is_over(self._ended, ASKED_EVERY_S):
            try:
                self._look()
            except (GuidanceError, zenoh.ZError, OSError, ValueError, KeyError, TypeError) as error:
                self.reason = str(error)
                self._leave()
        self._leave()

    def _look(self) -> None:
        """Join the bus where we are not on it, and ask everybody where they stand."""
        session = self._session
        if session is None:
            within_s = HERE_WITHIN_S if self._credentials.tls is None else JOIN_LIMIT_S
            session = join_session(self.endpoint, self._token_file, self._credentials, timeout_s=within_s)
            self._session, self._silent = session, 0
            if self._ended.is_set():
                return
            session.declare_subscriber(broadcast_key("*", "*"), self._hear)
        self._vouch(session)
        said = answers(session, control_key("*", STATUS), ANSWERED_WITHIN_S)
        self._silent = 0 if said else self._silent + 1
        if self._silent >= SILENT_AFTER:
            raise LinkError(f"no daemon answers at {self.endpoint}")
        self.reason = "" if said else "no answer"
        named = [(str(status["name"]), status) for status in said if "name" in status]
        self._known &= {name for name, _ in named}  # who was away may have come back another
        for name, status in named:
            if name not in self._known:
                self._join(session, name)
            self._news.append(Said(name, self._clock.now_s(), status))

    def _vouch(self, session: "zenoh.Session") -> None:
        """Give a person's sign of life where there is one."""
        seen_after_s = self._clock.now_s() - VOUCHED_FOR_S
        for name, at_s in list(self._vouched.items()):
            if at_s < seen_after_s:
                self._vouched.pop(name, None)
            elif name in self._known:
                answers(session, control_key(name, ALIVE), ANSWERED_WITHIN_S)

    def _join(self, session: "zenoh.Session", name: str) -> None:
        """Ask a daemon what it flies; one that still waits for its vehicle does not answer that yet."""
        replies = session.get(broadcast_key(name, FLIGHT), timeout=ANSWERED_WITHIN_S)
        for reply in replies:
            if reply.ok is not None:
                answer = json.loads(reply.ok.payload.to_bytes())
                heard = answer.get("heard")
                item = None if heard is None else Item(0.0, CYCLE_TOPIC, "json", json.dumps(heard).encode())
                self._news.append(Joined(name, dict(answer["metadata"]), item))
                self._known.add(name)

    def _hear(self, sample: "zenoh.Sample") -> None:
        """On Zenoh's thread, which must not wait: only queue it. What it says is judged where it is read."""
        _, name, _, what = str(sample.key_expr).split("/", 3)
        if what in TOPICS:
            item = Item(0.0, TOPICS[what], "json", sample.payload.to_bytes())
            self._news.append(Arrived(name, self._clock.now_s(), item))

    def _leave(self) -> None:
        session, self._session = self._session, None
        self._known.clear()
        if session is not None:
            with contextlib.suppress(zenoh.ZError):
                session.close()  # type: ignore[no-untyped-call]
