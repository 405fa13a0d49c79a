"""TIMESYNC both ways: the other side's questions are answered, and ours are asked once a second.

Times are our injected clock in nanoseconds. An answer counts only if it mirrors a time that we sent, so that the
answers to other companions on the link are left alone.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

from guidance.links.codec import Fields
from guidance.messages import Timesync

ASK_EVERY_S: Final = 1.0


def _nanoseconds(now_s: float) -> int:
    return round(now_s * 1e9)


@dataclass(slots=True)
class TimesyncPeer:
    """Our side of the exchange: the last few times we asked with."""

    asked_ns: deque[int] = field(default_factory=lambda: deque(maxlen=8))
    next_ask_s: float = float("-inf")

    def hear(self, fields: Fields, received_s: float) -> tuple[Timesync | None, dict[str, Any] | None]:
        """(an answer to us, or None; the fields to answer with, or None)."""
        tc1, ts1 = fields["tc1"], fields["ts1"]
        if tc1 == 0:
            return None, {"tc1": _nanoseconds(received_s), "ts1": ts1}
        if ts1 in self.asked_ns:
            self.asked_ns.remove(ts1)
            return Timesync(received_s, remote_ns=tc1, local_ns=ts1), None
        return None, None

    def ask(self, now_s: float) -> dict[str, Any] | None:
        """The fields of a question, if one is due. A question at time 0 would read as a reply, so it is never 0."""
        if now_s < self.next_ask_s:
            return None
        self.next_ask_s = now_s + ASK_EVERY_S
        self.asked_ns.append(_nanoseconds(now_s) or 1)
        return {"tc1": 0, "ts1": self.asked_ns[-1]}
