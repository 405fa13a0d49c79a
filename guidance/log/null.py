"""The record that could not be opened: it keeps nothing, and says why. The flight does not wait for a disk."""

from guidance.log.entries import CycleEntry
from guidance.messages import EvaderReport


class NullRecorder:
    """`Record` that has failed from the start."""

    dropped = 0

    def __init__(self, reason: str) -> None:
        self.failed: str | None = reason

    def frame(self, _now_s: float, _topic: str, _frame: bytes) -> None:
        """Nothing."""

    def cycle(self, _entry: CycleEntry) -> None:
        """Nothing."""

    def event(self, _now_s: float, _event: str, _detail: str = "") -> None:
        """Nothing."""

    def report(self, _report: EvaderReport) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""
