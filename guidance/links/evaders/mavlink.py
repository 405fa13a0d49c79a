"""Reports of an evader from the MAVLink messages of one system, on request if needed.

TIMESYNC reads the evader's clock four times a second, so the age of a report is measured. Its answer is
attached to the next report if the report's own time agrees with it: some messages carry another clock than TIMESYNC.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from guidance.links.evaders.carriers import Carrier, accepted
from guidance.links.mavlink import codec
from guidance.links.mavlink.frames import Frame, FrameReader, SigningKey, Station
from guidance.links.mavlink.pymavlink_link import own_heartbeat
from guidance.links.mavlink.requests import RequestQueue, TimesyncPeer
from guidance.links.port import Clock, Wire
from guidance.messages import Command, CommandAck, EvaderReport, Timesync

OWN_COMPONENT_ID: Final = 195
GROUND_STATION_ID: Final = 255
"""Our system id if we ask for reports. The evader's own id would mean a part of the evader."""

HEARTBEAT_S: Final = 1.0
RATE_AGAIN_S: Final = 3.0
"""Ask for reports after this time without one: the evader may have restarted. Not more often once it has acknowledged,
since an autopilot may begin its interval again with each request."""

_TIMESYNC_EVERY_S: Final = 1.0
"""The evader's clock is only compared with ours, so a growing delay need not be noticed within a second."""

_TOLD_AFTER_S: Final = 1.5
"""Other systems are named if they send for so long and the evader never reported."""

_MOST_OTHERS: Final = 8

_CLOCKS_AGREE_S: Final = 0.1
_MAX_DELAY_S: Final = 5.0


@dataclass(eq=False)
class MavlinkEvader:
    """`EvaderSource` over a wire. Only one system id is accepted, even after it has fallen silent.

    Args:
        wire: Closed with the source.
        carrier: The message that reports, and how it is read.
        system_id: The evader's.
        component_id: The evader's; None accepts any.
        clock: For TIMESYNC; None sends nothing.
        signing_key: Accept only frames signed with it, and sign ours; None does neither.
        request_rate_hz: Ask the evader for reports at this rate; None waits for them. Needs the clock.
    """

    wire: Wire
    carrier: Carrier
    _: KW_ONLY
    system_id: int
    component_id: int | None = None
    clock: Clock | None = None
    signing_key: SigningKey | None = None
    request_rate_hz: float | None = None

    def __post_init__(self) -> None:
        """Begin with nothing heard."""
        names = [self.carrier.message, "TIMESYNC"]
        our_system_id = self.system_id
        if self.request_rate_hz is not None:
            names += ["COMMAND_ACK", "HEARTBEAT"]
            our_system_id = GROUND_STATION_ID
        self._frames = FrameReader(names)
        self._station = Station(
            self.wire,
            our_system_id,
            OWN_COMPONENT_ID,
            signing_key=self.signing_key,
            clock=self.clock,
        )
        autopilot_id = 1
        self._asked_component_id = autopilot_id if self.component_id is None else self.component_id
        self._timesync = TimesyncPeer(_TIMESYNC_EVERY_S)
        self._answer: Timesync | None = None
        self._sent_s: float | None = None
        self._requests = RequestQueue()
        self._asked_s = -math.inf
        self._beat_s = -math.inf
        self._impostors = 0
        self._others: dict[tuple[int, int], None] = {}
        self._others_since_s: float | None = None
        self._heard_s = -math.inf
        self._counts: Counter[str] = Counter()

    def receive(self) -> Sequence[EvaderReport]:
        """Return all reports since the last call, in order of arrival."""
        reports = []
        for data in self.wire.impostors():
            frame = self._frames.first(data)
            if frame is None or frame.name != self.carrier.message:
                continue
            if self._is_meant(frame):
                self._impostors += 1
        for received_s, data in self.wire.receive():
            self._heard_s = received_s
            for frame in self._frames.read(data):
                if frame.name == "HEARTBEAT":
                    # An evader that reports on request may not report yet: remember the systems that are there instead.
                    if frame.system_id == self.system_id:
                        self._others.clear()
                        self._others_since_s = None
                    else:
                        self._note_other(frame, received_s)
                elif self._is_meant(frame):
                    reports += self._read(frame, received_s)
                elif not self._counts["reports"] and frame.name == self.carrier.message:
                    self._note_other(frame, received_s)
        if self.clock is not None:
            self._ask(self.clock(), reported=bool(reports))
        return reports

    def _ask(self, now_s: float, *, reported: bool) -> None:
        """Ask for the evader's clock once it has reported, and for its reports as long as none arrives."""
        if self._counts["reports"] and now_s >= self._timesync.next_ask_s:
            self._station.send(self._timesync.ask(now_s))
        if self.request_rate_hz is None:
            return
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            self._station.send(own_heartbeat())
        if reported:
            self._asked_s = now_s
        elif now_s - self._asked_s >= RATE_AGAIN_S:
            self._asked_s = now_s
            message_id = float(getattr(mavlink, f"MAVLINK_MSG_ID_{self.carrier.message}"))
            params = (message_id, 1e6 / self.request_rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)
            self._requests.add(Command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, params))
        for request, attempt in self._requests.due(now_s):
            self._station.send(
                codec.request(
                    request, attempt=attempt, to=(self.system_id, self._asked_component_id)
                )
            )
            self._counts["requests_sent"] += 1

    def _is_meant(self, frame: Frame) -> bool:
        """Return whether a frame is the evader's, validly signed if there is a key."""
        check = self._station.check
        problem = None
        if frame.system_id != self.system_id or self.component_id not in {
            None,
            frame.component_id,
        }:
            problem = "foreign"
        elif check is not None:
            problem = check.problem(frame)
        # The vehicle's arrive on a shared wire
        if problem is not None and frame.name != "COMMAND_ACK":
            self._counts[problem] += 1
        return problem is None

    def _note_other(self, frame: Frame, received_s: float) -> None:
        """Remember a system that sends instead of the evader."""
        if frame.system_id == self.system_id and self.component_id in {None, frame.component_id}:
            return  # wrongly signed
        if self._others_since_s is None:
            self._others_since_s = received_s
        if len(self._others) < _MOST_OTHERS:
            self._others[frame.system_id, frame.component_id] = None

    def problem(self) -> str:
        """Name the systems that are heard instead of the evader, if it never reported."""
        since_s = self._others_since_s
        if self._counts["reports"] or since_s is None or self._heard_s - since_s < _TOLD_AFTER_S:
            return ""
        wanted = f"system {self.system_id}"
        if self.component_id is not None:
            wanted += f", component {self.component_id}"
        heard = ", ".join(
            f"system {system_id}, component {component_id}"
            for system_id, component_id in sorted(self._others)
        )
        return (
            f"{self.carrier.message} of {wanted} is not heard. Heard: {heard}; see evader.system_id"
        )

    def _read(self, frame: Frame, received_s: float) -> list[EvaderReport]:
        fields = frame.fields
        if frame.name == "TIMESYNC":
            answer, reply = self._timesync.hear(fields, received_s)
            if answer is not None:
                self._answer = answer
            if reply is not None and self.request_rate_hz is not None:
                self._station.send(reply)
            return []
        if frame.name == "COMMAND_ACK":
            to_us = fields.target_system in {0, GROUND_STATION_ID}
            to_our_component = fields.target_component in {0, OWN_COMPONENT_ID}
            from_asked = frame.component_id == self._asked_component_id
            if to_us and to_our_component and from_asked:
                self._requests.hear(CommandAck(received_s, fields.command, fields.result))
            return []
        report = accepted(self._counts, self.carrier.report, fields, received_s)
        if report is None:
            return []
        impostors = self._impostors
        self._impostors = 0
        # The clock reading nearest to the last one, so that a late report stays before a wrap.
        sent_s = report.sent_s
        if not math.isnan(sent_s):
            if self._sent_s is not None:
                period_s = self.carrier.period_s
                sent_s += period_s * round((self._sent_s - sent_s) / period_s)
            self._sent_s = sent_s
        report = report._replace(
            sent_s=sent_s,
            sequence=frame.sequence,
            impostors=impostors if impostors > 0 else None,
        )
        answer = self._answer
        self._answer = None
        if answer is None:
            return [report]
        ours_s = 0.5 * (answer.local_ns / 1e9 + answer.received_s)
        theirs_less_ours_s = answer.remote_ns / 1e9 - ours_s
        delay_s = report.received_s - (report.sent_s - theirs_less_ours_s)
        if not -_CLOCKS_AGREE_S < delay_s < _MAX_DELAY_S:
            self._counts["clock_disagrees"] += 1
            return [report]
        self._counts["clock_answers"] += 1
        return [report._replace(timesync=answer)]

    def counters(self) -> Mapping[str, int]:
        """Return the number of reports, of refused ones by reason, and the wire's counts."""
        return {
            "reports": 0,
            "foreign": 0,
            "garbage_bytes": self._frames.garbage_bytes,
            **self._counts,
            **self.wire.counters(),
        }

    def close(self) -> None:
        """Close the wire."""
        self.wire.close()
