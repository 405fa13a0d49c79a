"""Flight records afterwards: reading them, whole or torn, replaying them through the present code, exporting them.

Reading:
    scan: every message of a record, an `Item` each. cycles_of, events_of, reports_of: those of one kind, as
        `CycleEntry`, `EventEntry` and reports of the evader.
    metadata_of: what was written at the start. title_of: what the flight is called.
    survey_of: a whole record in a `Survey`: how long, how much, whole or torn.
    record_errors: turns whatever a damaged record leads to into one error that names it.
    Aggregator: folds cycles as the flight did, each into the numbers of a `Cycle`.

Replay:
    replay: the present code over a record, a `ReplayedCycle` each. compare: counts what differs, in a `Comparison`.
    SettingsOf: makes a flight's settings of a record's metadata (`guidance.session.flight_files.recorded_settings`).
"""

from guidance.log.aggregation import Aggregator, Cycle
from guidance.log.entries import CycleEntry, EventEntry
from guidance.log.reader import (
    Item,
    SettingsOf,
    Survey,
    cycles_of,
    events_of,
    metadata_of,
    record_errors,
    reports_of,
    scan,
    survey_of,
    title_of,
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
    "SettingsOf",
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
