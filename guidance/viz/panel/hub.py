"""Finds the daemons of control endpoints, collects their data, and encodes it once for all pages.

A thread for each endpoint queries the status of its daemons. A daemon may restart with another token, so the thread
reconnects when no daemon answers. Received data waits in a bounded queue for the thread of the web server. Ten times a
second the changes become one message. A new page gets a snapshot of everything first.
"""

import contextlib
import json
import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import zenoh

from guidance.clock import Clock
from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.links.zenoh_access import Credentials
from guidance.links.zenoh_wire import close_all, is_over
from guidance.log.broadcast import FoundFlight, broadcast_key, find_flights, item_of
from guidance.log.entries import BEGUN, FLIGHT_OVER, EventEntry, Item
from guidance.session.control_bus import answers, join_session, order_team
from guidance.session.control_socket import ALIVE, STATUS
from guidance.viz.panel.snapshot import (
    HISTORY,
    Plain,
    SnapshotFold,
    event_row,
    history_row,
    level_of,
    of_operator,
)

HISTORY_S: Final = 300.0
HISTORY_INTERVAL_S: Final = 0.25
MAX_EVENTS: Final = 200
MAX_DAEMONS: Final = 32
NO_CONTACT_S: Final = 2.0
"""After so long without data, a daemon counts as lost."""

_BAD_DATA: Final = (ConfigError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError)

MAX_QUEUED_NEWS: Final = 1024
"""Cycles and events not yet read: 20 s of one daemon."""

STATUS_INTERVAL_S: Final = 0.5
"""Interval of status queries. Daemons check their readiness as often."""

LOCAL_JOIN_LIMIT_S: Final = 1.5
"""Time limit to connect on this computer. An attempt cannot be cancelled, and closing the panel waits for it."""

REMOTE_JOIN_LIMIT_S: Final = 3.0

ANSWER_LIMIT_S: Final = 1.5
ORDER_LIMIT_S: Final = 4.0
OPERATOR_LIMIT_S: Final = 2.0
"""An operator counts as present so long after a sign of life; pages send one every second."""

MAX_UNANSWERED: Final = 3
"""Consecutive status queries without an answer; then the client reconnects."""


class News(NamedTuple):
    """A flight, a status, a cycle or an event of a daemon, and the time of its arrival (panel's clock)."""

    name: str
    at_s: float
    what: FoundFlight | Mapping[str, Any] | Item


class DaemonBus:
    """Client of one control endpoint, with any number of daemons.

    Args:
        endpoint: Zenoh endpoint of the daemons or of a router.
        token_file: File of the daemons' token; None searches the usual places.
        clock: Time of arrivals.
        credentials: Credentials for a router.
    """

    def __init__(
        self, endpoint: str, token_file: Path | None, clock: Clock, credentials: Credentials
    ) -> None:
        self.endpoint = endpoint
        self.reason = "looking for a daemon"
        self._token_file = token_file
        self._clock = clock
        self._credentials = credentials
        self._news: deque[News] = deque(maxlen=MAX_QUEUED_NEWS)
        self._session: zenoh.Session | None = None
        self._known = set[str]()
        self._operator_seen_s = dict[str, float]()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"bus {endpoint}")
        self._thread.start()

    def news(self) -> Sequence[News]:
        """Take the news since the last call, oldest first."""
        return [self._news.popleft() for _ in range(len(self._news))]

    def order(self, name: str, order: str, by: str, team: str = "") -> Sequence[Mapping[str, Any]]:
        """Send an order to a daemon, or to all of a team; return an answer of each. Blocks until they arrive.

        Raises:
            LinkError: If no answer arrives in time.
        """
        if (session := self._session) is None:
            raise LinkError(f"no daemon at {self.endpoint}: {self.reason}")
        try:
            if team:
                return order_team(session, order, team, (), by=by, timeout_s=ORDER_LIMIT_S)
            answered = answers(session, name, order, ORDER_LIMIT_S, by)
        except (zenoh.ZError, ValueError) as error:
            raise LinkError(
                f"{name} at {self.endpoint}: the order was not sent ({error})"
            ) from error
        if not answered:
            mend = "repeat it, or take over by radio"
            raise LinkError(
                f"{name} at {self.endpoint}: no answer within {ORDER_LIMIT_S:g} s; {mend}"
            )
        return answered

    def note_operator(self, name: str) -> None:
        """Send signs of life to a daemon for the next `OPERATOR_LIMIT_S`: an operator is watching it."""
        self._operator_seen_s[name] = self._clock.now_s()

    def close(self) -> None:
        """Disconnect. May be called twice."""
        self._ended.set()
        self._disconnect()  # ends a pending query
        self._thread.join()

    def _run(self) -> None:
        limit_s = LOCAL_JOIN_LIMIT_S if self._credentials.tls is None else REMOTE_JOIN_LIMIT_S
        while not is_over(self._ended, STATUS_INTERVAL_S):
            try:
                self._watch(
                    join_session(
                        self.endpoint, self._token_file, self._credentials, timeout_s=limit_s
                    )
                )
            except (GuidanceError, zenoh.ZError, OSError, ValueError, KeyError, TypeError) as error:
                self.reason = str(error)
            self._disconnect()

    def _watch(self, session: "zenoh.Session") -> None:
        """Query the status of all daemons until the end, or until nobody answers."""
        self._session = session
        unanswered = 0
        self._known.clear()
        session.declare_subscriber(broadcast_key("*", "*"), self._queue)
        while not is_over(self._ended):
            unanswered = 0 if self._poll(session) else unanswered + 1
            if unanswered >= MAX_UNANSWERED:
                raise LinkError(f"no daemon answers at {self.endpoint}")
            self._ended.wait(STATUS_INTERVAL_S)

    def _poll(self, session: "zenoh.Session") -> bool:
        """Send signs of life, and query all status; return whether a daemon answered."""
        for name in self._known:
            if self._clock.now_s() - self._operator_seen_s.get(name, -math.inf) <= OPERATOR_LIMIT_S:
                answers(session, name, ALIVE, ANSWER_LIMIT_S)
        statuses = answers(session, "*", STATUS, ANSWER_LIMIT_S)
        self.reason = "" if statuses else "no answer"
        named = {str(status["name"]): status for status in statuses if "name" in status}
        self._known &= named.keys()  # one that was away may have restarted
        for name, status in named.items():
            for found in (
                find_flights(session, name, ANSWER_LIMIT_S) if name not in self._known else ()
            ):
                self._news.append(News(found.name, self._clock.now_s(), found))
                self._known.add(name)
            self._news.append(News(name, self._clock.now_s(), status))
        return bool(statuses)

    def _queue(self, sample: "zenoh.Sample") -> None:
        """Queue a cycle or event. Runs in Zenoh's thread, so it must not block; the reader checks the content."""
        item = item_of(sample)
        name = str(sample.key_expr).split("/")[1]
        if item is not None:
            self._news.append(News(name, self._clock.now_s(), item))

    def _disconnect(self) -> None:
        session = self._session
        self._session = None
        if session is not None:
            close_all(session.close)


class DaemonView:
    """Data of one daemon, and which of it the pages do not have yet."""

    def __init__(self, name: str, bus: DaemonBus, now_s: float) -> None:
        self.name = name
        self.bus = bus
        self.key = f"{name}@{bus.endpoint}"
        self._heard_s = now_s
        self._fold: SnapshotFold | None = None
        self._over: Plain | None = None
        self.told: Plain = {"status": {}}
        self._sent = dict[str, Any]()
        self._unsent_events = 0  # nothing was sent: the next message is whole
        self._events: deque[Plain] = deque(maxlen=MAX_EVENTS)
        self._rows: deque[Sequence[Any]] = deque(maxlen=math.ceil(HISTORY_S / HISTORY_INTERVAL_S))

    def take(self, news: News) -> None:
        """Take the metadata of a flight, a status, a cycle or an event; ignore unreadable ones."""
        if isinstance(news.what, Mapping):
            self.told = {"status": news.what, "operator": of_operator(news.what)}
            self._heard_s = news.at_s if self._fold is None else self._heard_s
            return
        with contextlib.suppress(*_BAD_DATA):  # another version: show its status at least
            if isinstance(news.what, FoundFlight):  # start again with its metadata
                self._fold = None
                self._over = None
                self._sent = {}
                self._rows.clear()
                self._fold = SnapshotFold(news.what.metadata, self.key)
                for item in news.what.heard:
                    self._fold.take(item)
            elif self._fold is not None:
                self._add(news.what, news.at_s, self._fold)

    def _add(self, item: Item, at_s: float, fold: SnapshotFold) -> None:
        entry = fold.take(item)
        if isinstance(entry, EventEntry):
            if entry.event == FLIGHT_OVER:
                over = json.loads(entry.detail)
                self._over = {
                    name: str(over.get(name, "")) for name in ("ended", "record", "replay")
                }
                entry = entry._replace(detail=self._over["ended"])
            elif entry.event == BEGUN:
                self._over = None
            self._events.append(event_row(entry))
            self._unsent_events += 1
        elif entry is not None:
            self._heard_s = at_s
            last_s = self._rows[-1][0] if self._rows else None
            if last_s is not None and entry.now_s < last_s:
                self._rows.clear()  # the daemon restarted
            if last_s is None or not 0.0 <= entry.now_s - last_s < HISTORY_INTERVAL_S:
                self._rows.append(history_row(fold.snapshot()))

    def message(self, now_s: float, *, whole: bool) -> Plain:
        """Return the parts that changed since the last message of changes, or everything (`whole`)."""
        full = whole or not self._sent
        silent_s = max(0.0, now_s - self._heard_s)
        message: Plain = {
            "key": self.key,
            "name": self.name,
            "endpoint": self.bus.endpoint,
            "over": self._over,
        }
        message |= {
            "silent_s": round(silent_s, 1),
            "contact": level_of(silent_s, 0.5 * NO_CONTACT_S, NO_CONTACT_S),
        }
        fold = self._fold
        parts = self.told | (
            {} if fold is None else {"scene": fold.scene, "snapshot": fold.snapshot()}
        )
        message |= {
            name: part for name, part in parts.items() if full or part is not self._sent.get(name)
        }
        if full:
            message["history"] = {"columns": HISTORY, "rows": list(self._rows)}
        if full or self._unsent_events:
            message["events"] = list(self._events)[0 if full else -self._unsent_events :]
        if not whole:
            self._sent = parts
            self._unsent_events = 0
        return message


class Hub:
    """All daemons of a panel.

    Args:
        buses: Connections to the daemons.
        clock: The panel's clock.
    """

    def __init__(self, buses: Sequence[DaemonBus], clock: Clock) -> None:
        self._buses = buses
        self._clock = clock
        self._views: dict[str, DaemonView] = {}

    def receive(self) -> None:
        """Read the news of all buses."""
        for bus in self._buses:
            for news in bus.news():
                key = f"{news.name}@{bus.endpoint}"
                if key not in self._views and len(self._views) < MAX_DAEMONS:
                    self._views[key] = DaemonView(news.name, bus, self._clock.now_s())
                if key in self._views:
                    self._views[key].take(news)

    def message(self, *, whole: bool = False) -> str:
        """Return JSON: the changes since the last message of changes, or everything (`whole`)."""
        now_s = self._clock.now_s()
        daemons = [view.message(now_s, whole=whole) for view in self._views.values()]
        buses = [{"endpoint": bus.endpoint, "reason": bus.reason} for bus in self._buses]
        return json.dumps(
            {"whole": whole, "daemons": daemons, "buses": buses},
            separators=(",", ":"),
            allow_nan=False,
        )

    def order(
        self, key: str, order: str, by: str, *, team: bool = False
    ) -> Sequence[Mapping[str, Any]]:
        """Send an order to a daemon, or to all vehicles of its team, and wait for an answer of each.

        Raises:
            LinkError: If the daemon is unknown or does not answer.
        """
        if (view := self._views.get(key)) is None:
            raise LinkError(f"no daemon {key!r} is known")
        return view.bus.order(
            view.name, order, by, str(view.told["status"].get("team", "")) if team else ""
        )

    def note_operator(self, key: str) -> None:
        """Send signs of life to a daemon for a short time; unknown keys are ignored."""
        if (view := self._views.get(key)) is not None:
            view.bus.note_operator(view.name)

    def close(self) -> None:
        """Disconnect from all buses."""
        for bus in self._buses:
            bus.close()
