"""PX4's shell over SERIAL_CONTROL: the texts are those of the real one (`python -m tests.witness --only shell`)."""

import pytest

from sitl_mock import MockVehicle
from sitl_mock.mavlink import Decoder, Encoder


class Shell:
    """A shell's client, time by hand."""

    def __init__(self):
        self.vehicle = MockVehicle("px4", ready_after_s=0.0)
        self._encoder = Encoder(255, 190)
        self._decoder = Decoder()
        self._now_s = 0.0
        self.vehicle.step(0.0)

    def type(self, text, flags=6, device=10):
        """Type a text; return what is printed within a second."""
        data = text.encode()
        sent = [
            self._encoder.pack(
                "SERIAL_CONTROL", device, flags, 0, 0, len(part), part.ljust(70, b"\0")
            )
            for part in (data[at : at + 70] for at in range(0, max(1, len(data)), 70))
        ]
        printed = b""
        for _ in range(50):
            self._now_s += 0.02
            for frame in self.vehicle.step(self._now_s, sent):
                for message in self._decoder.feed(frame, whole=True):
                    if message.get_type() == "SERIAL_CONTROL":
                        assert (message.device, message.flags) == (10, 1)
                        printed += bytes(message.data[: message.count])
            sent = []
        return printed.decode()


@pytest.fixture
def shell():
    return Shell()


def test_a_line_is_echoed_answered_and_followed_by_the_prompt(shell):
    assert shell.type("\n") == "\npxh> "
    assert shell.type("no") == ""
    unknown = "nosuch\nInvalid command: nosuch\ntype 'help' for a list of commands\npxh> "
    assert shell.type("such\n") == unknown
    assert shell.type("x" * 1000 + "\n").startswith("x" * 256 + "\nInvalid command")
    shell.type("half a li")
    shell.type("", flags=0)
    assert shell.type("\n") == "\npxh> "
    assert shell.type("help\n", device=0) == ""
    assert "  listener\n" in shell.type("help\n")


def test_parameters_are_shown_and_set(shell):
    symbols = "Symbols: x = used, + = saved, * = unsaved\n"
    shown = shell.type("param show mpc_xy_vel_max\n")
    assert shown.startswith(f"param show mpc_xy_vel_max\n{symbols}x   MPC_XY_VEL_MAX [")
    assert shown.endswith("] : 12.0000\n\n 887/897 parameters used.\npxh> ")
    assert shell.type("param show\n").count("\nx ") == 887
    set_to_9 = "param set MPC_XY_VEL_MAX 9\n  MPC_XY_VEL_MAX: curr: 12.0000 -> new: 9.0000\npxh> "
    assert shell.type("param set MPC_XY_VEL_MAX 9\n") == set_to_9
    assert "x + MPC_XY_VEL_MAX [" in shell.type("param show -c\n")
    assert shell.type("param show -q MPC_XY_VEL_MAX\n").splitlines()[1] == "9.0000"
    assert "not found" in shell.type("param set NOSUCH 1\n")


def test_versions_state_and_topics_are_told(shell):
    assert "PX4 version: Release 1.17.0 (17891583)\n" in shell.type("ver all\n")
    assert "ERROR [ver] unknown command\nCommand 'ver' failed, returned 1.\n" in shell.type(
        "ver x\n"
    )
    assert "INFO  [commander] Disarmed\nINFO  [commander] navigation mode: Hold\n" in shell.type(
        "commander status\n"
    )
    told = shell.type("listener vehicle_attitude\n").splitlines()
    assert told[1:4] == ["", "TOPIC: vehicle_attitude", " vehicle_attitude"]
    assert told[6].startswith("    q: [")
    assert told[6].endswith("deg)")
    assert "did not match any known topics\n" in shell.type("listener nosuch\n")
    assert (
        shell.type("listener vehicle_status -n 3\n").count("TOPIC: vehicle_status instance 0 #")
        == 3
    )
    shell.vehicle.autopilot.state.armed = True
    assert "[commander] Armed" in shell.type("commander status\n")


def test_arducopter_has_no_shell():
    shell = Shell()
    shell.vehicle = MockVehicle("arducopter", ready_after_s=0.0)
    assert shell.type("ver all\n") == ""
