"""One line of the report."""

from enum import StrEnum
from typing import NamedTuple


class Verdict(StrEnum):
    """What a row means for the flight."""

    PASS = "pass"
    WARN = "warn"  # worth knowing; nothing is held up
    REFUSE = "refuse"  # the vehicle does not become ready


class Finding(NamedTuple):
    """One condition: what was found, what is wanted, and how to come from one to the other (empty if it is)."""

    name: str
    value: str
    wanted: str
    verdict: Verdict
    advice: str = ""
