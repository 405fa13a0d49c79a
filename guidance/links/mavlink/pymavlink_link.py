"""`VehicleLink` through pymavlink, over any wire. The MAVSDK link differs only in how it sends.

It listens to one vehicle on one wire. Messages of others are dropped and counted. A STATUSTEXT longer than 50 bytes
arrives in chunks; they are joined here.
"""

import contextlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from guidance import messages
from guidance.links.mavlink import codec
from guidance.links.mavlink.codec import DECODERS, decode, other_aircraft
from guidance.links.mavlink.frames import Fields, Frame, FrameReader, SigningKey, Station
from guidance.links.mavlink.requests import RequestQueue, TimesyncPeer
from guidance.links.port import Clock, Wire

USED: Final = frozenset(DECODERS) | {"STATUSTEXT", "TIMESYNC", "PARAM_VALUE"}
"""Names of the messages that a link reads."""

MESSAGE_QUEUE_LENGTH: Final = 2048

AIRCRAFT_PER_S: Final = 100
"""Positions of other systems per second that are read: a flood of them pushes no message of the vehicle out."""

_TEXT_CHUNK_BYTES: Final = 50
_TEXT_TIMEOUT_S: Final = 1.0
_LONGEST_TEXT: Final = 800
_REASONS: Final = (
    "foreign",
    "unsigned",
    "refused",
    "unsaved",
    "unsent",
    "received",
    "invalid",
    "for_others",
)
_COUNTED: Final = (*_REASONS, "overflowed", "requests_sent", "setpoints_sent")


def own_heartbeat() -> Fields:
    """Return the HEARTBEAT of an onboard controller (MAV_TYPE 18) that is no autopilot (8) and active (4)."""
    return mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


@dataclass(slots=True)
class TextJoiner:
    """Joins the chunks of long STATUSTEXTs. A lost chunk shows as an ellipsis."""

    open: messages.StatusText | None = None
    _message_id: int = 0
    _next_sequence: int = 0

    def hear(self, message: Fields, received_s: float) -> list[messages.StatusText]:
        """Add one STATUSTEXT; return the texts that are complete.

        A text with `id` 0 has one chunk. A chunk that is not full is the last one.
        """
        if message.id == self._message_id:
            done = []
        else:
            done = self.close()
        begun = self.open
        if begun is None:
            begun = messages.StatusText(received_s, message.severity, "")
        lost = message.id and message.chunk_seq != (self._next_sequence if self.open else 0)
        self.open = begun._replace(text=f"{begun.text}{'…' if lost else ''}{message.text}")
        self._message_id = message.id
        self._next_sequence = message.chunk_seq + 1
        is_last = message.id == 0 or len(message.text.encode()) < _TEXT_CHUNK_BYTES
        return done + self.close() if is_last or len(self.open.text) >= _LONGEST_TEXT else done

    def close(self, before_s: float = math.inf) -> list[messages.StatusText]:
        """Return the open text as it is, if it began before `before_s`; it is closed then."""
        if self.open is None or self.open.received_s >= before_s:
            return []
        closed = self.open
        self.open = None
        return [closed]


class PymavlinkLink:
    """`VehicleLink` over a `Wire`. Nothing blocks, and all time comes from the given clock."""

    _reads: frozenset[str] = USED

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        *,
        system_id: int,
        component_id: int = 1,
        autopilot: int | None = None,
        own_system_id: int | None = None,
        own_component_id: int = 195,
        signing_key: SigningKey | None = None,
        unread: frozenset[str] = frozenset(),
    ) -> None:
        """Take over an open wire, which is closed with the link.

        Args:
            wire: Where the vehicle sends.
            clock: Time of setpoints, TIMESYNC and repeated requests.
            system_id: The vehicle's.
            component_id: Its autopilot's.
            autopilot: Its MAV_AUTOPILOT, which decides how parameters carry integers. By default that of the first
                HEARTBEAT of an autopilot; later ones never change it.
            own_system_id: Ours; None takes the vehicle's, as its companion computer.
            own_component_id: Ours. Messages addressed to other stations are dropped.
            signing_key: Sign our frames and refuse unsigned ones; None does neither.
            unread: Names of messages that are not read from this link; they are counted as unused.
        """
        self._wire = wire
        self._clock = clock
        self._own = own_system_id or system_id, own_component_id
        self._vehicle = system_id, component_id
        self._station = Station(wire, *self._own, signing_key=signing_key, clock=clock)
        self._frames = FrameReader(self._reads - unread)
        self._inbox: list[messages.Message] = []
        self._requests = RequestQueue()
        self._timesync = TimesyncPeer()
        self._texts = TextJoiner()
        self._closed = False
        self._aircraft_second = 0
        self._aircraft_heard = 0
        self.autopilot = autopilot
        self.heartbeats = 0
        self.others: set[int] = set()
        """System ids of other senders, named in an error."""
        self.counts: Counter[str] = Counter()
        self._start()

    def _start(self) -> None:
        """Prepare whatever else sends for this link."""

    @property
    def heard(self) -> bool:
        """True once a HEARTBEAT of the vehicle has arrived."""
        return self.heartbeats > 0

    def poll(self) -> None:
        """Read the wire as `receive` does, which returns the messages the next time."""
        self._inbox = [*self.receive()]

    def receive(self) -> Sequence[messages.Message]:
        """Read the wire and send due requests; return all messages of the vehicle since the last call, oldest first."""
        if self._closed:
            return []
        check = self._station.check
        for received_s, data in self._wire.receive():
            for frame in self._frames.read(data):
                if frame[1:3] != self._vehicle:
                    # A position of another system is an aircraft's, unless frames are signed.
                    self.counts["foreign"] += 1
                    self.others.add(frame.system_id)
                    known = frame.system_id == self._vehicle[0] or self._station.check is not None
                    if frame.name == "GLOBAL_POSITION_INT" and not known:
                        if int(received_s) != self._aircraft_second:
                            self._aircraft_second = int(received_s)
                            self._aircraft_heard = 0
                        self._aircraft_heard += 1
                        if self._aircraft_heard > AIRCRAFT_PER_S:
                            self.counts["aircraft_dropped"] += 1
                        else:
                            with contextlib.suppress(ValueError):
                                self._inbox.append(other_aircraft(frame, received_s))
                elif check is not None and (problem := check.problem(frame)) is not None:
                    self.counts[problem] += 1
                else:
                    self.counts["received"] += 1
                    try:
                        self.hear(frame, received_s)
                    except (KeyError, TypeError, ValueError, ArithmeticError):
                        self.counts["invalid"] += 1
        self._tend(self._clock())
        if (overflowed := len(self._inbox) - MESSAGE_QUEUE_LENGTH) > 0:
            del self._inbox[:overflowed]
            self.counts["overflowed"] += overflowed
        received = self._inbox
        self._inbox = []
        return received

    def hear(self, frame: Frame, received_s: float) -> None:
        """Take one used message of the vehicle.

        Raises:
            KeyError, TypeError, ValueError, ArithmeticError: If its values are implausible.
        """
        name = frame.name
        fields = frame.fields
        system_id, component_id = self._own
        if (
            getattr(fields, "target_system", 0) not in (0, system_id)
            or getattr(fields, "target_component", 0)
            not in (0, component_id)  # 0: addressed to all
        ):
            self.counts["for_others"] += 1
        elif name == "STATUSTEXT":
            self._inbox.extend(self._texts.hear(fields, received_s))
        elif name == "TIMESYNC":
            answer, reply = self._timesync.hear(fields, received_s)
            if answer is not None:
                self._inbox.append(answer)
            if reply is not None:
                self._send(reply)
        else:
            value = decode(frame, fields, received_s, self.autopilot)
            self._inbox.append(value)
            if isinstance(value, messages.Heartbeat):
                self.heartbeats += 1
                if self.autopilot is None and value.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                    self.autopilot = value.autopilot
            elif self._requests.waiting:
                self._requests.hear(value)

    def _tend(self, now_s: float) -> None:
        """Send unanswered requests again, and our TIMESYNC once a HEARTBEAT has arrived."""
        if self._texts.open:
            self._inbox.extend(self._texts.close(now_s - _TEXT_TIMEOUT_S))
        for request, attempt in self._requests.due(now_s) if self._requests.waiting else ():
            self._send(
                codec.request(request, attempt=attempt, to=self._vehicle, autopilot=self.autopilot)
            )
            self.counts["requests_sent"] += 1
        if self.heartbeats and now_s >= self._timesync.next_ask_s:
            self._send(self._timesync.ask(now_s))

    def request(self, request: messages.Request) -> None:
        """Send a command once, or a repeatable request until it is answered.

        Raises:
            ValueError: If it cannot be encoded.
        """
        if self._closed:
            return
        codec.request(request, attempt=0, to=self._vehicle, autopilot=self.autopilot)
        self._requests.add(request)
        self._tend(self._clock())

    def send_setpoint(self, setpoint: messages.Setpoint) -> None:
        """Send one setpoint frame now.

        Raises:
            ValueError: If it is not finite; it is not sent then.
        """
        if not self._closed:
            self._send(codec.setpoint(setpoint, now_s=self._clock(), to=self._vehicle))
            self.counts["setpoints_sent"] += 1

    def send_heartbeat(self) -> None:
        """Send our own HEARTBEAT once."""
        if not self._closed:
            self._send(own_heartbeat())

    def _send(self, message: Fields) -> None:
        self._station.send(message)

    def counters(self) -> Mapping[str, int]:
        """Return how many messages were received, sent and dropped, by reason."""
        check = self._station.check
        return {
            **dict.fromkeys(_COUNTED, 0),
            **self.counts,
            "used_unsaved": 0 if check is None else check.unsaved,
            "impostors": self._wire.impostors_of(self._vehicle[0]),
            "garbage_bytes": self._frames.garbage_bytes,
            "unknown": self._frames.unknown,
            "unused": self._frames.unused,
            "requests_unanswered": self._requests.unanswered,
            "requests_refused": self._requests.refused,
            **self._wire.counters(),
        }

    def close(self) -> None:
        """Close the wire and end receiving and sending. May be called twice."""
        self._closed = True
        self._inbox.clear()
        self._wire.close()
