"""HEARTBEATs with the vehicle's ids from another program, autopilot or vehicle type: counted, and nothing else."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import VirtualClock
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.links import MemoryWire
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.opening import Found
from guidance.messages import ParameterSet
from guidance.session.open import discovery
from tests.harness.vehicle import FENCED

FENCED_ARDUCOPTER = {"FENCE_ENABLE": 1, "FENCE_RADIUS": 230, "FENCE_ALT_MAX": 90, "GUID_TIMEOUT": 1}
SET_UP = {
    "px4": {"parameters": FENCED},
    "arducopter": {"parameters": FENCED_ARDUCOPTER, "vehicle": {"autopilot": "arducopter"}},
}
COMPANION = (18, 8)
CAMERA = (30, 0)
PLANE = {"px4": (1, 12), "arducopter": (1, 3)}
QUADROTOR = 2
INT32 = 6


def heartbeat(kind, *, system_id=1, component_id=1):
    """A disarmed HEARTBEAT of a (MAV_TYPE, MAV_AUTOPILOT)."""
    sender = mavlink.MAVLink(None, system_id, component_id)
    return bytes(mavlink.MAVLink_heartbeat_message(*kind, 0, 0, 4, 3).pack(sender))


def instead_of_its_own(one, kind):
    """From now on the vehicle says that it is of this (MAV_TYPE, MAV_AUTOPILOT)."""
    step = one.vehicle.step
    told = mavlink.MAVLink(None, 1, 1)

    def altered(frame):
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        if message.get_type() != "HEARTBEAT":
            return frame
        message.type = kind[0]
        message.autopilot = kind[1]
        return bytes(message.pack(told))

    one.vehicle.step = lambda now_s, frames=(): [altered(frame) for frame in step(now_s, frames)]


@pytest.mark.parametrize("autopilot", SET_UP)
def test_in_flight_they_are_counted_and_the_game_goes_on(base, autopilot):
    """Catches a game that a camera's HEARTBEAT ends."""
    one = base.engaged(**SET_UP[autopilot])
    for kind in (COMPANION, CAMERA, PLANE[autopilot], (QUADROTOR, 15 - PLANE[autopilot][1])):
        one.overheard(heartbeat(kind))
        one.run(0.5)
    assert one.state is State.ENGAGED
    assert one.daemon.flight.observed.other_beats == 4


@pytest.mark.parametrize("kind", [(QUADROTOR, 3), PLANE["px4"]])
def test_an_autopilot_that_becomes_another_in_flight_is_a_lost_one_and_named(base, kind):
    """Catches foreign HEARTBEATs that keep a lost autopilot alive."""
    one = base.engaged()
    instead_of_its_own(one, kind)
    one.run(4.0)
    cause = one.daemon.flight.cause
    assert one.state is not State.ENGAGED
    assert "no HEARTBEAT for 3.0 s" in cause.words
    assert f"MAV_AUTOPILOT {kind[1]}" in cause.words


@pytest.mark.parametrize(("kind", "words"), [(1, "fixed wing"), (20, "VTOL")])
def test_a_vehicle_that_is_no_multicopter_does_not_start(base, kind, words):
    """Catches a daemon that starts a plane."""
    one = base()
    instead_of_its_own(one, (kind, 12))
    one.run(10.0)
    (row,) = one.daemon.survey.rows
    assert (row.name, row.verdict) == ("autopilot", "refuse")
    assert f"px4 (MAV_AUTOPILOT 12), {words} (MAV_TYPE {kind})" in row.value
    assert not one.order("start")["accepted"]


def link_pair(**options):
    clock = VirtualClock()
    ours, theirs = MemoryWire.pair(clock.now_s)
    return PymavlinkLink(ours, clock.now_s, system_id=1, **options), theirs


@pytest.mark.parametrize("options", [{}, {"autopilot": 12}])
def test_they_never_change_how_parameters_are_encoded(options):
    link, vehicle = link_pair(**options)
    for kind in ((QUADROTOR, 12), COMPANION, (QUADROTOR, 3), CAMERA):
        vehicle.send(heartbeat(kind))
        link.receive()
    vehicle.receive()
    link.request(ParameterSet("COM_OBL_RC_ACT", 5.0, INT32))
    (frame,) = [data for _, data in vehicle.receive() if data[7] == 23]
    assert frame[10:14] == b"\x05\0\0\0"


def placed(monkeypatch, frames):
    """Return a clock whose wire brings these frames at once, wherever it is opened."""
    clock = VirtualClock()
    ours, theirs = MemoryWire.pair(clock.now_s)
    for frame in frames:
        theirs.send(frame)
    monkeypatch.setattr(discovery, "open_wire", lambda url, clock: ours)
    return clock


OTHERS = (
    heartbeat(CAMERA, component_id=100),
    heartbeat((26, 0), component_id=154),
    heartbeat((0, 12), component_id=100),
    heartbeat((30, 3), component_id=100),
    heartbeat((27, 8), component_id=156),
    heartbeat((6, 0), system_id=125),
)


def test_cameras_and_gimbals_that_are_heard_first_are_passed_over(monkeypatch):
    clock = placed(monkeypatch, [*OTHERS, heartbeat((QUADROTOR, 12))])
    with discovery.autopilot_at("udpin://", None, clock, who="there") as (_, found, autopilot):
        assert found == Found(1, 1, 12, QUADROTOR)
        assert autopilot.name == "px4"
    assert clock.now_s() == 0.0


def test_others_are_named_at_the_time_limit_if_no_autopilot_is_heard(monkeypatch):
    clock = placed(monkeypatch, OTHERS[:4])
    with (
        pytest.raises(ConfigError, match=r"component 100 is MAV_AUTOPILOT 0.*component 154"),
        discovery.autopilot_at("udpin://", None, clock, who="there"),
    ):
        pass
    assert clock.now_s() >= discovery.FOUND_WITHIN_S
