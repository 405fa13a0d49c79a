"""How the loop kept time, as its record has it."""

from typing import NamedTuple


class Timing(NamedTuple):
    """How much later than due a cycle began, and how long the one before worked."""

    late_s: float
    worked_s: float
