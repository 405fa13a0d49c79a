"""Scripts: equal seeds give equal bytes, times and events are as written, and errors name key and value."""

import itertools
from pathlib import Path

import pytest

from sitl_mock import ConfigError, MockVehicle
from sitl_mock.faults import KINDS, Faulted, parse_script, read_script
from sitl_mock.tables import REQUIRED

EXAMPLES = Path(__file__).parents[3] / "config" / "faults"

WILD = [
    {"kind": "loss", "probability": 0.2, "direction": "both"},
    {"kind": "reorder", "probability": 0.2},
    {"kind": "duplicate", "probability": 0.2, "late_s": 0.05},
    {"kind": "corrupt", "probability": 0.1},
    {"kind": "gusts", "after": "AIRBORNE"},
    {"kind": "sysid_clash", "at_s": 1.0},
    {"kind": "statustext", "at_s": 2.0},
    {"kind": "foreign_heartbeat"},
]


def bytes_of(rig, seed):
    flight = rig(*WILD, seed=seed, noise=True, texts=True)
    flight.run(1.5)
    for _ in range(8):
        flight.command(400, 1.0)
        flight.command(22)
    flight.run(10.0)
    return [frame for _, frame in flight.frames]


def test_equal_seed_and_script_give_equal_bytes_and_another_seed_others(rig):
    """Catches randomness outside of the seed, in any fault."""
    first = bytes_of(rig, 1)
    assert bytes_of(rig, 1) == first
    assert bytes_of(rig, 2) != first
    assert len(first) > 4000


def test_without_faults_a_vehicle_sends_the_very_bytes_of_a_vehicle(rig):
    plain = MockVehicle("px4", seed=3)
    wrapped = Faulted(MockVehicle("px4", seed=3))
    for count in range(400):
        assert wrapped.step(count * 0.02) == plain.step(count * 0.02)


def test_a_fault_that_is_over_leaves_no_trace(rig):
    struck = rig({"kind": "loss", "for_s": 1.0}).run(1.0)
    whole = rig().run(1.0)
    for flight in (struck, whole):
        flight.frames.clear()
        flight.run(3.0)
    assert [frame for _, frame in struck.frames] == [frame for _, frame in whole.frames]


def test_an_event_starts_a_fault_the_first_time_only(rig):
    flight = rig({"kind": "telemetry_freeze", "after": "ARMED", "at_s": 0.5, "for_s": 1.0}).run(1.5)
    for expected in (1.0, 0.0):
        flight.command(400, 1.0)
        armed_s = flight.now_s
        flight.run(3.0)
        times = [armed_s, *(t for t, _ in flight.all("ATTITUDE", armed_s))]
        gap_s = max(b - a for a, b in itertools.pairwise(times))
        assert gap_s == pytest.approx(max(expected, 0.02), abs=0.03)
        flight.command(400, 0.0)


@pytest.mark.parametrize("event", ["READY", "ARMED", "AIRBORNE", "TAKEOFF"])
def test_events_are_noticed_when_they_come(rig, event):
    flight = rig({"kind": "silence", "after": event, "for_s": 0.5}).run(0.4)
    assert flight.faulted.faults()[0]["state"] == "waiting"
    flight.run(1.2)
    flight.command(400, 1.0)
    flight.run(0.6)
    flight.command(22)
    flight.run(6.0)
    assert flight.faulted.faults() == ()


def test_faults_of_one_vehicle_leave_the_others_alone(rig):
    fault = {"kind": "silence", "vehicle": ["uav2", "uav3"]}
    assert rig(fault, name="uav1").run(1.0).heard
    assert not rig(fault, name="uav2").run(1.0).heard


def test_faults_of_one_link_leave_the_other_alone():
    script = parse_script({"fault": [{"kind": "loss", "link": "gcs"}]})
    links = {"onboard": "onboard", "gcs": "gcs"}
    both = Faulted(MockVehicle("px4", links=links), "uav1", script)
    said = [both.step_links(count * 0.1, {}) for count in range(20)]
    assert any(each["onboard"] for each in said)
    assert not any(each["gcs"] for each in said)


def test_faults_come_and_go_while_it_runs(rig):
    flight = rig().run(1.0)
    number = flight.faulted.inject({"kind": "loss", "messages": ["ATTITUDE"], "at_s": 0.5})
    assert flight.faulted.faults()[0] == {
        "number": number,
        "kind": "loss",
        "state": "waiting",
        "after": "",
        "at_s": 0.5,
        "for_s": None,
        "probability": 1.0,
        "direction": "both",
        "messages": ["ATTITUDE"],
    }
    flight.run(1.0)
    assert flight.faulted.faults()[0]["state"] == "acting"
    assert len(flight.all("ATTITUDE", 1.02, 1.5)) > 40
    assert not flight.all("ATTITUDE", 1.52)
    flight.faulted.clear(number)
    flight.run(1.0)
    assert flight.all("ATTITUDE", 2.04)
    assert flight.faulted.faults() == ()


def test_clearing_ends_what_a_fault_has_done_to_the_vehicle(rig):
    flight = rig({"kind": "gps_loss"}, {"kind": "loss"}).run(2.0)
    assert flight.vehicle.autopilot.conditions.gps_lost
    flight.faulted.clear()
    flight.run(0.5)
    assert not flight.vehicle.autopilot.conditions.gps_lost


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kind": "los"}, ["fault[0].kind", "'los'", "heartbeat_gap"]),
        ({}, ["fault[0].kind", "None"]),
        ({"kind": "target_slow"}, ["fault[0].kind", "use evader_slow, its new name"]),
        ({"kind": ["loss"]}, ["fault[0].kind", "['loss']"]),
        ({"kind": "loss", "probability": 1.5}, ["fault[0].probability", "1.5", "from 0 to 1"]),
        ({"kind": "loss", "probability": True}, ["probability", "True"]),
        ({"kind": "loss", "probability": "x"}, ["probability", "'x'"]),
        ({"kind": "loss", "probabilty": 0.5}, ["fault[0].probabilty", "0.5", "probability"]),
        ({"kind": "loss", "direction": "up"}, ["direction", "'up'", "out, in, both"]),
        ({"kind": "loss", "messages": ["HEARTBET"]}, ["messages", "HEARTBET", "COMMAND_ACK"]),
        ({"kind": "loss", "messages": 5}, ["messages", "5"]),
        ({"kind": "loss", "link": "radio"}, ["link", "'radio'", "onboard, gcs"]),
        ({"kind": "loss", "at_s": -1}, ["at_s", "-1"]),
        ({"kind": "loss", "at_s": float("nan")}, ["at_s", "nan"]),
        ({"kind": "loss", "for_s": "long"}, ["for_s", "'long'"]),
        ({"kind": "ack_wrong"}, ["fault[0].result", "missing"]),
        ({"kind": "ack_wrong", "result": 2.5}, ["result", "2.5", "0 to 255"]),
        ({"kind": "ack_lost", "messages": ["HEARTBEAT"]}, ["messages", "HEARTBEAT"]),
        ({"kind": "ack_lost", "commands": [400, "arm"]}, ["commands", "arm", "65535"]),
        ({"kind": "wind_gust", "direction": "in"}, ["direction", "no such key"]),
        ({"kind": "bad_fields", "value": "minus"}, ["value", "minus", "int_max"]),
        ({"kind": "corrupt", "bits": 4}, ["bits", "4", "from 1 to 3"]),
        ("loss", ["fault[0]", "'loss'", "table"]),
    ],
)
def test_what_is_wrong_is_named_with_its_value_and_what_is_allowed(values, words):
    with pytest.raises(ConfigError) as caught:
        parse_script({"fault": [values]}, "faults.toml")
    for word in ["faults.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (
            {"kind": "loss", "after": "OFBOARD"},
            ["fault[0].after", "'OFBOARD'", "ARMED", "OFFBOARD"],
        ),
        ({"kind": "pilot_mode", "mode": "LOITER"}, ["fault[0].mode", "'LOITER'", "POSCTL"]),
        (
            {"kind": "param_echo", "parameter": "NOPE", "value": 1},
            ["fault[0].parameter", "'NOPE'", "px4"],
        ),
        (
            {"kind": "bad_fields", "messages": ["ATTITUDE"], "fields": ["x"]},
            ["fault[0].fields", "'x'", "ATTITUDE"],
        ),
        (
            {"kind": "bad_fields", "fields": ["lat"], "value": "nan"},
            ["fault[0].fields", "'lat'", "int_max"],
        ),
    ],
)
def test_what_a_vehicle_does_not_have_is_refused_before_it_flies(rig, fault, words):
    with pytest.raises(ConfigError) as caught:
        rig(fault)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = -1", ["seed", "-1"]),
        ("speed = 3", ["speed", "3", "[[fault]]"]),
        ("fault = 3", ["fault", "3", "[[fault]]"]),
        ("[[fault]", ["faults.toml"]),
    ],
)
def test_a_file_that_is_no_script_is_refused(tmp_path, text, words):
    path = tmp_path / "faults.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_script(path)
    for word in words:
        assert word in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"nothing\.toml"):
        read_script(tmp_path / "nothing.toml")


def test_a_vehicle_that_is_not_in_the_fleet_is_named():
    script = parse_script({"fault": [{"kind": "loss"}, {"kind": "loss", "vehicle": "uav9"}]})
    with pytest.raises(ConfigError, match=r"fault\[1\]\.vehicle = 'uav9'.*uav1, uav2"):
        script.check_vehicles(["uav1", "uav2"])


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_examples_are_scripts_for_a_px4_and_a_rover(path):
    script = read_script(path)
    assert script.faults
    for name, flavour in (("uav1", "px4"), ("evader", "rover")):
        if flavour == "px4" or path.stem == "wayward-evader":
            Faulted(MockVehicle(flavour), name, script).step(0.0)


def test_every_default_passes_its_own_check():
    for kind in KINDS.values():
        for option in kind.options.values():
            if option.default not in (REQUIRED, frozenset()):
                assert option.check(option.default) == option.default


def test_the_command_line_lists_every_kind_with_its_meaning_and_keys():
    from typer.testing import CliRunner

    from sitl_mock.cli import app

    told = CliRunner().invoke(app, ["list", "faults"]).output
    for name, kind in KINDS.items():
        assert name in told
        assert kind.meaning in told
        for key in kind.options:
            assert key in told


def test_a_faults_file_that_is_wrong_ends_the_command_before_anything_is_opened(tmp_path):
    from typer.testing import CliRunner

    from sitl_mock.cli import app

    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\nkind = "loss"\nprobability = 7\n')
    result = CliRunner().invoke(app, ["run", "--udp", "21000", "--faults", str(path)])
    assert isinstance(result.exception, ConfigError)
    assert "probability = 7" in str(result.exception)
