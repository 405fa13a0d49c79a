"""The daemon's side of an order on this computer: what it reads, what it answers, and whom it waits for."""

import contextlib
import json
import os
import socket
import stat
import threading

import pytest

from guidance.errors import LinkError, OutputError
from guidance.session.orders import control_socket
from guidance.session.orders.control_socket import ControlSocket, begin_exchange
from guidance.session.orders.control_token import socket_path
from tests.harness.bus import published

PLAIN = socket.socket
"""A test may replace the class that the daemon uses."""


def connected(token):
    """Return a connection to the daemon of a token."""
    there = PLAIN(socket.AF_UNIX)
    there.settimeout(3.0)
    there.connect(str(socket_path(token.path)))
    return there


def wait_for_exchanges():
    """Wait until no exchange is under way; an exception in one would fail the test."""
    for thread in threading.enumerate():
        if thread.name == "order":
            thread.join(3.0)


class Daemon:
    """A control socket, and the orders that were given to its vehicle and to its team."""

    def __init__(self, token, *, passes_on=True):
        self.token = token
        self.given = []
        self.threads = []
        self.answer = {"accepted": True}
        self.before_the_answer = None
        pass_on = self._pass_on if passes_on else None
        self.socket = ControlSocket("uav1", self._answer, token, pass_on)

    def _answer(self, order, by):
        self.threads = [threading.current_thread(), *threading.enumerate()]
        self.given.append((order, by))
        if self.before_the_answer is not None:
            self.before_the_answer()
        return self.answer

    def _pass_on(self, order, team, names, *, by):
        self.given.append((order, team, names, by))
        if team == "south":
            raise LinkError("no vehicle of it answers")
        return [{"name": "uav1", "order": order}, {"name": "uav2", "order": order}]

    def sent(self, line):
        """Send bytes; return all that comes back until the exchange ends."""
        with connected(self.token) as there:
            there.sendall(line)
            there.shutdown(socket.SHUT_WR)
            received = there.makefile("rb").read()
        wait_for_exchanges()
        return received

    def asked(self, **request):
        """Send a request with the token; return the line that answers it."""
        line = self.sent(json.dumps({"token": self.token.secret, **request}).encode() + b"\n")
        assert line.endswith(b"}\n")
        return json.loads(line)


@pytest.fixture
def token(tmp_path):
    return published(tmp_path / "ctl.token")


@pytest.fixture
def daemon(token):
    made = Daemon(token)
    yield made
    made.socket.close()


@pytest.fixture
def alone(token):
    """A daemon that passes no orders on."""
    made = Daemon(token, passes_on=False)
    yield made
    made.socket.close()


def test_an_order_reaches_the_vehicle_and_its_answer_has_the_daemons_name(daemon):
    assert daemon.asked(order="hold", by="Ana") == {"name": "uav1", "accepted": True}
    assert daemon.asked(name="uav1") == {"name": "uav1", "accepted": True}
    daemon.answer = {"accepted": False, "name": "another"}
    assert daemon.asked(order="land", name=None) == {"name": "uav1", "accepted": False}
    assert daemon.given == [("hold", "Ana"), ("None", ""), ("land", "")]


def test_an_order_to_a_team_is_passed_on_as_it_was_sent(daemon):
    answers = {name: {"name": name, "order": "land"} for name in ("uav1", "uav2")}
    request = {"team_order": "land", "team": "north", "names": ["uav2", 3], "by": "Ana"}
    assert daemon.asked(**request) == {"answers": answers}
    assert list(daemon.asked(team_order="hold")) == ["answers"]
    assert daemon.given == [("land", "north", ["uav2", "3"], "Ana"), ("hold", "", [], "")]


def test_an_order_that_cannot_be_given_is_answered_with_the_reason(daemon):
    assert daemon.asked(team_order="land", team="south") == {"error": "no vehicle of it answers"}
    daemon.given.clear()
    for request, words in (
        ({"token": "another", "order": "hold"}, "token"),
        ({"order": "hold", "name": "uav2"}, "--name uav2: the daemon there is uav1"),
        ({"team_order": "jump", "team": "north"}, "order = 'jump': allowed are abort, "),
    ):
        answer = daemon.asked(**request)
        assert list(answer) == ["error"]
        assert words in answer["error"]
    assert daemon.given == []


def test_a_daemon_alone_takes_no_order_to_a_team_for_its_own(alone):
    assert alone.asked(team_order="start", team="north") == {"name": "uav1", "accepted": True}
    assert alone.given == [("None", "")]


def test_what_is_no_order_gets_no_answer_and_ends_its_exchange_in_silence(daemon):
    secret = daemon.token.secret
    wrong_kinds = json.dumps({"token": secret, "team_order": "hold", "names": 5}).encode()
    for line in (b"", b"nothing\n", b"[]\n", b"[" * 4000 + b"\n", wrong_kinds + b"\n"):
        assert daemon.sent(line) == b""
    assert daemon.given == []


def test_who_is_gone_before_the_answer_ends_the_exchange_in_silence(daemon):
    there = connected(daemon.token)
    gone = threading.Event()

    def leave():
        there.close()
        gone.set()

    daemon.before_the_answer = leave
    there.sendall(json.dumps({"token": daemon.token.secret}).encode() + b"\n")
    assert gone.wait(5.0)
    wait_for_exchanges()


def test_an_order_has_4096_bytes_and_what_follows_it_does_not_cost_its_answer(daemon):
    def padded(length):
        order = {"token": daemon.token.secret, "order": "hold", "name": "uav1", "by": ""}
        return json.dumps(order | {"by": "a" * (length - len(json.dumps(order)))}).encode()

    assert len(padded(4096)) == 4096
    assert json.loads(daemon.sent(padded(4096) + b"\n"))["accepted"]
    assert daemon.sent(padded(4097) + b"\n") == b""
    assert json.loads(daemon.sent(padded(200) + b"\n" + 20_000 * b"x"))["accepted"]


def test_a_client_that_says_nothing_is_given_up_after_a_second(token, monkeypatch):
    given_s = []

    class Socket(socket.socket):
        def settimeout(self, seconds):
            given_s.append(seconds)
            super().settimeout(min(seconds, 0.02))

    monkeypatch.setattr(socket, "socket", Socket)
    daemon = Daemon(token)
    with contextlib.closing(daemon.socket), connected(token) as there:
        assert there.recv(1) == b""
    assert given_s == [1.0]


def test_beyond_so_many_orders_at_once_a_client_is_turned_away(token, monkeypatch):
    monkeypatch.setattr(control_socket, "MOST_AT_ONCE", 1)
    daemon = Daemon(token)
    with contextlib.closing(daemon.socket):
        with connected(token), connected(token) as second:
            assert second.recv(1) == b""
        wait_for_exchanges()
        assert daemon.asked(order="hold")["accepted"]


def test_no_exchange_waits_for_a_free_place():
    class Full(threading.BoundedSemaphore):
        def acquire(self, blocking=True, timeout=None):
            assert not blocking
            return False

    assert begin_exchange(Full(), pytest.fail) is False


def test_a_thread_of_an_order_has_a_name_and_does_not_outlive_the_process(daemon):
    daemon.asked(order="hold")
    own, *others = daemon.threads
    assert (own.name, own.daemon) == ("order", True)
    assert "control socket" in [thread.name for thread in others]


@pytest.mark.parametrize("error", [None, PermissionError()])
def test_the_socket_gets_the_group_and_the_rights_of_the_token_file(token, monkeypatch, error):
    changes = []

    def chown(*about):
        changes.append(about)
        if error is not None:
            raise error

    monkeypatch.setattr(os, "chown", chown)
    token.path.chmod(0o755)
    daemon = Daemon(token)
    daemon.socket.close()
    daemon.socket.close()
    assert changes == [(socket_path(token.path), -1, token.path.stat().st_gid)]


def test_only_who_may_read_the_token_may_write_to_the_socket(token):
    token.path.chmod(0o755)
    with contextlib.closing(Daemon(token).socket):
        assert stat.S_IMODE(socket_path(token.path).stat().st_mode) == 0o666


def test_a_socket_that_cannot_be_made_is_named(token, tmp_path):
    nowhere = token._replace(path=tmp_path / "nowhere" / "ctl.token")
    with pytest.raises(OutputError, match=str(socket_path(nowhere.path))):
        Daemon(nowhere)
