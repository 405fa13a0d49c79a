"""Which messages under a key are the vehicle's own: those of one stream, an epoch with rising numbers.

A message of another epoch, or one whose number does not continue the stream, is refused. It begins a rival stream,
which takes over once the stream has been silent and the rival is steady itself: the vehicle has restarted, or the first
message was forged.

Two senders under one key show when both streams continue, or when one number has two contents. Either of them may be
the vehicle, so no message under the key is used until only one has been heard for a while.
"""

from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Final

TAKES_OVER_S: Final = 1.0
"""Another stream may take the place of one that is silent for so long."""

STEADY: Final = 3
"""So many messages one after another make a stream steady."""

_GAP_S: Final = 0.6
"""Longest time between two of them. Messages sent twice per second pass; single late messages are no stream."""

MOST_EPOCHS: Final = 16
"""Ended epochs that are remembered, and refused."""

TWO_SENDERS: Final = "two senders"
"""Why a message is refused while two senders use its key."""

ALONE_AFTER_S: Final = 3.0
"""A key is used again when only one sender has been heard for so long."""

_NUMBERS: Final = 20
_NUMBERS_PER_S: Final = 40.0
"""Numbers that a stream may skip, and for each second of silence so many more: four times the vehicles' rate."""

_REMEMBERED: Final = 64
"""Messages whose content is remembered: more than a late repetition is late."""


@dataclass(slots=True)
class Stream:
    """Messages of one epoch: the last number, when the first and the last one arrived, and how many came."""

    epoch: int
    number: int
    begun_s: float
    heard_s: float
    messages: int = 1

    def continues(self, now_s: float, epoch: int, number: int) -> bool:
        """True if a message is the next one, or one of the next."""
        largest_number = self.number + _NUMBERS + _NUMBERS_PER_S * max(0.0, now_s - self.heard_s)
        return epoch == self.epoch and self.number < number <= largest_number

    def add(self, now_s: float, number: int) -> None:
        """Add such a message."""
        self.number = number
        self.heard_s = now_s
        self.messages += 1

    def is_heard(self, now_s: float) -> bool:
        """True if its last message is recent."""
        return now_s - self.heard_s < TAKES_OVER_S


@dataclass(slots=True)
class Sender:
    """The streams under one key.

    Attributes:
        current: The stream that is used.
        rival: Another one.
        ended: Epochs of streams that were replaced.
        disputed_s: When two senders were last heard.
    """

    current: Stream | None = None
    rival: Stream | None = None
    ended: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_EPOCHS))
    disputed_s: float = float("-inf")
    _contents: OrderedDict[int, int] = field(default_factory=OrderedDict)

    def is_disputed(self, now_s: float) -> bool:
        """True if two senders use the key."""
        return now_s - self.disputed_s < ALONE_AFTER_S

    def refuses(self, now_s: float, epoch: int, number: int, content: int) -> str:
        """Take a message, or return in a few words why it is refused; empty if it is taken.

        Args:
            now_s: When it arrived.
            epoch: Of its sender.
            number: In that epoch.
            content: Hash of its bytes, which detects a repetition.
        """
        reason = self._judge(now_s, epoch, number, content)
        # Both speak if the stream went on after a steady rival had begun, and both were heard just now.
        current = self.current
        rival = self.rival
        both_speak = (
            current is not None
            and rival is not None
            and rival.messages >= STEADY
            and current.is_heard(now_s)
            and rival.is_heard(now_s)
            and current.heard_s > rival.begun_s
        )
        if reason != "order" and both_speak:
            self.disputed_s = now_s
        return TWO_SENDERS if self.is_disputed(now_s) else reason

    def _judge(self, now_s: float, epoch: int, number: int, content: int) -> str:
        """Add a message to its stream; return why it is not one of the stream that is used."""
        current = self.current
        if current is None:
            self.current = Stream(epoch, number, now_s, now_s)
            self._remember(number, content)
            return ""
        if current.continues(now_s, epoch, number):
            current.add(now_s, number)
            self._remember(number, content)
            return ""
        if epoch in self.ended:
            return "epoch"
        if epoch == current.epoch and number in self._contents:
            if self._contents[number] != content:
                self.disputed_s = now_s
            return "order"
        return self._rivals(now_s, epoch, number)

    def _remember(self, number: int, content: int) -> None:
        self._contents[number] = content
        if len(self._contents) > _REMEMBERED:
            self._contents.popitem(last=False)

    def _rivals(self, now_s: float, epoch: int, number: int) -> str:
        """Take a message of another stream if that one takes over."""
        current = self.current
        rival = self.rival
        goes_on = rival is not None and now_s - rival.heard_s <= _GAP_S
        if rival is not None and goes_on and rival.continues(now_s, epoch, number):
            rival.add(now_s, number)
        else:
            rival = Stream(epoch, number, now_s, now_s)
            self.rival = rival
        if current is not None and (current.is_heard(now_s) or rival.messages < STEADY):
            if epoch != current.epoch:
                return "epoch"
            is_late = current.number - _NUMBERS <= number <= current.number
            return "order" if is_late else "step"
        if current is not None and epoch != current.epoch:
            self.ended.append(current.epoch)
        self.current = rival
        self.rival = None
        self._contents.clear()
        return ""
