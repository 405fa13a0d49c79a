"""A daemon's record: its configuration is in it, and every flight of it is replayed bit for bit."""

import json

from guidance.flight import State
from guidance.records import compare, events_of, flight_settings, metadata_of, rows_of
from guidance.records.export import export
from guidance.service.record import BEGUN, Recorder


def test_both_flights_of_a_daemon_that_was_reset_are_replayed_bit_for_bit(base, vehicle_document, tmp_path):
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
    assert any(row.inputs.refusals for row in rows_of(path))
    comparison, survey = compare(path, flight_settings(metadata_of(path), {}))
    assert survey.torn is None
    assert comparison.setpoints > 300
    assert comparison.differing == 0
    other, _ = compare(path, flight_settings(metadata_of(path), {"policy": "pure_pursuit"}), what_if=True)
    assert other.differing > 100
    assert "features" in export(path, tmp_path / "map.geojson")


def test_a_disk_that_fills_up_is_said_once_and_the_flight_goes_on(base, vehicle_document, tmp_path):
    recorder = Recorder(tmp_path / "daemon.mcap", {"config": json.dumps(vehicle_document())})
    one = base(record=recorder)
    one.standing_by()
    recorder.failed = "No space left on device"
    assert one.order("engage")["accepted"]
    one.until(State.ENGAGED).run(1.0)
    recorder.close()
    assert one.log.messages().count("recording has stopped; the flight goes on") == 1
