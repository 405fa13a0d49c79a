"""Flight records: reading, replay and export.

Reading:
    scan: all messages of a record, as `Item`. cycles_of, events_of, reports_of: one kind of them, as `CycleEntry`,
        `EventEntry` and `EvaderReport`.
    metadata_of: configuration, versions and seed. title_of: title of the flight.
    survey_of: summary of a whole record, as `Survey`: duration, counts, damage.
    record_errors: turns any error caused by a damaged record into one that names the file.
    Aggregator: reads the cycles and events of flights, and computes the numbers of each cycle, as `Cycle`.

Replay:
    replay: runs the present code on a record, `ReplayedCycle` by cycle. compare: counts differences in a `Comparison`.
"""

from guidance.log.aggregator import Aggregator, Cycle
from guidance.log.entries import CycleEntry, EventEntry, Item, title_of
from guidance.log.reader import (
    Survey,
    cycles_of,
    events_of,
    metadata_of,
    record_errors,
    reports_of,
    scan,
    survey_of,
)
from guidance.log.replay import Comparison, ReplayedCycle, compare, replay

__all__ = [
    "Aggregator",
    "Comparison",
    "Cycle",
    "CycleEntry",
    "EventEntry",
    "Item",
    "ReplayedCycle",
    "Survey",
    "compare",
    "cycles_of",
    "events_of",
    "metadata_of",
    "record_errors",
    "replay",
    "reports_of",
    "scan",
    "survey_of",
    "title_of",
]
