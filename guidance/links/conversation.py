"""What every link does whatever its library: frame, decode, join, answer, ask again, count.

One wire is heard and one vehicle on it; everybody else is dropped and counted. The links add little: one signs
with a key and sends our HEARTBEAT, the other lets MAVSDK send that and what we ask.
"""

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from guidance.links import encode
from guidance.links.arrivals import Clock
from guidance.links.decode import DECODERS, Fields, OpenText, decode, expire_text, join_text, parameter
from guidance.links.encode import Station
from guidance.links.framing import CRC_EXTRA, IDS, NAMES, Frame, Framer, fields_of
from guidance.links.port import Wire
from guidance.links.requests import RequestQueue, TimesyncPeer
from guidance.messages import CommandAck, FenceCount, FenceItem, FenceRefused, Heartbeat, Message, Request, Setpoint
from guidance.vehicle import is_plausible

Admit = Callable[[Frame], str | None]
"""Sees each of the vehicle's frames first; a word says why one is not heard, and is counted."""

HEARD: Final = frozenset(DECODERS) | {"STATUSTEXT", "TIMESYNC", "PARAM_VALUE"}
_HEARD_IDS: Final = frozenset(IDS[name] for name in HEARD)
MOST_KEPT: Final = 2048


class Address(NamedTuple):
    """Who speaks, as MAVLink says it."""

    system_id: int
    component_id: int


class Conversation:
    """One vehicle's messages, in order of arrival, bounded; our requests to it, repeated until answered.

    It is a `VehicleLink` but for its own HEARTBEAT, and its methods are documented there.
    """

    def __init__(
        self, wire: Wire, clock: Clock, station: Station, admit: Admit | None, *, vehicle: Address, own: Address
    ) -> None:
        """Take over a wire, which is closed with the link.

        Args:
            wire: Where the vehicle and others speak.
            clock: By which time passes; its time alone.
            station: Makes our frames: numbered, and signed where there is a key.
            admit: What the vehicle's frames pass first; None lets all of them through.
            vehicle: Who is heard.
            own: Who we are: what is addressed to another station is not for us.
        """
        self._wire = wire
        self._clock = clock
        self._station = station
        self._admit = admit
        self._vehicle = vehicle
        self._to_vehicle = vehicle._asdict()
        self._own = own
        self._framer = Framer(CRC_EXTRA)
        self._inbox: deque[Message] = deque()
        self._requests = RequestQueue()
        self._timesync = TimesyncPeer()
        self._open_text: OpenText | None = None
        self._closed = False
        self.autopilot = 0
        self.heartbeats = 0
        self.others: set[int] = set()
        """System ids of whoever else speaks, to name them in an error."""
        self.counts: Counter[str] = Counter()

    @property
    def heard(self) -> bool:
        """Whether a HEARTBEAT of the vehicle was heard."""
        return self.heartbeats > 0

    def receive(self) -> Sequence[Message]:
        """All messages of the vehicle since the last call, oldest first."""
        self.poll()
        messages = list(self._inbox)
        self._inbox.clear()
        return messages

    def wait(self, timeout_s: float) -> None:
        """Wait until something has arrived, at most this long in real time."""
        if not self._inbox and not self._closed:
            self._wire.wait(timeout_s)

    def poll(self) -> None:
        """Read the wire and keep what comes for the next `receive`; send what is due."""
        if self._closed:
            return
        for received_s, data in self._wire.receive():
            for frame in self._framer.feed(data, stream=self._wire.stream):
                self._take_in(frame, received_s)
        self._tend(self._clock())
        while len(self._inbox) > MOST_KEPT:
            self._inbox.popleft()
            self.counts["overflowed"] += 1

    def _take_in(self, frame: Frame, received_s: float) -> None:
        if (frame.system_id, frame.component_id) != self._vehicle:
            self.counts["foreign"] += 1
            self.others.add(frame.system_id)
        elif self._admit is not None and (reason := self._admit(frame)) is not None:
            self.counts[reason] += 1
        elif frame.message_id not in _HEARD_IDS:
            self.counts["unused"] += 1
        else:
            self.counts["received"] += 1
            try:
                self.hear(NAMES[frame.message_id], fields_of(frame), received_s)
            except (KeyError, TypeError, ValueError, ArithmeticError):
                self.counts["invalid"] += 1

    def hear(self, name: str, fields: Fields, received_s: float) -> None:
        """Take one message of the vehicle.

        Raises:
            KeyError, TypeError, ValueError, ArithmeticError: If it cannot be meant.
        """
        if "target_system" in fields and not self._is_for_us(fields):
            self.counts["for_others"] += 1
        elif name == "STATUSTEXT":
            self._open_text, texts = join_text(self._open_text, fields, received_s)
            self._inbox.extend(texts)
        elif name == "TIMESYNC":
            answer, reply = self._timesync.hear(fields, received_s)
            if answer is not None:
                self._inbox.append(answer)
            if reply is not None:
                self._send("TIMESYNC", reply)
        elif name == "PARAM_VALUE":
            value = parameter(fields, received_s, autopilot=self.autopilot)
            self._requests.parameter_came(value.name)
            if not is_plausible(value):
                raise ValueError(f"{value}: cannot be meant")
            self._inbox.append(value)
        else:
            message = decode(name, fields, received_s)
            self._note(message)
            self._inbox.append(message)

    def _is_for_us(self, fields: Fields) -> bool:
        """A message with target fields (COMMAND_ACK) may answer another station; 0 addresses all."""
        system_id, component_id = fields["target_system"], fields.get("target_component", 0)
        return system_id in (0, self._own[0]) and component_id in (0, self._own[1])

    def _note(self, message: Message) -> None:
        """Note who speaks, and what is answered."""
        if isinstance(message, Heartbeat):
            self.autopilot = message.autopilot
            self.heartbeats += 1
        elif isinstance(message, CommandAck):
            self._requests.acknowledged(message.command, message.result, message.received_s)
        elif isinstance(message, FenceCount | FenceItem):
            self._requests.fence_came(message.sequence if isinstance(message, FenceItem) else None)
        elif isinstance(message, FenceRefused):
            self._requests.fence_refused()

    def _tend(self, now_s: float) -> None:
        """Send what is due: requests not answered yet, and our TIMESYNC question once the vehicle was heard."""
        if self._open_text is not None:
            self._open_text, texts = expire_text(self._open_text, now_s)
            self._inbox.extend(texts)
        for request, attempt in self._requests.due(now_s) if self._requests.waiting else ():
            self._send(*encode.request(request, attempt=attempt, autopilot=self.autopilot, **self._to_vehicle))
            self.counts["requests_sent"] += 1
        if self.heartbeats and now_s >= self._timesync.next_ask_s:
            self._send("TIMESYNC", self._timesync.ask(now_s))

    def request(self, request: Request) -> None:
        """Send a command, once, or a question, which is repeated from `receive` until it is answered.

        Raises:
            ValueError: If it cannot be sent as it is.
        """
        if self._closed:
            return
        encode.request(request, attempt=0, autopilot=self.autopilot, **self._to_vehicle)
        self._requests.add(request)
        self._tend(self._clock())

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Put one setpoint frame on the wire, now.

        Raises:
            ValueError: If it is not finite; nothing is sent then.
        """
        if not self._closed:
            self._send(*encode.setpoint(setpoint, now_s=self._clock(), **self._to_vehicle))
            self.counts["setpoints_sent"] += 1

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        self._wire.send(self._station.pack(name, fields))

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped, and why."""
        reasons = ("foreign", "unused", "unsigned", "refused", "unsent", "received", "invalid", "for_others")
        return {
            **dict.fromkeys((*reasons, "overflowed", "requests_sent", "setpoints_sent"), 0),
            **self.counts,
            "garbage_bytes": self._framer.garbage_bytes,
            "unknown": self._framer.unknown,
            "requests_unanswered": self._requests.unanswered,
            "requests_refused": self._requests.refused,
            **self._wire.counters(),
        }

    def close(self) -> None:
        """Close the wire; nothing is heard or sent any more. May be called twice."""
        self._closed = True
        self._inbox.clear()
        self._wire.close()
