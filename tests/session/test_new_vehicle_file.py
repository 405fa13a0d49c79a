"""`guidance init`: a vehicle file for the autopilot that is there, never looser than what it told."""

import tomllib

import pytest
from typer.testing import CliRunner

from guidance.autopilots import AUTOPILOTS
from guidance.cli.program import app
from guidance.config import parse_document
from guidance.errors import ConfigError, LinkError
from guidance.links.opening import Found
from guidance.session.open.discovery import (
    Surveyed,
    bound_parameters,
    survey,
    vehicle_file,
    write_new,
)
from guidance.session.vehicle_file import Config, load_vehicle

QUADROTOR = 2
PX4 = 12
ARDUPILOT = 3


def read_file(text):
    return parse_document(Config, tomllib.loads(text), source="written")


def px4(**parameters):
    told = {"MPC_XY_VEL_MAX": 12.0, "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5} | parameters
    return Surveyed("px4", Found(7, 1, PX4, QUADROTOR), told, AUTOPILOTS["px4"].versions[0])


def test_what_the_autopilot_allows_less_of_is_less_in_the_file():
    surveyed = px4(
        MPC_XY_VEL_MAX=4.4, MPC_Z_VEL_MAX_DN=0.7, GF_MAX_HOR_DIST=120.0, GF_MAX_VER_DIST=40.0
    )
    config = read_file(
        vehicle_file("px4", name="uav7", url="serial:///dev/ttyACM0:921600", surveyed=surveyed)
    )
    assert (config.name, config.vehicle.system_id, config.vehicle.url) == (
        "uav7",
        7,
        "serial:///dev/ttyACM0:921600",
    )
    assert (config.game.speed_m_s, config.game.descent_m_s) == (4.0, 0.6)
    assert (config.limits.fence_radius_m, config.limits.ceiling_m) == (115.0, 35.0)
    assert config.speed_limits.speed_m_s <= 4.4 + 1e-9
    # 3 m/s are allowed, and more than the file's own is not taken
    assert config.game.climb_m_s == 2.0


def test_a_slow_and_low_vehicle_gets_a_game_that_it_can_play():
    surveyed = px4(MPC_XY_VEL_MAX=2.2, GF_MAX_VER_DIST=14.0)
    config = read_file(vehicle_file("px4", name="slow", surveyed=surveyed))
    assert config.game.evader_speed_m_s < config.game.speed_m_s == 2.0
    assert config.flight.takeoff_height_m <= config.limits.ceiling_m == 9.0


def test_centimetres_are_read_as_such_and_a_fence_that_is_off_is_said():
    told = {
        "WPNAV_SPEED": 500.0,
        "WPNAV_SPEED_UP": 250.0,
        "WPNAV_SPEED_DN": 150.0,
        "FENCE_RADIUS": 150.0,
    }
    surveyed = Surveyed(
        "arducopter", Found(1, 1, ARDUPILOT, QUADROTOR), told, AUTOPILOTS["arducopter"].versions[0]
    )
    config = read_file(vehicle_file("arducopter", name="uav1", surveyed=surveyed))
    assert (config.game.speed_m_s, config.game.descent_m_s, config.limits.fence_radius_m) == (
        4.5,
        1.3,
        145.0,
    )
    text = vehicle_file("px4", name="uav1", surveyed=px4(GF_MAX_HOR_DIST=0.0))
    assert "GF_MAX_HOR_DIST is 0, which is off: guidance check refuses" in text
    assert "#   GF_MAX_VER_DIST    not read" in text


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_without_a_vehicle_the_file_is_the_one_that_comes_along(autopilot, tmp_path):
    out = tmp_path / "uav.toml"
    done = CliRunner().invoke(app, ["init", "--autopilot", autopilot, "--out", str(out)])
    assert done.exit_code == 0
    assert f"guidance check {out}" in done.stdout
    assert load_vehicle(out).vehicle.autopilot == autopilot


def test_nothing_is_overwritten_and_nothing_is_guessed(tmp_path):
    out = tmp_path / "uav.toml"
    write_new(out, "mine")
    with pytest.raises(ConfigError, match="exists and is not overwritten"):
        write_new(out, "another")
    assert out.read_text() == "mine"
    with pytest.raises(ConfigError, match="allowed are px4, arducopter"):
        vehicle_file("betaflight", name="uav1")
    with pytest.raises(ConfigError, match="name"):
        vehicle_file("px4", name="my uav")
    with pytest.raises(ConfigError, match="no autopilot given"):
        CliRunner().invoke(app, ["init", "--out", str(tmp_path / "b.toml")], catch_exceptions=False)


@pytest.mark.slow
@pytest.mark.parametrize("flavour", AUTOPILOTS)
def test_the_limits_of_a_vehicle_that_runs_are_read(flavour, mock_vehicle):
    vehicle = mock_vehicle(flavour, over=["udp"], ready_after_s=0.5)
    surveyed = survey(vehicle.udp)
    assert surveyed.autopilot == flavour
    assert set(surveyed.parameters) == set(bound_parameters(AUTOPILOTS[flavour].versions[0]))
    assert (
        read_file(
            vehicle_file(flavour, name="uav1", url=vehicle.udp, surveyed=surveyed)
        ).vehicle.url
        == vehicle.udp
    )
    with pytest.raises(ConfigError, match="not --autopilot"):
        survey(vehicle.udp, "arducopter" if flavour == "px4" else "px4")


def test_a_port_where_nobody_is_is_said(monkeypatch):
    monkeypatch.setattr("guidance.session.open.discovery.FOUND_WITHIN_S", 0.2)
    with pytest.raises(LinkError, match="no autopilot's HEARTBEAT"):
        survey("udpout://127.0.0.1:9")
