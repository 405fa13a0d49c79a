"""Keys of a scenario file: courses, sensors, faults, expectations, and the published schema."""

import copy
import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from mcap.writer import Writer

from guidance.config import config_folder, parse_document
from guidance.errors import ConfigError
from guidance.log.entries import CYCLE
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_document, load_scenario, read_track, scenario_schema

DATA = Path(__file__).parents[1] / "data"
SHORT = tomllib.loads((DATA / "short_chase.toml").read_text())


def built(**sections):
    document = copy.deepcopy(SHORT)
    for name, values in sections.items():
        document[name] = (
            {**document.get(name, {}), **values} if isinstance(values, dict) else values
        )
    return parse_document(Scenario, document, source="a.toml")


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"evader": {"policy": "waypoints"}}, "waypoints_m: missing with policy = 'waypoints'"),
        (
            {"evader": {"waypoints_m": [[1.0, 2.0]]}},
            "waypoints_m: not allowed with policy = 'optimal'",
        ),
        (
            {"pursuer": {"policy": "waypoints", "waypoints_m": [[1.0, 2.0]]}},
            "every point needs x, y and z",
        ),
        ({"evader": {"policy": "recorded"}}, "track: missing"),
        (
            {
                "evader": {
                    "policy": "recorded",
                    "track": [[0, 0, 0, 0], [4, 12, 0, 0], [20, 90, 0, 0]],
                }
            },
            "track: from 0 to 20 s it needs 4.5 m/s, but speed_m_s = ",
        ),
        ({"site": {"latitude_deg": 0.0, "longitude_deg": 0.0}}, "no position is known in MAVLink"),
        ({"evader": {"policy": "recorded", "track": [[0.0, 1.0, 1.0, 0.0]]}}, "at least two rows"),
        (
            {
                "evader": {
                    "policy": "recorded",
                    "track": [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]],
                }
            },
            "increasing times",
        ),
        (
            {"evader": {"policy": "task_oriented"}},
            "evader.policy = 'task_oriented': needs target.position_m",
        ),
        ({"evader": {"declared_speed_m_s": 9.0}}, "evader.declared_speed_m_s"),
        ({"wind": {"velocity_m_s": [2.0, 0.0]}}, "with 2 m/s of wind"),
        ({"envelope": {"speed_m_s": 5.0}}, "envelope: was renamed to limits"),
        ({"sensor": {"rate_hz": 0.0}}, "sensor.rate_hz = 0.0: must be greater than 0"),
        ({"sensor": {"latency": 0.1}}, "sensor.latency: unknown key; did you mean 'latency_s'?"),
        ({"sensor": {"outages_s": [[3.0, 2.0]]}}, "must be [from, to]"),
        ({"sensor": {"dropout": 1.0}}, "sensor.dropout = 1.0"),
        ({"fault": [{"kind": "loss", "after": "lunch"}]}, "fault.0.after = 'lunch'"),
        ({"expect": {"capture_time_s": {"min": 3.0, "max": 2.0}}}, "min = 3 is above max = 2"),
        ({"expect": {"capture_time_s": {}}}, "give min, max or both"),
        (
            {"expect": {"end": "yielded", "capture_time_s": {"max": 2.0}}},
            "contradicts expect.end = 'yielded'",
        ),
        ({"expect": {"end": "arrived"}}, 'game = "pe" has no place to arrive at'),
        (
            {"expect": {"end": "captured", "winner": "evader"}},
            "contradicts expect.end = 'captured': pursuer wins",
        ),
        ({"expect": {"flown": {"end": "captured", "winner": "none"}}}, "contradicts expect.end"),
        ({"expect": {"capture_times": {"max": 2.0}}}, "did you mean 'capture_time_s'?"),
        ({"expect": {"events": ["target lost"]}}, "'target lost' is named 'evader lost' now"),
    ],
)
def test_a_wrong_or_contradictory_key_is_named_with_what_is_allowed(sections, message):
    with pytest.raises(ConfigError) as caught:
        built(**sections)
    assert message in str(caught.value)


def test_an_expectation_that_fails_is_the_one_that_is_told():
    scenario = built(
        expect={
            "end": "captured",
            "capture_time_s": {"max": 0.5},
            "maths": {"regret": {"max": 1e-6}},
            "events": ["x"],
        }
    )
    verdicts = list(scenario.expect.verdicts(play_scenarios([scenario])[0]._asdict()))
    assert {(verdict.column, verdict.held) for verdict in verdicts} == {
        ("end", True),
        ("capture_time_s", False),
        ("regret", True),
        ("events", False),
    }


def test_what_is_expected_of_flights_is_not_asked_of_mathematics():
    scenario = built(expect={"flown": {"end": "yielded"}})
    outcome = play_scenarios([scenario])[0]
    assert list(scenario.expect.verdicts(outcome._asdict())) == []
    assert [
        verdict.held for verdict in scenario.expect.verdicts(outcome._replace(run="fast")._asdict())
    ] == [False]


def test_no_number_meets_no_range():
    scenario = built(expect={"maths": {"distance_to_disc_m": {"min": -1e9, "max": 1e9}}})
    outcome = play_scenarios([scenario])[0]
    assert next(scenario.expect.verdicts(outcome._asdict())).held
    assert not next(
        scenario.expect.verdicts(outcome._replace(distance_to_disc_m=float("nan"))._asdict())
    ).held


def test_a_track_is_read_from_a_csv_beside_the_scenario(tmp_path):
    (tmp_path / "walk.csv").write_text("t_s,x_m,y_m\n0,0,0\n10,8,6\n")
    path = tmp_path / "a.toml"
    text = (
        (DATA / "short_chase.toml")
        .read_text()
        .replace("[evader]", '[evader]\npolicy = "recorded"\ntrack = "walk.csv"')
    )
    path.write_text(text)
    assert load_scenario(str(path))[1].evader.track == ((0.0, 0.0, 0.0, 0.0), (10.0, 8.0, 6.0, 0.0))


def test_the_byte_order_mark_of_a_spreadsheet_and_blank_lines_do_not_spoil_a_track(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("\ufefft_s, x_m, y_m, z_m\r\n0,0,20,\r\n\r\n1,1,20,3\r\n", encoding="utf-8")
    rows = read_track(path, "evader", key="evader.track")
    assert rows == [(0.0, 0.0, 20.0, 0.0), (1.0, 1.0, 20.0, 3.0)]


def record_with(path, certificates):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("guidance.Cycle", "jsonschema", b"{}")
        channel = writer.register_channel(CYCLE.topic, "json", schema)
        for index, certificate in enumerate(certificates):
            row = {
                "now_s": 0.1 * index,
                **({} if certificate is None else {"certificate": certificate}),
            }
            writer.add_message(channel, 0, json.dumps(row).encode(), 0)
        writer.finish()


def test_a_track_is_read_from_a_flights_record(tmp_path):
    certificates = [
        {"pursuer_game_m": [0.1 * k, 0.0, 9.0], "evader_game_m": [0.0, 0.1 * k, 0.0]}
        for k in range(10)
    ]
    record_with(tmp_path / "flight.mcap", [None, *certificates])
    path = tmp_path / "a.toml"
    for player, first, last in (
        ("evader", (0.1, 0, 0, 0), (0.9, 0, 0.8, 0)),
        ("pursuer", (0.1, 0, 0, 9), (0.9, 0.8, 0, 9)),
    ):
        inserted = f'[{player}]\npolicy = "recorded"\ntrack = "flight.mcap"'
        path.write_text((DATA / "short_chase.toml").read_text().replace(f"[{player}]", inserted))
        track = getattr(load_scenario(str(path))[1], player).track
        assert len(track) == 5
        assert track[0] == pytest.approx(first)
        assert track[-1] == pytest.approx(last)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("walk.csv", None, "cannot be read"),
        ("walk.csv", "t_s,x_m\n0,0\n", "column y_m is missing"),
        ("walk.csv", "t_s,x_m,y_m\n0,0,0\n", "a track needs 2 at least"),
        ("walk.csv", "t_s,x_m,y_m\n0,0,nan\n1,1,1\n", "not finite"),
        ("walk.csv", "t_s,x_m,y_m\n0,0,east\n1,1,1\n", "is no track"),
        (
            "walk.csv",
            "t_s,x_m,y_m\n0,0,20\n1,1\n",
            "walk.csv is no track: row 3: 2 values for 3 columns",
        ),
        ("walk.csv", "t_s,x_m,y_m\n0,0,20\n1,1\n", "no value for y_m"),
        ("walk.csv", "t_s,x_m,y_m\n0,0,20\n1,1,20,7\n", "row 3: 4 values for 3 columns"),
        ("walk.csv", "t_s,x_m,y_m,x_m\n0,0,20,0\n", "row 1: column x_m is there 2 times"),
        ("walk.csv", "t_s,x_m,y_m\n0,0,20\n1,,20\n", "row 3, column x_m: '' is not a number"),
        (
            "walk.csv",
            "# by hand\nt_s,x_m,y_m\n0,0,20\n",
            "row 1: column t_s is missing; found '# by hand'",
        ),
        ("walk.csv", 't_s,x_m,y_m\n0,0,"20\n1,1,20\n', "row "),
        ("walk.txt", "", "allowed are a .csv"),
        ("walk.mcap", "no record", "not an MCAP file"),
    ],
)
def test_a_file_that_is_no_track_is_named_with_what_is_needed(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    path = tmp_path / "a.toml"
    path.write_text(f'[evader]\npolicy = "recorded"\ntrack = "{name}"\n')
    with pytest.raises(ConfigError) as caught:
        load_document(path)
    assert message in str(caught.value)
    assert "evader.track" in str(caught.value)


def test_the_published_schema_is_valid_and_accepts_every_scenario_that_comes_along():
    schema = scenario_schema()
    validator = jsonschema.Draft202012Validator(schema)
    jsonschema.Draft202012Validator.check_schema(schema)
    for path in sorted((config_folder() / "scenarios").glob("*.toml")):
        validator.validate(tomllib.loads(path.read_text()))
    wrong = {**SHORT, "evader": {**SHORT["evader"], "speed_m_s": -1.0}}
    assert not validator.is_valid(wrong)
    assert not validator.is_valid({**SHORT, "pursuit": {}})
    assert validator.is_valid(
        {**SHORT, "evader": {**SHORT["evader"], "policy": "recorded", "track": "a.csv"}}
    )


def test_every_length_time_speed_and_angle_of_the_schema_says_its_unit():
    unitless = {
        "tolerance",
        "dropout",
        "seed",
        "navigation_gain",
        "ratio",
        "alarms",
        "track",
        "regret",
        "policy",
        "hysteresis",
    }
    for section in [scenario_schema(), *scenario_schema()["$defs"].values()]:
        for key, value in section.get("properties", {}).items():
            if (
                '"number"' in json.dumps(value)
                and "$ref" not in json.dumps(value)
                and key not in {"min", "max"}
            ):
                assert key in unitless or key.endswith(("_m", "_s", "_s2", "_deg", "_hz")), key


def test_a_column_of_an_older_version_is_ignored_if_empty_and_else_names_the_new_one():
    assert built(expect={"maths": {"achieved": None}}).expect == built().expect
    with pytest.raises(ConfigError, match="achieved is named capture_time_s"):
        built(expect={"maths": {"achieved": {"max": 1.0}}})
