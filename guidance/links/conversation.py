"""What every link does whatever its library: decode, join, answer, ask again, count. No wire and no thread in here.

A link feeds the messages it heard to `hear`, calls `tend` once per poll, and hands out what `take` returns; frames to
be sent leave through the `send` function it gave.
"""

from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from guidance.links import encode
from guidance.links.decode import DECODERS, Fields, OpenText, decode, expire_text, join_text, meant, parameter
from guidance.links.requests import RequestQueue, TimesyncPeer
from guidance.messages import CommandAck, FenceCount, FenceItem, FenceRefused, Heartbeat, Message, Request, Setpoint

Send = Callable[[str, dict[str, Any]], None]

HEARD: Final = frozenset(DECODERS) | {"STATUSTEXT", "TIMESYNC", "PARAM_VALUE"}
MOST_KEPT: Final = 2048


class Conversation:
    """One vehicle's messages, in order of arrival, bounded; our requests to it, repeated until answered."""

    def __init__(self, send: Send, *, system_id: int, component_id: int, own: tuple[int, int]) -> None:
        self._send = send
        self._target = {"system_id": system_id, "component_id": component_id}
        self._own = own
        self._inbox: deque[Message] = deque()
        self._requests = RequestQueue()
        self._timesync = TimesyncPeer()
        self._open_text: OpenText | None = None
        self.autopilot = 0
        self.heartbeats = 0
        self.counts: Counter[str] = Counter()

    def hear(self, name: str, fields: Fields, received_s: float) -> None:
        """Take one message of the vehicle; what cannot be meant is counted as invalid and dropped."""
        self.counts["received"] += 1
        try:
            self._interpret(name, fields, received_s)
        except (KeyError, TypeError, ValueError, ArithmeticError):
            self.counts["invalid"] += 1

    def _interpret(self, name: str, fields: Fields, received_s: float) -> None:
        if not self._is_for_us(fields):
            self.counts["for_others"] += 1
        elif name == "STATUSTEXT":
            self._open_text, texts = join_text(self._open_text, fields, received_s)
            self._keep(*texts)
        elif name == "TIMESYNC":
            answer, reply = self._timesync.hear(fields, received_s)
            if answer is not None:
                self._keep(answer)
            if reply is not None:
                self._send("TIMESYNC", reply)
        elif name == "PARAM_VALUE":
            value = parameter(fields, received_s, autopilot=self.autopilot)
            self._requests.parameter_came(value.name)
            self._keep(meant(value))
        else:
            self._note(decode(name, fields, received_s))

    def _is_for_us(self, fields: Fields) -> bool:
        """A message with target fields (COMMAND_ACK) may answer another station; 0 addresses all."""
        system_id, component_id = fields.get("target_system", 0), fields.get("target_component", 0)
        return system_id in (0, self._own[0]) and component_id in (0, self._own[1])

    def _note(self, message: Message) -> None:
        if isinstance(message, Heartbeat):
            self.autopilot = message.autopilot
            self.heartbeats += 1
        elif isinstance(message, CommandAck):
            self._requests.acknowledged(message.command, message.result, message.received_s)
        elif isinstance(message, FenceCount | FenceItem):
            self._requests.fence_came(message.sequence if isinstance(message, FenceItem) else None)
        elif isinstance(message, FenceRefused):
            self._requests.fence_refused()
        self._keep(message)

    def _keep(self, *messages: Message) -> None:
        for message in messages:
            if len(self._inbox) >= MOST_KEPT:
                self._inbox.popleft()
                self.counts["overflowed"] += 1
            self._inbox.append(message)

    def tend(self, now_s: float) -> None:
        """Send what is due: requests not answered yet, and our TIMESYNC question once the vehicle was heard."""
        self._open_text, texts = expire_text(self._open_text, now_s)
        self._keep(*texts)
        for request, attempt in self._requests.due(now_s):
            self._send(*encode.request(request, attempt=attempt, autopilot=self.autopilot, **self._target))
            self.counts["requests_sent"] += 1
        if self.heartbeats and (question := self._timesync.ask(now_s)) is not None:
            self._send("TIMESYNC", question)

    def awaits_parameter(self, name: str) -> bool:
        """Whether we asked for it and have no answer yet."""
        return self._requests.awaits_parameter(name)

    def take(self) -> list[Message]:
        """All messages since the last call, oldest first."""
        messages = list(self._inbox)
        self._inbox.clear()
        return messages

    def request(self, request: Request, now_s: float) -> None:
        """Send a request now; what only asks is repeated until it is answered.

        Raises:
            ValueError: If it cannot be sent as it is.
        """
        encode.request(request, attempt=0, autopilot=self.autopilot, **self._target)
        self._requests.add(request)
        self.tend(now_s)

    def setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        """Send exactly one setpoint frame.

        Raises:
            ValueError: If it is not finite; nothing is sent then.
        """
        self._send(*encode.setpoint(setpoint, now_s=now_s, **self._target))
        self.counts["setpoints_sent"] += 1

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped."""
        return {
            "received": 0,
            "invalid": 0,
            "for_others": 0,
            "overflowed": 0,
            "requests_sent": 0,
            "setpoints_sent": 0,
            **self.counts,
            "requests_unanswered": self._requests.unanswered,
            "requests_refused": self._requests.refused,
        }
