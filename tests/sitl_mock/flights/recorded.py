"""Recorded flights: the kept part of a .tlog, and the track, modes, answers and reports used in comparisons."""

import csv
import gzip
import math
import struct
import tempfile
from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from sitl_mock.compare import FieldRange, Stream, behaviour_of, read_tlog
from sitl_mock.mavlink import Decoder

FOLDER = Path(__file__).parents[2] / "data" / "flights"
_TIME = struct.Struct(">Q")
_NOT_KEPT = frozenset({"PING", "TIMESYNC", "SYSTEM_TIME"})
_THINNED_S = {
    "LOCAL_POSITION_NED": 0.5,
    "ATTITUDE": 0.5,
    "GLOBAL_POSITION_INT": 5.0,
    "HOME_POSITION": 10.0,
}
_NEWS = frozenset(
    {
        "HEARTBEAT",
        "COMMAND_ACK",
        "STATUSTEXT",
        "MISSION_ACK",
        "MISSION_ITEM_REACHED",
        "MISSION_COUNT",
        "EVENT",
    }
)


def keep(tlog: Path, kept: Path, until_s: float = math.inf) -> None:
    """Write the data for a comparison: all client messages, and the vehicle's messages about the flight.

    Positions and attitudes are thinned to two per second; of other messages the first one is kept.
    """
    raw = tlog.read_bytes()
    at = 0
    out = []
    decoder = Decoder()
    last_s = defaultdict(lambda: -math.inf)
    landed = None
    begun_us = None
    while at < len(raw):
        (time_us,) = _TIME.unpack_from(raw, at)
        at += _TIME.size
        size = raw[at + 1] + (12 if raw[at] == 0xFD else 8)
        (message,) = decoder.feed(raw[at : at + size], whole=True)
        at += size
        begun_us = time_us if begun_us is None else begun_us
        if (time_us - begun_us) * 1e-6 > until_s:
            break
        name = message.get_type()
        if (message.get_srcSystem(), message.get_srcComponent()) == (1, 1):
            period_s = _THINNED_S.get(name, 0.0 if name in _NEWS else math.inf)
            if name == "EXTENDED_SYS_STATE" and message.landed_state != landed:
                landed = message.landed_state
                period_s = 0.0
            if time_us * 1e-6 < last_s[name] + period_s:
                continue
            last_s[name] = time_us * 1e-6
        elif name in _NOT_KEPT and math.isinf(until_s):
            continue
        out.append(_TIME.pack(time_us) + bytes(message.get_msgbuf()))
    kept.parent.mkdir(exist_ok=True)
    kept.write_bytes(gzip.compress(b"".join(out), mtime=0))


def keep_streams(tlog: Path, table: Path, until_s: float) -> None:
    """Write how each message behaved until a time: its rate, and each field's range on the ground and in the air."""
    recording = read_tlog(tlog)
    streams = behaviour_of((at_s, message) for at_s, message in recording.said if at_s <= until_s)
    with table.open("w", newline="", encoding="ascii") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("message", "count", "rate_hz", "phase", "field", "moves", "least", "most"))
        for name, stream in sorted(streams.items()):
            if not any(stream.fields.values()):
                writer.writerow((name, stream.count, f"{stream.rate_hz:.3f}", "", "", "", "", ""))
            for phase, fields in sorted(stream.fields.items()):
                for label, values in fields.items():
                    absent = math.isnan(values.first)
                    span = ("", "") if absent else (f"{values.least:.7g}", f"{values.most:.7g}")
                    writer.writerow(
                        (
                            name,
                            stream.count,
                            f"{stream.rate_hz:.3f}",
                            phase,
                            label,
                            int(values.moves),
                            *span,
                        )
                    )


def streams_of(name):
    """Read such a table: message to its count, rate and fields by phase and name, as `behaviour_of` gives them."""
    streams = {}
    with (FOLDER / f"{name}_streams.csv").open(newline="", encoding="ascii") as file:
        for row in csv.DictReader(file):
            count = int(row["count"])
            rate_hz = float(row["rate_hz"])
            last_s = (count - 1) / rate_hz if rate_hz else 0.0
            stream = streams.setdefault(row["message"], Stream(count, 0.0, last_s))
            if not row["field"]:
                continue
            values = FieldRange(moves=row["moves"] == "1")
            if row["least"]:
                values.least = float(row["least"])
                values.most = float(row["most"])
                values.first = float(row["least"])
            stream.fields.setdefault(row["phase"], {})[row["field"]] = values
    return streams


def recording(name):
    """Read a kept flight."""
    with tempfile.NamedTemporaryFile(suffix=".tlog") as file:
        file.write(gzip.decompress((FOLDER / f"{name}.tlog.gz").read_bytes()))
        file.flush()
        return read_tlog(Path(file.name))


@dataclass
class Flown:
    """Behaviour of a vehicle in a flight.

    Attributes:
        track: Time, north, east, down (m), their rates (m/s) and yaw (rad).
        modes: Time and mode as HEARTBEAT told it, with whether it was armed, when either changed.
        answers: Command and result of every COMMAND_ACK.
        texts: Time and STATUSTEXT.
        reached: Time by number of MISSION_ITEM_REACHED.
        plans: Kind and result of every MISSION_ACK.
        yaw_rad: The last yaw.
    """

    track: list = field(default_factory=list)
    modes: list = field(default_factory=list)
    answers: list = field(default_factory=list)
    texts: list = field(default_factory=list)
    reached: dict = field(default_factory=dict)
    plans: list = field(default_factory=list)
    yaw_rad: float = math.nan

    def at(self, at_s):
        """The row of the track that is nearest to a time."""
        index = bisect_left(self.track, (at_s,))
        return min(self.track[max(index - 1, 0) : index + 1], key=lambda row: abs(row[0] - at_s))

    def modes_between(self, start_s, end_s, least_s=0.0):
        """The modes of a span of time that lasted for longer than `least_s`, with whether it was armed."""
        ends_s = [at_s for at_s, *_ in self.modes[1:]] + [math.inf]
        spans = [
            (at_s, until_s, (*mode,))
            for (at_s, *mode), until_s in zip(self.modes, ends_s, strict=True)
        ]
        return {
            mode
            for at_s, until_s, mode in spans
            if at_s <= end_s and until_s > start_s and until_s - at_s > least_s
        }

    def _local_position_ned(self, at_s, m):
        self.track.append((at_s, m.x, m.y, m.z, m.vx, m.vy, m.vz, self.yaw_rad))

    def _attitude(self, _, m):
        self.yaw_rad = m.yaw

    def _heartbeat(self, at_s, m):
        mode = (m.custom_mode, m.base_mode >> 7)
        if not self.modes or self.modes[-1][1:] != mode:
            self.modes.append((at_s, *mode))

    def _command_ack(self, _, m):
        self.answers.append((m.command, m.result))

    def _statustext(self, at_s, m):
        self.texts.append((at_s, m.text))

    def _mission_item_reached(self, at_s, m):
        self.reached.setdefault(m.seq, at_s)

    def _mission_ack(self, _, m):
        self.plans.append((m.mission_type, m.type))

    def take(self, at_s, message):
        """Measure one message."""
        measure = getattr(self, f"_{message.get_type().lower()}", None)
        if measure is not None:
            measure(at_s, message)


def flown(said):
    """Measure what a vehicle said."""
    result = Flown()
    for at_s, message in said:
        result.take(at_s, message)
    return result
