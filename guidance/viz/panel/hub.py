"""What every page is told: all daemons of all buses, folded once, laid out once, however many pages look.

Ten times a second what is new becomes one message. A page that joins is told everything first.
"""

import contextlib
import json
import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Protocol

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.log import CycleEntry, EventEntry, Item, SettingsOf
from guidance.log.entries import BEGUN, FLIGHT_OVER
from guidance.viz.panel.bus import Joined, News, Said
from guidance.viz.panel.levels import of_age, of_operator
from guidance.viz.panel.snapshot import HISTORY, SnapshotFold

HISTORY_S: Final = 300.0
HISTORY_EVERY_S: Final = 0.25
MOST_EVENTS: Final = 200
MOST_DAEMONS: Final = 32
NO_CONTACT_S: Final = 2.0
"""A daemon that was not heard for so long may have died: what is shown of it is old."""

Plain = dict[str, Any]
_SENSELESS: Final = (ConfigError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError)


class Bus(Protocol):
    """Where daemons are heard and ordered: `guidance.viz.panel.bus.DaemonBus`."""

    endpoint: str
    reason: str

    def news(self) -> Sequence[News]:
        """Return what came since the last call."""
        ...

    def order(self, name: str, order: str, by: str) -> Mapping[str, Any]:
        """Give an order and return the answer; LinkError if there is none."""
        ...

    def vouch(self, name: str) -> None:
        """Tell a daemon, for a little while, that a person is there."""
        ...

    def close(self) -> None:
        """Leave it."""
        ...


class Watched:
    """One daemon: what was heard of it, and what of that the pages do not know yet."""

    def __init__(self, name: str, bus: Bus, settings_of: SettingsOf, now_s: float) -> None:
        self.name = name
        self.bus = bus
        self.key = f"{name}@{bus.endpoint}"
        self._settings_of = settings_of
        self._fold: SnapshotFold | None = None
        self._status: Mapping[str, Any] = {}
        self._status_new = False
        self._scene_told = 0
        self._begun_new = True
        self._cycle_new = False
        self._events_new: list[Plain] = []
        self._events: deque[Plain] = deque(maxlen=MOST_EVENTS)
        self._history: deque[Sequence[float | None]] = deque(maxlen=math.ceil(HISTORY_S / HISTORY_EVERY_S))
        self._heard_s = now_s
        self._over: Plain | None = None

    def join(self, joined: Joined) -> None:
        """Begin anew with what a daemon says it flies."""
        self._fold, self._scene_told, self._begun_new = None, 0, True
        self._over = None
        self._history.clear()
        with contextlib.suppress(*_SENSELESS):  # of another version: its status is shown nevertheless
            self._fold = SnapshotFold(self._settings_of, joined.metadata, self.key)
            if joined.heard is not None:
                self._fold.take(joined.heard)

    def say(self, said: Said) -> None:
        """Take an answer to being asked where it stands."""
        self._status, self._status_new = said.status, True
        if self._fold is None:
            self._heard_s = said.at_s

    def hear(self, item: Item, at_s: float) -> None:
        """Take a cycle or an event; what is none of this version's is passed over."""
        if self._fold is None:
            return
        with contextlib.suppress(*_SENSELESS):
            entry = self._fold.take(item)
            if isinstance(entry, EventEntry):
                self._note(entry)
            elif isinstance(entry, CycleEntry):
                self._heard_s, self._cycle_new = at_s, True
                self._remember(entry.now_s)

    def _note(self, event: EventEntry) -> None:
        detail = event.detail
        if event.event == FLIGHT_OVER:
            over = json.loads(detail)
            self._over = {name: str(over.get(name, "")) for name in ("ended", "record", "replay")}
            detail = self._over["ended"]
        elif event.event == BEGUN:
            self._over = None
        said = {"now_s": round(event.now_s, 2), "event": event.event, "detail": detail[:300]}
        self._events.append(said)
        self._events_new.append(said)
        del self._events_new[:-MOST_EVENTS]

    def _remember(self, now_s: float) -> None:
        last_s = self._history[-1][0] if self._history else None
        if last_s is not None and now_s < last_s:
            self._history.clear()  # another daemon's clock
        if self._fold is not None and (last_s is None or not 0.0 <= now_s - last_s < HISTORY_EVERY_S):
            row = self._fold.history_row()
            if row is not None:
                self._history.append(row)

    def told(self, now_s: float, *, whole: bool) -> Plain:
        """Lay out what pages do not know yet, or everything. What is new stays so until `settle`."""
        silent_s = max(0.0, now_s - self._heard_s)
        contact = of_age(silent_s, NO_CONTACT_S)
        said: Plain = {"key": self.key, "name": self.name, "endpoint": self.bus.endpoint}
        said |= {"silent_s": round(silent_s, 1), "contact": str(contact), "over": self._over}
        if whole or self._status_new:
            said["status"] = self._status
            said["operator"] = of_operator(self._status)
        fold = self._fold
        if fold is not None:
            if whole or fold.scenes != self._scene_told:
                said["scene"] = fold.scene
            if whole or self._cycle_new:
                said["snapshot"] = fold.snapshot()
        if whole or self._begun_new:
            said |= {"history": {"columns": HISTORY, "rows": list(self._history)}, "events": list(self._events)}
        elif self._events_new:
            said["events"] = self._events_new
        return said

    def settle(self) -> None:
        """Everything new was told."""
        self._status_new = self._cycle_new = self._begun_new = False
        self._events_new = []
        self._scene_told = 0 if self._fold is None else self._fold.scenes


class Hub:
    """All buses of a panel.

    Args:
        buses: Where daemons are looked for.
        settings_of: Makes a flight's settings of its metadata.
        clock: The panel's.
    """

    def __init__(self, buses: Sequence[Bus], settings_of: SettingsOf, clock: Clock) -> None:
        self._buses = buses
        self._settings_of = settings_of
        self._clock = clock
        self._watched: dict[str, Watched] = {}

    def listen(self) -> None:
        """Take in what came."""
        for bus in self._buses:
            for news in bus.news():
                watched = self._of(news.name, bus)
                if watched is None:
                    continue
                if isinstance(news, Joined):
                    watched.join(news)
                elif isinstance(news, Said):
                    watched.say(news)
                else:
                    watched.hear(news.item, news.at_s)

    def _of(self, name: str, bus: Bus) -> Watched | None:
        key = f"{name}@{bus.endpoint}"
        if key not in self._watched and len(self._watched) < MOST_DAEMONS:
            self._watched[key] = Watched(name, bus, self._settings_of, self._clock.now_s())
        return self._watched.get(key)

    def settle(self) -> None:
        """Nobody is there to be told what is new: who comes is told everything."""
        for watched in self._watched.values():
            watched.settle()

    def message(self, *, whole: bool = False) -> str:
        """Lay out, as JSON, what is new since the last message that was not whole, or everything there is."""
        now_s = self._clock.now_s()
        said = [watched.told(now_s, whole=whole) for watched in self._watched.values()]
        if not whole:
            self.settle()
        looked = [{"endpoint": bus.endpoint, "reason": bus.reason} for bus in self._buses]
        return json.dumps({"whole": whole, "daemons": said, "buses": looked}, separators=(",", ":"), allow_nan=False)

    def order(self, key: str, order: str, by: str) -> Mapping[str, Any]:
        """Give an order to one daemon. Waits for the answer.

        Raises:
            LinkError: If there is no such daemon, or it does not answer.
        """
        watched = self._watched.get(key)
        if watched is None:
            raise LinkError(f"no daemon {key!r} was heard")
        return watched.bus.order(watched.name, order, by)

    def vouch(self, key: str) -> None:
        """Tell one daemon that a person is there who looks at it; of one that was not heard nothing is said."""
        watched = self._watched.get(key)
        if watched is not None:
            watched.bus.vouch(watched.name)

    def __iter__(self) -> Iterator[Watched]:
        return iter(self._watched.values())

    def close(self) -> None:
        """Leave all buses."""
        for bus in self._buses:
            bus.close()
