"""Reports of a target from MAVLink messages of one pinned system on a wire; everybody else is ignored."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Protocol

from pymavlink.dialects.v20 import common

from guidance.links.codec import Fields
from guidance.links.dialect import CRC_EXTRA, NAMES
from guidance.links.framing import Frame, Framer
from guidance.links.port import Wire
from guidance.links.targets.refusal import Refused
from guidance.telemetry import TargetReport


class Carrier(Protocol):
    """How one MAVLink message becomes a report. It may remember the sender's clock."""

    @property
    def message(self) -> str:
        """The message's name."""

    def report(self, fields: Fields, received_s: float) -> TargetReport:
        """Turn fields into a report.

        Raises:
            Refused: If it must not be used.
        """


class MavlinkTarget:
    """`TargetSource` over a wire. The system id is pinned: when it falls silent, nobody takes its place."""

    def __init__(self, wire: Wire, carrier: Carrier, *, system_id: int, component_id: int | None = None) -> None:
        """Take over a wire; `component_id` None hears any component of the system."""
        self._wire = wire
        self._carrier = carrier
        self._system_id = system_id
        self._component_id = component_id
        self._framer = Framer(CRC_EXTRA)
        self._mavlink = common.MAVLink(None)
        self._counts: Counter[str] = Counter()

    def receive(self) -> Sequence[TargetReport]:
        """All reports since the last call, in order of arrival."""
        reports = []
        for received_s, data in self._wire.receive():
            for frame in self._framer.feed(data, stream=self._wire.stream):
                if self._is_meant(frame):
                    reports += self._read(frame, received_s)
        return reports

    def _is_meant(self, frame: Frame) -> bool:
        if NAMES[frame.message_id] != self._carrier.message:
            return False
        if frame.system_id == self._system_id and self._component_id in (None, frame.component_id):
            return True
        self._counts["foreign"] += 1
        return False

    def _read(self, frame: Frame, received_s: float) -> list[TargetReport]:
        try:
            fields = self._mavlink.decode(bytearray(frame.data)).to_dict()
            report = self._carrier.report(fields, received_s)
        except Refused as refused:
            self._counts[f"refused_{refused.reason}"] += 1
            return []
        except (common.MAVError, ValueError, ArithmeticError):
            self._counts["refused_invalid"] += 1
            return []
        self._counts["reports"] += 1
        return [report]

    def counters(self) -> Mapping[str, int]:
        """Reports, and what was refused, by reason."""
        return {"reports": 0, "foreign": 0, "garbage_bytes": self._framer.garbage_bytes, **self._counts}

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()
