"""Rerun files, read back with Rerun's reader and compared with the record."""

import json
import math
import shutil
import threading
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pyarrow
import pytest
import rerun as rr
from rerun.chunk import McapReader, RrdReader
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.config import load
from guidance.errors import ConfigError, OutputError
from guidance.flight import State
from guidance.log import Aggregator, Item, cycles_of, events_of, metadata_of, scan, survey_of
from guidance.log.entries import CYCLE, EVENT, RELOADED
from guidance.log.scene import isochron_at
from guidance.session.flight_files import recorded_settings
from guidance.session.vehicle_file import Config
from guidance.viz.view import CURVES, DRAWN_EVERY_S, Painter, RecordFile, view


class Seeing:
    """A recording of Rerun: entity -> (seconds, values of one component), in order of time; static ones apart."""

    def __init__(self, path):
        reader = RrdReader(str(path))
        (self.entry,) = reader.recordings()
        self.blueprints = reader.blueprints()
        rows = defaultdict(list)
        self.still = {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                _, colon, component = name.partition(":")
                if not colon:
                    continue
                values = batch.column(name).to_pylist()
                if chunk.is_static:
                    self.still[chunk.entity_path, component] = values[0]
                else:
                    times = [
                        1e-9 * time
                        for time in batch.column("flight").cast(pyarrow.int64()).to_pylist()
                    ]
                    rows[chunk.entity_path, component] += zip(times, values, strict=True)
        self._rows = {key: sorted(kept, key=lambda row: row[0]) for key, kept in rows.items()}

    def of(self, entity, component):
        kept = [row for row in self._rows[entity, component] if row[1] is not None]
        return [row[0] for row in kept], [row[1] for row in kept]


@pytest.fixture(scope="module")
def rows(record):
    return list(cycles_of(record))


@pytest.fixture(scope="module")
def seen(record, tmp_path_factory):
    out = tmp_path_factory.mktemp("rrd") / "deep" / "flight.rrd"
    run = CliRunner().invoke(app, ["view", str(record), "--save", str(out)])
    assert run.exit_code == 0, run.output
    return Seeing(out), run.output


def test_both_are_where_the_certificates_have_them_at_every_cycle_of_the_game(seen, rows):
    """Catches players that are shown elsewhere than they were."""
    played = [row for row in rows if row.certificate is not None]
    for entity, where in (("/game/pursuer", "pursuer_game_m"), ("/game/evader", "evader_game_m")):
        times, places = seen[0].of(entity, "positions")
        at = dict(zip(np.round(times, 3), places, strict=True))
        for row in played:
            np.testing.assert_allclose(
                at[round(row.now_s, 3)][0], getattr(row.certificate, where), atol=1e-4
            )
        _, strips = seen[0].of(f"{entity}/track", "strips")
        line = [point for (strip,) in strips for point in strip]
        assert math.dist(line[0], places[0][0]) < 1e-4
        assert math.dist(line[-1], places[-1][0]) < 1e-4
        assert max(map(math.dist, line[:-1], line[1:])) < 1.0  # it has no gaps


def test_all_vehicles_of_a_team_are_in_one_recording(record, tmp_path):
    """Catches a vehicle that overwrites another one's curves."""
    for name in ("uav1", "uav2"):
        (tmp_path / name).mkdir()
        shutil.copy(record, tmp_path / name / "record.mcap")
    run = CliRunner().invoke(app, ["view", str(tmp_path), "--save", str(tmp_path / "team.rrd")])
    assert run.exit_code == 0, run.output
    both = Seeing(tmp_path / "team.rrd")
    for entity, component in (
        ("/game/{}/pursuer", "positions"),
        ("/plots/range/{}/ground_m", "scalars"),
    ):
        (_, one), (_, other) = (
            both.of(entity.format(name), component) for name in ("uav1", "uav2")
        )
        assert len(one) > 100
        assert one == other


def test_the_plots_are_the_records_numbers(seen, rows):
    names = {f"/{curve.path}" for curve in CURVES}
    assert all(len(seen[0].of(name, "scalars")[0]) > 100 for name in names)
    played = {round(row.now_s, 3): row for row in rows if row.certificate is not None}
    for entity, wanted in (
        ("/plots/range/ground_m", lambda row: row.certificate.gap_m),
        ("/plots/to_go/value_s", lambda row: row.certificate.meeting_time_s),
        ("/plots/speed/commanded_m_s", lambda row: math.hypot(*row.setpoint.velocity_ned_m_s)),
    ):
        plotted = {
            round(time, 3): value[0]
            for time, value in zip(*seen[0].of(entity, "scalars"), strict=True)
        }
        both = plotted.keys() & played.keys()
        assert len(both) > 100
        assert all(plotted[time] == pytest.approx(wanted(played[time])) for time in both)


def test_the_guarantee_never_rises_far_above_what_was_promised_at_engagement(seen, rows):
    promised = next(row.certificate.value for row in rows if row.certificate is not None)
    _, values = seen[0].of("/plots/guarantee/value", "scalars")
    assert values[0][0] == pytest.approx(promised)
    assert all(value[0] < 1.3 * promised for value in values)


def test_the_isochron_and_the_disc_are_those_of_their_moment(seen, rows, record):
    settings = recorded_settings(metadata_of(record))
    at = {round(row.now_s, 3): row for row in rows}
    times, strips = seen[0].of("/game/isochron", "strips")
    assert np.diff(times).min() >= DRAWN_EVERY_S - 1e-6
    for time, (strip,) in zip(times[::10], strips[::10], strict=True):
        curve = isochron_at(settings.cycle, at[round(time, 3)].certificate, len(strip))
        np.testing.assert_allclose(np.array(strip)[:, :2], curve, atol=1e-4)
    times, strips = seen[0].of("/game/stand_off_disc", "strips")
    for time, (strip,) in zip(times, strips, strict=True):
        evader = at[round(time, 3)].certificate.evader_game_m
        radii = np.linalg.norm(np.array(strip)[:, :2] - evader[:2], axis=-1)
        np.testing.assert_allclose(radii, settings.cycle.game.standoff.radius_m, rtol=1e-4)


def test_fence_events_states_and_a_layout_are_there(seen, record, rows):
    (edge,) = seen[0].still["/game/fence", "strips"]
    assert np.ptp(np.array(edge)[:, 0]) == pytest.approx(2.0 * 300.0, rel=1e-3)
    _, texts = seen[0].of("/events", "text")
    assert [text for (text,) in texts] == [
        f"{one.event}  {one.detail}".rstrip() for one in events_of(record)
    ]
    _, states = seen[0].of("/state", "text")
    assert [state for (state,) in states][-1] == State.LANDED
    assert seen[0].blueprints
    assert seen[0].entry.application_id == "guidance"
    assert f"{len(rows)} cycles" in seen[1]


def test_a_record_that_grows_is_followed_and_comes_to_the_same(record, seen, tmp_path, monkeypatch):
    """Catches a view that loses what is written while it reads.

    The file gets longer only while the viewer waits for it: every wait is another piece.
    """
    whole = record.read_bytes()
    growing = tmp_path / "growing.mcap"
    growing.write_bytes(whole[:100])
    written = 100

    class Ended(threading.Event):
        def wait(self, timeout=None):
            nonlocal written
            with growing.open("ab") as file:
                file.write(whole[written : written + 30_000])
            written += 30_000
            return False

    monkeypatch.setattr("os.nice", lambda _: None)
    count = view({"": RecordFile(growing, live=True)}, tmp_path / "g.rrd", (0, 0), print, Ended())
    followed = Seeing(tmp_path / "g.rrd")
    assert count == sum(item.topic == CYCLE.topic for item in scan(record))
    for entity in ("/game/pursuer", "/game/evader"):
        times, places = followed.of(entity, "positions")
        assert (times, places) == seen[0].of(entity, "positions")
    # Shown piece by piece, not at the end
    assert len(followed.of("/game/pursuer/track", "strips")[0]) > 20


def test_reruns_own_reader_of_mcap_finds_every_message_of_the_record(record):
    """An independent reader, of whose authors none is ours nor of the library that wrote it."""
    counts = Counter()
    for chunk in McapReader(str(record)).stream():
        if "McapMessage:data" in chunk.to_record_batch().schema.names:
            counts[chunk.entity_path.removeprefix("/")] += chunk.num_rows
    assert counts == survey_of(record).messages


def test_a_second_flight_in_a_record_begins_anew(record, tmp_path):
    """Catches curves of a flight that go on into the next."""
    recording = rr.RecordingStream("guidance")
    recording.set_sinks(rr.FileSink(tmp_path / "two.rrd"))
    painter = Painter(recording, Aggregator(recorded_settings, metadata_of(record), "two"))
    for _ in range(2):
        for item in scan(record):
            painter.take(item)
    painter.flush()
    recording.disconnect()
    _, cleared = Seeing(tmp_path / "two.rrd").of("/game/isochron", "is_recursive")
    assert len(cleared) == 2
    # Both flights fall on the same times: each number is there twice, counted from its own engagement.
    _, guarantee = Seeing(tmp_path / "two.rrd").of("/plots/guarantee/value", "scalars")
    assert len(guarantee) > 200
    assert guarantee[0::2] == guarantee[1::2]


def test_a_configuration_that_is_read_again_is_drawn_from_then_on(record, tmp_path):
    """The stand-off disc of a daemon that read another one is as wide as that says."""
    file = Path(__file__).parents[2] / "config" / "vehicles" / "px4.toml"
    config = load(Config, file)
    wider = config.model_copy(
        update={"game": config.game.model_copy(update={"standoff_radius_m": 11.0})}
    )
    recording = rr.RecordingStream("guidance")
    recording.set_sinks(rr.FileSink(tmp_path / "again.rrd"))
    painter = Painter(
        recording, Aggregator(recorded_settings, {"config": config.model_dump_json()}, "again")
    )
    cycles = [item for item in scan(record) if item.topic == CYCLE.topic]
    played = next(number for number, item in enumerate(cycles) if b'"certificate"' in item.data)
    painter.take(cycles[played])
    reloaded = {"now_s": cycles[played].now_s, "event": RELOADED, "detail": wider.model_dump_json()}
    painter.take(Item(reloaded["now_s"], EVENT.topic, "json", json.dumps(reloaded).encode()))
    painter.take(cycles[played + 50])
    painter.flush()
    recording.disconnect()
    seen = Seeing(tmp_path / "again.rrd")
    _, strips = seen.of("/game/stand_off_disc", "strips")
    widths = [np.ptp(np.array(strip)[:, 0]) / 2.0 for (strip,) in strips]
    assert widths == pytest.approx([config.game.standoff_radius_m, 11.0], rel=1e-3)
    # The whole file is no event's text
    assert [text for (text,) in seen.of("/events", "text")[1]] == [RELOADED]


def test_without_rerun_the_extra_is_named(record, monkeypatch, tmp_path):
    monkeypatch.setattr("guidance.extras.find_spec", lambda _: None)
    for words in (["view", str(record), "--save", str(tmp_path / "a.rrd")], ["fly", "--view"]):
        run = CliRunner().invoke(app, words)
        assert isinstance(run.exception, ConfigError)
        assert "pip install 'pursuit-guidance[viz]'" in str(run.exception)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ([], "give either the FILE"),
        (["RECORD", "--live"], "give either the FILE"),
        (["RECORD", "--save", "RECORD/x.rrd"], "cannot be written"),
        (["nothing.mcap"], "nothing.mcap: cannot be read"),
    ],
)
def test_what_cannot_be_shown_is_refused_by_name(record, words, what):
    run = CliRunner().invoke(
        app, ["view", *(word.replace("RECORD", str(record)) for word in words)]
    )
    assert isinstance(run.exception, OutputError if "--save" in words else ConfigError)
    assert what in str(run.exception)


@pytest.mark.parametrize("option", ["--port", "--web-port"])
def test_a_port_out_of_range_is_refused_by_name(record, option):
    run = CliRunner().invoke(app, ["view", str(record), option, "70000"])
    assert run.exit_code == 2
    assert f"'{option}': Input should be less than or equal to 65535" in run.output
