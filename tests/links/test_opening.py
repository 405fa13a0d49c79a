"""Opening links: allowed URLs, errors if the vehicle does not answer, and how long that takes."""

import contextlib
import socket
import threading
import time

import pytest
from pymavlink.dialects.v20 import common as dialect

from guidance.errors import ConfigError, LinkError
from guidance.frames import Ned
from guidance.links import SigningKey, parse
from guidance.links.mavlink.frames import ticks
from guidance.links.opening import open_link, open_wire
from guidance.messages import Setpoint
from tests.links.peer import Peer, living, until
from tests.links.rigs import clock, free_port, opened_link, udp


class FastClock:
    """A clock that a waiting opener moves by itself: nothing sleeps for long."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        time.sleep(0.0005)


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("udpin://0.0.0.0:14540", ("udpin", "0.0.0.0", 14540, "")),
        ("udpout://127.0.0.1:14550", ("udpout", "127.0.0.1", 14550, "")),
        ("tcpout://localhost:5760", ("tcpout", "localhost", 5760, "")),
        ("serial:///dev/ttyACM0:57600", ("serial", "/dev/ttyACM0", 57600, "")),
        ("serial://COM3:57600", ("serial", "COM3", 57600, "")),
        ("zenoh://127.0.0.1:7447/uav1", ("zenoh", "127.0.0.1", 7447, "uav1")),
        ("zenoh://127.0.0.1:7447/fleet/uav1", ("zenoh", "127.0.0.1", 7447, "fleet/uav1")),
        ("zenoh://127.0.0.1:7447", ("zenoh", "127.0.0.1", 7447, "")),
    ],
)
def test_a_url_says_where(url, parts):
    assert parse(url) == parts


@pytest.mark.parametrize(
    "url",
    [
        "",
        "127.0.0.1:14540",
        "udp://127.0.0.1:14540",
        "udpin://127.0.0.1",
        "udpin://:14540",
        "udpin://127.0.0.1:99999",
        "udpin://127.0.0.1:x",
        "udpin://127.0.0.1:14540/uav1",
        "serial:///dev/ttyACM0",
        "serial:///dev/ttyACM0:fast",
        "serial:///dev/ttyACM0:0",
        "zenoh://127.0.0.1/uav1",
        "zenoh://127.0.0.1:7447/uav*",
        "zenoh://127.0.0.1:7447/a//b",
        "zenoh://127.0.0.1:7447/uav1?x=1",
        "http://127.0.0.1:80",
    ],
)
def test_the_error_of_a_bad_url_names_it_and_the_allowed_forms(url):
    with pytest.raises(ConfigError) as caught:
        open_wire(url, clock=clock)
    assert repr(url) in str(caught.value)


@pytest.mark.parametrize("scheme", ["udp", "tcp"])
def test_the_error_of_udp_and_tcp_urls_names_both_directions(scheme):
    with pytest.raises(
        ConfigError, match=f"{scheme}in://host:port waits for the vehicle, {scheme}out://"
    ):
        parse(f"{scheme}://127.0.0.1:14540")


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
@pytest.mark.parametrize("scheme", ["udpin", "udpout"])
def test_opening_a_silent_link_fails_after_the_callers_timeout(kind, scheme):
    now = FastClock()
    url = f"{scheme}://127.0.0.1:{free_port()}"
    with pytest.raises(LinkError, match="no HEARTBEAT") as caught:
        opened_link(kind, url, system_id=1, clock=now, sleep=now.sleep, timeout_s=10.0)
    assert url in str(caught.value)
    assert 60.0 <= now.now_s <= 60.1


def test_a_zenoh_endpoint_without_anybody_is_a_clear_error_in_bounded_time():
    port = free_port(socket.SOCK_STREAM)
    started_s = time.monotonic()
    with pytest.raises(LinkError, match=rf"zenoh tcp/127.0.0.1:{port}: no session within 0.3 s"):
        open_wire(f"zenoh://127.0.0.1:{port}/uav1", clock=clock, timeout_s=0.3)
    assert time.monotonic() - started_s < 2.0


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
def test_a_zenoh_session_without_the_vehicle_is_a_clear_error_too(kind, router):
    now = FastClock()
    url = f"zenoh://127.0.0.1:{router.port}/nobody"
    with pytest.raises(LinkError, match="no HEARTBEAT"):
        opened_link(kind, url, system_id=1, clock=now, sleep=now.sleep, timeout_s=3.0)


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
def test_a_tcp_port_without_anybody_is_a_link_error(kind):
    now = FastClock()
    url = f"tcpout://127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with pytest.raises(LinkError):
        opened_link(kind, url, system_id=1, clock=now, sleep=now.sleep, timeout_s=1.0)


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
def test_a_vehicle_with_another_system_id_is_not_accepted(kind):
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        stranger = Peer(lambda data: theirs.sendto(data, ("127.0.0.1", port)), system_id=42)
        now = FastClock()
        with (
            living(stranger, list, heartbeat_every_s=0.01),
            pytest.raises(LinkError, match="no HEARTBEAT"),
        ):
            opened_link(
                kind,
                f"udpin://127.0.0.1:{port}",
                system_id=7,
                clock=now,
                sleep=now.sleep,
                timeout_s=3.0,
            )


def test_a_serial_device_that_is_not_there_is_a_link_error():
    with pytest.raises(LinkError, match="/dev/ttyNOBODY"):
        open_wire("serial:///dev/ttyNOBODY:57600", clock=clock)


def threads_of_python():
    """A thread of C++ that has called in once leaves an object behind when it ends; that is not a thread."""
    return {
        thread for thread in threading.enumerate() if not isinstance(thread, threading._DummyThread)
    }


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
def test_links_opened_and_closed_many_times_leave_no_thread_behind(kind):
    before = threads_of_python()
    for _ in range(5):
        with udp(kind, None) as rig:
            rig.peer.local_position(1)
            assert rig.hear(lambda got: len(got) > 0)
    assert threads_of_python() <= before


def test_the_library_is_silent_on_standard_output(capfd):
    with udp("mavsdk", None) as rig:
        rig.peer.send(b"\xfd\xff\xfe")
        rig.peer.say(dialect.MAVLink_statustext_message(4, b"not text \xff\xfe", 0, 0))
        rig.peer.local_position(1)
        assert rig.hear(lambda got: len(got) > 1)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


@pytest.mark.parametrize("kind", ["mavsdk", "pymavlink"])
def test_an_autopilot_that_waits_to_be_called_is_called(kind):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        theirs.bind(("127.0.0.1", 0))
        theirs.setblocking(False)
        callers = []

        def receive() -> list[bytes]:
            with contextlib.suppress(BlockingIOError):
                data, caller = theirs.recvfrom(2048)
                callers.append(caller)
                return [data]
            return []

        peer = Peer(lambda data: callers and theirs.sendto(data, callers[-1]))
        with living(peer, receive, heartbeat_every_s=0.02):
            url = f"udpout://127.0.0.1:{theirs.getsockname()[1]}"
            link = opened_link(kind, url, system_id=1, clock=time.monotonic, timeout_s=5.0)
            link.send_setpoint(Setpoint(Ned((1.0, 0.0, 0.0))))
            assert until(lambda: len(peer.of("SET_POSITION_TARGET_LOCAL_NED")) == 1)
            link.close()


def test_unsigned_heartbeats_sent_first_do_not_keep_a_signed_vehicle_out():
    key = SigningKey(bytes(range(32)))
    now = FastClock()
    to = ("127.0.0.1", free_port())
    wire = open_wire(f"udpin://127.0.0.1:{to[1]}", clock=now, systems=(1,), signing_key=key)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as strangers,
    ):
        forger = Peer(lambda data: strangers.sendto(data, to))
        vehicle = Peer(lambda data: theirs.sendto(data, to))
        signing = vehicle.mavlink.signing
        signing.secret_key = key.secret
        signing.sign_outgoing = True
        signing.timestamp = ticks(time.time())
        for _ in range(10):
            forger.heartbeat()
        with (
            living(forger, list, heartbeat_every_s=0.02),
            living(vehicle, list, heartbeat_every_s=0.05),
        ):
            link = open_link(
                wire,
                "pymavlink",
                system_id=1,
                clock=now,
                who="signed",
                signing_key=key,
                sleep=now.sleep,
            )
        assert link.counters()["wire_unsigned"] + link.counters()["wire_impostor"] > 0
        assert link.counters()["unsigned"] == 0
        link.close()
