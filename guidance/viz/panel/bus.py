"""The panel's client of a control endpoint: finds daemons, queries their status and sends orders, in separate threads.

A daemon may restart with another token, so the client reconnects when no daemon answers. Received data waits in a
bounded queue for the thread of the web server.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from guidance.clock import Clock
from guidance.errors import GuidanceError, LinkError
from guidance.links.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.links.zenoh_wire import is_over
from guidance.log.broadcast import FoundFlight, broadcast_key, find_flights, item_of
from guidance.log.reader import Item
from guidance.session.control_bus import JOIN_LIMIT_S, answers, control_key, join_session
from guidance.session.control_socket import ALIVE, STATUS

MAX_QUEUED_NEWS: Final = 1024
"""Cycles and events not yet read: 20 s of one daemon."""

STATUS_INTERVAL_S: Final = 0.5
"""Interval of status queries. Daemons check their readiness as often."""

LOCAL_JOIN_LIMIT_S: Final = 1.5
"""Time limit to connect on this computer. An attempt cannot be cancelled, and closing the panel waits for it."""

ANSWER_LIMIT_S: Final = 1.5
ORDER_LIMIT_S: Final = 4.0
OPERATOR_LIMIT_S: Final = 2.0
"""An operator counts as present so long after a sign of life; pages send one every second."""

MAX_UNANSWERED: Final = 3
"""Consecutive status queries without an answer; then the client reconnects."""


class StatusAnswer(NamedTuple):
    """A daemon's answer to a status query, and the time of its arrival (panel's clock)."""

    name: str
    at_s: float
    status: Mapping[str, Any]


class BroadcastItem(NamedTuple):
    """A cycle or an event that a daemon published, and the time of its arrival (panel's clock)."""

    name: str
    at_s: float
    item: Item


News = FoundFlight | StatusAnswer | BroadcastItem


class DaemonBus:
    """Client of one control endpoint, with any number of daemons.

    Args:
        endpoint: Zenoh endpoint of the daemons or of a router.
        token_file: File of the daemons' token; None searches the usual places.
        clock: Time of arrivals.
        credentials: Credentials for a router.
    """

    def __init__(
        self, endpoint: str, token_file: Path | None, clock: Clock, credentials: Credentials = NO_CREDENTIALS
    ) -> None:
        self.endpoint = endpoint
        self.reason = "looking for a daemon"
        self._token_file = token_file
        self._clock = clock
        self._credentials = credentials
        self._news: deque[News] = deque(maxlen=MAX_QUEUED_NEWS)
        self._session: zenoh.Session | None = None
        self._known: set[str] = set()
        self._unanswered = 0
        self._operator_seen_s: dict[str, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"bus {endpoint}")
        self._thread.start()

    def news(self) -> Sequence[News]:
        """Return the news since the last call, oldest first."""
        taken = []
        with contextlib.suppress(IndexError):
            while True:
                taken.append(self._news.popleft())
        return taken

    def order(self, name: str, order: str, by: str) -> Mapping[str, Any]:
        """Send an order and return the daemon's answer. Blocks until it arrives.

        Raises:
            LinkError: If no answer arrives in time.
        """
        session = self._session
        if session is None:
            raise LinkError(f"no daemon at {self.endpoint}: {self.reason}")
        try:
            answered = answers(session, control_key(name, order), ORDER_LIMIT_S, by)
        except (zenoh.ZError, ValueError) as error:
            raise LinkError(f"{name} at {self.endpoint}: the order was not sent ({error})") from error
        if not answered:
            raise LinkError(
                f"{name} at {self.endpoint}: no answer within {ORDER_LIMIT_S:g} s; repeat it, or take over by radio"
            )
        return answered[0]

    def note_operator(self, name: str) -> None:
        """Send signs of life to a daemon for the next `OPERATOR_LIMIT_S`: an operator is watching it."""
        self._operator_seen_s[name] = self._clock.now_s()

    def close(self) -> None:
        """Disconnect. May be called twice."""
        self._ended.set()
        self._disconnect()  # ends a pending query
        self._thread.join()

    def _run(self) -> None:
        while not is_over(self._ended, STATUS_INTERVAL_S):
            try:
                self._poll()
            except (GuidanceError, zenoh.ZError, OSError, ValueError, KeyError, TypeError) as error:
                self.reason = str(error)
                self._disconnect()
        self._disconnect()

    def _poll(self) -> None:
        """Connect if necessary, then query the status of all daemons."""
        session = self._session
        if session is None:
            limit_s = LOCAL_JOIN_LIMIT_S if self._credentials.tls is None else JOIN_LIMIT_S
            session = join_session(self.endpoint, self._token_file, self._credentials, timeout_s=limit_s)
            self._session, self._unanswered = session, 0
            if self._ended.is_set():
                return
            session.declare_subscriber(broadcast_key("*", "*"), self._queue)
        self._send_sign_of_life(session)
        statuses = answers(session, control_key("*", STATUS), ANSWER_LIMIT_S)
        self._unanswered = 0 if statuses else self._unanswered + 1
        if self._unanswered >= MAX_UNANSWERED:
            raise LinkError(f"no daemon answers at {self.endpoint}")
        self.reason = "" if statuses else "no answer"
        named = [(str(status["name"]), status) for status in statuses if "name" in status]
        self._known &= {name for name, _ in named}  # one that was away may have restarted
        for name, status in named:
            if name not in self._known:
                self._find(session, name)
            self._news.append(StatusAnswer(name, self._clock.now_s(), status))

    def _send_sign_of_life(self, session: "zenoh.Session") -> None:
        """Tell the daemons that an operator is watching."""
        oldest_s = self._clock.now_s() - OPERATOR_LIMIT_S
        for name, at_s in list(self._operator_seen_s.items()):
            if at_s < oldest_s:
                self._operator_seen_s.pop(name, None)
            elif name in self._known:
                answers(session, control_key(name, ALIVE), ANSWER_LIMIT_S)

    def _find(self, session: "zenoh.Session", name: str) -> None:
        """Query the flight of a daemon."""
        for found in find_flights(session, name, ANSWER_LIMIT_S):
            self._news.append(found)
            self._known.add(name)

    def _queue(self, sample: "zenoh.Sample") -> None:
        """Queue a cycle or event. Runs in Zenoh's thread, so it must not block; the reader checks the content."""
        item, name = item_of(sample), str(sample.key_expr).split("/")[1]
        if item is not None:
            self._news.append(BroadcastItem(name, self._clock.now_s(), item))

    def _disconnect(self) -> None:
        session, self._session = self._session, None
        self._known.clear()
        if session is not None:
            with contextlib.suppress(zenoh.ZError):
                session.close()  # type: ignore[no-untyped-call]
