"""What the loop does, published for whoever looks on: `guidance/<name>/live/cycle` and `/event`, as a record has them.

The loop only appends to a bounded queue. A thread of our own lays out JSON and publishes, and only while somebody has
subscribed. It drops rather than waits: an onlooker that hangs or dies is Zenoh's matter, and never the loop's.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

import zenoh

from guidance.log.known import in_bytes
from guidance.log.writer import RELOADED, Record
from guidance.messages import EvaderReport

MOST_WAITING: Final = 256
"""Five seconds of cycles: what finds no room is dropped and counted."""

FLIGHT: Final = "flight"
"""Asked for by who joins late: the record's metadata, and what was last heard of each kind."""

_LOOK_EVERY_S: Final = 0.05
_MOST_ASKED: Final = 16


def broadcast_key(name: str, what: str) -> str:
    """Return the key that something is published, or asked for, on."""
    return f"guidance/{name}/live/{what}"


class Broadcast:
    """`Record` for onlookers.

    Args:
        name: The vehicle's.
        session: The bus. It stays open longer than this.
        metadata: As a record's.
    """

    failed = None

    def __init__(self, name: str, session: "zenoh.Session", metadata: Mapping[str, str]) -> None:
        self._name = name
        self._metadata = dict(metadata)
        self._heard: dict[str, Any] = {}
        self._now_s, self._state = 0.0, ""
        self._waiting: deque[tuple[str, Mapping[str, Any]]] = deque()
        self._asked: deque[Any] = deque(maxlen=_MOST_ASKED)
        self.dropped = 0
        self._publishers = {what: self._declare(session, what) for what in ("cycle", "event")}
        self._queryable = session.declare_queryable(broadcast_key(name, FLIGHT), self._asked.append)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="broadcast", daemon=True)
        self._thread.start()

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Nothing: raw frames have a bus of their own."""

    def report(self, report: EvaderReport) -> None:
        """Nothing: the cycle has it."""

    def cycle(self, _now_s: float, row: Mapping[str, Any]) -> None:
        """Publish one guidance cycle."""
        self._put("cycle", row)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Publish one event."""
        self._put("event", {"now_s": now_s, "event": event, "detail": detail})

    def close(self) -> None:
        """Publish no more. May be called twice."""
        self._stop.set()
        self._thread.join()
        with contextlib.suppress(zenoh.ZError):
            self._queryable.undeclare()  # type: ignore[no-untyped-call]

    def _declare(self, session: "zenoh.Session", what: str) -> "zenoh.Publisher":
        return session.declare_publisher(
            broadcast_key(self._name, what),
            encoding=zenoh.Encoding.APPLICATION_JSON.with_schema(f"guidance.{what.capitalize()}"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
        )

    def _put(self, what: str, row: Mapping[str, Any]) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
        else:
            self._waiting.append((what, row))

    def _run(self) -> None:
        while not self._stop.wait(_LOOK_EVERY_S):
            with contextlib.suppress(zenoh.ZError, ValueError, TypeError):  # what cannot be said is left unsaid
                self._publish()
                self._answer()

    def _publish(self) -> None:
        watched = {what: is_watched(one) for what, one in self._publishers.items()}
        while self._waiting:
            what, row = self._waiting.popleft()
            self._note(row)
            if watched[what]:
                self._publishers[what].put(in_bytes(row))

    def _note(self, row: Mapping[str, Any]) -> None:
        """Keep what who joins later has to know."""
        if row.get("event") == RELOADED:
            self._metadata["config"] = row["detail"]
        if "inputs" not in row:
            return
        self._now_s, self._state = row["now_s"], row["state"]
        self._heard.update((message["kind"], message) for message in row["inputs"]["messages"])

    def _answer(self) -> None:
        while self._asked:
            query = self._asked.popleft()
            inputs = {"messages": list(self._heard.values()), "reports": [], "orders": [], "refusals": []}
            heard = {"now_s": self._now_s, "state": self._state, "inputs": inputs, "requests": []}
            answer = {"name": self._name, "metadata": self._metadata, "heard": heard}
            query.reply(broadcast_key(self._name, FLIGHT), in_bytes(answer), encoding=zenoh.Encoding.APPLICATION_JSON)
            query.drop()


def is_watched(publisher: "zenoh.Publisher") -> bool:
    """Whether anybody has subscribed."""
    status: Any = publisher.matching_status  # an object; its stub says bool
    return bool(status.matching)


class Records:
    """Several records as one. It has failed once any of them has."""

    def __init__(self, records: Sequence[Record]) -> None:
        self._records = records

    @property
    def failed(self) -> str | None:
        """Why one of them writes nothing any more; None while all is well."""
        return next((record.failed for record in self._records if record.failed is not None), None)

    def frame(self, now_s: float, topic: str, frame: bytes) -> None:
        """Keep one raw MAVLink frame."""
        for record in self._records:
            record.frame(now_s, topic, frame)

    def cycle(self, now_s: float, row: Mapping[str, Any]) -> None:
        """Keep one guidance cycle."""
        for record in self._records:
            record.cycle(now_s, row)

    def event(self, now_s: float, event: str, detail: str = "") -> None:
        """Keep one event."""
        for record in self._records:
            record.event(now_s, event, detail)

    def report(self, report: EvaderReport) -> None:
        """Keep one report of the evader."""
        for record in self._records:
            record.report(report)
