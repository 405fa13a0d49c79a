"""MAVProxy, scripted by its standard input: both flavours armed, flown, their parameters and plans listed."""

import os
import queue
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

MAVPROXY = Path(sys.executable).with_name("mavproxy.py")


class Proxy:
    """One MAVProxy process; its words come line by line. It ends when its standard input does."""

    def __init__(self, port, folder):
        command = [sys.executable, str(MAVPROXY), f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={folder}"]
        command += [f"--logfile={folder}/flight.tlog", "--default-modules=cmdlong,param,arm,mode,wp,fence"]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "TERM": "dumb"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._lines = queue.Queue()
        self.heard = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line.strip())

    def say(self, command):
        """Type a command."""
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()

    def expect(self, words, within_s=6.0):
        """Wait for a line with these words."""
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            try:
                line = self._lines.get(timeout=0.1)
            except queue.Empty:
                continue
            self.heard.append(line)
            if words in line:
                return line
        raise AssertionError(f"MAVProxy did not say {words!r}; it said {self.heard[-15:]}")

    def close(self):
        """End it."""
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        self.process.stdout.close()


@pytest.fixture
def proxy(tmp_path):
    """``proxy(vehicle)`` starts MAVProxy on a vehicle."""
    started = []

    def start(vehicle):
        started.append(Proxy(vehicle.udp_port, tmp_path))
        return started[-1]

    yield start
    for each in started:
        each.close()


def test_arducopter_is_flown_by_mavproxy(fleet_of, proxy):
    with fleet_of({"copter": "arducopter"}, over=["udp"]) as fleet:
        mav = proxy(fleet["copter"])
        mav.expect("Detected vehicle 1:1")
        assert int(mav.expect("Received", 20.0).split()[1]) == 1390, "by FTP, in one file"
        mav.say("param set GUID_TIMEOUT 2.5")
        time.sleep(0.5)
        mav.say("param show GUID_TIMEOUT")
        mav.expect("2.5")
        mav.say("wp list")
        mav.expect("Requesting 0 waypoints")
        mav.say("fence list")
        mav.expect("Requesting 0 fence items")
        mav.say("mode GUIDED")
        mav.expect("DO_SET_MODE: ACCEPTED")
        mav.expect("Mode GUIDED")
        mav.say("arm throttle")
        mav.expect("COMPONENT_ARM_DISARM: ACCEPTED")
        mav.expect("ARMED")
        mav.say("takeoff 3")
        mav.expect("NAV_TAKEOFF: ACCEPTED")
        time.sleep(2.0)
        mav.say("disarm")
        mav.expect("COMPONENT_ARM_DISARM: FAILED")
        mav.say("mode LAND")
        mav.expect("Mode LAND")
        mav.expect("DISARMED", 20.0)


def test_px4_is_armed_and_flown_by_mavproxy(fleet_of, proxy):
    with fleet_of({"uav1": "px4"}, over=["udp"]) as fleet:
        mav = proxy(fleet["uav1"])
        mav.expect("Detected vehicle 1:1")
        assert int(mav.expect("Received", 20.0).split()[1]) == 887
        mav.say("param show COM_OF_LOSS_T")
        mav.expect("COM_OF_LOSS_T    1.0")
        mav.say("param set COM_OBL_RC_ACT 5")
        time.sleep(0.5)
        mav.say("param show COM_OBL_RC_ACT")
        mav.expect("COM_OBL_RC_ACT   5")
        mav.say("wp list")
        mav.expect("Requesting 0 waypoints")
        mav.say("long MAV_CMD_NAV_TAKEOFF 0 0 0 nan nan nan nan")
        mav.expect("NAV_TAKEOFF: ACCEPTED")
        mav.say("arm throttle")
        mav.expect("COMPONENT_ARM_DISARM: ACCEPTED")
        mav.expect("ARMED")
        time.sleep(2.0)
        mav.say("disarm")
        mav.expect("COMPONENT_ARM_DISARM: TEMPORARILY_REJECTED")
        mav.say("long MAV_CMD_NAV_LAND 0 0 0 nan nan nan nan")
        mav.expect("NAV_LAND: ACCEPTED")
        mav.expect("DISARMED", 20.0)
