"""A fleet's configuration and its vehicles."""

import pytest

from sitl_mock import ConfigError
from sitl_mock.faults.script import read_script
from sitl_mock.mavlink import Encoder
from sitl_mock.serving.fleet import (
    build,
    checked_fleet,
    parse_vehicles,
    read_fleet,
    with_parameters,
)


def fleet(*vehicles, **more):
    return checked_fleet({"vehicle": list(vehicles), **more}, "test")


def test_a_number_of_vehicles_gets_names_and_system_ids_in_order():
    vehicles = build(fleet(*parse_vehicles(["20"], "px4")))
    assert list(vehicles) == [f"uav{number}" for number in range(1, 21)]
    assert [vehicle.system_id for vehicle in vehicles.values()] == list(range(1, 21))


def test_each_vehicle_may_be_named_with_flavour_and_place():
    px4, rover = parse_vehicles(["px4:uav1", "rover:evader@30,-4.5,0"], "px4")
    vehicles = build(fleet(px4, rover))
    assert vehicles["uav1"].flavour == "px4"
    assert vehicles["evader"].flavour == "rover"
    kinds = [vehicle["flavour"] for vehicle in parse_vehicles(["px4,px4@1.18", "rover"], "px4")]
    assert kinds == ["px4", "px4@1.18", "rover"]
    assert checked_fleet({"vehicle": [rover]}, "test").vehicle[0].start_ned_m == (30.0, -4.5, 0.0)


def test_free_system_ids_go_round_those_that_are_given():
    vehicles = build(fleet({"name": "a"}, {"name": "b", "system_id": 1}, {"name": "c"}))
    assert {name: each.system_id for name, each in vehicles.items()} == {"a": 2, "b": 1, "c": 3}


def test_every_vehicle_of_a_fleet_has_noise_of_its_own():
    one, two = build(fleet({"name": "a"}, {"name": "b"})).values()
    assert one.autopilot.settings.seed != two.autopilot.settings.seed


@pytest.mark.parametrize(
    ("vehicles", "named"),
    [
        ([{"name": "a", "flavor": "px4"}], "vehicle.0.flavor"),
        ([{"name": "a"}, {"name": "a"}], "'a' is given twice"),
        ([{"name": "a", "system_id": 256}], "vehicle.0.system_id = 256"),
        ([{"name": "a/b"}], "vehicle.0.name = 'a/b'"),
        ([], "vehicle"),
    ],
)
def test_a_wrong_key_or_value_is_named(vehicles, named):
    with pytest.raises(ConfigError, match=named):
        fleet(*vehicles)


def test_system_ids_that_are_given_may_be_equal_as_ardupilots_instances_are():
    vehicles = build(
        fleet({"name": "a", "system_id": 1}, {"name": "b", "system_id": 1}, {"name": "c"})
    )
    assert [vehicle.system_id for vehicle in vehicles.values()] == [1, 1, 2]


@pytest.mark.parametrize(("required", "armed"), [(True, False), (False, True)])
def test_a_vehicle_may_sign_and_may_refuse_what_is_not_signed(required, armed):
    signing = {"key_hex": "ab" * 32, "required": required}
    vehicle = build(fleet({"name": "a", "ready_after_s": 0.1, "signing": signing}))["a"]
    frames = vehicle.step(0.0) + vehicle.step(0.5)
    assert all(frame[2] & 1 for frame in frames), "signed"
    vehicle.step(0.5, [Encoder(255, 190).pack("COMMAND_LONG", 1, 1, 400, 0, 1.0, *[0.0] * 6)])
    assert vehicle.armed == armed
    with pytest.raises(ConfigError, match=r"signing\.key_hex"):
        fleet({"name": "a", "signing": {"key_hex": "abc"}})


def test_an_unknown_parameter_is_refused_by_name():
    with pytest.raises(ConfigError, match="COM_OF_LOSS"):
        build(fleet({"name": "a", "parameters": {"COM_OF_LOSS": 1.0}}))


@pytest.mark.parametrize("spec", ["px5", "px4:", "-3"])
def test_a_spec_that_is_none_says_what_is_allowed(spec):
    with pytest.raises(ConfigError, match="flavour:name"):
        parse_vehicles([spec], "px4")


def test_named_vehicles_between_commas_are_shown_one_by_one():
    with pytest.raises(
        ConfigError, match=r"one by one: --vehicles px4:uav1@1,2,3 --vehicles rover:rover1$"
    ):
        parse_vehicles(["px4:uav1@1,2,3,rover:rover1"], "px4")
    with pytest.raises(ConfigError, match=r"--vehicles px4:uav1 --vehicles rover:rover1$"):
        parse_vehicles(["px4:uav1,rover:rover1"], "px4")


def test_a_parameter_of_one_flavour_is_no_parameter_of_a_mixed_fleet():
    mixed = fleet(
        {"name": "a"}, {"name": "b", "flavour": "rover"}, {"name": "c", "flavour": "px4@1.18"}
    )
    with pytest.raises(
        ConfigError,
        match=r"b is of flavour rover, .* write --param a:MIS_TAKEOFF_ALT=3 --param c:MIS_TAKEOFF_ALT=3$",
    ):
        with_parameters(mixed, ["MIS_TAKEOFF_ALT=3"])
    given = with_parameters(mixed, ["a:MIS_TAKEOFF_ALT=3", "c:MIS_TAKEOFF_ALT=3"])
    assert [vehicle.parameters for vehicle in given.vehicle] == [
        {"MIS_TAKEOFF_ALT": 3.0},
        {},
        {"MIS_TAKEOFF_ALT": 3.0},
    ]
    with pytest.raises(ConfigError, match="list parameters --flavour rover` names them"):
        with_parameters(mixed, ["b:MIS_TAKEOFF_ALT=3"])


def test_a_file_is_read_and_a_missing_or_broken_one_is_named(tmp_path):
    path = tmp_path / "fleet.toml"
    path.write_text(
        "seed = 3\n[home]\nlat_deg = 10.0\nlon_deg = 20.0\nalt_amsl_m = 5.0\n"
        "[[vehicle]]\nname = 'uav1'\nstart_ned_m = [1.0, 2.0, 0.0]\n[vehicle.parameters]\nCOM_OF_LOSS_T = 2.0\n"
    )
    vehicle = build(read_fleet(path))["uav1"]
    assert vehicle.autopilot.parameters["COM_OF_LOSS_T"] == 2.0
    assert vehicle.autopilot.frame.origin.lat_deg == pytest.approx(10.0, abs=1e-4)
    path.write_text("seed = ")
    with pytest.raises(ConfigError, match=r"fleet\.toml"):
        read_fleet(path)
    with pytest.raises(ConfigError, match=r"missing\.toml"):
        read_fleet(tmp_path / "missing.toml")


@pytest.mark.parametrize("value", ["[" * 100_000 + "]" * 100_000, "9" * 100_000, "[1,"])
@pytest.mark.parametrize("read", [read_fleet, read_script])
def test_a_file_that_is_no_toml_is_named_and_no_traceback(read, value, tmp_path):
    path = tmp_path / "given.toml"
    path.write_text(f"vehicle = {value}")
    with pytest.raises(ConfigError, match=r"file .*given\.toml: not valid TOML"):
        read(path)
