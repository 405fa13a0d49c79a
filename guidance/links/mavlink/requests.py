"""Requests in flight and their answers; TIMESYNC in both directions.

Requests that are safe to repeat are sent up to four times, half a second apart, until they are answered.

A command that acts on the vehicle (a mode, arming, take-off) is sent once. Its acknowledgement may have been lost and a
pilot may have taken over since, so a blind repeat could take the vehicle back. To repeat it, look at a HEARTBEAT first.

A COMMAND_ACK names only the command's number, so one request per number is in flight. Stream and message requests
queue; any other command replaces its predecessor at once.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from guidance import messages
from guidance.links.mavlink.frames import Fields
from guidance.messages import (
    Command,
    FenceReceived,
    FenceRequest,
    ParameterRequest,
    ParameterSet,
    Request,
    Timesync,
)

_REPEAT_S: Final = 0.5
MAX_SENDS: Final = 4
IN_PROGRESS_TIMEOUT_S: Final = 10.0
_QUEUE_LENGTH: Final = 64
_REPEATABLE: Final = frozenset({511, 512})  # SET_MESSAGE_INTERVAL, REQUEST_MESSAGE

_TIMESYNC_EVERY_S: Final = 0.25
"""Often enough to notice a growing delay of the vehicle before a position is a second old."""

RequestKey = tuple[type[Request], int | str | None]
"""Matches an answer to its request: a command's number or a parameter's name. The fence is read in steps."""


def is_repeatable(request: Request) -> bool:
    """Return whether a repeat is harmless: read or set parameters, the fence, streams and messages."""
    return (
        request.command in _REPEATABLE
        if isinstance(request, Command)
        else not isinstance(request, FenceReceived)
    )


@dataclass(slots=True)
class _Pending:
    request: Request
    max_sends: int
    sends: int = 0
    next_send_s: float = float("-inf")


@dataclass(slots=True)
class RequestQueue:
    """Requests that wait for an answer. The caller passes the time."""

    waiting: dict[RequestKey, deque[_Pending]] = field(default_factory=dict)
    unanswered: int = 0
    refused: int = 0

    def add(self, request: Request) -> None:
        """Add a request. It is due at once, or after those of its key. A request that already waits is not added."""
        named = None if isinstance(request, FenceRequest | FenceReceived) else request[0]
        lane = self.waiting.setdefault((type(request), named), deque())
        if not isinstance(request, Command) or not is_repeatable(request):
            lane.clear()
        elif any(waiting.request == request for waiting in lane):
            return
        if len(lane) >= _QUEUE_LENGTH:
            self.refused += 1
            return
        lane.append(_Pending(request, MAX_SENDS if is_repeatable(request) else 1))

    def due(self, now_s: float) -> Iterator[tuple[Request, int]]:
        """Yield (request, attempt counted from 0) for all that must be sent now; drop those never answered."""
        for key, lane in list(self.waiting.items()):
            while lane and lane[0].sends >= lane[0].max_sends and now_s >= lane[0].next_send_s:
                # Has no answer
                self.unanswered += not isinstance(lane.popleft().request, FenceReceived)
            if not lane:
                del self.waiting[key]
            elif now_s >= (pending := lane[0]).next_send_s:
                yield pending.request, pending.sends
                pending.sends += 1
                pending.next_send_s = now_s + _REPEAT_S

    def hear(self, message: messages.Message) -> None:
        """Note a message of the vehicle, which may answer a request."""
        match message:
            case messages.CommandAck(now_s, command, result):
                lane = self.waiting.get((Command, command))
                # Wait without repeats
                if lane and lane[0].sends > 0 and result == mavlink.MAV_RESULT_IN_PROGRESS:
                    lane[0].sends = lane[0].max_sends
                    lane[0].next_send_s = now_s + IN_PROGRESS_TIMEOUT_S
                elif lane and lane[0].sends > 0:  # every other result is final
                    lane.popleft()
            case messages.Parameter(name=name):
                self.waiting.pop((ParameterRequest, name), None)
                self.waiting.pop((ParameterSet, name), None)
            case messages.FenceRefused():
                self.waiting.pop((FenceRequest, None), None)
            case messages.FenceCount() | messages.FenceItem():
                answered = FenceRequest(
                    message.sequence if isinstance(message, messages.FenceItem) else None
                )
                lane = self.waiting.get((FenceRequest, None))
                if lane and lane[0].request == answered:
                    lane.clear()


@dataclass(slots=True)
class TimesyncPeer:
    """TIMESYNC: answers the other side's questions, and asks our own.

    Times are our injected clock in nanoseconds. An answer counts only if it repeats one of our last few questions;
    answers to other companions on the link are ignored.

    Args:
        every_s: Time between two of our questions.
    """

    every_s: float = _TIMESYNC_EVERY_S
    asked_ns: deque[int] = field(default_factory=lambda: deque(maxlen=8))
    next_ask_s: float = float("-inf")

    def hear(self, message: Fields, received_s: float) -> tuple[Timesync | None, Fields | None]:
        """Return an answer to our question or None, and the reply to theirs or None."""
        if message.tc1 == 0:
            return None, mavlink.MAVLink_timesync_message(round(received_s * 1e9), message.ts1)
        if message.ts1 in self.asked_ns:
            self.asked_ns.remove(message.ts1)
            return Timesync(received_s, remote_ns=message.tc1, local_ns=message.ts1), None
        return None, None

    def ask(self, now_s: float) -> Fields:
        """Return a question; the next is due at `next_ask_s`. Its time is never 0, which would mark an answer."""
        self.next_ask_s = now_s + self.every_s
        self.asked_ns.append(round(now_s * 1e9) or 1)
        return mavlink.MAVLink_timesync_message(0, self.asked_ns[-1])
