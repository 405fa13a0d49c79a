"""What we ask and what answers it: requests in flight, and TIMESYNC.

Requests that only ask are repeated every half second, four times in all, until they are answered.

A command that acts on the vehicle (a mode, arming, take-off) is sent once: its acknowledgement may have been lost and a
pilot may have taken over since, and a blind repeat would take the vehicle back. Whoever wants it repeated has to look
at a HEARTBEAT first.

A COMMAND_ACK names only the command's number. So of one number there is one in flight at a time: stream and message
requests queue behind each other, while any other command takes the place of its predecessor at once.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from guidance.links.decode import Fields
from guidance.messages import Command, FenceReceived, FenceRequest, ParameterRequest, ParameterSet, Request, Timesync

REPEAT_S: Final = 0.5
MOST_SENDS: Final = 4
IN_PROGRESS_PATIENCE_S: Final = 10.0
MOST_QUEUED: Final = 64
MAV_RESULT_IN_PROGRESS: Final = 5
_ASKING: Final = frozenset({511, 512})  # SET_MESSAGE_INTERVAL, REQUEST_MESSAGE

TIMESYNC_EVERY_S: Final = 1.0

Key = tuple[str, int | str]


def key_of(request: Request) -> Key:
    """What an answer would name: the command's number, or the parameter's name."""
    match request:
        case ParameterRequest(name):
            return "parameter", name
        case ParameterSet(name):
            return "parameter set", name
        case FenceRequest():
            return "fence", 0  # one step at a time
        case FenceReceived():
            return "fence received", 0
    return "command", request.command


def only_asks(request: Request) -> bool:
    """Whether a repeat can do no harm: parameters, read or set, the fence, streams and messages."""
    if isinstance(request, Command):
        return request.command in _ASKING
    return not isinstance(request, FenceReceived)


@dataclass(slots=True)
class _Flight:
    request: Request
    most_sends: int
    sends: int = 0
    next_send_s: float = float("-inf")


@dataclass(slots=True)
class RequestQueue:
    """What waits for an answer. `due` yields what to put on the wire now; time is given, never read."""

    waiting: dict[Key, deque[_Flight]] = field(default_factory=dict)
    unanswered: int = 0
    refused: int = 0

    def add(self, request: Request) -> None:
        """Take a request; it is due at once, unless it has to queue. One that waits already is not queued twice."""
        lane = self.waiting.setdefault(key_of(request), deque())
        if not isinstance(request, Command) or not only_asks(request):
            lane.clear()
        elif any(waiting.request == request for waiting in lane):
            return  # it is on its way already
        if len(lane) >= MOST_QUEUED:
            self.refused += 1
            return
        lane.append(_Flight(request, MOST_SENDS if only_asks(request) else 1))

    def due(self, now_s: float) -> Iterator[tuple[Request, int]]:
        """Yield (request, attempt counted from 0) for all that must be sent now; drop what was never answered."""
        for key in list(self.waiting):
            lane = self.waiting[key]
            while lane and lane[0].sends >= lane[0].most_sends and now_s >= lane[0].next_send_s:
                self.unanswered += not isinstance(lane.popleft().request, FenceReceived)  # which nobody answers
            if not lane:
                del self.waiting[key]
                continue
            flight = lane[0]
            if now_s >= flight.next_send_s:
                yield flight.request, flight.sends
                flight.sends += 1
                flight.next_send_s = now_s + REPEAT_S

    def acknowledged(self, command: int, result: int, now_s: float) -> None:
        """A COMMAND_ACK came: in progress means wait and do not repeat, everything else is final."""
        lane = self.waiting.get(("command", command))
        if not lane or lane[0].sends == 0:
            return
        if result == MAV_RESULT_IN_PROGRESS:
            lane[0].sends = lane[0].most_sends
            lane[0].next_send_s = now_s + IN_PROGRESS_PATIENCE_S
            return
        lane.popleft()
        if not lane:
            del self.waiting["command", command]

    def fence_came(self, sequence: int | None) -> None:
        """A MISSION_COUNT (None) or a MISSION_ITEM_INT of the fence came."""
        lane = self.waiting.get(("fence", 0))
        if lane and lane[0].request == FenceRequest(sequence):
            del self.waiting["fence", 0]

    def fence_refused(self) -> None:
        """There is no fence to be had."""
        self.waiting.pop(("fence", 0), None)

    def parameter_came(self, name: str) -> None:
        """A PARAM_VALUE came."""
        self.waiting.pop(("parameter", name), None)
        self.waiting.pop(("parameter set", name), None)


def _nanoseconds(now_s: float) -> int:
    return round(now_s * 1e9)


@dataclass(slots=True)
class TimesyncPeer:
    """TIMESYNC both ways: the other side's questions are answered, and ours are asked once a second.

    Times are our injected clock in nanoseconds. An answer counts only if it mirrors one of the last few times that we
    sent, so that the answers to other companions on the link are left alone.
    """

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

    def ask(self, now_s: float) -> dict[str, Any]:
        """The fields of a question; the next is due at `next_ask_s`. At time 0 it would read as a reply: never 0."""
        self.next_ask_s = now_s + TIMESYNC_EVERY_S
        self.asked_ns.append(_nanoseconds(now_s) or 1)
        return {"tc1": 0, "ts1": self.asked_ns[-1]}
