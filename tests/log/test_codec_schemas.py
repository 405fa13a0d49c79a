"""Every message matches the schema of its channel, and viewers can read the schemas."""

import json
import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from guidance.clock import Timing
from guidance.cycle import Alarm, Certificate
from guidance.frames import Ned
from guidance.log import cycles_of, reports_of, scan
from guidance.log.codec import Codec, form_of
from guidance.log.entries import CYCLE, EVENT, REPORT, Item
from guidance.log.scene import FIX, POSE, POSE_EVERY_S, SCENE, disc, time_of
from guidance.messages import Datum, EvaderReport, GlobalPosition, Message, Request, Setpoint

SCHEMAS = {
    one["title"]: one for one in (CYCLE.schema, EVENT.schema, REPORT.schema, FIX, POSE, SCENE)
}
SETPOINT = Codec("setpoint", Setpoint)
RECORDED = (
    *get_args(Message),
    EvaderReport,
    Setpoint,
    Certificate,
    Alarm,
    Timing,
    *get_args(Request),
)


def as_a_viewer_reads(schema):
    """Check the rule of the schema readers of Foxglove and Lichtblick: one plain type at every depth."""
    assert schema["type"] == "object"
    for name, field in schema["properties"].items():
        kind = field["type"]
        inner = field["items"] if kind == "array" else field
        assert inner["type"] in {"boolean", "string", "number", "integer", "object"}, name
        if inner["type"] == "object":
            as_a_viewer_reads(inner)


@pytest.fixture(scope="module")
def channels(flight):
    """Topic -> (schema's name, schema, messages as bytes) of every JSON channel."""
    found = {}
    with flight[1].open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding == "json":
                if channel.topic not in found:
                    assert schema.encoding == "jsonschema"
                    found[channel.topic] = (schema.name, json.loads(schema.data), [])
                found[channel.topic][2].append(message.data)
    return found


def test_every_message_of_a_flight_matches_the_schema_of_its_channel(channels):
    """Catches a field that is recorded and not in its schema."""
    names = {name for name, _, _ in channels.values()}
    assert names == SCHEMAS.keys()
    for topic, (_, schema, messages) in channels.items():
        Draft202012Validator.check_schema(schema)
        validator = Draft202012Validator(schema)
        every = max(1, len(messages) // 300)
        for message in map(json.loads, messages[::every]):
            assert (topic, [error.message for error in validator.iter_errors(message)]) == (
                topic,
                [],
            )


@pytest.mark.parametrize("name", SCHEMAS)
def test_viewers_can_read_every_schema(name):
    as_a_viewer_reads(SCHEMAS[name])


def test_every_field_of_inputs_and_certificate_is_described():
    cycle = CYCLE.schema["properties"]
    assert cycle["certificate"]["properties"].keys() == set(Certificate._fields)
    messages = cycle["inputs"]["properties"]["messages"]["items"]["properties"]
    assert messages.keys() == {"kind"}.union(*(kind._fields for kind in get_args(Message)))
    assert messages["kind"]["enum"] == [kind.__name__ for kind in get_args(Message)]
    assert cycle["setpoint"]["properties"]["velocity_ned_m_s"]["items"] == {"type": "number"}


@pytest.mark.parametrize("damage", ["text", "unknown", "missing", "long", "null"])
def test_a_damaged_message_does_not_match_the_schema(channels, damage):
    _, schema, messages = channels[CYCLE.topic]
    cycle = next(message for message in map(json.loads, messages) if "certificate" in message)
    certificate = cycle["certificate"]
    assert Draft202012Validator(schema).is_valid(cycle)
    match damage:
        case "text":
            certificate["value"] = "1.5"
        case "unknown":
            certificate["valve"] = 1.5
        case "missing":
            del certificate["winner"]
        case "long":
            certificate["pursuer_game_m"].append(0.0)
        case "null":
            certificate["value"] = None
    assert not Draft202012Validator(schema).is_valid(cycle)


numbers = st.floats() | st.just(math.nan)


@given(st.tuples(numbers, numbers, numbers), numbers)
def test_nan_and_infinity_are_left_out_as_the_schema_allows(velocity, yaw_rad):
    setpoint = json.loads(SETPOINT.encode(Setpoint(Ned(velocity), yaw_rad=yaw_rad)))
    assert Draft202012Validator(SETPOINT.schema).is_valid(setpoint)
    assert ("yaw_rad" in setpoint) == math.isfinite(yaw_rad)
    assert setpoint["velocity_ned_m_s"] == [one if math.isfinite(one) else None for one in velocity]


def test_defaults_of_recorded_types_are_none_or_nan():
    """An absent field is read as its default, whichever that is."""
    defaults = [
        (kind.__name__, field, value)
        for kind in RECORDED
        for field, value in kind._field_defaults.items()
    ]
    assert [one for one in defaults if one[2] is not None and one[2] == one[2]] == []


@pytest.mark.parametrize("kind", [dict, float | str])
def test_a_type_that_viewers_cannot_read_is_refused(kind):
    with pytest.raises(TypeError, match="viewers cannot read"):
        form_of(kind)


def json_of(item: Item):
    return json.loads(item.data)


def test_evader_reports_have_a_channel_with_both_clocks_and_the_datum(flight):
    items = [item for item in scan(flight[1]) if item.topic == REPORT.topic]
    read = [report for row in cycles_of(flight[1]) for report in row.inputs.reports]
    assert len(items) == len(read) > 100
    assert repr(list(reports_of(flight[1]))) == repr(read)
    for item, report in zip(items, read, strict=True):
        said = json_of(item)
        assert item.now_s == pytest.approx(report.received_s, abs=1e-9)
        assert (said["received_s"], said["sent_s"]) == (report.received_s, report.sent_s)
        assert said["said"] == {"altitude_m": report.altitude_amsl_m, "datum": Datum.AMSL}


def test_the_map_shows_both_reported_positions_ten_times_a_second(flight):
    fixes = {name: [] for name in ("pursuer", "evader")}
    for item in scan(flight[1]):
        if item.topic.startswith("guidance/map/"):
            said = json_of(item)
            assert item.topic.endswith(said["frame_id"])
            fixes[said["frame_id"]].append(
                (said["timestamp"], said["latitude"], said["longitude"], said["altitude"])
            )
    heard = {
        tuple(time_of(message.received_s).values()): message
        for row in cycles_of(flight[1])
        for message in row.inputs.messages
        if isinstance(message, GlobalPosition)
    }
    for stamp, latitude, longitude, altitude in fixes["pursuer"]:
        there = heard[stamp["sec"], stamp["nsec"]]
        assert (latitude, longitude, altitude) == (
            there.latitude_deg,
            there.longitude_deg,
            there.altitude_amsl_m,
        )
    for places in fixes.values():
        times_s = [stamp["sec"] + 1e-9 * stamp["nsec"] for stamp, *_ in places]
        apart_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
        assert 0.9 * POSE_EVERY_S <= apart_s <= 0.25


def test_the_scene_shows_the_positions_of_the_certificate(flight):
    """Catches a picture of the game that differs from its certificate."""
    rows = {round(row.now_s * 1e9): row for row in cycles_of(flight[1])}
    seen = 0
    for item in scan(flight[1]):
        if item.topic != "guidance/scene":
            continue
        (entity,) = json_of(item)["entities"]
        certificate = rows[round(item.now_s * 1e9)].certificate
        centres = [tuple(sphere["pose"]["position"].values()) for sphere in entity["spheres"]]
        assert centres == [
            certificate.pursuer_game_m,
            certificate.evader_game_m,
            certificate.meeting_point_game_m,
        ]
        rim = [tuple(point.values()) for point in entity["lines"][0]["points"]]
        assert rim == list(disc(certificate))
        seen += 1
    assert seen > 20


def test_the_rim_of_the_disc_is_at_stand_off_distance_from_the_evader(flight):
    row = next(row for row in cycles_of(flight[1]) if row.certificate is not None)
    x, y, _ = row.certificate.evader_game_m
    standoff = flight[0].scenario.standoff
    for corner in disc(row.certificate):
        assert math.hypot(corner[0] - x, corner[1] - y) == pytest.approx(standoff.radius_m)
