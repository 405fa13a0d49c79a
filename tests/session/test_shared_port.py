"""The attacker's flight on a shared, unsigned UDP port: whoever has the evader's place speaks as the vehicle there."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.flight import Event, State
from guidance.links.wires.udp import AddressPins
from guidance.log.entries import LINK_NEWS
from sitl_mock.faults import frames
from sitl_mock.mavlink import SPEC_BY_NAME
from tests.session.test_other_heartbeats import heartbeat

pytestmark = pytest.mark.flight

VEHICLE = ("127.0.0.1", 14580)
EVADER = ("127.0.0.1", 666)
POSITION = SPEC_BY_NAME["LOCAL_POSITION_NED"].message_id
FENCE_M = 50.0
AUTO_LAND = 6 << 24 | 4 << 16
PX4_QUADROTOR = (2, 12)


class SharedPort:
    """The vehicle's wire behind a port's pins. The attacker answers each true position with forged frames."""

    def __init__(self, wire):
        self._wire = wire
        self._pins = AddressPins((1, 2))
        self.impostors_of = self._pins.impostors_of.__getitem__
        self.send = wire.send
        self.impostors = wire.impostors
        self.counters = wire.counters
        self.close = wire.close

    def receive(self):
        arrived = []
        for at_s, data in self._wire.receive():
            arrived.append((at_s, self._pins.admit(at_s, VEHICLE, data)))
            self._pins.admit(at_s, EVADER, heartbeat((10, 3), system_id=2))
            if frames.message_id(data) == POSITION:
                arrived += [
                    (at_s, self._pins.admit(at_s, EVADER, forged)) for forged in self.forge(data)
                ]
        return [(at_s, data) for at_s, data in arrived if data]

    def forge(self, true):
        ahead = {
            "time_boot_ms": frames.value(true, "time_boot_ms") + 300,
            "x": frames.value(true, "x") - 60.0,
        }
        takeover = mavlink.MAVLink_heartbeat_message(*PX4_QUADROTOR, 0x81, AUTO_LAND, 4, 3)
        return b"\0" + frames.changed(true, ahead), b"?" + takeover.pack(
            mavlink.MAVLink(None, 1, 1)
        )


def test_forged_positions_and_modes_from_the_evaders_place_change_nothing_and_are_an_event(base):
    one = base(limits={"fence_radius_m": FENCE_M}, port=SharedPort)
    one.engaged()
    farthest_m = 0.0
    for _ in range(400):
        one.cycle()
        farthest_m = max(farthest_m, math.hypot(*one.vehicle.truth.position_ned_m[:2]))
    assert one.state is State.ON_STATION
    assert farthest_m < 31.0  # the evader stands at 30 m
    assert not {Event.PILOT, Event.SECOND_SENDER, Event.ESTIMATOR_RESET} & {*one.events}
    assert one.link.counters()["impostors"] > 1000
    labels = {"vehicle": one.daemon.name, "event": LINK_NEWS}
    assert one.metrics.registry.get_sample_value("guidance_events_total", labels) >= 2.0
