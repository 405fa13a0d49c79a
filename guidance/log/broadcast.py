"""Publishes cycles and events on `guidance/<name>/live/cycle` and `/event`, in the format of the record.

The loop only appends to a bounded queue. A separate thread encodes and publishes, and only while there are
subscribers. It drops entries instead of waiting, so a viewer that hangs does not affect the loop. `LiveFlight` is the
viewer's side: it yields arrivals as items of a record and drops the oldest if it is too slow.
"""

import contextlib
import json
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.flight import Inputs
from guidance.links.zenoh.session import close_all, is_over, is_small
from guidance.log.codec import Codec
from guidance.log.entries import (
    CONFIG,
    CYCLE,
    EVENT,
    FLIGHT_OVER,
    RELOADED,
    CycleEntry,
    EventEntry,
    Idle,
    Item,
)
from guidance.log.sink import Entry
from guidance.log.writer import Record

MAX_BROADCASTS_WAITING: Final = 256
"""Five seconds of cycles; further entries are dropped and counted."""

_MOST_QUERIES: Final = 16

FLIGHT: Final = "flight"
"""Query of viewers that join late: the metadata, and the last message of each kind."""


MAX_ARRIVED: Final = 4096
_TIMEOUT_S: Final = 4.0
_CODECS: Final[Mapping[str, Codec[Any]]] = {"cycle": CYCLE, "event": EVENT}
"""By the last part of a broadcast key."""


def broadcast_key(name: str, channel: str) -> str:
    """Return the Zenoh key of a broadcast or query."""
    return f"guidance/{name}/live/{channel}"


class Broadcast(Record):
    """`Record` for onlookers, without frames.

    Args:
        name: Name of the vehicle.
        session: The bus; not closed here.
        metadata: As in a record.
    """

    def __init__(self, name: str, session: "zenoh.Session", metadata: Mapping[str, str]) -> None:
        super().__init__()
        self._name = name
        self._metadata = dict(metadata)
        self._latest = dict[type, Any]()
        self._waiting = deque[CycleEntry | EventEntry]()
        self._last: CycleEntry | None = None
        self._heard = Inputs()
        json_of = zenoh.Encoding.APPLICATION_JSON.with_schema
        options: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "priority": zenoh.Priority.DATA_LOW,
        }
        self._publishers = {
            channel: session.declare_publisher(
                broadcast_key(name, channel), encoding=json_of(codec.title), **options
            )
            for channel, codec in _CODECS.items()
        }
        self._asked: deque[zenoh.Query] = deque(maxlen=_MOST_QUERIES)
        self._queries = session.declare_queryable(broadcast_key(name, FLIGHT), self._ask)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="broadcast")
        self._thread.start()

    def frames(self, passed: Sequence[Entry]) -> None:
        """Publish cycles and events; raw frames are published elsewhere."""
        for _, _, entry in passed:
            if len(self._waiting) >= MAX_BROADCASTS_WAITING:
                self.dropped += 1
            elif not isinstance(entry, bytes):
                self._waiting.append(entry)

    def over(self, now_s: float, detail: str) -> None:
        """Publish how the flight ended."""
        self.event(now_s, FLIGHT_OVER, detail)

    @property
    def waiting(self) -> int:
        """Number of entries that are not published yet."""
        return len(self._waiting)

    def watched(self) -> set[str]:
        """Return the channels with subscribers."""
        publishers = self._publishers.items()
        return {channel for channel, publisher in publishers if is_watched(publisher)}

    def close(self) -> None:
        """Stop publishing; may be called twice."""
        self._stop.set()
        self._thread.join()
        close_all(self._queries.undeclare)

    def _ask(self, query: "zenoh.Query") -> None:
        """Keep a query for the thread; on Zenoh's own thread, which must not wait."""
        if is_small(query):
            self._asked.append(query)
        else:
            self.dropped += 1
            query.drop()  # type: ignore[no-untyped-call]

    def _run(self) -> None:
        stopped = False
        while not stopped:
            stopped = is_over(self._stop, 0.05)  # the last entries are published after the end
            # An entry that cannot be encoded is dropped
            with contextlib.suppress(zenoh.ZError, ValueError, TypeError):
                watched = self.watched()
                while self._waiting:
                    entry = self._waiting.popleft()
                    # Viewers that join later need the last cycle, the role, the latest message of each kind and the
                    # configuration.
                    if isinstance(entry, CycleEntry):
                        self._last = entry
                        if entry.inputs.role:
                            self._heard = Inputs(role=entry.inputs.role)
                        for message in entry.inputs.messages:
                            self._latest[type(message)] = message
                    elif entry.event == RELOADED:
                        self._metadata[CONFIG] = entry.detail
                    channel = "cycle" if isinstance(entry, CycleEntry) else "event"
                    if channel in watched:
                        self._publishers[channel].put(_CODECS[channel].encode(entry))
                while self._asked:
                    query = self._asked.popleft()
                    answer: dict[str, Any] = {"name": self._name, "metadata": self._metadata}
                    if self._last is not None:
                        inputs = self._heard._replace(messages=tuple(self._latest.values()))
                        answer["heard"] = CYCLE.plain(
                            CycleEntry(self._last.now_s, self._last.state, inputs, ())
                        )
                    data = json.dumps(answer, allow_nan=False).encode()
                    query.reply(
                        broadcast_key(self._name, FLIGHT),
                        data,
                        encoding=zenoh.Encoding.APPLICATION_JSON,
                    )
                    query.drop()  # type: ignore[no-untyped-call]


def is_watched(publisher: "zenoh.Publisher") -> bool:
    """Return True if there is a subscriber."""
    status: Any = publisher.matching_status  # an object; its stub says bool
    return bool(status.matching)


class FoundFlight(NamedTuple):
    """A daemon's flight: its name, its metadata, and as `heard` its last cycle with the latest message of each kind."""

    name: str
    metadata: Mapping[str, str]
    heard: Sequence[Item]


def find_flights(session: "zenoh.Session", name: str, timeout_s: float) -> Sequence[FoundFlight]:
    """Ask a daemon, or all of a bus ("*"), for the flight. One that waits for its vehicle does not answer yet."""
    replies = session.get(
        broadcast_key(name, FLIGHT), timeout=timeout_s, target=zenoh.QueryTarget.ALL
    )
    samples = (reply.ok for reply in replies if reply.ok is not None)
    return [flight for flight in map(flight_of, samples) if flight is not None]


def flight_of(sample: "zenoh.Sample") -> FoundFlight | None:
    """Return the flight that a daemon describes; None if it cannot be read. The name comes from the key."""
    try:
        answer = json.loads(sample.payload.to_bytes())
        metadata = {str(key): str(value) for key, value in answer["metadata"].items()}
        items = []
        if "heard" in answer:
            data = json.dumps(answer["heard"]).encode()
            items.append(Item(0.0, CYCLE.topic, "json", data))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return FoundFlight(str(sample.key_expr).split("/")[1], metadata, items)


def item_of(sample: "zenoh.Sample") -> Item | None:
    """Return a cycle or event as published, without its time; None for anything else. The content is not checked."""
    codec = _CODECS.get(str(sample.key_expr).rpartition("/")[2])
    return None if codec is None else Item(0.0, codec.topic, "json", sample.payload.to_bytes())


class LiveFlight:
    """The running flight of a daemon, seen by a viewer.

    Args:
        session: The daemon's bus; the caller closes it.
        name: Name of the vehicle; None if there is only one.

    Raises:
        ConfigError: If there are several daemons and no name.
        LinkError: If no daemon answers.
    """

    live = True

    def __init__(self, session: "zenoh.Session", name: str | None = None) -> None:
        flights = {flight.name: flight for flight in find_flights(session, name or "*", _TIMEOUT_S)}
        if len(flights) > 1:
            raise ConfigError(
                f"--name: which vehicle? daemons on this bus: {', '.join(sorted(flights))}"
            )
        if not flights:
            raise LinkError(
                f"{name or 'any daemon'}: no answer within {_TIMEOUT_S:g} s; is it running?"
            )
        ((self.name, self._flight),) = flights.items()
        self._arriving = session.declare_subscriber(
            broadcast_key(self.name, "*"), zenoh.handlers.RingChannel(MAX_ARRIVED)
        )

    def metadata(self, _idle: Idle) -> Mapping[str, str]:
        """Return the metadata of the flight, as in its record."""
        return self._flight.metadata

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield arrivals until `idle` returns True, beginning with the vehicle's latest messages."""
        yield from self._flight.heard
        while True:
            while (sample := self._arriving.try_recv()) is not None:
                if (item := item_of(sample)) is not None:
                    yield item
            if idle():
                return
