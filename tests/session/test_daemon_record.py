"""A daemon's record: its configuration is in it, and every flight of it is replayed bit for bit."""

import errno
import json
from functools import partial
from io import BufferedWriter, FileIO
from types import SimpleNamespace

import pytest

from guidance.config import parse_document
from guidance.flight import State
from guidance.log import compare, cycles_of, events_of, writer
from guidance.log.entries import BEGUN, RELOADED, STOPPED
from guidance.log.export import export
from guidance.log.writer import VIRTUAL_CHUNK_S, Recorder
from guidance.session.flight_files import recorded_settings
from guidance.session.fly.daemon import Equipment
from guidance.session.plan import plan_of
from guidance.session.service import daemon_recording
from guidance.session.vehicle_file import Config


@pytest.mark.flight
def test_both_flights_of_a_daemon_that_was_reset_are_replayed_bit_for_bit(
    base, vehicle_document, tmp_path
):
    path = tmp_path / "daemon.mcap"
    recorder = Recorder(path, {"config": json.dumps(vehicle_document())})
    one = base(record=recorder)
    one.engaged().run(5.0)
    one.order("land")
    one.until(State.LANDED)
    assert one.order("reset")["accepted"]
    one.engaged().run(2.0)
    recorder.close()
    assert [event.event for event in events_of(path)].count(BEGUN) == 2
    assert any(row.inputs.refusals for row in cycles_of(path))
    comparison, survey = compare(path, recorded_settings)
    assert survey.torn is None
    assert comparison.setpoints > 300
    assert comparison.differing == 0
    # The evader stands straight ahead, where every policy flies the same way: a slower pursuer does not.
    other, _ = compare(
        path, partial(recorded_settings, changes={"game.speed_m_s": 4.0}), what_if=True
    )
    assert other.differing > 100
    assert "features" in export(path, tmp_path / "map.geojson", recorded_settings)


def test_a_reloaded_configuration_is_recorded_and_used_by_the_replay(base, tmp_path):
    """Catches a replay by settings that were exchanged before the flight."""
    path = tmp_path / "daemon.mcap"
    recorder = Recorder(path, {"config": base().config.model_dump_json()})
    one = base(record=recorder).until(State.READY)
    wider = {**one.config.game.model_dump(), "standoff_radius_m": 9.0, "speed_m_s": 5.0}
    again = parse_document(Config, {**one.config.model_dump(), "game": wider}, source="again")
    one.daemon.exchange(lambda: plan_of(again), one.now_s)
    one.engaged().run(3.0)
    recorder.close()
    (read,) = [event for event in events_of(path) if event.event == RELOADED]
    assert json.loads(read.detail) == again.model_dump(mode="json")
    comparison, _ = compare(path, recorded_settings)
    assert comparison.setpoints > 150
    assert comparison.differing == 0
    before, _ = compare(path, recorded_settings, what_if=True)
    assert before.differing > 100


class FullDisk(FileIO):
    """A raw file with room for so many bytes: the write that does not fit is cut short, the next one fails."""

    room = 0

    def write(self, data):
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = super().write(data[: self.room])
        self.room -= count
        return count


@pytest.fixture(params=[pytest.param("in the loop", marks=pytest.mark.long), "in the background"])
def recorder_of(request, monkeypatch, vehicle_document, tmp_path):
    """Make a recorder on a disk with room for `room` bytes."""

    def make(room):
        monkeypatch.setattr(FullDisk, "room", room)
        monkeypatch.setattr(
            writer, "private_file", lambda path: SimpleNamespace(open=lambda *_, **__: disk(path))
        )
        metadata = {"config": json.dumps(vehicle_document())}
        return Recorder(
            tmp_path / "daemon.mcap", metadata, threaded=request.param == "in the background"
        )

    def disk(path):
        return BufferedWriter(FullDisk(path, "wb"))

    return make


def test_a_full_disk_is_reported_once_and_the_flight_continues_without_a_record(
    base, recorder_of, tmp_path
):
    """Catches setpoints that change when the disk is full."""
    recorder = recorder_of(60_000)
    one = base(record=recorder).engaged().run(3.0)
    bare = base.engaged().run(3.0)
    recorder.close()
    one.run(0.1)
    assert one.log.messages().count(STOPPED) == 1
    assert one.order("status")["recording"] == "stopped: [Errno 28] No space left on device"
    happened = {"vehicle": "uav1", "event": STOPPED}
    assert one.metrics.registry.get_sample_value("guidance_events_total", happened) == 1.0
    assert (tmp_path / "daemon.mcap").stat().st_size == 60_000
    assert sum(1 for _ in cycles_of(tmp_path / "daemon.mcap")) > 50  # what was written can be read
    flown, wanted = (
        [(m.vx, m.vy, m.vz) for m in each.setpoints_since(0.0)] for each in (one, bare)
    )
    assert flown[: len(wanted)] == wanted
    assert len(wanted) > 100


@pytest.mark.parametrize("required", [True, False])
def test_a_required_record_that_cannot_be_opened_prevents_the_start(
    required, base, vehicle_document, tmp_path
):
    """Catches a flight without the record that its file requires."""
    (tmp_path / "file").write_text("")
    document = vehicle_document(record={"folder": str(tmp_path / "file" / "records")})
    bare = base()
    with daemon_recording(
        parse_document(Config, document, source="test"), {}, Equipment(sinks=[bare.log])
    ) as unwritten:
        one = base(record=unwritten, record_required=required).until(
            State.CHECKING if required else State.READY
        )
        one.run(3.0)
        started = one.order("start")
        assert started["accepted"] is not required
        status = one.order("status")
        assert status["recording"].startswith("stopped: record.folder = ")
        assert status["preflight_refused"] == (["record"] if required else [])
        assert "set record.required = false" in started.get("reason", "set record.required = false")
    assert one.log.messages().count(STOPPED) == 1
    assert bare.log.messages() == ["the record is incomplete"]


def test_a_record_that_is_written_is_said_to_be_on_and_one_that_is_not_wanted_off(
    base, recorder_of
):
    recorder = recorder_of(10_000_000)
    assert base(record=recorder).order("status")["recording"] == "on"
    recorder.close()
    assert base().order("status")["recording"] == "off"


def test_a_record_deleted_in_flight_is_no_longer_reported_as_on(base, tmp_path):
    """Catches a status that calls a deleted record on."""
    recorder = Recorder(tmp_path / "daemon.mcap", {})
    one = base(record=recorder).engaged()
    assert one.order("status")["recording"] == "on"
    (tmp_path / "daemon.mcap").unlink()
    one.run(VIRTUAL_CHUNK_S + 0.1)
    assert one.order("status")["recording"] == f"stopped: {tmp_path / 'daemon.mcap'} was deleted"
    recorder.close()
