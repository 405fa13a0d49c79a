"""The panel's lists, replays and exports of records, and the setpoints of a flight that a panel watches."""

import itertools
import json
import shutil
import threading

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from guidance.clock import MonotonicClock
from guidance.errors import OutputError
from guidance.links.zenoh.credentials import NO_CREDENTIALS
from guidance.log import cycles_of
from guidance.log.entries import Item
from guidance.session.flight_files import RECORD
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import Onlooker
from guidance.session.orders.control_bus import free_endpoint
from guidance.session.recorded_flight import fly_recorded
from guidance.viz.panel import records, snapshot
from guidance.viz.panel.hub import DaemonBus, Hub
from guidance.viz.panel.records import RecordFolder
from guidance.viz.panel.snapshot import HISTORY
from tests.harness.flights import NEAR


@pytest.fixture
def folder(record, tmp_path):
    """A folder with a complete record, a torn one, and a file that is no record."""
    whole = tmp_path / "uav1.mcap"
    torn = tmp_path / "pe-001" / "record.mcap"
    strange = tmp_path / "strange.mcap"
    shutil.copy(record, whole)
    torn.parent.mkdir()
    torn.write_bytes(record.read_bytes()[:200_000])
    strange.write_text("no record")
    (tmp_path / "notes.txt").write_text("nothing")
    return RecordFolder(tmp_path)


async def test_records_are_listed_with_their_outcomes_and_read_once(folder, monkeypatch):
    """Catches a list that reads every record at each look."""
    first = folder.listed()  # at once, without details
    assert [row["reading"] for row in first] == [True] * 3
    assert all(row["megabytes"] >= 0.0 for row in first)
    rows = {row["record"]: row for row in await folder.listed_whole()}
    assert rows.keys() == {"uav1.mcap", "pe-001/record.mcap", "strange.mcap"}
    whole = rows["uav1.mcap"]
    torn = rows["pe-001/record.mcap"]
    assert (whole["captured"], whole["ended"], whole["torn"]) == (True, "landed", None)
    assert whole["title"] == NEAR.title
    assert whole["duration_s"] > 20.0
    assert torn["torn"]
    assert not torn["captured"]
    assert "not an MCAP file" in rows["strange.mcap"]["error"]

    def never(*_):
        pytest.fail("an unchanged record was read again")

    monkeypatch.setattr(records, "output_lines", never)
    assert {row["record"]: row for row in folder.listed()} == rows
    await folder.close()


async def test_a_reader_that_dies_leaves_an_error_for_each_record_that_it_did_not_read(
    folder, monkeypatch
):
    async def dies(*_arguments):
        yield json.dumps([str(folder.folder / "uav1.mcap"), {"ended": "landed"}]).encode()
        raise OutputError("killed")

    monkeypatch.setattr(records, "output_lines", dies)
    rows = {row["record"]: row for row in await folder.listed_whole()}
    assert rows["uav1.mcap"]["ended"] == "landed"
    assert all(
        "cannot be read" in rows[name]["error"] for name in ("pe-001/record.mcap", "strange.mcap")
    )
    await folder.close()


async def test_products_are_made_only_from_records_of_the_folder(folder):
    """Catches a file outside of the folder that a page can ask for."""
    for name, what in (
        ("../uav1.mcap", "events"),
        ("/etc/passwd", "events"),
        ("notes.txt", "events"),
        ("uav1.mcap", "sh"),
    ):
        assert await folder.product(name, what) is None
    with pytest.raises(OutputError, match="not an MCAP file"):
        await folder.product("strange.mcap", "events")
    made = await folder.product("pe-001/record.mcap", "events")
    assert made.name == "pe-001.txt"
    assert "vehicle heard" in made.read_text()
    assert await folder.product("pe-001/record.mcap", "events") == made
    await folder.close()
    assert not made.exists()


async def test_record_routes_answer_with_the_right_content_types(folder, monkeypatch):
    async def quick(*arguments):
        assert arguments[:2] == ("-m", "guidance.viz.panel.snapshot")
        for name in arguments[3:]:
            yield json.dumps([name, {"ended": "landed"}]).encode()

    monkeypatch.setattr(records, "output_lines", quick)
    application = web.Application()
    application.add_routes(folder.routes("/secret/"))
    async with TestClient(TestServer(application)) as client:
        await client.get("/secret/records")
        await folder.listed_whole()
        listed = await (await client.get("/secret/records")).json()
        assert {row["ended"] for row in listed["records"]} == {"landed"}
        assert (
            await client.get("/secret/records/events", params={"record": "nothing"})
        ).status == 404
        frames = await client.get("/secret/records/frames", params={"record": "uav1.mcap"})
        assert frames.content_type == "application/json"
    await folder.close()


def test_a_replay_contains_the_whole_flight_in_order(record, capsys):
    """Catches frames of a replay that are missing or out of order."""
    assert snapshot.write_json("frames", str(record)) == 0
    said = json.loads(capsys.readouterr().out)
    times = [frame["now_s"] for frame in said["frames"]]
    assert times == sorted(times)
    assert 0.09 < min(after - before for before, after in itertools.pairwise(times)) < 0.13
    assert [said["frames"][0]["state"], said["frames"][-1]["state"]] == ["checking", "landed"]
    assert said["columns"] == list(HISTORY)
    assert [event["event"] for event in said["events"]][:2] == ["flight begins", "vehicle heard"]
    assert [scene["from_s"] for scene in said["scenes"]] == sorted(
        scene["from_s"] for scene in said["scenes"]
    )
    engaged = next(frame for frame in said["frames"] if frame["game"])
    assert engaged["state"] == "engaged"
    assert engaged["game"]["isochron_m"]


class CountedBus(DaemonBus):
    """Counts the cycles and events that the page takes."""

    cycles = 0

    def news(self):
        taken = super().news()
        self.cycles += sum(isinstance(news.what, Item) for news in taken)
        return taken


def test_a_watched_flight_sends_the_same_setpoints_bit_for_bit(record, tmp_path):
    """Catches a page that changes the flight it looks at."""
    endpoint = free_endpoint()
    bus = CountedBus(endpoint, None, MonotonicClock(), NO_CREDENTIALS)
    hub = Hub([bus], MonotonicClock())

    def look(_):
        hub.receive()
        hub.message()
        if not bus.cycles:
            # The panel connects in real time, and the flight is faster
            threading.Event().wait(0.01)

    try:
        fly_recorded(
            NEAR, tmp_path / "flown", MockOptions(fast=True), Onlooker(look, control=endpoint)
        )
    finally:
        hub.close()
    assert bus.cycles > 100
    flown, alone = (
        [row.setpoint for row in cycles_of(path)] for path in (tmp_path / "flown" / RECORD, record)
    )
    assert sum(setpoint is not None for setpoint in alone) > 100
    assert flown == alone
