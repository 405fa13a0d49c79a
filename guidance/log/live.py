"""What a daemon broadcasts, as items of a record: subscribed to over Zenoh, bounded, the oldest dropped first."""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, Final

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.log.broadcast import FLIGHT, broadcast_key
from guidance.log.entries import CYCLE_TOPIC, EVENT_TOPIC
from guidance.log.reader import Idle, Item

MOST_WAITING: Final = 4096
TIMEOUT_S: Final = 4.0

TOPICS: Final[Mapping[str, str]] = {"cycle": CYCLE_TOPIC, "event": EVENT_TOPIC}
"""What a daemon broadcasts, by the end of its key, and the topic that a record has it under."""


class LiveFlight:
    """A daemon's flight, from now on.

    Args:
        session: The daemon's bus, joined; closed with this.
        name: The vehicle's; None for the only one there is.

    Raises:
        ConfigError: If there are several daemons and no name.
        LinkError: If nobody answers.
    """

    live = True
    trusted = False

    def __init__(self, session: "zenoh.Session", name: str | None = None) -> None:
        self._arrived: deque[tuple[str, bytes]] = deque(maxlen=MOST_WAITING)
        self._session = session
        try:
            self._flight = self._find(name)
            self.name = str(self._flight["name"])
            self._session.declare_subscriber(broadcast_key(self.name, "*"), self._hear)
        except BaseException:
            self.close()
            raise

    def metadata(self, _idle: Idle) -> Mapping[str, str]:
        """As a record of this flight has it."""
        return dict(self._flight["metadata"])

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield what arrives, until `idle` ends it; first what the vehicle said before we came."""
        if "heard" in self._flight:
            yield _item(CYCLE_TOPIC, self._flight["heard"])
        while True:
            while self._arrived:
                topic, data = self._arrived.popleft()
                try:
                    yield _item(topic, json.loads(data))
                except (ValueError, KeyError, TypeError):  # whoever is on the bus may say anything
                    continue
            if idle():
                return

    def close(self) -> None:
        """Leave the bus. May be called twice."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _find(self, name: str | None) -> dict[str, Any]:
        there = {str(one["name"]): one for one in self._ask(name or "*")}
        if len(there) > 1:
            raise ConfigError(f"--name: which vehicle? daemons on this bus: {', '.join(sorted(there))}")
        if not there:
            who = name or "any daemon"
            raise LinkError(f"{who}: no answer within {TIMEOUT_S:g} s; is it running?")
        return there.popitem()[1]

    def _ask(self, name: str) -> list[dict[str, Any]]:
        replies = self._session.get(broadcast_key(name, FLIGHT), timeout=TIMEOUT_S, target=zenoh.QueryTarget.ALL)
        return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]

    def _hear(self, sample: "zenoh.Sample") -> None:
        """On Zenoh's thread: keep it and be gone."""
        topic = TOPICS.get(str(sample.key_expr).rpartition("/")[2])
        if topic is not None:
            self._arrived.append((topic, sample.payload.to_bytes()))


def _item(topic: str, row: Mapping[str, Any]) -> Item:
    return Item(float(row["now_s"]), topic, "json", json.dumps(row).encode())
