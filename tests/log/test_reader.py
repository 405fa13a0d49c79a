import json
import math
import struct

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from guidance.errors import ConfigError
from guidance.flight import Inputs, State
from guidance.log import Survey, cycles_of, events_of, metadata_of, scan, survey_of
from guidance.log.entries import CYCLE, CycleEntry
from guidance.log.writer import Recorder


def entry(number, *text):
    """Return a cycle that contains its number."""
    return CycleEntry(0.02 * number, State.ENGAGED, Inputs(refusals=(str(number), *text)), ())


def number_of(item):
    return int(json.loads(item.data)["inputs"]["refusals"][0])


def written(path, cycles=60):
    recorder = Recorder(path, {"seed": "3"})
    for number in range(cycles):
        recorder.cycle(entry(number, "x" * 400))
    recorder.close()
    return path


def chunks_in(data):
    """Return begin and end of each chunk, from the format: opcode, length, content."""
    position = 8
    found = []
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == Opcode.CHUNK:
            found.append((position, position + 9 + length))
        position += 9 + length
    return found


def test_the_survey_of_a_flight_counts_everything(flight):
    result, path = flight
    survey = survey_of(path)
    assert survey.torn is None
    assert survey.missing == 0
    assert survey.messages[CYCLE.topic] == result.cycles
    assert survey.metadata["guidance"] == "0.1.0"
    assert survey.duration_s == pytest.approx(result.duration_s, abs=0.05)
    assert [event.event for event in events_of(path)].count("stand-off reached") == 1
    assert sum(survey.data_bytes.values()) == sum(len(item.data) for item in scan(path))


def test_a_record_cut_in_its_last_chunk_is_read_up_to_the_chunk_before(tmp_path):
    """Catches messages that are lost with the chunk behind them."""
    whole = written(tmp_path / "whole.mcap").read_bytes()
    chunks = chunks_in(whole)
    assert len(chunks) >= 3
    begin, end = chunks[-1]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[:begin])
    before = [number_of(item) for item in scan(cut)]
    assert before == list(range(len(before)))
    assert 0 < len(before) < 60
    assert 0.02 * (59 - before[-1]) <= 0.2  # lost with the last chunk
    for length in range(begin, end + 1):
        cut.write_bytes(whole[:length])
        survey = Survey()
        read = [number_of(item) for item in scan(cut, survey)]
        assert read == (before if length < end else list(range(60)))
        assert survey.torn is not None
        assert survey.metadata == {"seed": "3"}


def test_a_record_cut_at_any_byte_is_read_without_an_error(tmp_path):
    """Catches a length that is believed beyond the end of the file."""
    recorder = Recorder(tmp_path / "whole.mcap", {"seed": "3"})
    for number in range(3):
        # A short schema, because the file is cut at every byte
        recorder.event(0.02 * number, "happened")
    recorder.close()
    whole = (tmp_path / "whole.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    most = 0
    for length in range(len(whole)):
        cut.write_bytes(whole[:length])
        survey = Survey()
        count = sum(1 for _ in scan(cut, survey))
        assert count >= most
        assert survey.torn is not None
        most = count
    assert most == 3


def refusals(path, survey):
    """Return the number and the text of each cycle that can be read."""
    items = [item for item in scan(path, survey) if item.topic == CYCLE.topic]
    return [json.loads(item.data)["inputs"]["refusals"] for item in items]


@pytest.mark.parametrize("damaged", [0, 1, 2])
def test_a_flipped_bit_costs_its_chunk_and_nothing_else(tmp_path, damaged):
    """Catches a reader that gives up behind the first damaged chunk."""
    whole = bytearray(written(tmp_path / "whole.mcap").read_bytes())
    spans = [span for span in chunks_in(whole) if span[1] - span[0] > 100]
    begin, end = spans[damaged]
    sizes = chunk_sizes(tmp_path / "whole.mcap")
    path = tmp_path / "flipped.mcap"
    for position in range(begin, end, 7):
        flipped = bytearray(whole)
        flipped[position] ^= 0x10
        path.write_bytes(flipped)
        survey = Survey()
        cycles = refusals(path, survey)
        assert [int(number) for number, _ in cycles] == sorted(
            {int(number) for number, _ in cycles}
        )
        assert all(text == "x" * 400 for _, text in cycles)
        if len(cycles) == 60:  # a bit on which no message depends, as in the chunk's times
            assert survey.faults == []
            continue
        assert len(cycles) == 60 - sizes[damaged]
        assert survey.damaged_chunks == 1
        if damaged < len(sizes) - 1:
            assert survey.missing == sizes[damaged]
        assert survey.torn is None


def chunk_sizes(path):
    """Return the number of messages in each chunk, by the `mcap` package's own reader."""
    with path.open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
        begins = [index.message_start_time for index in indexes]
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    edges = [*begins[1:], math.inf]
    return [
        sum(begin <= time < edge for time in times)
        for begin, edge in zip(begins, edges, strict=True)
    ]


@pytest.mark.parametrize(
    "content", [b"no record, but long enough to look at", b"\x89PNG\r\n\x1a\n" + bytes(100)]
)
def test_a_file_that_is_not_a_record_is_refused_by_name(tmp_path, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="other: not an MCAP file"):
        survey_of(path)


def test_a_missing_or_empty_file_is_reported(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.mcap: cannot be read"):
        survey_of(tmp_path / "none.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert survey_of(tmp_path / "empty.mcap").torn is not None
    with pytest.raises(ConfigError, match="nothing can be read"):
        metadata_of(tmp_path / "empty.mcap")


@pytest.mark.parametrize("data", [b"{", b"[1]", b'{"now_s": 1.0}', b"\xff"])
def test_a_foreign_cycle_is_refused_with_its_time(tmp_path, data):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(CYCLE.topic, "json", 0)
        writer.add_message(channel, 1_500_000_000, data, 1_500_000_000)
        writer.finish()
    with pytest.raises(ConfigError, match=r"1\.500 s"):
        list(cycles_of(path))
