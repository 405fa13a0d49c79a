"""Which messages under a key are the vehicle's own: those of one stream, an epoch with rising numbers.

The steady stream wins. A message of another epoch, or one whose number jumps, is refused while the stream goes on. It
begins a rival stream, which takes over once the stream has been silent and the rival is steady itself: the vehicle has
restarted, or the first message was forged.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

TAKES_OVER_S: Final = 1.0
"""Silence of a stream after which another one may take its place."""

STEADY: Final = 3
"""So many messages one after another make a stream steady."""

MOST_EPOCHS: Final = 16
"""Ended epochs that are remembered, and refused."""

_NUMBERS: Final = 20
_NUMBERS_PER_S: Final = 40.0
"""Numbers that a stream may skip, and for each second of silence so many more: four times of what vehicles send."""


@dataclass(slots=True)
class Stream:
    """Messages of one epoch: the last number, when it arrived, and how many came."""

    epoch: int
    number: int
    heard_s: float
    messages: int = 1

    def continues(self, now_s: float, epoch: int, number: int) -> bool:
        """Whether a message is the next one, or one of the next."""
        most = self.number + _NUMBERS + _NUMBERS_PER_S * max(0.0, now_s - self.heard_s)
        return epoch == self.epoch and self.number < number <= most

    def add(self, now_s: float, number: int) -> None:
        """Add such a message."""
        self.number = number
        self.heard_s = now_s
        self.messages += 1


@dataclass(slots=True)
class Sender:
    """The streams under one key."""

    current: Stream | None = None
    rival: Stream | None = None
    ended: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_EPOCHS))

    def refuses(self, now_s: float, epoch: int, number: int) -> str:
        """Take a message, or return in one word why it is refused; empty if it is taken.

        Args:
            now_s: When it arrived.
            epoch: Of its sender.
            number: In that epoch.
        """
        current = self.current
        if current is None:
            self.current = Stream(epoch, number, now_s)
            return ""
        if current.continues(now_s, epoch, number):
            current.add(now_s, number)
            return ""
        if epoch in self.ended:
            return "epoch"
        if epoch == current.epoch and current.number - _NUMBERS <= number <= current.number:
            return "order"
        return self._rivals(now_s, epoch, number)

    def _rivals(self, now_s: float, epoch: int, number: int) -> str:
        """Take a message of another stream if that one takes over."""
        current = self.current
        rival = self.rival
        if rival is not None and rival.continues(now_s, epoch, number):
            rival.add(now_s, number)
        else:
            rival = Stream(epoch, number, now_s)
            self.rival = rival
        silent = current is None or now_s - current.heard_s >= TAKES_OVER_S
        if not silent or rival.messages < STEADY:
            return "step" if current is not None and epoch == current.epoch else "epoch"
        if current is not None and epoch != current.epoch:
            self.ended.append(current.epoch)
        self.current = rival
        self.rival = None
        return ""
