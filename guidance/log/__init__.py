"""Flight records afterwards: reading them, whole or torn, replaying them through the present code, exporting them."""

from guidance.log.aggregation import Aggregator, Cycle
from guidance.log.reader import Item, SettingsOf, Survey, making_sense_of, metadata_of, scan, survey_of, title_of
from guidance.log.replay import Comparison, ReplayedCycle, compare, replay
from guidance.log.rows import CycleRow, EventRow, events_of, reports_of, rows_of

__all__ = [
    "Aggregator",
    "Comparison",
    "Cycle",
    "CycleRow",
    "EventRow",
    "Item",
    "ReplayedCycle",
    "SettingsOf",
    "Survey",
    "compare",
    "events_of",
    "making_sense_of",
    "metadata_of",
    "replay",
    "reports_of",
    "rows_of",
    "scan",
    "survey_of",
    "title_of",
]
