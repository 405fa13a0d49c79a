"""Versions of the autopilots: names, units and limits of parameters, commands and messages that differ."""

import json

import pytest
from typer.testing import CliRunner

from sitl_mock.cli import app
from sitl_mock.differences import differences_of
from sitl_mock.errors import ConfigError
from sitl_mock.flavours import flavour_named
from sitl_mock.serving.fleet import parse_vehicles
from sitl_mock.versions import SPECS, VERSIONS
from tests.harness.client import Flight

ACCEPTED = 0
UNSUPPORTED = 3
FAILED = 4
GROUND = (255, 190)


def read(flight, name):
    """The value of a parameter over MAVLink; None without an answer."""
    before = len(flight.all("PARAM_VALUE"))
    flight.send("PARAM_REQUEST_READ", 1, 1, name, -1)
    flight.run(0.1)
    answers = [m for _, m in flight.all("PARAM_VALUE")[before:] if m.param_id == name]
    return answers[-1].param_value if answers else None


def test_a_name_without_a_version_is_the_recorded_one():
    for name, versions in VERSIONS.items():
        assert flavour_named(name) == flavour_named(f"{name}@{versions[0]}")
        assert flavour_named(name).version == versions[0]


def test_an_unknown_version_is_refused_with_the_allowed_ones():
    with pytest.raises(ConfigError, match=r"px4@1\.17, px4@1\.18"):
        flavour_named("px4@2.0")


@pytest.mark.parametrize("spec", ["px4@1.18", "arducopter@4.7"])
def test_autopilot_version_tells_the_version(spec):
    flight = fly_version(spec)
    flight.command(512, 148.0)
    version = flight.last("AUTOPILOT_VERSION").flight_sw_version
    major, minor = spec.partition("@")[2].split(".")
    assert (version >> 24, version >> 16 & 0xFF) == (int(major), int(minor))


def fly_version(spec, **settings):
    """A stepped flight of a version."""
    flight = Flight(spec.partition("@")[0], spec=spec, **settings)
    return flight.run(1.0)


def test_arducopter_4_7_has_the_new_names_and_units_only(fly):
    recorded = fly("arducopter").run(1.0)
    later = fly_version("arducopter@4.7")
    for old, new, value in (
        ("RTL_ALT", "RTL_ALT_M", 15.0),
        ("WPNAV_SPEED", "WP_SPD", 10.0),
        ("ANGLE_MAX", "ATC_ANGLE_MAX", 30.0),
        ("LAND_SPEED", "LAND_SPD_MS", 0.5),
        ("SYSID_THISMAV", "MAV_SYSID", 1.0),
        ("PSC_VELXY_P", "PSC_NE_VEL_P", 2.0),
        ("PSC_ACCZ_P", "PSC_D_ACC_P", 0.05),
        ("SR0_POSITION", "MAV1_POSITION", 0.0),
        ("GPS_TYPE", "GPS1_TYPE", 1.0),
    ):
        assert read(recorded, new) is None, new
        assert read(recorded, old) is not None, old
        assert read(later, old) is None, old
        assert read(later, new) == pytest.approx(value), new


def test_arducopter_4_7_flies_by_its_own_parameters():
    flight = fly_version("arducopter@4.7", parameters={"WP_SPD": 3.0}).airborne(height=10.0)
    lat, lon, _ = flight.vehicle.autopilot.frame.to_geodetic(40.0, 0.0, 0.0)
    flight.send(
        "SET_POSITION_TARGET_GLOBAL_INT",
        *(0, 1, 1, 6, 3576, round(lat * 1e7), round(lon * 1e7), 10.0),
        *[0.0] * 8,
    )
    flight.run(8.0)
    assert flight.velocity[0] == pytest.approx(3.0, abs=0.1)


def test_the_versions_of_arducopter_fly_alike(fly):
    flights = [fly("arducopter"), fly_version("arducopter@4.7")]
    places = []
    for flight in flights:
        flight.run(1.0 if flight is flights[0] else 0.0)
        flight.airborne(height=8.0)
        flight.run(3.0)
        places.append(flight.position)
    assert places[0] == pytest.approx(places[1], abs=1e-6)


def test_arducopter_4_7_skips_the_checks_of_arming_skipchk():
    for skipped, result in ((0.0, FAILED), (-1.0, ACCEPTED)):
        flight = fly_version("arducopter@4.7", parameters={"ARMING_SKIPCHK": skipped})
        flight.send("PARAM_SET", 1, 1, "ATC_ANGLE_MAX", 5.0, 9)
        assert flight.guided() == [ACCEPTED]
        assert flight.command(400, 1.0) == [result]


@pytest.mark.parametrize(
    ("spec", "results"),
    [
        ("px4@1.17", (ACCEPTED, ACCEPTED, UNSUPPORTED)),
        ("px4@1.18", (UNSUPPORTED, UNSUPPORTED, ACCEPTED)),
    ],
)
def test_commands_of_px4_come_and_go_with_the_version(spec, results):
    flight = fly_version(spec)
    answers = [flight.command(number, 1.0) for number in (410, 520)]
    answers.append(flight.command_int(611, 0, x=473_900_000, y=85_400_000, z=480.0))
    assert answers == [[result] for result in results]


@pytest.mark.parametrize(
    ("spec", "results"),
    [("arducopter@4.5", (UNSUPPORTED, FAILED)), ("arducopter@4.7", (ACCEPTED, ACCEPTED))],
)
def test_commands_of_arducopter_come_with_the_version(spec, results):
    flight = fly_version(spec)
    assert [flight.command(5300, 1.0), flight.command(512, 435.0)] == [[one] for one in results]


@pytest.mark.parametrize(("speed", "taken_over"), [(1.0, True), (-1.0, False), (100.0, False)])
def test_px4_1_18_is_overridden_by_fast_sticks(ned_velocity, speed, taken_over):
    flight = fly_version(
        "px4@1.18", source=GROUND, parameters={"MAN_OVERRIDE_SPD": speed, "COM_RC_IN_MODE": 1}
    ).airborne(height=8.0)
    stream = ned_velocity(0.0, 0.0, 0.0)
    flight.offboard(stream)

    def sticks(pitch):
        flight.send("MANUAL_CONTROL", 1, pitch, 0, 500, 0, *[0] * 11)
        flight.run(0.1, stream)

    for pitch in range(0, 300, 10):  # slowly
        sticks(pitch)
    assert flight.mode == "OFFBOARD"
    sticks(900)
    sticks(900)
    assert (flight.mode == "POSCTL") is taken_over


def test_differences_name_what_a_client_must_change():
    found = {
        (each.subject, each.first, each.second) for each in differences_of("px4@1.17", "px4@1.18")
    }
    assert ("parameter", "COM_RC_OVERRIDE = 1", "") in found
    assert ("parameter", "", "MAN_OVERRIDE_SPD = 1 1/s") in found
    assert ("command", "410 MAV_CMD_GET_HOME_POSITION", "") in found
    assert ("message", "GNSS_INTEGRITY", "") in found
    later = differences_of("arducopter@4.5", "arducopter@4.7")
    (height,) = [each for each in later if each.first.startswith("RTL_ALT =")]
    assert height[1:] == ("RTL_ALT = 1500 cm", "RTL_ALT_M = 15 m", "value × 0.01")
    assert ("mission item", "", "195 MAV_CMD_DO_SET_ROI_LOCATION", "") in later


def test_differences_are_the_same_backwards():
    there = differences_of("arducopter@4.5", "arducopter@4.7")
    back = differences_of("arducopter@4.7", "arducopter@4.5")
    assert {(each.subject, each.second, each.first) for each in back} == {
        (each.subject, each.first, each.second) for each in there
    }
    assert differences_of("px4", "px4@1.17") == []


def test_versions_are_listed_and_compared_on_the_command_line():
    listed = CliRunner().invoke(app, ["versions"]).output
    assert all(spec in listed for spec in SPECS)
    result = CliRunner().invoke(app, ["versions", "px4@1.17", "px4@1.18", "--json"])
    assert {"subject", "first", "second", "note"} == set(json.loads(result.output)[0])
    assert "COM_RC_OVERRIDE" in CliRunner().invoke(app, ["versions", "px4@1.18"]).output
    wrong = CliRunner().invoke(app, ["versions", "px4@1.17", "rover@4.5"])
    assert isinstance(wrong.exception, ConfigError)


def test_a_fleet_of_versions_needs_no_names():
    assert parse_vehicles(["px4@1.17,px4@1.18,arducopter@4.7"], "px4") == [
        {"name": "uav1", "flavour": "px4@1.17"},
        {"name": "uav2", "flavour": "px4@1.18"},
        {"name": "uav3", "flavour": "arducopter@4.7"},
    ]
    assert parse_vehicles(["px4@1.18:a@1,2,3"], "px4") == [
        {"name": "a", "flavour": "px4@1.18", "start_ned_m": [1.0, 2.0, 3.0]}
    ]


@pytest.mark.mock_versions("px4", "arducopter@4.7")
def test_a_clients_test_runs_once_per_version(mock_flavour, mock_vehicle):
    vehicle = mock_vehicle.stepped(mock_flavour, ready_after_s=0.5)
    assert mock_flavour in {"px4@1.17", "px4@1.18", "arducopter@4.7"}
    assert vehicle.step(1.0)
