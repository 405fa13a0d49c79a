"""Reports of an evader from MAVLink messages of one pinned system on a wire; everybody else is ignored.

An evader that answers TIMESYNC is asked once a second for its clock, so that the age of a report is measured and not
guessed. Its answer goes along with its next report, if the report's own time agrees with it: some messages carry
another clock than TIMESYNC does.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from pymavlink.dialects.v20 import common

from guidance.links.arrivals import Clock
from guidance.links.codec import Fields
from guidance.links.dialect import CRC_EXTRA, NAMES
from guidance.links.evaders.refusal import Refused
from guidance.links.framing import Frame, Framer
from guidance.links.port import Wire
from guidance.links.timesync import TimesyncPeer
from guidance.messages import EvaderReport, Timesync

OWN_COMPONENT_ID: Final = 195
_CLOCKS_AGREE_S: Final = 0.1
_LONGEST_DELAY_S: Final = 5.0


class Carrier(Protocol):
    """How one MAVLink message becomes a report. It may remember the sender's clock."""

    @property
    def message(self) -> str:
        """The message's name."""

    def report(self, fields: Fields, received_s: float) -> EvaderReport:
        """Turn fields into a report.

        Raises:
            Refused: If it must not be used.
        """


class MavlinkEvader:
    """`EvaderSource` over a wire. The system id is pinned: when it falls silent, nobody takes its place."""

    def __init__(
        self,
        wire: Wire,
        carrier: Carrier,
        *,
        system_id: int,
        component_id: int | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Take over a wire. `component_id` None hears any component; without a `clock` nothing is ever sent."""
        self._wire = wire
        self._carrier = carrier
        self._system_id = system_id
        self._component_id = component_id
        self._framer = Framer(CRC_EXTRA)
        self._mavlink = common.MAVLink(None, system_id, OWN_COMPONENT_ID)
        self._clock = clock
        self._timesync = TimesyncPeer()
        self._answer: Timesync | None = None
        self._counts: Counter[str] = Counter()

    def receive(self) -> Sequence[EvaderReport]:
        """All reports since the last call, in order of arrival."""
        reports = []
        for received_s, data in self._wire.receive():
            for frame in self._framer.feed(data, stream=self._wire.stream):
                if self._is_meant(frame):
                    reports += self._read(frame, received_s)
        if self._clock is not None and self._counts["reports"]:
            self._ask(self._clock())
        return reports

    def _ask(self, now_s: float) -> None:
        question = self._timesync.ask(now_s)
        if question is not None:
            self._wire.send(bytes(common.MAVLink_timesync_message(**question).pack(self._mavlink)))
            self._mavlink.seq = (self._mavlink.seq + 1) % 256

    def _is_meant(self, frame: Frame) -> bool:
        if NAMES[frame.message_id] not in (self._carrier.message, "TIMESYNC"):
            return False
        if frame.system_id == self._system_id and self._component_id in (None, frame.component_id):
            return True
        self._counts["foreign"] += 1
        return False

    def _read(self, frame: Frame, received_s: float) -> list[EvaderReport]:
        try:
            fields = self._mavlink.decode(bytearray(frame.data)).to_dict()
            if NAMES[frame.message_id] == "TIMESYNC":
                answer, _ = self._timesync.hear(fields, received_s)
                self._answer = answer or self._answer
                return []
            report = self._with_answer(self._carrier.report(fields, received_s))
        except Refused as refused:
            self._counts[f"refused_{refused.reason}"] += 1
            return []
        except (common.MAVError, ValueError, ArithmeticError):
            self._counts["refused_invalid"] += 1
            return []
        self._counts["reports"] += 1
        return [report]

    def _with_answer(self, report: EvaderReport) -> EvaderReport:
        answer, self._answer = self._answer, None
        if answer is None:
            return report
        theirs_less_ours_s = answer.remote_ns / 1e9 - 0.5 * (answer.local_ns / 1e9 + answer.received_s)
        delay_s = report.received_s - (report.sent_s - theirs_less_ours_s)
        if not -_CLOCKS_AGREE_S < delay_s < _LONGEST_DELAY_S:
            self._counts["clock_disagrees"] += 1
            return report
        self._counts["clock_answers"] += 1
        return report._replace(timesync=answer)

    def counters(self) -> Mapping[str, int]:
        """Reports, and what was refused, by reason."""
        return {"reports": 0, "foreign": 0, "garbage_bytes": self._framer.garbage_bytes, **self._counts}

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()
