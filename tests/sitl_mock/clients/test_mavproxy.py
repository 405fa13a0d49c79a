"""MAVProxy, scripted by its standard input: both flavours armed, flown, their parameters and plans listed."""

import struct
import time

import pytest

from tests.sitl_mock.flights.mavproxy import Proxy

pytestmark = pytest.mark.slow
SPEED = 3.0
"""Of the vehicles' time; MAVProxy waits for messages only."""


@pytest.fixture
def proxy(tmp_path):
    """``proxy(vehicle)`` starts MAVProxy on a vehicle."""
    started = []

    def start(vehicle):
        started.append(Proxy(vehicle.udp_port, tmp_path, "cmdlong,param,arm,mode,wp,fence,log,ftp"))
        return started[-1]

    yield start
    for each in started:
        each.close()


def test_arducopter_is_flown_by_mavproxy(fleet_of, proxy):
    with fleet_of({"copter": "arducopter"}, over=["udp"], speed=SPEED) as fleet:
        mav = proxy(fleet["copter"])
        mav.expect("Detected vehicle 1:1", 30.0)  # it takes long to start on a busy machine
        assert mav.expect_number(r"Received (\d+)", 20.0) == 1390, "by FTP, in one file"
        mav.say("param set GUID_TIMEOUT 2.5")
        time.sleep(0.5)
        mav.say("param show GUID_TIMEOUT")
        mav.expect("2.5")
        mav.say("wp list")
        mav.expect("Requesting 0 waypoints")
        mav.say("fence list")
        mav.expect("Requesting 0 fence items")
        mav.say("log list")
        mav.expect("No logs")
        mav.say("ftp list")
        mav.expect("D terrain")
        mav.say("long MAV_CMD_SET_MESSAGE_INTERVAL 33 200000 0 0 0 0 0")  # GLOBAL_POSITION_INT
        mav.expect("SET_MESSAGE_INTERVAL: ACCEPTED")
        mav.say("mode GUIDED")
        mav.expect("DO_SET_MODE: ACCEPTED")
        mav.expect("Mode GUIDED")
        mav.say("arm throttle")
        mav.expect("COMPONENT_ARM_DISARM: ACCEPTED")
        mav.expect("ARMED")
        mav.say("takeoff 3")
        mav.expect("NAV_TAKEOFF: ACCEPTED")
        assert mav.climbed(1.0)
        mav.say("disarm")
        mav.expect("COMPONENT_ARM_DISARM: FAILED")
        mav.say("mode LAND")
        mav.expect("Mode LAND")
        mav.expect("DISARMED", 20.0)


def test_px4_is_armed_and_flown_by_mavproxy(fleet_of, proxy):
    with fleet_of({"uav1": "px4"}, over=["udp"], speed=SPEED) as fleet:
        mav = proxy(fleet["uav1"])
        mav.expect("Detected vehicle 1:1", 30.0)  # it takes long to start on a busy machine
        assert mav.expect_number(r"Received (\d+)", 20.0) == 887
        mav.say("param show COM_OF_LOSS_T")
        mav.expect("COM_OF_LOSS_T    1.0")
        mav.say("param set COM_OBL_RC_ACT 5")
        time.sleep(0.5)
        mav.say("param show COM_OBL_RC_ACT")
        # MAVProxy shows PX4's whole numbers as floats
        (bits,) = struct.unpack("<f", struct.pack("<i", 5))
        mav.expect(f"COM_OBL_RC_ACT   {bits}")
        mav.say("wp list")
        mav.expect("Requesting 0 waypoints")
        mav.say("long MAV_CMD_NAV_TAKEOFF 0 0 0 nan nan nan nan")
        mav.expect("NAV_TAKEOFF: ACCEPTED")
        mav.say("arm throttle")
        mav.expect("COMPONENT_ARM_DISARM: ACCEPTED")
        mav.expect("ARMED")
        assert mav.climbed(1.0)
        mav.say("disarm")
        mav.expect("COMPONENT_ARM_DISARM: TEMPORARILY_REJECTED")
        mav.say("long MAV_CMD_NAV_LAND 0 0 0 nan nan nan nan")
        mav.expect("NAV_LAND: ACCEPTED")
        mav.expect("DISARMED", 20.0)
