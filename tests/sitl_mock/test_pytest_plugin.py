"""The plugin in another suite."""

import subprocess
import sys
from importlib.metadata import entry_points

import pytest

from sitl_mock import ConfigError, TransportError
from sitl_mock.child import end, running
from sitl_mock.pytest_plugin import fleet_tables

pytest_plugins = ["pytester"]


def test_pytest_finds_the_plugin_by_its_entry_point():
    (found,) = entry_points(group="pytest11", name="sitl_mock")
    assert found.value == "sitl_mock.pytest_plugin"


def test_loading_the_plugin_loads_nothing_heavy():
    """Catches a plugin that slows down every suite on its computer."""
    names = ("pymavlink", "zenoh", "numpy", "pydantic", "sitl_mock.vehicle.mock_vehicle")
    heavy = f"[name for name in {names} if name in sys.modules]"
    code = f"import sys, sitl_mock.pytest_plugin; print({heavy})"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "[]\n"
    )


def test_a_stepped_vehicle_is_moved_by_the_clock_of_the_test(mock_vehicle):
    quiet = mock_vehicle.stepped(faults={"fault": [{"kind": "silence"}]})
    loud = mock_vehicle.stepped("arducopter", "copter", system_id=9)
    assert quiet.step(0.0) + quiet.step(2.0) == []
    assert loud.step(0.0) + loud.step(2.0) != []
    assert (loud.name, loud.vehicle.system_id) == ("copter", 9)


@pytest.mark.slow
def test_vehicles_and_fleets_say_where_they_can_be_reached(mock_vehicle, mock_fleet):
    vehicle = mock_vehicle("rover", "evader", ready_after_s=0.5)
    fleet = mock_fleet(2, over=["udp"])
    other = mock_fleet(
        [{"name": "a", "flavour": "arducopter", "start_ned_m": [9, 0, 0]}], over=["zenoh"]
    )
    assert (vehicle.name, vehicle.flavour, vehicle.namespace) == ("evader", "rover", "evader")
    assert list(fleet) == ["uav1", "uav2"]
    assert len(fleet) == 2
    assert fleet["uav2"].udp_port == fleet["uav1"].udp_port + 1
    assert fleet["uav1"].udp_listens == fleet["uav1"].udp_port + 40
    assert other["a"].zenoh != vehicle.zenoh
    assert other["a"].udp_port is None


@pytest.mark.slow
def test_a_fleet_may_be_a_list_of_flavours():
    assert fleet_tables(["px4", {"name": "evader", "flavour": "rover"}]) == [
        {"name": "uav1", "flavour": "px4"},
        {"name": "evader", "flavour": "rover"},
    ]


def test_fleets_that_run_side_by_side_share_no_port(mock_fleet):
    """Catches two fleets that choose the same port."""
    fleets = [mock_fleet({"a": "arducopter", "b": "px4"}, over=["udp"]) for _ in range(3)]
    ports = [vehicle.udp_port for fleet in fleets for vehicle in fleet.values()]
    assert len(set(ports)) == 6


def test_ports_that_would_clash_within_a_fleet_are_told(mock_fleet):
    kinds = {f"v{number}": "px4" if number < 10 else "arducopter" for number in range(11)}
    kinds = {"first": "px4", **{f"c{number}": "arducopter" for number in range(4)}, **kinds}
    with pytest.raises(TransportError, match="clash"):
        mock_fleet(kinds, over=["udp"])


@pytest.mark.slow
def test_a_suite_flies_vehicles_and_all_of_them_end_with_their_tests(pytester):
    pytester.makepyfile(
        """
        import socket

        seen = []

        def hear(vehicle):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
                client.settimeout(5.0)
                client.bind(("127.0.0.1", vehicle.udp_port))
                return client.recv(2048)

        def test_one(mock_vehicle):
            vehicle = mock_vehicle("px4", ready_after_s=0.5)
            other = mock_vehicle("rover", "evader", over=["udp"])
            assert vehicle.udp == f"udpin://127.0.0.1:{vehicle.udp_port}"
            assert vehicle.zenoh.startswith("tcp/127.0.0.1:")
            assert (vehicle.namespace, other.namespace) == ("uav1", "evader")
            assert other.zenoh is None
            assert hear(vehicle)[0] == hear(other)[0] == 0xFD

        def test_fleet(mock_fleet):
            fleet = mock_fleet({"a": "px4", "b": "arducopter"}, over=["udp"], ready_after_s=0.5)
            assert [fleet[name].system_id for name in fleet] == [1, 2]
            assert [hear(vehicle)[5] for vehicle in fleet.values()] == [1, 2]
            seen.append(fleet.process)

        def test_a_fleet_has_ended_with_its_test():
            assert seen[0].returncode == 0

        def test_stepped(mock_vehicle):
            quiet = mock_vehicle.stepped(faults={"fault": [{"kind": "silence"}]})
            loud = mock_vehicle.stepped("arducopter", system_id=9)
            assert quiet.step(0.0) + quiet.step(2.0) == []
            assert loud.step(0.0) + loud.step(2.0) != []
            assert loud.vehicle.system_id == 9

        def test_that_fails_ends_its_fleet_too(mock_fleet):
            seen.append(mock_fleet(2, over=["udp"]).process)
            raise RuntimeError("meant")

        def test_it_has_ended():
            assert seen[1].returncode == 0
        """
    )
    pytester.runpytest_subprocess("-q").assert_outcomes(passed=5, failed=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"vehicles": [{"name": "a", "flavor": "px4"}]}, ["flavor", "px4"]),
        ({"vehicles": [{"name": "a", "flavour": "plane"}]}, ["flavour", "'plane'", "rover"]),
        ({"vehicles": [{"name": "a"}], "over": ["tcp"]}, ["over", "tcp", "udp and zenoh"]),
        (
            {"vehicles": [{"name": "a"}], "faults": {"fault": [{"kind": "x"}]}},
            ["kind", "'x'", "loss"],
        ),
        (
            {"vehicles": [{"name": "a"}], "faults": {"fault": [{"kind": "loss", "vehicle": "b"}]}},
            ["vehicle", "'b'"],
        ),
    ],
)
def test_wrong_settings_are_named_not_waited_for(arguments, words):
    with pytest.raises(ConfigError) as caught, running(**arguments):
        pass
    for word in words:
        assert word in str(caught.value)


@pytest.mark.slow
def test_a_child_ends_when_its_parent_is_killed():
    code = (
        "import os, signal, sys\n"
        "from sitl_mock.child import running\n"
        "with running([{'name': 'a'}], over=['udp']) as fleet:\n"
        "    print(fleet.process.pid, flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    child_pid = int(parent.stdout.readline())
    parent.stdout.close()
    parent.wait()
    watch = f"import os, time\nend = time.monotonic() + 5\nwhile os.path.exists('/proc/{child_pid}/stat'):\n"
    watch += f"    state = open('/proc/{child_pid}/stat').read().rsplit(')')[1].split()[0]\n"
    watch += "    if state == 'Z': break\n    assert time.monotonic() < end\n    time.sleep(0.05)\n"
    subprocess.run([sys.executable, "-c", watch], check=True)


@pytest.mark.slow
def test_ending_twice_is_harmless():
    with running([{"name": "a"}], over=["udp"]) as fleet:
        end(fleet.process)
    assert fleet.process.returncode == 0
