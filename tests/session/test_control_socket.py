"""Orders by the socket on this computer, which needs no Zenoh and which nobody else can block."""

import itertools
import socket
import stat
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from guidance.errors import ConfigError, LinkError
from guidance.session.orders.control_socket import ControlSocket
from guidance.session.orders.control_token import socket_path
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders.socket_client import ask_here, ask_team_here
from tests.harness.bus import published
from tests.harness.command import HEAVY, fresh

ENDPOINT = "tcp/127.0.0.1:7448"


class Loop:
    """Takes the mailbox every 20 ms, as the flight's loop does: orders are accepted, queries get a status."""

    def __init__(self):
        self.mailbox = Mailbox()
        self.taken = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.wait(0.02):
            for question in itertools.chain(*self.mailbox.take()):
                self.taken.append((question.order, question.by))
                question.set_result({"accepted": True, "order": question.order, "name": "uav1"})

    def close(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def loop():
    made = Loop()
    yield made
    made.close()


@pytest.fixture
def token(tmp_path):
    return published(tmp_path / "ctl.token")


@pytest.fixture
def control(loop, token):
    made = ControlSocket("uav1", loop.mailbox.answer, token)
    yield made
    made.close()


def asked(order, token, name=None):
    return ask_here(order, endpoint=ENDPOINT, name=name, token_file=token.path, by="ctl, ana")


def test_an_order_arrives_with_its_giver_and_is_answered(control, token, loop):
    assert asked("hold", token) == {"accepted": True, "order": "hold", "name": "uav1"}
    assert loop.taken == [("hold", "ctl, ana")]


def test_without_a_token_or_a_daemon_there_is_no_answer(token, tmp_path):
    assert (
        ask_here("hold", endpoint=ENDPOINT, name=None, token_file=tmp_path / "other.token") is None
    )
    assert asked("hold", token) is None


def test_a_socket_left_by_a_killed_daemon_counts_as_none_and_is_replaced(loop, token):
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(socket_path(token.path)))
    assert asked("hold", token) is None
    again = ControlSocket("uav1", loop.mailbox.answer, token)
    assert asked("hold", token)["accepted"]
    again.close()
    assert not socket_path(token.path).exists()


def test_another_token_another_name_and_an_unknown_order_are_errors(control, token):
    published(token.path)
    with pytest.raises(LinkError, match="token is not this daemon's"):
        asked("hold", token)
    token.path.write_text(f"guidance:{token.secret}\n")
    with pytest.raises(LinkError, match="the daemon there is uav1"):
        asked("hold", token, name="uav2")
    with pytest.raises(ConfigError, match="allowed are abort, "):
        asked("jump", token)


@pytest.mark.parametrize(
    ("token_mode", "socket_mode"), [(0o600, 0o600), (0o640, 0o660), (0o644, 0o666)]
)
def test_the_socket_has_the_rights_of_the_token_file(loop, token, token_mode, socket_mode):
    token.path.chmod(token_mode)
    made = ControlSocket("uav1", loop.mailbox.answer, token)
    assert stat.S_IMODE(socket_path(token.path).stat().st_mode) == socket_mode
    made.close()


def test_a_path_too_long_for_the_kernel_works(loop, tmp_path):
    folder = tmp_path / ("f" * 120)
    path = folder / "ctl.token"
    token = published(path)
    made = ControlSocket("uav1", loop.mailbox.answer, token)
    assert asked("hold", token)["accepted"]
    made.close()


@pytest.mark.parametrize(
    "sent", [b"", b"\n", b"[]\n", b"{}\n", b"\xff\n", b'{"token": 1}\n', b"x" * 10_000]
)
def test_whatever_is_sent_orders_nothing_and_the_next_order_is_taken(control, token, loop, sent):
    with socket.socket(socket.AF_UNIX) as there:
        there.connect(str(socket_path(token.path)))
        there.sendall(sent)
        there.shutdown(socket.SHUT_WR)
        there.recv(1000)
    assert loop.taken == []
    assert asked("hold", token)["accepted"]


def test_100_of_100_holds_are_accepted_while_32_clients_poll(control, token):
    """Catches a hold that waits behind the queries of others on the socket."""
    polling = threading.Event()
    polling.set()

    def poll():
        count = 0
        while polling.is_set():
            assert asked("status", token)["accepted"]
            count += 1
        return count

    with ThreadPoolExecutor(32) as pool:
        polls = [pool.submit(poll) for _ in range(32)]
        answers = [asked("hold", token) for _ in range(100)]
        polling.clear()
        assert sum(answer["accepted"] for answer in answers) == 100
        assert all(one.result() > 0 for one in polls)


def ctl(*words, token):
    return fresh("ctl", *words, "--token-file", token.path)


def test_an_order_takes_less_than_400_ms_of_processor_time_and_imports_nothing_heavy(
    control, token
):
    runs = [ctl("hold", token=token) for _ in range(3)]
    code, words, modules, _ = runs[0]
    assert (code, words) == (0, "uav1: hold accepted, \n")
    assert modules & (HEAVY | {"zenoh"}) == set()
    assert min(took_s for *_, took_s in runs) < 0.3  # and the loop answers within two cycles


@pytest.fixture
def team(loop, token):
    """A socket whose daemon passes orders on to a team of two."""
    given = []

    def pass_on(order, team, names, *, by):
        if team != "north":
            raise LinkError(f"--team {team}: no vehicle of it answers")
        given.append((order, team, list(names), by))
        accepted = {"accepted": True, "order": order, "state": "holding"}
        return [{"name": name, **accepted} for name in names or ("uav1", "uav2")]

    made = ControlSocket("uav1", loop.mailbox.answer, token, pass_on)
    yield given
    made.close()


def test_an_order_to_a_team_takes_the_same_fast_path(team, token, loop):
    runs = [ctl("hold", "--team", "north", token=token) for _ in range(3)]
    code, words, modules, _ = runs[0]
    assert (code, words) == (0, "uav1: hold accepted, holding\nuav2: hold accepted, holding\n")
    assert modules & (HEAVY | {"zenoh"}) == set()
    assert min(took_s for *_, took_s in runs) < 0.3
    code, words, *_ = ctl("land", "--team", "north", "--name", "uav2,uav3", token=token)
    assert (code, words) == (0, "uav2: land accepted, holding\nuav3: land accepted, holding\n")
    assert [(order, names) for order, _, names, _ in team[-2:]] == [
        ("hold", []),
        ("land", ["uav2", "uav3"]),
    ]
    assert team[0][3].startswith("ctl")
    with pytest.raises(LinkError, match="--team south: no vehicle of it answers"):
        ask_team_here("hold", "south", (), endpoint=ENDPOINT, token_file=token.path)
    assert loop.taken == []


def test_a_daemon_of_an_older_version_gets_no_order_that_is_meant_for_a_team(control, token, loop):
    assert (
        ask_team_here("start", "north", (), endpoint=ENDPOINT, token_file=token.path, by="ctl")
        is None
    )
    assert "start" not in [order for order, _ in loop.taken]


def test_orders_are_taken_again_after_a_moment_without_a_free_descriptor(loop, token, monkeypatch):
    refusals = iter([OSError(24, "Too many open files")] * 3)

    class Listener(socket.socket):
        def accept(self):
            for refusal in refusals:
                raise refusal
            return super().accept()

    waits_s = []

    class Closed(threading.Event):
        def wait(self, timeout=None):
            waits_s.append(timeout)
            return super().wait(timeout)

    with monkeypatch.context() as patched:
        patched.setattr(socket, "socket", Listener)
        patched.setattr(threading, "Event", Closed)
        made = ControlSocket("uav1", loop.mailbox.answer, token)
    assert asked("hold", token)["accepted"]
    made.close()
    assert [wait_s for wait_s in waits_s if wait_s is not None][:3] == [0.05] * 3


@pytest.mark.parametrize("words", [("hold", "--name", "uav1"), ("status", "--json")])
def test_every_form_of_the_command_is_answered_by_the_socket(control, token, words):
    """Catches an option that makes `ctl` load Zenoh."""
    code, said, modules, _ = ctl(*words, token=token)
    assert code == 0
    assert "accepted" in said
    assert "zenoh" not in modules


def test_an_order_for_another_daemon_is_an_error_with_its_exit_code(control, token):
    command = [
        sys.executable,
        "-m",
        "guidance",
        "ctl",
        "hold",
        "--name",
        "b",
        "--token-file",
        str(token.path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (LinkError.exit_code, "")
    assert "the daemon there is uav1" in done.stderr
