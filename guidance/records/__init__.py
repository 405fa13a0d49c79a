"""Flight records afterwards: reading them, whole or torn, replaying them through the present code, exporting them."""

from guidance.records.reading import Item, Survey, making_sense_of, metadata_of, scan, survey_of
from guidance.records.replay import Comparison, ReplayedCycle, compare, replay
from guidance.records.rows import CycleRow, EventRow, events_of, reports_of, rows_of
from guidance.records.settings import changes_of, flight_settings, title_of
from guidance.records.telling import Cycle, Teller

__all__ = [
    "Comparison",
    "Cycle",
    "CycleRow",
    "EventRow",
    "Item",
    "ReplayedCycle",
    "Survey",
    "Teller",
    "changes_of",
    "compare",
    "events_of",
    "flight_settings",
    "making_sense_of",
    "metadata_of",
    "replay",
    "reports_of",
    "rows_of",
    "scan",
    "survey_of",
    "title_of",
]
