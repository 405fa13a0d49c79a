"""`guidance run` where PX4's flight mode cannot be: an exit code, a reason with what to do, and nothing armed."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import tomlkit

from guidance.links.px4.messages import TYPES
from tests.harness.command import guidance
from tests.harness.vehicle import document
from tests.links.px4.peer import Px4Peer, beating, encoded
from tests.links.rigs import free_port
from tests.links.rigs import router as opened_router


@pytest.fixture(scope="module")
def router():
    with opened_router() as opened:
        yield opened


@pytest.fixture
def run(tmp_path):
    """Run the daemon of a vehicle file to its end."""

    def run(url: str, **vehicle):
        given = document(
            evader={"url": f"udpin://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"},
            record={"folder": str(tmp_path)},
            control={"endpoint": f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"},
        )
        given["vehicle"] = {
            "autopilot": "px4",
            "link": "zenoh",
            "url": url,
            "connect_timeout_s": 0.5,
            **vehicle,
        }
        path = tmp_path / "vehicle.toml"
        path.write_text(tomlkit.dumps(given), encoding="utf-8")
        return guidance("run", path)

    return run


@contextmanager
def px4(router, domain_id: int, **state) -> Iterator[tuple[str, Px4Peer]]:
    peer = Px4Peer(router.session, domain_id)
    for name, value in state.items():
        setattr(peer, name, value)
    try:
        yield f"zenoh+tcp://127.0.0.1:{router.port}/{domain_id}", peer
    finally:
        peer.close()
    assert peer.of("vehicle_command") == []
    assert peer.of("vehicle_command_mode_executor") == []


def test_a_router_that_is_not_there_ends_with_3(run):
    done = run(f"zenoh+tls://127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    assert done.returncode == 3
    assert "does a Zenoh router" in done.stderr


def test_a_port_of_another_program_ends_with_3(run):
    with socket.create_server(("127.0.0.1", 0)) as other:
        done = run(f"zenoh+tcp://127.0.0.1:{other.getsockname()[1]}")
    assert done.returncode == 3
    assert "does a Zenoh router" in done.stderr


def test_a_px4_without_the_module_ends_with_3(run):
    done = run(f"zenoh+tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    assert done.returncode == 3
    assert "ZENOH_ENABLE 1" in done.stderr


def test_another_version_of_a_message_ends_with_3(run, router):
    stop = threading.Event()

    def say(key: str) -> None:
        while not stop.wait(0.02):
            router.session.put(key, encoded("VehicleStatus"))

    with px4(router, 201) as (url, peer):
        key = TYPES["VehicleStatus"].key(peer.domain_id, "fmu/out/vehicle_status")[:-2] + "00"
        saying = threading.Thread(target=say, args=[key])
        saying.start()
        try:
            done = run(url)
        finally:
            stop.set()
            saying.join()
    assert done.returncode == 3
    assert "another version of VehicleStatus" in done.stderr
    assert "use that version" in done.stderr


def test_a_name_of_25_characters_ends_with_2(run, router):
    with px4(router, 202) as (url, _):
        done = run(url, mode_name="x" * 25)
    assert done.returncode == 2
    assert "vehicle.mode_name" in done.stderr
    assert "PX4 keeps 24" in done.stderr


def test_eight_modes_that_are_taken_end_with_3(run, router):
    with px4(router, 203, free_modes=0) as (url, peer), beating(peer):
        done = run(url)
    assert done.returncode == 3
    assert "end another program's mode, or restart PX4" in done.stderr
