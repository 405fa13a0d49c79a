"""Who may order: the token, its file and its rights. Over a real Zenoh session on loopback where it says so."""

import os
import socket
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from guidance.errors import ConfigError, LinkError, OutputError
from guidance.links.zenoh.session import open_session
from guidance.session.orders import control_token
from guidance.session.orders.control_client import join_session
from guidance.session.orders.mailbox import Mailbox
from guidance.session.orders_section import Control
from tests.harness.bus import ControlBus, published


@pytest.fixture
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run" / "uav1.token"


def test_a_token_is_drawn_anew_each_time_and_for_its_owners_eyes(tmp_path):
    path = tmp_path / "run" / "guidance" / "uav1.token"
    first = published(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert control_token.read_token(path) == first
    second = published(path)
    assert len(second.secret) == 64
    assert second.secret != first.secret
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_token_that_a_person_made_for_a_group_is_used_and_stays(path):
    path.parent.mkdir(mode=0o700)
    path.write_text("guidance:" + "ab" * 32)
    path.chmod(0o640)
    token = published(path)
    assert token == (path, "ab" * 32)
    control_token.discard_token(token)
    assert path.exists()


def test_our_token_goes_with_us_and_a_successors_stays(path):
    first = published(path)
    second = published(path)
    control_token.discard_token(first)
    assert control_token.read_token(path) == second
    control_token.discard_token(second)
    assert control_token.read_token(path) is None


def test_a_token_that_somebody_spoiled_or_removed_disturbs_nobody_who_ends(path):
    token = published(path)
    path.write_text("spoiled")
    control_token.discard_token(token)
    assert path.read_text() == "spoiled"
    path.unlink()
    control_token.discard_token(token)


@pytest.mark.parametrize(
    "text", ["", "guidance:", "guidance:xyz", "root:" + "ab" * 32, "guidance:" + "ab" * 4]
)
def test_what_is_no_token_is_one_clear_error(path, text):
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(ConfigError, match="one line, guidance:<hexadecimal digits>"):
        control_token.read_token(path)


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: path.write_bytes(b"\xff"), "not a text file"),
        (Path.mkdir, "Is a directory"),
        (lambda path: path.write_text("guidance:" + "ab" * 2044), "larger than 4096 bytes"),
    ],
)
def test_a_token_that_cannot_be_read_says_why(path, make, reason):
    path.parent.mkdir()
    make(path)
    with pytest.raises(ConfigError, match=rf"{path}: cannot be read \({reason}\)"):
        control_token.read_token(path)


def test_a_path_of_more_than_100_bytes_is_reached_by_its_folder_as_long_as_it_is_needed():
    folder = Path(tempfile.gettempdir())
    longest = folder / "x".ljust(99 - len(str(folder)), "x")
    with control_token.reachable(longest) as address:
        assert address == str(longest)
    longer = folder / f"{longest.name}x"
    with control_token.reachable(longer) as address:
        parent, _, name = address.rpartition("/")
        assert (name, Path(parent).readlink()) == (longer.name, folder.resolve())
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(int(parent.rpartition("/")[2]))


@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o770])
@pytest.mark.parametrize("reading", [control_token.draw_token, control_token.read_token])
def test_a_token_where_others_may_write_is_refused(path, reading, mode):
    """A sticky folder too: another user may have put the token there, and knows its secret."""
    path.parent.mkdir()
    path.write_text("guidance:" + "ab" * 32)
    path.chmod(0o644)
    path.parent.chmod(mode)
    with pytest.raises(ConfigError, match="others may write to"):
        reading(path)


def test_a_daemons_token_in_a_folder_of_another_user_is_refused(path, monkeypatch):
    monkeypatch.setattr(
        Path, "stat", lambda _: SimpleNamespace(st_uid=os.getuid() + 1, st_mode=0o40755)
    )
    with pytest.raises(ConfigError, match="others may write to"):
        control_token.draw_token(path)


def test_the_folder_for_users_without_a_runtime_folder_is_refused_if_another_made_it(
    monkeypatch, tmp_path
):
    """Its name is easy to guess: a stranger's token there would lead our orders to a daemon of theirs."""
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = control_token.token_path("tcp/127.0.0.1:7448").parent
    folder.mkdir(mode=0o700)
    assert control_token.token_path("tcp/127.0.0.1:7448").parent == folder
    folder.chmod(0o1777)
    with pytest.raises(ConfigError, match="others may write to"):
        control_token.token_path("tcp/127.0.0.1:7448")


def test_a_path_that_cannot_be_written_is_refused():
    with pytest.raises(
        OutputError, match=r"control.token_file = '/proc/nowhere/a.token': cannot be written"
    ):
        control_token.draw_token(Path("/proc/nowhere/a.token"))


def test_the_token_lies_in_the_runtime_folder_of_the_service_or_of_the_user(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    at = "tcp/127.0.0.1:7448"
    assert control_token.token_path(at) == tmp_path / "guidance" / "tcp-127.0.0.1-7448.token"
    named = control_token.token_path("unixsock-stream/run/_Guidance")
    assert named.name == "unixsock-stream-run-Guidance.token"
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/guidance:/run/other")
    assert str(control_token.token_path(at)) == "/run/guidance/tcp-127.0.0.1-7448.token"
    monkeypatch.delenv("RUNTIME_DIRECTORY")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert control_token.token_path(at).parent.name == f"guidance-{os.getuid()}"


@pytest.fixture
def control(endpoint, path):
    bus = ControlBus("uav1", Mailbox(), Control(endpoint=endpoint, host=True, token_file=path))
    yield bus
    bus.close()


def test_nobody_gets_in_without_the_token(control, endpoint, path, tmp_path):
    """An order of another user, who can reach the port and cannot read the file."""
    with pytest.raises(LinkError):
        open_session(endpoint, timeout_s=1.0)
    forged = tmp_path / "forged"
    forged.write_text("guidance:" + "00" * 32)
    with pytest.raises(LinkError, match="does not let us in"):
        join_session(endpoint, forged, timeout_s=1.0)
    with join_session(endpoint, path) as session:
        assert session.info.routers_zid()


def test_a_daemon_that_finds_the_endpoint_taken_leaves_the_owners_token_alone(
    control, endpoint, path
):
    before = path.read_text()
    with pytest.raises(LinkError, match="cannot listen there"):
        ControlBus("uav2", Mailbox(), Control(endpoint=endpoint, host=True, token_file=path))
    assert path.read_text() == before
    assert sorted(one.name for one in path.parent.iterdir()) == [
        path.with_suffix(".sock").name,
        path.name,
    ]
    control.close()
    assert not path.exists()
