"""`--json` of every command that prints a table: one document on standard output, and nothing else there."""

import json
import math

import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.flight import Inputs, State
from guidance.log.entries import CycleEntry
from guidance.log.writer import Recorder


def printed(*arguments):
    done = CliRunner().invoke(app, [*map(str, arguments)])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.fixture
def record(tmp_path):
    path = tmp_path / "record.mcap"
    recorder = Recorder(path, {"scenario": '{"title": "A flight"}'})
    recorder.cycle(CycleEntry(0.5, State.READY, Inputs(), ()))
    recorder.event(1.0, "armed", "arming -> climbing")
    recorder.close()
    return path


def test_a_record_is_told_as_json(record):
    told = printed("log", "info", record, "--json")
    assert (told["title"], told["missing_messages"], told["torn"]) == ("A flight", 0, None)
    assert sum(channel["messages"] for channel in told["channels"].values()) == 2
    assert printed("log", "events", record, "--json") == [
        {"now_s": 1.0, "event": "armed", "detail": "arming -> climbing"}
    ]


def test_scenarios_are_told_as_json_and_drawn_only_where_asked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    listed = printed("scenario", "list", "--json")
    assert {"name", "game", "title", "expected"} == set(listed[0])
    told = printed("scenario", "show", "wind", "--json")
    (wind,) = told["facts"]["wind"]
    assert wind.startswith("(2, 0) m/s, east and north; in mathematics")
    assert list(tmp_path.iterdir()) == []
    row = printed("scenario", "run", "pe", "--json")
    assert row["end"] == "captured"
    assert math.isclose(row["regret"], 0.0, abs_tol=1e-6)


def test_the_folder_of_a_flight_stands_for_its_record(record):
    assert printed("log", "info", record.parent, "--json") == printed(
        "log", "info", record, "--json"
    )
    refused = CliRunner().invoke(app, ["log", "info", str(record.parent.parent)])
    assert "name a vehicle's folder" in str(refused.exception)
