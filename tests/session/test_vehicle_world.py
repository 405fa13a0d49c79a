"""From a configuration to open ends: the key, the shared wire, the frames passed on, the frame that is declared."""

import math
import socket
import threading
from contextlib import closing

import pytest
from pymavlink.dialects.v20 import common as mavlink

from guidance.clock import MonotonicClock
from guidance.config import parse_document
from guidance.errors import ConfigError, LinkError
from guidance.frames import Ned
from guidance.links.world import World
from guidance.messages import Heartbeat, Setpoint
from guidance.session.open import links
from guidance.session.open.links import open_all, open_control, signing_key
from guidance.session.orders.mailbox import Mailbox
from guidance.session.vehicle_file import Config


@pytest.fixture
def udp():
    """A port, and a vehicle (system 1) and its evader (system 2) that send to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    stop = threading.Event()

    def send():
        vehicle = mavlink.MAVLink(None, 1, 1)
        evader = mavlink.MAVLink(None, 2, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            count = 0
            while not stop.wait(0.02):
                count += 1
                heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 29, 0x03040000, 3, 3)
                position = mavlink.MAVLink_global_position_int_message(
                    20 * count, 473977420, 85455940, 488000, 0, 100, 0, 0, 0
                )
                for frame in (heartbeat.pack(vehicle), position.pack(evader)):
                    out.sendto(frame, ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    yield f"udpin://127.0.0.1:{port}"
    stop.set()
    thread.join()


def decoded(passed):
    return mavlink.MAVLink(None).decode(bytearray(passed.frame))


def setpoints(passed):
    sent = [decoded(one) for one in passed if one.topic == "uav1/mavlink_raw/in"]
    return [one for one in sent if one.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]


def config_of(vehicle_document, **sections):
    return parse_document(Config, vehicle_document(**sections), source="test")


@pytest.mark.parametrize("link", ["pymavlink", "mavsdk"])
def test_an_evader_on_the_vehicles_wire_is_received_and_all_frames_are_passed_on(
    vehicle_document, udp, link
):
    config = config_of(vehicle_document, vehicle={"url": udp, "link": link}, evader={"url": None})
    clock = MonotonicClock()
    opened = World()
    try:
        open_all(config, clock, opened, tapped=True)
        messages = list(opened.links["uav1"].receive())
        reports = list(opened.evaders["uav1"]["evader"].receive())
        deadline_s = clock.now_s() + 5.0
        beats = list[Heartbeat]()
        while not (beats and reports) and clock.now_s() < deadline_s:
            clock.sleep_until(clock.now_s() + 0.01)
            beats = [message for message in messages if isinstance(message, Heartbeat)]
            messages += opened.links["uav1"].receive()
            reports += opened.evaders["uav1"]["evader"].receive()
        assert beats
        assert reports[0].latitude_deg == pytest.approx(47.397742)
        assert math.isclose(reports[0].velocity_ned_m_s[0], 1.0)
        opened.links["uav1"].send_setpoint(Setpoint(Ned((1.0, 2.0, 3.0))))
        passed = []
        while not any(setpoints(passed)) and clock.now_s() < deadline_s:
            passed += opened.drain()
        assert {one.topic for one in passed} == {"uav1/mavlink_raw/out", "uav1/mavlink_raw/in"}
        assert [(setpoint.vx, setpoint.vy, setpoint.vz) for setpoint in setpoints(passed)] == [
            (1.0, 2.0, 3.0)
        ]
        heard = [decoded(one) for one in passed if one.topic == "uav1/mavlink_raw/out"]
        assert {(one.get_srcSystem(), one.get_type()) for one in heard} == {
            (1, "HEARTBEAT"),
            (2, "GLOBAL_POSITION_INT"),
        }
    finally:
        opened.close()
        opened.close()


def test_a_vehicle_that_is_silent_leaves_nothing_open(vehicle_document, udp):
    config = config_of(
        vehicle_document, vehicle={"url": udp, "system_id": 7, "connect_timeout_s": 0.3}
    )
    for _ in range(2):  # the port is free again
        with (
            pytest.raises(LinkError, match=r"system 7: no HEARTBEAT within 0\.3 s"),
            closing(World()) as opened,
        ):
            open_all(config, MonotonicClock(), opened, tapped=False)


def test_a_url_that_is_none_is_refused_before_anything_is_opened(vehicle_document):
    with pytest.raises(
        ConfigError, match=r"vehicle\.url = 'carrier://pigeon': allowed are udpin://"
    ):
        config_of(vehicle_document, vehicle={"url": "carrier://pigeon"})


def test_a_signing_key_comes_from_a_file_that_nobody_else_may_read(tmp_path):
    path = tmp_path / "key"
    path.write_text("0f" * 32 + "\n")
    path.chmod(0o600)
    assert signing_key(path).secret == bytes([15] * 32)
    path.chmod(0o640)
    with pytest.raises(ConfigError, match="others may read it; chmod 600 it"):
        signing_key(path)


@pytest.mark.parametrize("content", ["0f" * 31, "é" * 64])
def test_a_file_that_holds_no_key_is_refused_without_showing_it(tmp_path, content):
    path = tmp_path / "key"
    path.write_text(content, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="64 hexadecimal digits") as refused:
        signing_key(path)
    assert content not in str(refused.value)


def test_a_missing_key_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"vehicle\.signing_key_file = .*nowhere"):
        signing_key(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("endpoint", "shown"), [("tls/192.168.1.10:7447", ["cert.pem"]), ("tcp/127.0.0.1:7448", [])]
)
def test_orders_are_taken_by_certificates_where_a_router_judges_them(
    vehicle_document, monkeypatch, endpoint, shown
):
    read = []
    opened = []
    monkeypatch.setattr(
        links, "credentials_of", lambda zenoh: read.append(str(zenoh.tls_certificate_file))
    )
    monkeypatch.setattr(
        links, "control_bus", lambda _name, _mailbox, control, *_: opened.append(control)
    )
    tls = {"tls_certificate_file": "cert.pem", "tls_key_file": "key.pem", "tls_ca_file": "ca.pem"}
    control = {"endpoint": endpoint, "host": not shown}
    open_control(config_of(vehicle_document, control=control, zenoh=tls), Mailbox())
    assert read == shown
    assert [(one.endpoint, one.host) for one in opened] == [(endpoint, not shown)]
