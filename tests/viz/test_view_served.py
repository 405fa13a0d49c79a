"""The viewer as a process of its own: bound to loopback, silent to the world, ended with whoever started it."""

import contextlib
import http.client
import itertools
import json
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
import rerun as rr

from guidance.cli.viewers import CommandBeside, command
from guidance.errors import ConfigError, LinkError
from guidance.log import cycles_of, metadata_of
from guidance.log.broadcast import Broadcast, LiveFlight
from guidance.log.entries import CYCLE, Item
from guidance.session.orders.control_bus import free_endpoint
from guidance.session.orders.control_client import join_session
from guidance.viz.serving import Relay, hidden_address, recording_server
from tests.harness.bus import open_to_all

FREE = ("--port", "0", "--web-port", "0")
LISTENING = "0A"


def children(pid):
    """A process and all that it has started."""
    found = [pid]
    for one in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in one.read_text().split():
            found += children(int(child))
    return found


def listening(pid):
    """Listening addresses of a process, in the hexadecimal form of /proc."""
    sockets = set()
    for one in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            sockets.add(str(one.readlink()).removeprefix("socket:[").rstrip("]"))
    rows = [
        line.split()
        for table in ("tcp", "tcp6")
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]
    ]
    return {row[1].split(":")[0] for row in rows if row[3] == LISTENING and row[9] in sockets}


def is_running(pid):
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def until(true, limit_s=15.0):
    deadline_s = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


@pytest.fixture
def served(record):
    """A viewer of a record, its page's address, and all of its processes."""
    child = subprocess.Popen(
        command(("view", str(record), "--follow", *FREE)),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    words = child.stdout.readline().split()
    yield child, words[-1], children(child.pid)
    child.kill()
    child.wait()
    child.stdin.close()
    child.stdout.close()


def test_the_view_listens_on_loopback_only_and_its_page_may_speak_to_nobody_else(served):
    """Catches a viewer that the network can reach, and one that loads matplotlib."""
    child, url, pids = served
    # 127.0.0.1, and the hidden ones of Rerun's two servers
    until(lambda: len(set().union(*map(listening, pids))) == 3)
    addresses = set().union(*map(listening, pids))
    assert all(address.endswith("7F") for address in addresses)  # 127.0.0.0/8
    # Its compiled parts would be seen: a view without pictures starts a second sooner.
    assert "matplotlib" not in Path(f"/proc/{child.pid}/maps").read_text()
    with urllib.request.urlopen(url, timeout=10.0) as page:
        policy = dict(
            part.split(" ", 1) for part in page.headers["Content-Security-Policy"].split("; ")
        )
        assert b"<html" in page.read()
    recording = urlsplit(parse_qs(urlsplit(url).query)["url"][0].removeprefix("rerun+"))
    assert policy["default-src"] == "'none'"
    assert policy["connect-src"] == f"'self' http://127.0.0.1:{recording.port} data: blob:"
    outside = {word for words in policy.values() for word in words.split() if "://" in word}
    assert outside == {f"http://127.0.0.1:{recording.port}"}
    base = f"http://{urlsplit(url).netloc}"
    with urllib.request.urlopen(f"{base}/re_viewer_bg.wasm", timeout=20.0) as program:
        assert len(program.read()) > 1_000_000
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{base}/nothing", timeout=10.0)
    child.send_signal(signal.SIGTERM)
    assert child.wait(30.0) == 0  # a live view shows the rest first
    until(lambda: not any(map(is_running, pids)))


@pytest.mark.long
def test_nothing_of_it_outlives_the_one_that_started_it(served):
    """Catches a viewer that stays behind a killed command."""
    child, _, pids = served
    assert len(pids) == 2
    child.stdin.close()  # as the kernel does for a process that is gone
    until(lambda: not any(map(is_running, pids)))


def test_beside_a_flight_the_viewer_may_die_and_nothing_of_it_stays_or_is_waited_for(record, capfd):
    """Catches a flight that waits for its viewer, and a server that stays behind a killed viewer."""
    said = []
    beside = CommandBeside("view", str(record), "--follow", *FREE, say=said.append)
    pids = {*children(beside.child.pid)}
    # By us, and not into a live line
    until(lambda: any("http://127.0.0.1" in line for line in said))
    pids |= {*children(beside.child.pid)}
    assert len(pids) == 2
    beside.child.kill()
    beside.child.wait()
    until(lambda: not any(map(is_running, pids)))
    beside.close()
    beside.close()


def test_a_mocked_flight_is_shown_during_the_flight_and_until_it_is_closed(tmp_path):
    """Catches a viewer that ends with the flight, or stays behind."""
    scenario = Path(__file__).parents[1] / "data" / "near_chase.toml"
    undrawn = (
        "import sys; sys.modules['matplotlib'] = None; "  # a picture takes as long as the flight
    )
    program = f"{undrawn}from guidance.cli import main; main()"
    words = [
        sys.executable,
        "-c",
        program,
        "fly",
        str(scenario),
        "--fast",
        "--view",
        "--out",
        str(tmp_path),
    ]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        lines = list(iter(child.stdout.readline, "the view stays: Ctrl-C ends it\n"))
        pids = children(child.pid)
        # The flight took less time than the viewer's start
        if not any(line.startswith("look at") for line in lines):
            assert "look at" in child.stdout.readline()
        child.send_signal(signal.SIGINT)
        rest = child.communicate(timeout=60.0)[0]
    finally:
        child.kill()
        child.wait()
    assert child.returncode == 0
    assert any("captured" in line for line in lines)
    assert "cycles shown" in rest
    until(lambda: not any(map(is_running, pids)))


def test_a_port_in_use_is_one_clear_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with (
            pytest.raises(
                LinkError, match=rf"--port {port}: Address already in use; choose another"
            ),
            recording_server(port),
        ):
            pass


@pytest.fixture
def bus(record):
    """A daemon's broadcast, without the daemon."""
    endpoint = free_endpoint()
    session = open_to_all(endpoint)
    metadata = {"uav1": {"scenario": "{}"}, "uav2": metadata_of(record)}
    opened = [Broadcast(name, session, metadata[name]) for name in metadata]
    yield opened, endpoint
    for one in opened:
        one.close()
    session.close()


def test_a_daemon_is_looked_at_live_from_what_was_heard_on(bus, record):
    (broadcast, _), endpoint = bus
    cycles = list(cycles_of(record))
    for cycle in cycles[:200]:
        broadcast.cycle(cycle)
    until(lambda: broadcast.waiting == 0)
    with join_session(endpoint) as session:
        flight = LiveFlight(session, "uav1")
        assert flight.metadata(lambda: False) == {"scenario": "{}"}
        until(lambda: broadcast.watched() == {"cycle", "event"})
        broadcast.event(cycles[200].now_s, "armed", "ready -> arming")
        for cycle in cycles[200:230]:
            broadcast.cycle(cycle)
        deadline_s = time.monotonic() + 15.0
        items = list(
            itertools.islice(
                flight.items(lambda: time.sleep(0.01) or time.monotonic() > deadline_s), 32
            )
        )
    assert all(isinstance(item, Item) for item in items)
    said = [json.loads(item.data) for item in items]
    assert {"Heartbeat", "LocalPosition"} <= {one["kind"] for one in said[0]["inputs"]["messages"]}
    assert [one for one in said[1:] if "event" not in one] == list(
        map(CYCLE.plain, cycles[200:230])
    )
    assert [one["event"] for one in said if "event" in one] == ["armed"]


def test_with_several_daemons_a_name_is_asked_for_and_nobody_is_one_clear_error(bus):
    _, endpoint = bus
    with join_session(endpoint) as session:
        with pytest.raises(ConfigError, match=r"which vehicle\? daemons on this bus: uav1, uav2"):
            LiveFlight(session, None)
        with pytest.raises(LinkError, match=r"uav9: no answer"):
            LiveFlight(session, "uav9")


def test_the_command_shows_a_daemon_live(bus, record):
    """Catches a break in the way from a daemon to the viewer.

    The whole way: a broadcast, `guidance view --live` as its own process, and an end by signal.
    """
    (other, broadcast), endpoint = bus
    other.close()
    cycles = list(cycles_of(record))
    program = "from guidance.cli import main; main()"
    words = [
        sys.executable,
        "-c",
        program,
        "view",
        "--live",
        "--name",
        "uav2",
        "--endpoint",
        endpoint,
        *FREE,
    ]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert "look at" in child.stdout.readline()
        until(lambda: "cycle" in broadcast.watched())
        for cycle in cycles[:100]:
            broadcast.cycle(cycle)
        until(lambda: broadcast.waiting == 0)
        time.sleep(0.5)  # a process of its own: no clock of ours moves it
        child.send_signal(signal.SIGINT)
        rest = child.communicate(timeout=15.0)[0]
    finally:
        child.kill()
        child.wait()
    assert "100 cycles shown" in rest


STRANGE = ["evil.example", "evil.example:{port}", "127.0.0.1:1", "", "127.0.0.1", "[::1]:{port}"]


@pytest.mark.parametrize("host", STRANGE)
def test_a_page_asked_for_by_a_name_that_is_not_ours_is_not_given(host):
    """DNS rebinding: a stranger's page whose name leads to loopback reads nothing from here."""
    front = Relay("--web-port", 0, hidden_address(), "Referrer-Policy: no-referrer\r\n")
    try:
        port = front.port
        assert status_for(port, host.format(port=port)) == http.HTTPStatus.MISDIRECTED_REQUEST
        for ours in (f"127.0.0.1:{port}", f"localhost:{port}"):
            # Accepted, but there is no server behind
            assert status_for(port, ours) == http.HTTPStatus.BAD_GATEWAY
    finally:
        front.close()


def test_the_recording_is_given_to_nobody_who_asks_for_another_host():
    with recording_server(0) as (port, sink), rr.RecordingStream("test") as stream:
        stream.set_sinks(sink)  # it listens from now on
        for host in STRANGE:
            assert (
                status_for(port, host.format(port=port), "POST")
                == http.HTTPStatus.MISDIRECTED_REQUEST
            )
        for ours in (f"127.0.0.1:{port}", f"localhost:{port}"):
            assert status_for(port, ours, "POST") == http.HTTPStatus.OK
        with socket.create_connection(
            ("127.0.0.1", port), timeout=5.0
        ) as native:  # HTTP/2, which no page can speak
            native.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(3) + b"\x04" + bytes(5))
            assert native.recv(9)[3] == 4  # the server's SETTINGS frame
        stream.disconnect()


def status_for(port, host, method="GET"):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5.0)
    with contextlib.closing(connection):
        connection.putrequest(
            method, "/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages", skip_host=True
        )
        for name, value in {
            "Host": host,
            "Content-Type": "application/grpc-web+proto",
            "Content-Length": "5",
        }.items():
            connection.putheader(name, value)
        connection.endheaders(bytes(5))
        return connection.getresponse().status
