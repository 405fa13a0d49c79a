"""Collects the data of all daemons and encodes it once for all pages.

Ten times a second the changes become one message. A new page gets a snapshot of everything first.
"""

import contextlib
import json
import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.log import CycleEntry, EventEntry, Item, SettingsOf
from guidance.log.broadcast import FoundFlight
from guidance.log.entries import BEGUN, FLIGHT_OVER
from guidance.viz.panel.bus import DaemonBus, StatusAnswer
from guidance.viz.panel.snapshot import HISTORY, SnapshotFold, event_row, history_row, of_age, of_operator

HISTORY_S: Final = 300.0
HISTORY_INTERVAL_S: Final = 0.25
MAX_EVENTS: Final = 200
MAX_DAEMONS: Final = 32
NO_CONTACT_S: Final = 2.0
"""After so long without data, a daemon counts as lost."""

Plain = dict[str, Any]
_BAD_DATA: Final = (ConfigError, ValueError, KeyError, TypeError, AttributeError, ArithmeticError)


class DaemonView:
    """Data of one daemon, and which of it the pages do not have yet."""

    def __init__(self, name: str, bus: DaemonBus, settings_of: SettingsOf, now_s: float) -> None:
        self.name = name
        self.bus = bus
        self.key = f"{name}@{bus.endpoint}"
        self._settings_of = settings_of
        self._fold: SnapshotFold | None = None
        self._status: Mapping[str, Any] = {}
        self._status_new = False
        self._scene_sent = 0
        self._reset_new = True
        self._cycle_new = False
        self._events_new: list[Plain] = []
        self._events: deque[Plain] = deque(maxlen=MAX_EVENTS)
        self._history: deque[Sequence[float | None]] = deque(maxlen=math.ceil(HISTORY_S / HISTORY_INTERVAL_S))
        self._heard_s = now_s
        self._over: Plain | None = None

    def reset(self, found: FoundFlight) -> None:
        """Start again with the metadata of a flight."""
        self._fold, self._scene_sent, self._reset_new = None, 0, True
        self._over = None
        self._history.clear()
        with contextlib.suppress(*_BAD_DATA):  # another version: show its status at least
            self._fold = SnapshotFold(self._settings_of, found.metadata, self.key)
            if found.last_cycle is not None:
                self._fold.take(found.last_cycle)

    def set_status(self, answer: StatusAnswer) -> None:
        """Store the answer to a status query."""
        self._status, self._status_new = answer.status, True
        if self._fold is None:
            self._heard_s = answer.at_s

    def add(self, item: Item, at_s: float) -> None:
        """Add a cycle or an event; ignore unreadable ones."""
        if self._fold is None:
            return
        with contextlib.suppress(*_BAD_DATA):
            entry = self._fold.take(item)
            if isinstance(entry, EventEntry):
                self._add_event(entry)
            elif isinstance(entry, CycleEntry):
                self._heard_s, self._cycle_new = at_s, True
                self._add_history(entry.now_s)

    def _add_event(self, event: EventEntry) -> None:
        if event.event == FLIGHT_OVER:
            over = json.loads(event.detail)
            self._over = {name: str(over.get(name, "")) for name in ("ended", "record", "replay")}
            event = event._replace(detail=self._over["ended"])
        elif event.event == BEGUN:
            self._over = None
        row = event_row(event)
        self._events.append(row)
        self._events_new.append(row)
        del self._events_new[:-MAX_EVENTS]

    def _add_history(self, now_s: float) -> None:
        last_s = self._history[-1][0] if self._history else None
        if last_s is not None and now_s < last_s:
            self._history.clear()  # the daemon restarted
        if self._fold is not None and (last_s is None or not 0.0 <= now_s - last_s < HISTORY_INTERVAL_S):
            seen = self._fold.snapshot()
            if seen is not None:
                self._history.append(history_row(seen))

    def message(self, now_s: float, *, whole: bool) -> Plain:
        """Return the changes since `mark_sent`, or everything."""
        silent_s = max(0.0, now_s - self._heard_s)
        contact = of_age(silent_s, NO_CONTACT_S)
        message: Plain = {"key": self.key, "name": self.name, "endpoint": self.bus.endpoint}
        message |= {"silent_s": round(silent_s, 1), "contact": str(contact), "over": self._over}
        if whole or self._status_new:
            message["status"] = self._status
            message["operator"] = of_operator(self._status)
        fold = self._fold
        if fold is not None:
            if whole or fold.scenes != self._scene_sent:
                message["scene"] = fold.scene
            if whole or self._cycle_new:
                message["snapshot"] = fold.snapshot()
        if whole or self._reset_new:
            message |= {"history": {"columns": HISTORY, "rows": list(self._history)}, "events": list(self._events)}
        elif self._events_new:
            message["events"] = self._events_new
        return message

    def mark_sent(self) -> None:
        """Mark everything as sent."""
        self._status_new = self._cycle_new = self._reset_new = False
        self._events_new = []
        self._scene_sent = 0 if self._fold is None else self._fold.scenes


class Hub:
    """All daemons of a panel.

    Args:
        buses: Connections to the daemons.
        settings_of: Makes settings from the metadata of a flight.
        clock: The panel's clock.
    """

    def __init__(self, buses: Sequence[DaemonBus], settings_of: SettingsOf, clock: Clock) -> None:
        self._buses = buses
        self._settings_of = settings_of
        self._clock = clock
        self._views: dict[str, DaemonView] = {}

    def receive(self) -> None:
        """Read the news of all buses."""
        for bus in self._buses:
            for news in bus.news():
                view = self._view(news.name, bus)
                if view is None:
                    continue
                if isinstance(news, FoundFlight):
                    view.reset(news)
                elif isinstance(news, StatusAnswer):
                    view.set_status(news)
                else:
                    view.add(news.item, news.at_s)

    def _view(self, name: str, bus: DaemonBus) -> DaemonView | None:
        key = f"{name}@{bus.endpoint}"
        if key not in self._views and len(self._views) < MAX_DAEMONS:
            self._views[key] = DaemonView(name, bus, self._settings_of, self._clock.now_s())
        return self._views.get(key)

    def mark_sent(self) -> None:
        """Mark everything as sent, without a message: no page is open, and a new one gets a snapshot."""
        for view in self._views.values():
            view.mark_sent()

    def message(self, *, whole: bool = False) -> str:
        """Return JSON: the changes since the last message of changes, or everything (`whole`)."""
        now_s = self._clock.now_s()
        daemons = [view.message(now_s, whole=whole) for view in self._views.values()]
        if not whole:
            self.mark_sent()
        buses = [{"endpoint": bus.endpoint, "reason": bus.reason} for bus in self._buses]
        return json.dumps({"whole": whole, "daemons": daemons, "buses": buses}, separators=(",", ":"), allow_nan=False)

    def order(self, key: str, order: str, by: str) -> Mapping[str, Any]:
        """Send an order to a daemon and wait for the answer.

        Raises:
            LinkError: If the daemon is unknown or does not answer.
        """
        view = self._views.get(key)
        if view is None:
            raise LinkError(f"no daemon {key!r} is known")
        return view.bus.order(view.name, order, by)

    def note_operator(self, key: str) -> None:
        """Send signs of life to a daemon for a short time; unknown keys are ignored."""
        view = self._views.get(key)
        if view is not None:
            view.bus.note_operator(view.name)

    def close(self) -> None:
        """Disconnect from all buses."""
        for bus in self._buses:
            bus.close()
