"""PX4's topics on a real Zenoh session: keys, attachments, the router that comes late, and the example mode."""

import contextlib
import math
import re
import select
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import zenoh

from sitl_mock.child import end, running
from sitl_mock.errors import ConfigError
from sitl_mock.mavlink import Decoder, Encoder
from sitl_mock.px4.messages import message_type, names
from sitl_mock.px4.topic_link import PUBLISHED, SUBSCRIBED, frame_of
from sitl_mock.serving.fleet import checked_fleet, with_zenoh
from sitl_mock.transports import Arrival
from sitl_mock.transports.px4_zenoh import LINK, Px4ZenohEndpoint, key_of
from sitl_mock.transports.zenoh_session import configuration, free_port

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "px4_mode.py"
SEEN = {
    ("out", "vehicle_local_position", "VehicleLocalPosition"): "690ad53516929724",
    ("out", "vehicle_odometry", "VehicleOdometry"): "4295b96ad312084a",
    ("out", "vehicle_status", "VehicleStatus"): "828bddbb7d4c2aa6",
    ("in", "register_ext_component_request", "RegisterExtComponentRequest"): "dc16364abd320fd4",
    ("in", "unregister_ext_component", "UnregisterExtComponent"): "93b673ec972cd7ee",
    ("in", "config_overrides_request", "ConfigOverrides"): "dadb646b79dfc71a",
    ("in", "arming_check_reply", "ArmingCheckReply"): "bbab73fbc7dedd6d",
    ("in", "mode_completed", "ModeCompleted"): "9b2bbfcc9a544dd6",
    ("in", "config_control_setpoints", "VehicleControlMode"): "edb7e835846bc777",
    ("in", "manual_control_input", "ManualControlSetpoint"): "2ec0e528a355533a",
    ("in", "goto_setpoint", "GotoSetpoint"): "ef99fb91ae3a8cc2",
    ("in", "trajectory_setpoint", "TrajectorySetpoint"): "9a7deb0cb7db5e52",
    ("in", "vehicle_command", "VehicleCommand"): "1f0ab537807e2e20",
    ("in", "vehicle_command_mode_executor", "VehicleCommand"): "1f0ab537807e2e20",
}
"""The first 16 digits of the hashes in the keys that PX4 v1.17's `zenoh status` shows."""


@pytest.fixture
def address():
    return f"tcp/127.0.0.1:{free_port()}"


def test_keys_are_those_of_the_real_px4():
    for (way, name, message), digest in SEEN.items():
        kind = f"px4_msgs::msg::dds_::{message}_"
        assert {"in": SUBSCRIBED, "out": PUBLISHED}[way][name] == message
        key = key_of(0, way, name, message)
        assert key.startswith(f"0/fmu/{way}/{name}/{kind}/RIHS01_{digest}")


class TestEndpoint:
    @pytest.fixture
    def endpoint(self, address, monkeypatch):
        monkeypatch.setattr("sitl_mock.transports.zenoh_session.CONNECT_S", 0.1)
        endpoint = Px4ZenohEndpoint({"uav1": 3}, address)
        yield endpoint
        endpoint.close()

    def test_it_waits_for_a_router_and_then_carries_both_ways(self, endpoint, address):
        payload = message_type("ModeCompleted").encoded(timestamp=1234, nav_state=23)
        threads = set(threading.enumerate())
        endpoint.send("uav1", LINK, [frame_of("mode_completed", payload)])
        assert endpoint.dropped == 1
        with zenoh.open(configuration("router", address, connect=False)) as router:
            heard = router.declare_subscriber("3/fmu/out/**", zenoh.handlers.FifoChannel(10))
            deadline_s = time.monotonic() + 20.0
            sample = None
            while sample is None and time.monotonic() < deadline_s:
                endpoint.send("uav1", LINK, [frame_of("mode_completed", payload)])
                sample = heard.try_recv()
                time.sleep(0.02)
            assert str(sample.key_expr) == key_of(3, "out", "mode_completed", "ModeCompleted")
            assert bytes(sample.payload) == payload
            attachment = bytes(sample.attachment)
            assert attachment[8:] == (1234).to_bytes(8, "little") + b"\x10\xaa\xbb\xcc" + bytes(13)
            router.put(key_of(3, "in", "mode_completed", "ModeCompleted"), payload[:14])
            select.select(endpoint.filenos(), [], [], 2.0)
            assert endpoint.receive() == [
                Arrival("uav1", LINK, frame_of("mode_completed", payload[:14]))
            ]
            heard.undeclare()
            # A daemon thread that returned from Zenoh while the interpreter ends would abort it
            assert set(threading.enumerate()) <= threads

    def test_what_is_no_topic_and_what_is_of_another_link_is_not_sent(self, endpoint):
        endpoint.send("uav1", "onboard", [b"a frame"])
        assert endpoint.dropped == 0
        endpoint.send("uav1", LINK, [b"a frame", b"", b"mode_completed\0"])
        assert endpoint.dropped == 3

    def test_closing_twice_is_allowed(self, endpoint):
        endpoint.close()


@pytest.mark.parametrize(
    ("vehicles", "named"),
    [
        ([{"name": "a", "flavour": "arducopter"}], "there is no PX4"),
        ([{"name": "a"}, {"name": "b"}], "--param b:ZENOH_DOMAIN_ID=1"),
    ],
)
def test_a_fleet_whose_topics_would_be_nobodys_or_the_same_is_refused(vehicles, named):
    with pytest.raises(ConfigError, match=re.escape(named)):
        with_zenoh(checked_fleet({"vehicle": vehicles}, "test"))


def test_vehicles_with_their_own_domains_are_told_apart():
    vehicles = [
        {"name": "a"},
        {"name": "b", "parameters": {"ZENOH_DOMAIN_ID": 1}},
        {"name": "c", "flavour": "rover"},
    ]
    fleet = with_zenoh(checked_fleet({"vehicle": vehicles}, "test"))
    assert [vehicle.parameters.get("ZENOH_ENABLE") for vehicle in fleet.vehicle] == [1.0, 1.0, None]


def written(folder: Path) -> Path:
    """Write PX4's messages as files, as they are in px4_msgs."""
    for name in names():
        lines = [
            f"{field.kind}{f'[{field.length}]' if field.length else ''} {field.name}"
            for field in message_type(name).fields
        ]
        text = "\n".join(lines).replace("uint8[25] name", "char[25] name")
        (folder / f"{name}.msg").write_text(text, encoding="utf-8")
    return folder


class Station:
    """A ground station on UDP."""

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(5.0)
        self._encoder = Encoder(255, 190)
        self._decoder = Decoder()
        self._vehicle = None

    def until(self, name, condition=lambda _: True, within_s=40.0):
        """Return the first message of a name that meets a condition."""
        deadline_s = time.monotonic() + within_s
        while time.monotonic() < deadline_s:
            data, self._vehicle = self._socket.recvfrom(65536)
            for message in self._decoder.feed(data):
                if message.get_type() == name and condition(message):
                    return message
        raise AssertionError(f"no {name} within {within_s} s")

    def command(self, number, *params):
        """Send a command and return the result of its last answer."""
        values = [*params, *[0.0] * (7 - len(params))]
        frame = self._encoder.pack("COMMAND_LONG", 1, 1, number, 0, *values)
        self._socket.sendto(frame, self._vehicle)
        return self.until("COMMAND_ACK", lambda ack: ack.command == number).result

    def close(self):
        self._socket.close()


@pytest.mark.slow
def test_the_example_flies_the_mock_as_a_mode_that_a_station_chooses(tmp_path, address):
    """`docs/how-to/own-px4-mode.md`: nothing of this project is imported by the example."""
    source = EXAMPLE.read_text(encoding="utf-8")
    assert not re.search(r"\b(guidance|sitl_mock)\b", source)
    program = subprocess.Popen(
        [sys.executable, str(EXAMPLE), str(written(tmp_path)), address],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
    )
    try:
        vehicle = {"name": "uav1", "flavour": "px4", "ready_after_s": 0.5, "noise": False}
        with (
            running([vehicle], over=["udp"], px4_zenoh=address) as fleet,
            contextlib.closing(Station(fleet["uav1"].udp_port)) as station,
        ):
            station.until("HEARTBEAT", lambda beat: beat.system_status == 3)
            assert select.select([program.stdout], [], [], 20.0)[0]
            assert program.stdout.readline() == "mode 23\n"
            nan = math.nan
            assert station.command(22, nan, nan, nan, nan, nan, nan, nan) == 0
            assert station.command(400, 1.0) == 0
            hold = 4 << 16 | 3 << 24
            own = 4 << 16 | 11 << 24
            station.until(
                "HEARTBEAT", lambda beat: beat.custom_mode == hold and beat.base_mode & 128
            )
            station.command(176, 1.0, 4.0, 11.0)
            station.until("HEARTBEAT", lambda beat: beat.custom_mode == own, 5.0)
            moving = station.until("LOCAL_POSITION_NED", lambda local: local.vx > 2.0, 10.0)
            assert abs(moving.vy) < 0.5
            program.kill()
            station.until("HEARTBEAT", lambda beat: beat.custom_mode != own, 5.0)
    finally:
        end(program)
        program.stdout.close()


def test_the_mock_says_that_there_is_no_router_and_goes_on():
    """Catches a mock that ends, or is silent, without a router."""
    with running(
        [{"name": "uav1", "flavour": "px4"}], over=["udp"], px4_zenoh="tcp/127.0.0.1:1"
    ) as fleet:
        deadline_s = time.monotonic() + 15.0
        while "no Zenoh router at tcp/127.0.0.1:1" not in fleet.log.read_text(encoding="utf-8"):
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        fleet.check()
