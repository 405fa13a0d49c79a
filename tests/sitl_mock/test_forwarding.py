"""What a vehicle forwards between its links, as PX4 (MAV_n_FORWARD) and ArduPilot's routing do."""

import pytest

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder

COMPANION = 191
STATION = 255


class Clients:
    """A companion on the onboard link and a ground station on another."""

    def __init__(self, flavour, **settings):
        links = {"onboard": "onboard", "gcs": "gcs"}
        self.vehicle = MockVehicle(flavour, links=links, ready_after_s=0.5, **settings)
        self.companion = Encoder(1, COMPANION)
        self.station = Encoder(STATION, 190)
        self.now_s = 0.0
        self.heard = {"onboard": [], "gcs": []}
        self.receivers = {"onboard": Decoder(), "gcs": Decoder()}

    def send(self, link, *frames):
        self.now_s += 0.02
        for name, sent in self.vehicle.step_links(self.now_s, {link: frames}).items():
            for message in self.receivers[name].feed(b"".join(sent)):
                self.heard[name].append(message)

    def beat(self):
        self.send("gcs", self.station.pack("HEARTBEAT", 6, 8, 0, 0, 4, 3))
        self.send("onboard", self.companion.pack("HEARTBEAT", 18, 8, 0, 0, 4, 3))

    def of(self, link, name, component=COMPANION):
        return [
            message
            for message in self.heard[link]
            if message.get_type() == name and message.get_srcComponent() == component
        ]


AIRCRAFT = (7, 473977420, 85455940, 0, 488000, 0, 0, 0, b"R8H10", 17, 1, 0, 0)


@pytest.mark.parametrize("flavour", ["px4", "arducopter", "rover"])
def test_a_station_sees_the_companion_and_the_companion_the_station(flavour):
    clients = Clients(flavour)
    clients.beat()
    clients.send("onboard", clients.companion.pack("STATUSTEXT", 6, "guidance: engaged", 0, 0))
    clients.send("onboard", clients.companion.pack("ADSB_VEHICLE", *AIRCRAFT))
    clients.send("gcs", clients.station.pack("COMMAND_LONG", 1, COMPANION, 31010, 0, *(0,) * 7))
    assert len(clients.of("gcs", "HEARTBEAT")) == 1
    assert clients.of("gcs", "STATUSTEXT")[0].text == "guidance: engaged"
    assert len(clients.of("gcs", "ADSB_VEHICLE")) == (flavour == "px4"), "ArduPilot keeps it"
    assert clients.of("onboard", "COMMAND_LONG", component=190)[0].command == 31010


@pytest.mark.parametrize("flavour", ["px4", "arducopter"])
def test_nothing_is_forwarded_to_its_sender_to_nobody_or_from_the_vehicle_itself(flavour):
    clients = Clients(flavour)
    heartbeat = clients.companion.pack("HEARTBEAT", 18, 8, 0, 0, 4, 3)
    clients.send("onboard", heartbeat)
    assert not clients.of("gcs", "HEARTBEAT"), "nobody was heard there"
    clients.beat()
    clients.send("gcs", clients.station.pack("COMMAND_LONG", 1, 1, 520, 0, 1, *(0,) * 6))
    clients.send("gcs", clients.station.pack("COMMAND_LONG", 9, 1, 520, 0, 1, *(0,) * 6))
    clients.send("gcs", Encoder(1, 1).pack("ATTITUDE", 1, *(0.0,) * 6))
    assert not clients.of("onboard", "COMMAND_LONG", component=190)
    assert not [m for m in clients.of("onboard", "ATTITUDE", component=1) if m.time_boot_ms == 1]
    assert not clients.of("onboard", "HEARTBEAT"), "no echo"


def test_px4_keeps_heartbeats_without_its_parameter():
    clients = Clients("px4", parameters={"MAV_HB_FORW_EN": 0})
    clients.beat()
    clients.beat()
    assert not clients.of("gcs", "HEARTBEAT")
