"""The client of the socket on this computer: what it sends, how long it waits, and what it makes of the answer."""

import io
import json
import socket
from types import SimpleNamespace

import pytest

from guidance.errors import ConfigError, LinkError
from guidance.session.orders import socket_client
from guidance.session.orders.control_token import socket_path
from guidance.session.orders.replies import MAX_REPLY_BYTES
from guidance.session.orders.socket_client import SilentDaemonError, ask_here, ask_team_here
from guidance.session.orders.words import REPLY_TIMEOUT_S, TEAM_TIMEOUT_S

ENDPOINT = "tcp/127.0.0.1:7448"
SECRET = "ab" * 32


class Daemon:
    """A daemon's end of the socket: it keeps what arrives, and answers what the test says."""

    def __init__(self, path):
        self.path = path
        self.answer = {"accepted": True}
        self.error = None
        self.heard = []

    def socket(self, family, kind):
        assert (family, kind) == (socket.AF_UNIX, socket.SOCK_STREAM)
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def settimeout(self, seconds):
        self.timeout_s = seconds

    def connect(self, address):
        assert address == str(socket_path(self.path))
        if self.error is not None:
            raise self.error

    def sendall(self, line):
        assert line.endswith(b"\n")
        self.heard.append((json.loads(line), self.timeout_s))

    def makefile(self, mode):
        assert mode == "rb"
        data = self.answer if isinstance(self.answer, bytes) else json.dumps(self.answer).encode()
        file = io.BytesIO(data)

        def readline(most):
            assert most == 32 * MAX_REPLY_BYTES
            return file.read()

        return SimpleNamespace(readline=readline)


@pytest.fixture
def daemon(monkeypatch, tmp_path):
    path = tmp_path / "uav1.token"
    path.write_text(f"guidance:{SECRET}")
    made = Daemon(path)
    kinds = {"AF_UNIX": socket.AF_UNIX, "SOCK_STREAM": socket.SOCK_STREAM}
    monkeypatch.setattr(socket_client, "socket", SimpleNamespace(socket=made.socket, **kinds))
    return made


def asked(daemon, name=None, **about):
    return ask_here("hold", endpoint=ENDPOINT, name=name, token_file=daemon.path, **about)


def asked_team(daemon, names=(), **about):
    return ask_team_here("hold", "north", names, endpoint=ENDPOINT, token_file=daemon.path, **about)


def test_an_order_is_sent_with_the_token_and_its_sender_and_waited_for(daemon):
    assert asked(daemon, "uav1", by="Ana")["accepted"]
    asked(daemon)
    order = {"token": SECRET, "order": "hold"}
    assert daemon.heard == [
        ({**order, "name": "uav1", "by": "Ana"}, REPLY_TIMEOUT_S),
        ({**order, "name": None, "by": ""}, REPLY_TIMEOUT_S),
    ]


@pytest.mark.parametrize(
    ("name", "answered", "told"),
    [
        (None, {}, "the daemon"),
        ("uav1", {}, "uav1"),
        (None, {"name": "uav7"}, "uav7"),
        ("uav1", {"name": "uav7"}, "uav7"),
    ],
)
def test_an_answer_has_the_name_of_its_daemon_or_the_one_that_was_asked(
    daemon, name, answered, told
):
    daemon.answer = {"accepted": True, **answered}
    assert asked(daemon, name) == {"accepted": True, "order": "hold", "name": told}


def test_the_token_of_an_endpoint_is_read_in_its_usual_place(daemon, monkeypatch):
    monkeypatch.setattr(socket_client, "token_path", {ENDPOINT: daemon.path}.get)
    assert ask_here("hold", endpoint=ENDPOINT, name=None)["accepted"]
    daemon.answer = {"answers": {}}
    assert ask_team_here("hold", "north", (), endpoint=ENDPOINT) == []


def test_an_order_to_a_team_is_sent_whole_and_each_answer_is_read(daemon):
    daemon.answer = {"answers": {"uav1": {"accepted": True}, "uav2": 5}}
    first, second = asked_team(daemon, ("uav1", "uav2"), by="Ana")
    assert first == {"accepted": True, "order": "hold", "name": "uav1"}
    assert (second["accepted"], second["order"], second["name"]) == (False, "hold", "uav2")
    asked_team(daemon)
    order = {"token": SECRET, "team_order": "hold", "team": "north"}
    assert daemon.heard == [
        ({**order, "names": ["uav1", "uav2"], "by": "Ana"}, TEAM_TIMEOUT_S),
        ({**order, "names": [], "by": ""}, TEAM_TIMEOUT_S),
    ]


def test_a_daemon_that_passes_no_orders_on_gives_no_answer_for_a_team(daemon):
    assert asked_team(daemon) is None


@pytest.mark.parametrize("ask", [asked, asked_team])
@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", "no answer that can be read"),
        (b"[" * 100_000, "no answer that can be read"),
        ([], "no answer that can be read"),
        ({"error": "not \x1bnow"}, r"not \\x1bnow$"),
    ],
)
def test_an_answer_that_is_none_is_an_error_that_names_the_endpoint(daemon, ask, answer, words):
    daemon.answer = answer
    with pytest.raises(LinkError, match=f"^control {ENDPOINT}: {words}"):
        ask(daemon)


@pytest.mark.parametrize("ask", [asked, asked_team])
@pytest.mark.parametrize(
    "error", [FileNotFoundError(), NotADirectoryError(), ConnectionRefusedError()]
)
def test_where_no_daemon_listens_there_is_no_answer(daemon, ask, error):
    daemon.error = error
    assert ask(daemon) is None
    daemon.path.unlink()
    assert ask(daemon) is None


def test_a_daemon_that_is_silent_is_named_by_its_socket(daemon):
    daemon.error = TimeoutError("timed out")
    with pytest.raises(SilentDaemonError, match=f"{socket_path(daemon.path)}: .*timed out"):
        asked(daemon)


@pytest.mark.parametrize("ask", [ask_here, ask_team_here])
def test_a_word_that_is_no_order_is_sent_to_nobody(daemon, ask):
    about = {"name": None} if ask is ask_here else {"team": "north", "names": ()}
    with pytest.raises(ConfigError, match="order = 'jump': allowed are abort, "):
        ask("jump", endpoint=ENDPOINT, token_file=daemon.path, **about)
    assert daemon.heard == []
