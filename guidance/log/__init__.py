"""Flight records afterwards: reading them, whole or torn, replaying them through the present code, exporting them."""

from guidance.log.aggregation import Aggregator, Cycle
from guidance.log.entries import CycleEntry, EventEntry
from guidance.log.reader import (
    Item,
    SettingsOf,
    Survey,
    cycles_of,
    events_of,
    making_sense_of,
    metadata_of,
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
    "making_sense_of",
    "metadata_of",
    "replay",
    "reports_of",
    "scan",
    "survey_of",
    "title_of",
]
