"""pymavlink's mavutil: arming, modes by name, and the parameters counted."""

import time

import pytest
from pymavlink import mavutil

pytestmark = pytest.mark.slow
SPEED = 4.0
"""Of the vehicles' time; mavutil waits for messages only."""


@pytest.fixture(scope="module")
def fleet(fleet_of):
    vehicles = {"uav1": "px4", "copter": "arducopter", "car": "rover"}
    with fleet_of(vehicles, over=["udp"], speed=SPEED) as started:
        yield started


@pytest.fixture
def link(fleet, request):
    """A mavutil connection that has heard the vehicle."""
    opened = mavutil.mavlink_connection(
        f"udpin:127.0.0.1:{fleet[request.param].udp_port}", source_system=255
    )
    assert opened.wait_heartbeat(timeout=5.0) is not None
    yield opened
    opened.close()


def wait_mode(link, mode, within_s=5.0):
    end_s = time.monotonic() + within_s
    while link.flightmode != mode:
        assert time.monotonic() < end_s, f"{link.flightmode}, not {mode}"
        link.recv_match(blocking=True, timeout=0.2)


@pytest.mark.parametrize("link", ["uav1", "copter", "car"], indirect=True)
def test_mavutil_counts_every_parameter_once(link):
    link.param_fetch_all()
    names = set()
    count = None
    end_s = time.monotonic() + 10.0
    while count is None or len(names) < count:
        assert time.monotonic() < end_s, f"{len(names)} of {count}"
        message = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
        if message is not None and message.param_index != 65535:
            names.add(message.param_id)
            count = message.param_count
    assert count > 50
    assert len(names) == count


@pytest.mark.parametrize(
    ("link", "mode"),
    [("uav1", "LOITER"), ("copter", "GUIDED"), ("car", "GUIDED")],
    indirect=["link"],
)
def test_mavutil_sets_a_mode_arms_and_disarms(link, mode):
    time.sleep(1.0 / SPEED)  # until it can be armed
    link.set_mode(mode)
    wait_mode(link, mode)
    link.arducopter_arm()
    end_s = time.monotonic() + 4.0
    while not link.motors_armed():
        assert time.monotonic() < end_s
        link.recv_match(blocking=True, timeout=0.2)
    link.arducopter_disarm()
    while link.motors_armed():
        assert time.monotonic() < end_s + 4.0
        link.recv_match(blocking=True, timeout=0.2)


@pytest.mark.parametrize("link", ["uav1", "copter", "car"], indirect=True)
def test_autopilot_and_type_are_those_of_the_flavour(link):
    beat = link.recv_match(type="HEARTBEAT", blocking=True, timeout=2.0)
    expected = {1: (12, 2), 2: (3, 2), 3: (3, 10)}[link.target_system]
    assert (beat.autopilot, beat.type) == expected
