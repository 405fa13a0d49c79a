"""Finds the daemons of control endpoints, collects their data, and encodes it once for all pages.

A thread for each endpoint queries the status of its daemons. A daemon may restart with another token, so the thread
reconnects when no daemon answers. Received data waits in bounded queues, one for each daemon, for the thread of the web
server. Ten times a second the changes become one message. A new page gets a snapshot of everything first.

Each daemon's data is read and encoded alone. Unusable data is that daemon's fault: it is named on the page, and
the others are shown as before.
"""

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
from guidance.links.zenoh.credentials import Credentials
from guidance.links.zenoh.session import close_all, is_over
from guidance.log.broadcast import FLIGHT, FoundFlight, broadcast_key, flight_of, item_of
from guidance.log.entries import BEGUN, FLIGHT_OVER, EventEntry, Item
from guidance.session.orders.control_client import (
    answers,
    join_session,
    order_team,
    replies,
    say_alive,
)
from guidance.session.orders.replies import is_bad, is_vehicle_name
from guidance.session.orders.words import STATUS
from guidance.texts import printable
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
MAX_DAEMONS: Final = 128
"""Vehicles that the page shows. It says how many more there are."""

MAX_NAMES: Final = 1024
"""Vehicles of one endpoint whose news are kept until they are read."""

NO_CONTACT_S: Final = 2.0
"""After this time without data, a daemon counts as lost."""

_BAD_DATA: Final = (
    ConfigError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
)  # fmt: skip

MAX_QUEUED_NEWS: Final = 1024
"""Cycles and events of one daemon that are not yet read: 20 s of them."""

MAX_NEWS_BYTES: Final = 1 << 18
"""Longest cycle, event or description of a flight; longer ones are not read."""

FAULT_SHOWN_S: Final = 10.0
"""The page names unusable data of a daemon for this time."""

STATUS_INTERVAL_S: Final = 0.5
"""Interval of status queries. Daemons check their readiness as often."""

LOCAL_JOIN_LIMIT_S: Final = 1.5
"""Time limit to connect on this computer. An attempt cannot be cancelled, and closing the panel waits for it."""

REMOTE_JOIN_LIMIT_S: Final = 3.0

STATUS_TIMEOUT_S: Final = 1.5
ORDER_LIMIT_S: Final = 4.0
OPERATOR_LIMIT_S: Final = 2.0
"""An operator counts as present for this time after a sign of life; pages send one every second."""

MAX_UNANSWERED: Final = 3
"""Consecutive status queries without an answer; then the client reconnects."""


class Unreadable(NamedTuple):
    """Unusable data from a daemon."""

    words: str


class News(NamedTuple):
    """A flight, a status, a cycle or an event of a daemon, and the time of its arrival (panel's clock)."""

    name: str
    at_s: float
    what: FoundFlight | Mapping[str, Any] | Item | Unreadable


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
        self._news = dict[str, deque[News]]()
        self._session: zenoh.Session | None = None
        self._known = set[str]()
        self._operator_seen_s = dict[str, float]()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"bus {endpoint}")
        self._thread.start()

    def news(self) -> Sequence[News]:
        """Take the news since the last call, oldest first of each daemon."""
        taken = list[News]()
        for queue in list(self._news.values()):
            taken.extend(queue.popleft() for _ in range(len(queue)))
        return taken

    def order(self, name: str, order: str, by: str, team: str = "") -> Sequence[Mapping[str, Any]]:
        """Send an order to a daemon, or to all of a team; return an answer of each. Blocks until they arrive.

        Raises:
            LinkError: If no answer arrives in time.
        """
        session = self._session
        if session is None:
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
            remedy = "repeat it, or take over by radio"
            raise LinkError(
                f"{name} at {self.endpoint}: no answer within {ORDER_LIMIT_S:g} s; {remedy}"
            )
        return answered

    def note_operator(self, name: str) -> None:
        """Send signs of life to a daemon for the next `OPERATOR_LIMIT_S`: an operator is watching it."""
        self._operator_seen_s[name] = self._clock.now_s()

    def forget(self, name: str) -> None:
        """Ask a daemon for its flight again."""
        self._known.discard(name)

    def close(self) -> None:
        """Disconnect. May be called twice."""
        self._ended.set()
        self._disconnect()  # ends a pending query
        self._thread.join()

    def _run(self) -> None:
        limit_s = LOCAL_JOIN_LIMIT_S if self._credentials.tls is None else REMOTE_JOIN_LIMIT_S
        while not is_over(self._ended, STATUS_INTERVAL_S):
            try:
                session = join_session(
                    self.endpoint, self._token_file, self._credentials, timeout_s=limit_s
                )
                self._session = session
                unanswered = 0
                self._known.clear()
                session.declare_subscriber(broadcast_key("*", "*"), self._queue)
                while not is_over(self._ended):
                    unanswered = 0 if self._poll(session) else unanswered + 1
                    if unanswered >= MAX_UNANSWERED:
                        raise LinkError(f"no daemon answers at {self.endpoint}")
                    self._ended.wait(STATUS_INTERVAL_S)
            except (GuidanceError, zenoh.ZError, OSError, ValueError, KeyError, TypeError) as error:
                self.reason = str(error)
            self._disconnect()

    def _poll(self, session: "zenoh.Session") -> bool:
        """Send signs of life, and query all status; return whether a daemon answered.

        Each answer is news when it arrives, so a slow daemon delays no other.
        """
        for name in tuple(self._known):
            if self._clock.now_s() - self._operator_seen_s.get(name, -math.inf) <= OPERATOR_LIMIT_S:
                say_alive(session, name)
        names = set[str]()
        for status in replies(session, "*", STATUS, STATUS_TIMEOUT_S):
            name = status["name"]
            names.add(name)
            self.reason = ""
            if name not in self._known:
                session.get(
                    broadcast_key(name, FLIGHT), self._queue_flight, timeout=STATUS_TIMEOUT_S
                )
            self._add(name, status)
        self._known &= names  # a daemon that was away may have restarted
        if not names:
            self.reason = "no answer"
        return bool(names)

    def _queue_flight(self, reply: "zenoh.Reply") -> None:
        """Queue the description of a flight. Runs in Zenoh's thread."""
        if reply.ok is None:
            return
        name = _sender(reply.ok)
        flight = None if len(reply.ok.payload) > MAX_NEWS_BYTES else flight_of(reply.ok)
        self._add(name, Unreadable("its flight") if flight is None else flight)
        self._known.add(name)

    def _queue(self, sample: "zenoh.Sample") -> None:
        """Queue a cycle or event. Runs in Zenoh's thread, so it must not block; the reader checks the content."""
        if len(sample.payload) > MAX_NEWS_BYTES:
            self._add(_sender(sample), Unreadable("a message of its broadcast"))
            return
        item = item_of(sample)
        if item is not None:
            self._add(_sender(sample), item)

    def _add(self, name: str, what: FoundFlight | Mapping[str, Any] | Item | Unreadable) -> None:
        """Queue news of a daemon; one that sends too much pushes out its own news only."""
        if not is_vehicle_name(name) or (name not in self._news and len(self._news) >= MAX_NAMES):
            return
        queue = self._news.setdefault(name, deque(maxlen=MAX_QUEUED_NEWS))
        queue.append(News(name, self._clock.now_s(), what))

    def _disconnect(self) -> None:
        session = self._session
        self._session = None
        if session is not None:
            close_all(session.close)


def _sender(sample: "zenoh.Sample") -> str:
    """Return the name of the daemon that may publish and answer under a key."""
    return str(sample.key_expr).split("/")[1]


class DaemonView:
    """Data of one daemon, and which of it the pages do not have yet."""

    def __init__(self, name: str, bus: DaemonBus, now_s: float) -> None:
        self.name = name
        self.bus = bus
        self.key = f"{name}@{bus.endpoint}"
        self._heard_s = now_s
        self._fold: SnapshotFold | None = None
        self._over: Plain | None = None
        self.latest: Plain = {"status": {}}
        self._sent = dict[str, Any]()
        self._unsent_events = 0  # nothing was sent: the next message is whole
        self._events: deque[Plain] = deque(maxlen=MAX_EVENTS)
        self._rows: deque[Sequence[Any]] = deque(maxlen=math.ceil(HISTORY_S / HISTORY_INTERVAL_S))
        self._unreadable = ""
        self._unreadable_s = -math.inf

    def take(self, news: News) -> None:
        """Take the metadata of a flight, a status, a cycle or an event; note the fault of an unreadable one."""
        what = news.what
        if isinstance(what, Unreadable):
            self._note_fault(what.words, news.at_s)
        elif isinstance(what, Mapping):
            self.latest = {"status": what, "operator": of_operator(what)}
            self._heard_s = news.at_s if self._fold is None else self._heard_s
        else:
            try:
                if isinstance(what, FoundFlight):  # start again with its metadata
                    self._fold = None
                    self._over = None
                    self._sent = {}
                    self._rows.clear()
                    fold = SnapshotFold(what.metadata, self.key)
                    for item in what.heard:
                        fold.take(item)
                    self._fold = fold
                elif self._fold is not None:
                    self._add(what, news.at_s, self._fold)
            except _BAD_DATA:  # another version, or damaged: its status is shown at least
                kind = (
                    "its flight" if isinstance(what, FoundFlight) else "a message of its broadcast"
                )
                self._note_fault(kind, news.at_s)

    def _note_fault(self, what: str, at_s: float) -> None:
        self._unreadable = f"{what} cannot be read: check its version"
        self._unreadable_s = at_s

    def fault(self, now_s: float) -> str:
        """Name the fault of the daemon's data; empty without one."""
        status = self.latest["status"]
        if status and is_bad(status):
            return str(status["reason"])
        return self._unreadable if now_s - self._unreadable_s <= FAULT_SHOWN_S else ""

    def _add(self, item: Item, at_s: float, fold: SnapshotFold) -> None:
        entry = fold.take(item)
        if isinstance(entry, EventEntry):
            if entry.event == FLIGHT_OVER:
                finished_evaders = json.loads(entry.detail)
                self._over = {
                    name: printable(str(finished_evaders.get(name, "")))
                    for name in ("ended", "record", "replay")
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

    def message(self, now_s: float, *, whole: bool) -> str:
        """Return JSON: what changed since the last message of changes, or everything (`whole`).

        Data that cannot be encoded becomes a fault of this daemon, and is left out.
        """
        try:
            is_first = not self._sent
            full = whole or is_first
            message = self._about(now_s)
            parts = dict(self.latest)
            fold = self._fold
            if fold is not None:
                parts["scene"] = fold.scene
                parts["snapshot"] = fold.snapshot()
            for name, part in parts.items():
                if full or part is not self._sent.get(name):
                    message[name] = part
            if full:
                message["history"] = {"columns": HISTORY, "rows": list(self._rows)}
                message["events"] = list(self._events)
            elif self._unsent_events:
                message["events"] = list(self._events)[-self._unsent_events :]
            if not whole:
                self._sent = parts
                self._unsent_events = 0
            return _encoded(message)
        except _BAD_DATA:
            self.latest = {"status": {}}
            self._fold = None
            self._rows.clear()
            self._events.clear()
            self._note_fault("a cycle or event of its flight", now_s)
            self.bus.forget(self.name)
            self._sent = {}
            return _encoded(self._about(now_s) | self.latest | {"snapshot": None, "events": []})

    def _about(self, now_s: float) -> Plain:
        silent_s = max(0.0, now_s - self._heard_s)
        return {
            "key": self.key,
            "name": self.name,
            "endpoint": self.bus.endpoint,
            "over": self._over,
            "fault": self.fault(now_s),
            "silent_s": round(silent_s, 1),
            "contact": level_of(silent_s, 0.5 * NO_CONTACT_S, NO_CONTACT_S),
        }


def _encoded(message: Plain) -> str:
    return json.dumps(message, separators=(",", ":"), allow_nan=False)


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
        self._left_out = set[str]()

    def receive(self) -> None:
        """Read the news of all buses."""
        for bus in self._buses:
            for news in bus.news():
                key = f"{news.name}@{bus.endpoint}"
                if key not in self._views and len(self._views) < MAX_DAEMONS:
                    self._views[key] = DaemonView(news.name, bus, self._clock.now_s())
                if key in self._views:
                    self._views[key].take(news)
                else:
                    self._left_out.add(key)

    def message(self, *, whole: bool = False) -> str:
        """Return JSON: the changes since the last message of changes, or everything (`whole`)."""
        now_s = self._clock.now_s()
        daemons = ",".join(view.message(now_s, whole=whole) for view in self._views.values())
        about = {
            "whole": whole,
            "left_out": len(self._left_out),
            "buses": [{"endpoint": bus.endpoint, "reason": bus.reason} for bus in self._buses],
        }
        return f'{_encoded(about)[:-1]},"daemons":[{daemons}]}}'

    def order(
        self, key: str, order: str, by: str, *, team: bool = False
    ) -> Sequence[Mapping[str, Any]]:
        """Send an order to a daemon, or to all vehicles of its team, and wait for an answer of each.

        Raises:
            LinkError: If the daemon is unknown or does not answer.
        """
        view = self._views.get(key)
        if view is None:
            known = "is known"
            if key in self._left_out:
                known = f"is shown, for there are {MAX_DAEMONS} already: use guidance ctl"
            raise LinkError(f"no daemon {key!r} {known}")
        team_name = str(view.latest["status"].get("team", "")) if team else ""
        return view.bus.order(view.name, order, by, team_name)

    def note_operator(self, key: str) -> None:
        """Send signs of life to a daemon for a short time; unknown keys are ignored."""
        view = self._views.get(key)
        if view is not None:
            view.bus.note_operator(view.name)

    def close(self) -> None:
        """Disconnect from all buses."""
        for bus in self._buses:
            bus.close()
