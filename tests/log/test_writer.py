import calendar
import errno
import json
import math
import subprocess
import sys
import time
from datetime import datetime
from typing import NamedTuple

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader

from guidance.flight import Inputs, State
from guidance.log import writer as record
from guidance.log.codec import plain
from guidance.log.entries import CYCLE, EVENT, CycleEntry
from guidance.log.writer import McapFile, Recorder, started_utc, versions


class Pair(NamedTuple):
    a: float
    b: tuple[float, ...]


def entry(number, *text):
    """Return a cycle that contains its number."""
    return CycleEntry(0.02 * number, State.ENGAGED, Inputs(refusals=(str(number), *text)), ())


def number_of(item):
    return int(json.loads(item.data)["inputs"]["refusals"][0])


def rows_of(path):
    rows = []
    with path.open("rb") as stream:
        try:
            for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                rows.append((channel.topic, message))
        except EndOfFile:
            pass
    return rows


def test_messages_are_read_back_with_time_topic_and_schema(tmp_path):
    path = tmp_path / "deep" / "record.mcap"
    recorder = Recorder(path, {"seed": "3"})
    recorder.frames([(1.25, "uav1/mavlink_raw/in", b"\xfd\x00")])
    recorder.cycle(entry(75))
    recorder.event(1.75, "armed", "ready -> arming")
    recorder.close()
    recorder.close()
    with path.open("rb") as stream:
        reader = make_reader(stream)
        found = [
            (schema and schema.name, channel.topic, message)
            for schema, channel, message in reader.iter_messages()
        ]
        metadata = {entry.name: entry.metadata for entry in reader.iter_metadata()}
    assert metadata == {"run": {"seed": "3"}, "end": {"last": "yes"}}
    assert [(schema, topic) for schema, topic, _ in found] == [
        (None, "uav1/mavlink_raw/in"),
        ("guidance.Cycle", CYCLE.topic),
        ("guidance.Event", EVENT.topic),
    ]
    assert found[0][2].data == b"\xfd\x00"
    assert found[0][2].log_time == 1_250_000_000
    assert json.loads(found[2][2].data) == {
        "now_s": 1.75,
        "event": "armed",
        "detail": "ready -> arming",
    }


def test_a_killed_process_loses_only_the_last_chunk(tmp_path):
    path = tmp_path / "record.mcap"
    recorder = Recorder(path, {})
    written = 2000
    for number in range(written):
        recorder.cycle(entry(number, "x" * 400))
    # As after kill -9: the file is neither flushed nor finished.
    read = [number_of(message) for _, message in rows_of(path)]
    assert read == list(range(len(read)))
    assert written - len(read) <= round(record.VIRTUAL_CHUNK_S / 0.02) + 1
    recorder.close()


def test_a_full_disk_stops_the_recording_but_not_the_flight(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path / "record.mcap", {})
    recorder.event(0.0, "before")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(McapFile, "add", full)
    recorder.event(1.0, "lost")
    assert "No space left" in recorder.failed
    recorder.event(2.0, "quietly dropped")
    recorder.close()


def test_an_unwritable_folder_is_refused_before_takeoff(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        Recorder(tmp_path / "file" / "record.mcap", {})


def test_rows_become_plain_json():
    value = {"pair": Pair(1.0, (math.nan, math.inf)), "n": 3, "none": None, "yes": True}
    assert plain(value) == {
        "pair": {"a": 1.0, "b": [None, None]},
        "n": 3,
        "none": None,
        "yes": True,
    }


FLYING = """
import sys
from pathlib import Path
from guidance.flight import Inputs, State
from guidance.log.entries import CycleEntry
from guidance.clock import MonotonicClock
from guidance.log.writer import Recorder
recorder, clock, due_s = Recorder(Path(sys.argv[1]), {}, threaded=True), MonotonicClock(), 0.0
while True:
    clock.sleep_until(due_s)
    due_s += 0.02
    now_s = clock.now_s()
    recorder.cycle(CycleEntry(now_s, State.ENGAGED, Inputs(), ()))
    print(now_s, flush=True)
"""


def test_kill_9_loses_at_most_0_2_s(tmp_path):
    """Catches a record that waits in memory for longer than it promises."""
    path = tmp_path / "record.mcap"
    child = subprocess.Popen(
        [sys.executable, "-c", FLYING, path], stdout=subprocess.PIPE, text=True
    )
    try:
        flown_s = [float(child.stdout.readline()) for _ in range(60)]
    finally:
        child.kill()
        child.wait()
        flown_s += [float(line) for line in child.stdout.read().splitlines()]
        child.stdout.close()
    kept_s = [message.log_time * 1e-9 for _, message in rows_of(path)]
    assert kept_s == pytest.approx(flown_s[: len(kept_s)], abs=1e-9)  # whole nanoseconds
    assert flown_s[-1] - kept_s[-1] <= 0.2


def test_versions_and_the_start_are_recorded():
    assert {"python", "pursuit-guidance", "numpy", "pymavlink"} <= versions().keys()
    started = datetime.fromisoformat(started_utc(100.0)).timestamp()
    assert started == pytest.approx(calendar.timegm(time.gmtime()) - 100.0, abs=2.0)
