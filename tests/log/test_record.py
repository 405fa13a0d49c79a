"""The recorder's thread writes everything, and a full or stalled disk does not affect the loop."""

import errno
import threading

import pytest
from mcap.reader import make_reader

from guidance.flight import Inputs, State
from guidance.log.entries import CycleEntry
from guidance.log.writer import MAX_ENTRIES_WAITING, McapFile, Recorder

READY = CycleEntry(0.0, State.READY, Inputs(), ())


def test_the_thread_writes_a_complete_record(tmp_path):
    path = tmp_path / "record.mcap"
    recorder = Recorder(path, {}, threaded=True)
    for number in range(200):
        recorder.cycle(READY._replace(now_s=0.02 * number))
    recorder.frames([(1.0, "uav1/mavlink_raw/in", b"\xfd")])
    recorder.event(2.0, "armed")
    recorder.close()
    recorder.close()
    assert recorder.failed is None
    with path.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 202


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), ValueError("no such row")]
)
def test_a_record_that_fails_is_reported_and_raises_nothing(tmp_path, monkeypatch, error):
    recorder = Recorder(tmp_path / "record.mcap", {}, threaded=True)

    def fail(*_):
        raise error

    monkeypatch.setattr(McapFile, "add", fail)
    for _ in range(10):
        recorder.cycle(READY)
    recorder.close()
    assert str(error) in recorder.failed


def test_a_stalled_disk_drops_rows_and_never_blocks_the_loop(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path / "record.mcap", {}, threaded=True)
    go = threading.Event()
    monkeypatch.setattr(McapFile, "add", lambda *_: go.wait(10.0))
    for _ in range(MAX_ENTRIES_WAITING + 100):
        recorder.cycle(READY)
    assert recorder.dropped >= 99
    go.set()
    recorder.close()
