"""An output of a flight: a record, a log, metrics, another program's messages. All outputs get the same calls.

A daemon calls its outputs in every cycle, on the thread of the loop. A sink therefore never waits: slow work goes to a
thread of its own through a bounded queue, and entries that do not fit are dropped and counted. A sink that raises is
dropped; the flight continues.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from guidance.clock import Timing
from guidance.flight import Flight, FlightSettings, Outputs
from guidance.log.entries import CycleEntry, EventEntry

Entry = tuple[float, str, bytes | CycleEntry | EventEntry]
"""Time, topic (of a frame the Zenoh key), and a raw MAVLink frame, a cycle or an event."""


class FlightIdentity(NamedTuple):
    """The flight of the following cycles.

    Attributes:
        vehicle: Its name.
        evaders: Names of its evaders.
        settings: Of the flight.
    """

    vehicle: str
    evaders: Sequence[str]
    settings: FlightSettings


class AnsweredOrder(NamedTuple):
    """An order and its answer: `order` is "unknown" if there is no such word, `by` names who gave it, or is empty."""

    order: str
    accepted: bool
    by: str
    reason: str


class Report(NamedTuple):
    """A cycle at its end.

    Attributes:
        now_s: Of the cycle.
        flight: To be read during the call only; it changes with the next cycle.
        outputs: Of the cycle.
        timing: How the loop kept time; None for a cycle that failed.
        orders: Answered since the last report.
        counters: Of each link, by link and name: once a second, and when the state changes. None otherwise.
    """

    now_s: float
    flight: Flight
    outputs: Outputs
    timing: Timing | None
    orders: Sequence[AnsweredOrder]
    counters: Mapping[str, Mapping[str, int]] | None


class Sink:
    """One output of a flight. A subclass implements the methods that it needs; the others do nothing.

    No method waits or raises. The order of calls: `begin`; in each cycle `cycle`, its events, `report`, `frames`,
    `worked`; `over` and `close` once at the end. `say` comes at any time, also before `begin`.

    Attributes:
        dropped: Entries that were dropped, because their reader was too slow.
    """

    dropped: int = 0

    def begin(self, identity: FlightIdentity, /) -> None:
        """Begin a flight. A daemon may fly several; each begins without the state of the last."""

    def cycle(self, entry: CycleEntry, /) -> None:
        """Take a cycle with its inputs and outputs, as a record keeps it, right after its setpoint was sent."""

    def event(self, now_s: float, event: str, detail: str = "", /) -> None:
        """Take an event, as a record keeps it: of the flight's table, an alarm, an order with a name, a mate's news."""

    def frames(self, passed: Sequence[Entry], /) -> None:
        """Take the raw MAVLink frames of the vehicle and of the evaders since the last cycle."""

    def report(self, report: Report, /) -> None:
        """Take a cycle when everything else in it is done."""

    def say(self, level: int, message: str, fields: Mapping[str, Any], /) -> None:
        """Take a message to people, with its level as in `logging`."""

    def worked(self, work_s: float, missed: int, /) -> None:
        """Take the working time of a cycle of the loop, s, and how many cycles it made late."""

    def over(self, now_s: float, detail: str, /) -> None:
        """Take how the flight ended, as JSON (`guidance.log.entries.FLIGHT_OVER`)."""

    def close(self) -> None:
        """Finish; may be called twice."""
