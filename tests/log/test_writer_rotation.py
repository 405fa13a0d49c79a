"""A long flight in several files: each can be read alone, all as one, and memory stays bounded."""

import gc
import json
import shutil
import tracemalloc

import pytest

from guidance.errors import ConfigError
from guidance.flight import Inputs, State
from guidance.log import Survey, cycles_of, metadata_of, scan, survey_of
from guidance.log.entries import CYCLE, CycleEntry
from guidance.log.writer import Recorder, part_path
from guidance.session.output_sections import RecordSection


def entry(number, *text):
    """Return a cycle that contains its number."""
    return CycleEntry(0.02 * number, State.ENGAGED, Inputs(refusals=(str(number), *text)), ())


def number_of(item):
    return int(json.loads(item.data)["inputs"]["refusals"][0])


def write(path, seconds, **rotation):
    recorder = Recorder(path, {"seed": "3"}, **rotation)
    for number in range(round(seconds * 50)):
        recorder.cycle(entry(number))
    recorder.close()
    assert recorder.failed is None
    return recorder


def numbers(path, survey=None):
    return [number_of(item) for item in scan(path, survey) if item.topic == CYCLE.topic]


def test_the_first_file_is_read_with_all_others_and_each_other_alone(tmp_path):
    path = tmp_path / "flight.mcap"
    write(path, 25.0, rotate_s=10.0)
    names = ["flight.002.mcap", "flight.003.mcap", "flight.mcap"]
    assert sorted(one.name for one in tmp_path.iterdir()) == names
    survey = Survey()
    assert numbers(path, survey) == list(range(1250))
    assert (survey.torn, survey.missing, survey.metadata) == (None, 0, {"seed": "3"})
    assert numbers(tmp_path / "flight.002.mcap") == list(range(500, 1000))
    assert metadata_of(tmp_path / "flight.003.mcap") == {"seed": "3", "part": "3"}


def test_a_file_that_reaches_its_size_limit_is_followed_by_the_next(tmp_path):
    path = tmp_path / "flight.mcap"
    write(path, 60.0, rotate_bytes=20_000)
    assert len(list(tmp_path.iterdir())) > 2
    assert max(one.stat().st_size for one in tmp_path.iterdir()) < 60_000  # the index is added
    assert numbers(path) == list(range(3000))


@pytest.mark.parametrize(
    ("lost", "read", "missing"),
    [
        ("flight.002.mcap", [*range(500), *range(1000, 1250)], 500),
        ("flight.003.mcap", range(1000), 0),
    ],
)
def test_a_lost_file_is_named_and_its_messages_are_counted(tmp_path, lost, read, missing):
    path = tmp_path / "flight.mcap"
    write(path, 25.0, rotate_s=10.0)
    (tmp_path / lost).unlink()
    survey = Survey()
    assert numbers(path, survey) == list(read)
    assert survey.missing_files == [lost]
    assert survey.missing == missing
    assert f"{lost} is missing" in survey.faults


def test_a_file_with_the_number_of_a_lost_one_does_not_hide_the_gap(tmp_path):
    path = tmp_path / "flight.mcap"
    write(path, 25.0, rotate_s=10.0)
    shutil.move(tmp_path / "flight.003.mcap", tmp_path / "flight.002.mcap")
    survey = Survey()
    assert numbers(path, survey) == [*range(500), *range(1000, 1250)]
    assert survey.missing == 500


def test_a_failure_to_open_the_next_file_keeps_the_previous_one(tmp_path):
    path = tmp_path / "flight.mcap"
    (tmp_path / "flight.002.mcap").mkdir()
    recorder = Recorder(path, {"seed": "3"}, rotate_s=1.0)
    for number in range(100):
        recorder.cycle(entry(number))
    assert "Is a directory" in recorder.failed
    recorder.close()
    shutil.rmtree(tmp_path / "flight.002.mcap")
    survey = Survey()
    assert numbers(path, survey) == list(range(50))
    assert survey.torn is None


def test_the_cycles_of_a_flight_in_several_files_are_those_of_one(tmp_path, flight):
    """Catches a cycle that is lost between two files of a record."""
    _, whole = flight
    path = tmp_path / "record.mcap"
    recorder = Recorder(path, metadata_of(whole), rotate_s=10.0)
    for item in scan(whole):
        if item.topic == CYCLE.topic:
            recorder.cycle(CYCLE.decode(item.data))
        elif item.encoding == "mavlink":
            recorder.frames([(item.now_s, item.topic, item.data)])
    recorder.close()
    assert part_path(path, 3).exists()
    assert list(map(repr, cycles_of(path))) == list(map(repr, cycles_of(whole)))
    survey = survey_of(path)
    assert (survey.missing, survey.torn) == (0, None)


def test_the_writers_memory_does_not_grow_from_file_to_file(tmp_path):
    """Catches an index that is kept after its file is closed.

    The index of a file is kept until the file is finished: the same amount at the end of each.
    """
    at_end_bytes = []
    recorder = Recorder(tmp_path / "flight.mcap", {}, rotate_s=4.0)
    tracemalloc.start()
    try:
        for number in range(1000):
            recorder.event(0.02 * number, "happened")
            if number % 200 == 198:
                gc.collect()
                at_end_bytes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
        recorder.close()
    assert len(at_end_bytes) == 5
    assert max(at_end_bytes) < min(at_end_bytes) + 20_000


@pytest.mark.parametrize(("key", "value"), [("rotate_s", 1.0), ("rotate_mb", 0.1)])
def test_file_limits_that_are_too_small_are_refused(key, value):
    with pytest.raises(ValueError, match=key):
        RecordSection(**{key: value})


def test_a_later_file_can_be_read_without_the_first(tmp_path):
    path = tmp_path / "flight.mcap"
    write(path, 25.0, rotate_s=10.0)
    path.unlink()
    with pytest.raises(ConfigError, match="cannot be read"):
        metadata_of(path)
    assert numbers(tmp_path / "flight.003.mcap") == list(range(1000, 1250))
