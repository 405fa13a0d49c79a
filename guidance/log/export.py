"""Exports a record in the format that the ending of the output file selects; .tlog is written here.

A .tlog is the telemetry log of QGroundControl, Mission Planner and pymavlink's mavlogdump. Each frame follows 8 bytes
with its time in microseconds since 1970, big-endian. Records in virtual time have no UTC start and begin in 1970.
"""

import heapq
import struct
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import all as dialect

from guidance.errors import ConfigError, OutputError
from guidance.extras import require
from guidance.links.frames import FrameReader, frame_length
from guidance.log.maps import features_of, write_geojson, write_kml
from guidance.log.reader import Item, SettingsOf, Survey, metadata_of, scan, title_of

ENCODING: Final = "mavlink"
_REORDER_S: Final = 1.0
"""Frames are recorded vehicle by vehicle each cycle, so times within this window may be out of order."""


def _map(path: Path, out: Path, settings_of: SettingsOf) -> int:
    metadata = metadata_of(path)
    features = features_of(path, settings_of(metadata))
    return (write_kml if out.suffix == ".kml" else write_geojson)(features, title_of(metadata), out)


def _table(path: Path, out: Path, _: SettingsOf) -> int:
    require(str(out), "sim")
    from guidance.log.table import write_table  # noqa: PLC0415 - pyarrow is of an extra

    return write_table(path, out)


EXPORTS: Final[Mapping[str, tuple[str, Callable[[Path, Path, SettingsOf], int]]]] = {
    ".tlog": ("frames", lambda path, out, _: write_tlog(path, out)),
    ".csv": ("cycles", _table),
    ".parquet": ("cycles", _table),
    ".geojson": ("features", _map),
    ".kml": ("features", _map),
}


def export(path: Path, out: Path, settings_of: SettingsOf) -> str:
    """Write `out` in the format of its ending; return the count and unit written, for example "12 frames".

    Raises:
        ConfigError: If the ending is unknown, or the record cannot be read.
        OutputError: If `out` cannot be written.
    """
    if out.suffix not in EXPORTS:
        raise ConfigError(f"{out}: must end in {', '.join(EXPORTS)}")
    what, write = EXPORTS[out.suffix]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return f"{write(path, out, settings_of)} {what}"
    except OSError as error:
        raise OutputError(f"{out}: cannot be written ({error.strerror or error}); choose another file") from error


def write_tlog(path: Path, out: Path) -> int:
    """Write the raw frames of both directions and all vehicles, oldest first; return their number.

    Raises:
        ConfigError: If the record cannot be read.
        OSError: If `out` cannot be written.
    """
    survey, count = Survey(), 0
    with out.open("wb") as stream:
        for now_s, frame in _ordered(_frames(path, survey)):
            stream.write(struct.pack(">Q", max(0, round((now_s + started_unix_s(survey)) * 1e6))) + frame)
            count += 1
    return count


def started_unix_s(survey: Survey) -> float:
    """Return the Unix time of the record clock's zero; 0 if unknown."""
    started = survey.metadata.get("started_utc")
    if started is None:
        return 0.0
    try:
        return datetime.fromisoformat(started).timestamp()
    except ValueError:
        return 0.0


def _frames(path: Path, survey: Survey) -> Iterator[tuple[float, bytes]]:
    readers: dict[str, FrameReader] = {}
    for item in scan(path, survey):
        if item.encoding != ENCODING:
            continue
        if _is_one_frame(item):
            yield item.now_s, item.data
        else:  # a piece of a byte stream
            reader = readers.setdefault(
                item.topic, FrameReader(dialect=dialect)
            )  # a log keeps the messages of every dialect
            yield from ((item.now_s, bytes(frame.get_msgbuf())) for frame in reader.read(item.data))


def _is_one_frame(item: Item) -> bool:
    return len(item.data) >= 8 and frame_length(item.data) == len(item.data)


def _ordered(frames: Iterator[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
    waiting: list[tuple[float, int, bytes]] = []
    for number, (now_s, frame) in enumerate(frames):
        heapq.heappush(waiting, (now_s, number, frame))
        while waiting[0][0] < now_s - _REORDER_S:
            first_s, _, first = heapq.heappop(waiting)
            yield first_s, first
    while waiting:
        first_s, _, first = heapq.heappop(waiting)
        yield first_s, first
