"""Flights are their owner's: whatever the umask, files have 0600 and folders that are made for them 0700."""

import os
import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from guidance.cli.fly import fly_scenario
from guidance.cli.program import app
from guidance.files import private_file, private_folder, whole_file
from guidance.session.open.mock import MockOptions
from guidance.session.open.opened import NOBODY

NEAR = Path(__file__).parent / "data" / "near_chase.toml"
CAREFREE = 0
STRICT = 0o077
ABSURD = 0o777


@pytest.fixture(params=[CAREFREE, STRICT, ABSURD])
def umask(request):
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


@pytest.fixture
def carefree():
    before = os.umask(CAREFREE)
    yield
    os.umask(before)


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_folders_that_are_missing_are_made_for_us_alone(tmp_path, umask):
    made = private_folder(tmp_path / "a" / "b")
    assert [mode(made), mode(made.parent)] == [0o700, 0o700]


def test_a_folder_that_was_there_keeps_its_rights(tmp_path, umask):
    tmp_path.chmod(0o750)
    assert private_folder(tmp_path) == tmp_path
    assert mode(tmp_path) == 0o750


def test_a_file_in_a_folders_place_is_an_error(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(FileExistsError):
        private_folder(tmp_path / "a")
    with pytest.raises(NotADirectoryError):
        private_folder(tmp_path / "a" / "b")


def test_a_file_is_ours_alone_even_where_another_was(tmp_path, umask):
    path = tmp_path / "new"
    assert private_file(path).read_bytes() == b""
    assert mode(path) == 0o600
    path.write_text("old")
    path.chmod(0o666)
    assert private_file(path).read_bytes() == b""
    assert mode(path) == 0o600


def test_a_device_keeps_its_rights(tmp_path):
    before = mode(Path("/dev/null"))
    private_file(Path("/dev/null"))
    assert mode(Path("/dev/null")) == before


@pytest.mark.parametrize("target", ["there", "missing"])
def test_a_symbolic_link_is_refused_and_its_target_stays(tmp_path, target):
    (tmp_path / "there").write_text("theirs")
    (tmp_path / "link").symlink_to(tmp_path / target)
    with pytest.raises(OSError, match="symbolic link"):
        private_file(tmp_path / "link")
    assert (tmp_path / "there").read_text() == "theirs"
    assert not (tmp_path / "missing").exists()


def test_a_file_of_another_user_is_refused_and_stays_as_it_is(tmp_path, monkeypatch):
    """A file that others may write: opening it succeeds."""
    path = tmp_path / "theirs"
    path.write_text("theirs")
    path.chmod(0o666)
    monkeypatch.setattr(os, "geteuid", lambda: path.stat().st_uid + 1)
    with pytest.raises(PermissionError, match="another user"):
        private_file(path)
    assert (path.read_text(), mode(path)) == ("theirs", 0o666)


def test_a_pipe_in_a_files_place_does_not_block(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="pipe"):
        private_file(tmp_path / "pipe")


def test_a_file_takes_its_place_when_it_is_whole_and_only_then(tmp_path, umask):
    path = tmp_path / "row.json"
    path.write_text("before")

    def write_half():
        with whole_file(path) as unfinished:
            unfinished.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert path.read_text() == "before"
    with whole_file(path) as unfinished:
        unfinished.write_text("after")
        assert unfinished.suffix == path.suffix
    assert path.read_text() == "after"
    assert mode(path) == 0o600
    assert list(tmp_path.iterdir()) == [path]


def test_a_whole_file_never_follows_a_symbolic_link(tmp_path):
    (tmp_path / "theirs").write_text("theirs")
    (tmp_path / "link.csv").symlink_to(tmp_path / "theirs")
    with pytest.raises(OSError, match="symbolic link"), whole_file(tmp_path / "link.csv"):
        pass
    assert (tmp_path / "theirs").read_text() == "theirs"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["link.csv", "theirs"]


def test_a_device_is_written_directly():
    with whole_file(Path("/dev/null")) as device:
        assert device == Path("/dev/null")


@pytest.mark.usefixtures("carefree", "soon_up_and_down")
def test_whatever_a_flight_and_its_report_leave_is_their_owners(tmp_path, monkeypatch):
    """Catches a file of a flight, record or report that others may read."""
    from guidance.viz import report as page

    flown = tmp_path / "flights" / "one"
    monkeypatch.setattr(page, "PICTURES", dict(list(page.PICTURES.items())[:1]))
    assert fly_scenario(str(NEAR), MockOptions(fast=True), flown, None, NOBODY, as_json=False) == 0
    assert set(page.write_report(flown / "record.mcap", flown / "report")) <= set(flown.rglob("*"))
    run = ["scenario", "run", str(NEAR), "--as", "maths", "--out", str(tmp_path / "played")]
    assert CliRunner().invoke(app, run, catch_exceptions=False).exit_code == 0
    left = [tmp_path / "played" / "outcome.json", tmp_path / "flights", flown, *flown.rglob("*")]
    assert {"record.mcap", "outcome.json", "flight.png", "report.html"} <= {
        path.name for path in left
    }
    assert not told_apart(left)


@pytest.mark.usefixtures("carefree")
def test_so_is_a_sweeps_folder(tmp_path):
    from guidance.sweeps.folder import alone, write_whole

    with alone(tmp_path / "a" / "b"):
        write_whole(tmp_path / "a" / "b" / "rows", b"1")
    assert not told_apart([*(tmp_path / "a").rglob("*"), tmp_path / "a"])


def told_apart(paths):
    """Name those that others could read or write, or we could not."""
    return {
        str(path): oct(mode(path))
        for path in paths
        if mode(path) != (0o700 if path.is_dir() else 0o600)
    }
