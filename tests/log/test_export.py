"""Every export is read with an independent tool and compared with the record."""

import csv
import itertools
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import geojson
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from pyarrow import parquet
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as dialect
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.control import Limits
from guidance.control.polygon import Polygon
from guidance.errors import ConfigError, OutputError
from guidance.flight import State
from guidance.frames import Amsl, Enu, LocalFrame, Ned
from guidance.log import Aggregator, cycles_of, metadata_of, reports_of, scan, survey_of
from guidance.log.entries import REPORT
from guidance.log.export import (
    EXPORTS,
    export,
    feature,
    features_of,
    kml,
    started_unix_s,
    write_tlog,
)
from guidance.log.export import geojson as written
from guidance.log.scene import fence_edges
from guidance.log.writer import Recorder
from guidance.messages import GlobalPosition, Home, LocalPosition
from guidance.session.flight_files import recorded_settings


@pytest.fixture(scope="module")
def exported(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    for suffix in EXPORTS:
        export(flight[1], folder / f"flight{suffix}", recorded_settings)
    return folder


@pytest.fixture(scope="module")
def rows(flight):
    return list(cycles_of(flight[1]))


@pytest.fixture(scope="module")
def frames(flight):
    """Return `count` frames of the record from `begin`; a function, because hypothesis would print a list."""
    all_of_them = [frame for _, frame in frames_of(flight[1])]
    return lambda begin, count: all_of_them[begin : begin + count]


def frames_of(path):
    return [(item.now_s, item.data) for item in scan(path) if item.encoding == "mavlink"]


def test_the_mcap_library_reads_the_record_itself(flight):
    """Catches a record that only our own reader understands."""
    with flight[1].open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        count = sum(1 for _ in reader.iter_messages())
        schemas = reader.get_summary().schemas.values()
    assert count == sum(survey_of(flight[1]).messages.values())
    assert {schema.encoding for schema in schemas} == {"jsonschema"}
    assert all(json.loads(schema.data)["type"] == "object" for schema in schemas)


def test_pymavlink_reads_every_frame_of_the_tlog_in_time_order(flight, exported):
    """Catches frames of a tlog that are lost, altered or out of order."""
    link = mavutil.mavlink_connection(str(exported / "flight.tlog"))
    read = []
    while (message := link.recv_msg()) is not None:
        read.append((message._timestamp, bytes(message.get_msgbuf())))
    link.close()
    recorded = sorted(frames_of(flight[1]), key=lambda frame: frame[0])
    assert [frame for _, frame in read] == [frame for _, frame in recorded]
    assert [stamp for stamp, _ in read] == pytest.approx([now_s for now_s, _ in recorded], abs=1e-6)


def test_mavlogdump_prints_every_setpoint_sent(flight, exported):
    """Catches a tlog that pymavlink's own program reads with frames missing."""
    script = Path(sys.executable).with_name("mavlogdump.py")
    command = [
        sys.executable,
        "-W",
        "ignore",
        str(script),
        "--types",
        "SET_POSITION_TARGET_LOCAL_NED",
    ]
    done = subprocess.run(
        [*command, "--format", "json", str(exported / "flight.tlog")],
        capture_output=True,
        text=True,
        check=True,
    )
    said = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    to_pursuer = [one for one in said if one["data"]["target_system"] == 1]
    assert len(to_pursuer) == flight[0].setpoints_sent


@pytest.fixture(scope="module")
def columns(exported):
    """The Parquet file's columns by name, with None where a cell is empty."""
    return parquet.read_table(exported / "flight.parquet").to_pydict()


def numbers(cells):
    return np.array(cells, dtype=float)


def test_the_parquet_holds_the_rows_bit_for_bit(columns, rows):
    """Catches a number that an export rounds."""
    assert columns["now_s"] == [row.now_s for row in rows]
    assert columns["state"] == [row.state for row in rows]
    for name, value in (
        (
            "setpoint_velocity_east_m_s",
            lambda row: row.setpoint and row.setpoint.velocity_ned_m_s[1],
        ),
        ("game_value", lambda row: row.certificate and row.certificate.value),
        ("game_pursuer_up_m", lambda row: row.certificate and row.certificate.pursuer_game_m[2]),
    ):
        np.testing.assert_array_equal(numbers(columns[name]), numbers([value(row) for row in rows]))


def test_a_column_keeps_its_value_until_the_next_message(columns, rows):
    north_m = math.nan
    expected = []
    for row in rows:
        for message in row.inputs.messages:
            north_m = message.position_ned_m[0] if isinstance(message, LocalPosition) else north_m
        expected.append(north_m)
    np.testing.assert_array_equal(numbers(columns["vehicle_position_north_m"]), expected)


def test_evader_columns_hold_the_report_with_both_clocks_and_the_datum(columns, flight):
    reports = {report.received_s: report for report in reports_of(flight[1])}
    names = [
        f"evader_{name}"
        for name in ("received_s", "sent_s", "source", "said_altitude_m", "said_datum")
    ]
    told = [
        cells
        for cells in zip(*(columns[name] for name in names), strict=True)
        if cells[0] is not None
    ]
    assert len(told) > 100
    for received_s, *cells in told:
        report = reports[received_s]
        assert tuple(cells) == (report.sent_s, report.source, *report.said)


def test_a_number_of_the_csv_shows_whether_its_column_has_fractions(exported, columns):
    with (exported / "flight.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    floats = {name for name, cells in columns.items() if any(type(cell) is float for cell in cells)}
    assert len(floats) > 50
    for row in rows:
        assert all(not row[name] or set(row[name]) & set(".en") for name in floats)


def test_the_csv_holds_the_same_as_the_parquet(exported, columns):
    with (exported / "flight.csv").open(newline="") as file:
        from_csv = list(csv.DictReader(file))
    assert list(from_csv[0]) == list(columns)
    for name, cells in columns.items():
        texts = [row[name] for row in from_csv]
        if all(cell is None or type(cell) in {int, float} for cell in cells):
            np.testing.assert_array_equal(
                numbers([text or math.nan for text in texts]), numbers(cells)
            )
        else:
            assert [text.lower() for text in texts] == [
                "" if cell is None else str(cell).lower() for cell in cells
            ]


def test_a_geojson_reader_finds_valid_shapes_at_the_flown_positions(exported, rows):
    collection = geojson.loads((exported / "flight.geojson").read_text())
    assert collection.is_valid, collection.errors()
    by_name = {feature.properties["name"]: feature for feature in collection.features}
    track = by_name["pursuer"]
    said = [
        (message.longitude_deg, message.latitude_deg, message.altitude_amsl_m)
        for row in rows
        for message in row.inputs.messages
        if isinstance(message, GlobalPosition)
    ]
    np.testing.assert_allclose(
        np.array(track.geometry.coordinates), np.array(said), atol=1e-3, rtol=0
    )
    assert len(track.properties["times_s"]) == len(said)
    assert {State.CLIMBING, State.ENGAGED, State.ON_STATION, State.LANDED} <= by_name.keys()
    assert by_name["evader (GLOBAL_POSITION_INT)"].geometry.type == "LineString"
    fence = by_name["fence"].geometry.coordinates[0]
    assert fence[0] == fence[-1]
    area = sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise(fence))
    assert area > 0.0  # anticlockwise, as RFC 7946 requires
    north = max(corner[1] for corner in fence) - min(corner[1] for corner in fence)
    assert math.radians(north) * 6371000.0 == pytest.approx(2.0 * 300.0, rel=0.01)


def test_the_kml_is_well_formed_and_has_the_same_places(exported):
    root = ElementTree.parse(exported / "flight.kml").getroot()
    space = {"k": "http://www.opengis.net/kml/2.2"}
    marks = root.findall(".//k:Placemark", space)
    features = json.loads((exported / "flight.geojson").read_text())["features"]
    assert [mark.findtext("k:name", namespaces=space) for mark in marks] == [
        one["properties"]["name"] for one in features
    ]
    for mark, one in zip(marks, features, strict=True):
        said = [
            [float(part) for part in place.split(",")]
            for place in mark.findtext(".//k:coordinates", namespaces=space).split()
        ]
        kind = one["geometry"]["type"]
        coordinates = one["geometry"]["coordinates"]
        assert said == {"Point": [coordinates], "Polygon": coordinates[0]}.get(kind, coordinates)


def test_an_unknown_altitude_is_left_out_of_a_place():
    place = feature("evader", "Point", [(8.0, 47.0, math.nan)])
    assert json.loads(written([place], "t"))["features"][0]["geometry"]["coordinates"] == [
        8.0,
        47.0,
    ]


@given(cuts=st.lists(st.integers(1, 60), min_size=1, max_size=20), begin=st.integers(0, 1000))
def test_a_byte_stream_cut_anywhere_is_written_as_whole_frames(
    frames, tmp_path_factory, cuts, begin
):
    # pymavlink cannot check a message that it does not know (EVENT): in a stream it looks like garbage.
    sent = [
        one
        for one in frames(begin, 12)
        if int.from_bytes(one[7:10], "little") in dialect.mavlink_map
    ]
    stream = b"".join(sent)
    path = tmp_path_factory.mktemp("stream") / "stream.mcap"
    recorder = Recorder(path, {})
    position = 0
    while position < len(stream):
        length = cuts[position % len(cuts)]
        recorder.frames([(1.0, "uav/mavlink_raw/out", stream[position : position + length])])
        position += length
    recorder.close()
    out = path.with_suffix(".tlog")
    assert write_tlog(path, out) == len(sent)
    data = out.read_bytes()
    stamp = (1_000_000).to_bytes(8, "big")
    assert data == b"".join(stamp + frame for frame in sent)


def test_the_log_begins_at_the_utc_start_of_the_record(flight, tmp_path):
    path = tmp_path / "dated.mcap"
    recorder = Recorder(path, {"started_utc": "2026-03-01T12:00:00+00:00"})
    recorder.frames([(2.5, "uav/mavlink_raw/out", frames_of(flight[1])[0][1])])
    recorder.close()
    write_tlog(path, tmp_path / "dated.tlog")
    assert (
        int.from_bytes((tmp_path / "dated.tlog").read_bytes()[:8], "big") == 1_772_366_402_500_000
    )
    survey = survey_of(path)
    survey.metadata["started_utc"] = "yesterday"
    assert started_unix_s(survey.metadata) == 0.0


def test_an_unknown_ending_or_an_unwritable_path_is_refused(flight, tmp_path):
    with pytest.raises(ConfigError, match=r"flight\.bin: must end in \.tlog, \.csv"):
        export(flight[1], tmp_path / "flight.bin", recorded_settings)
    (tmp_path / "file").write_text("")
    for suffix in EXPORTS:
        with pytest.raises(OutputError, match="cannot be written"):
            export(flight[1], tmp_path / "file" / f"flight{suffix}", recorded_settings)


def test_the_log_commands_show_the_content_of_a_record(flight, tmp_path):
    """Catches a count or a datum that `log info` tells otherwise than the record."""
    runner = CliRunner()
    info = runner.invoke(app, ["log", "info", str(flight[1])], env={"COLUMNS": "200"})
    assert info.exit_code == 0, info.output
    assert "pursuer/mavlink_raw/in" in info.output
    assert "whole" in info.output
    count = survey_of(flight[1]).messages[REPORT.topic]
    words = "reports of the evader by GLOBAL_POSITION_INT, altitudes amsl, with the sender's clock"
    assert f"{count} {words}" in info.output
    events = runner.invoke(app, ["log", "events", str(flight[1])])
    assert events.output.splitlines()[-1].rstrip().endswith(" landing -> landed")
    done = runner.invoke(app, ["log", "export", str(flight[1]), str(tmp_path / "a" / "b.csv")])
    assert f"{flight[0].cycles} cycles" in done.output
    assert metadata_of(flight[1])["seed"] == str(flight[0].scenario.seed)


SQUARE_NE_M = ((-50.0, -40.0), (-50.0, 60.0), (50.0, 60.0), (50.0, -40.0))


@pytest.mark.parametrize("given", ["metres", "degrees", "the other way round"])
def test_a_polygon_fence_is_on_the_map_in_metres_or_degrees(flight, given):
    """Catches a fence of a map that is elsewhere or runs the wrong way round."""
    settings = recorded_settings(metadata_of(flight[1]))
    before_start = itertools.takewhile(lambda row: row.state != State.ARMING, cycles_of(flight[1]))
    homes = [
        message
        for row in before_start
        for message in row.inputs.messages
        if isinstance(message, Home)
    ]
    home = homes[-1]  # fixed as the flight is accepted
    frame = LocalFrame(
        home.latitude_deg, home.longitude_deg, Amsl(0.0), projection=settings.autopilot.projection
    )
    corners_deg = tuple(frame.wgs84_from_ned(Ned((*corner, 0.0)))[:2] for corner in SQUARE_NE_M)
    if given == "metres":
        cycle = replace(
            settings.cycle,
            envelope=replace(settings.cycle.envelope, fence_polygon=Polygon(SQUARE_NE_M)),
        )
        settings = settings.model_copy(update={"cycle": cycle})
    else:
        corners = corners_deg if given == "degrees" else corners_deg[::-1]
        settings = settings.model_copy(update={"limits": Limits(fence_polygon_deg=corners)})
    fences = [
        one for one in features_of(flight[1], settings) if one["properties"]["name"] == "fence"
    ]
    (edge,) = fences[-1]["geometry"]["coordinates"]
    drawn = {(latitude, longitude) for longitude, latitude, _ in edge}
    assert drawn == {
        (round(latitude, 8), round(longitude, 8)) for latitude, longitude in corners_deg
    }
    assert edge[0] == edge[-1]
    # Anticlockwise
    assert sum(a[0] * b[1] - b[0] * a[1] for a, b in itertools.pairwise(edge)) > 0.0
    aggregator = Aggregator(lambda _: settings, {}, "test")
    for item in itertools.islice(scan(flight[1]), 10_000):
        aggregator.take(item)
    (edge,) = fence_edges(replace(aggregator.envelope, fence_radius_m=None), Enu((0.0, 0.0, 0.0)))
    drawn_ne_m = {(round(north, 3) + 0.0, round(east, 3) + 0.0) for east, north, _ in edge}
    assert drawn_ne_m == set(SQUARE_NE_M)


@pytest.mark.parametrize("suffix", EXPORTS)
def test_an_export_is_private_and_never_follows_a_symbolic_link(flight, tmp_path, suffix):
    theirs = tmp_path / "theirs"
    theirs.write_text("theirs")
    out = tmp_path / f"flight{suffix}"
    out.symlink_to(theirs)
    with pytest.raises(OutputError, match="symbolic link"):
        export(flight[1], out, recorded_settings)
    assert theirs.read_text() == "theirs"
    out.unlink()
    export(flight[1], out, recorded_settings)
    assert out.stat().st_mode & 0o777 == 0o600


def test_shapes_across_the_date_line_are_cut_in_both_formats():
    ring = [(179.9, 0.0, 5.0), (179.9, 0.1, 5.0), (-179.9, 0.1, 5.0), (-179.9, 0.0, 5.0)]
    features = [
        feature("fence", "Polygon", [*ring, ring[0]]),
        feature("pursuer", "LineString", [(179.9, 0.0, 5.0), (-179.9, 0.0, 5.0)]),
    ]
    fence, track = geojson.loads(written(features, "flight")).features
    assert (fence.geometry.type, track.geometry.type) == ("MultiPolygon", "MultiLineString")
    assert fence.is_valid
    assert track.is_valid
    root = ElementTree.fromstring(kml(features, "flight"))
    space = {"k": "http://www.opengis.net/kml/2.2"}
    assert len(root.findall(".//k:MultiGeometry/k:Polygon", space)) == 2
    assert len(root.findall(".//k:MultiGeometry/k:LineString", space)) == 2
