"""The commit in a record's metadata: known in a checkout, absent elsewhere, and never an error."""

import json
import subprocess
from pathlib import Path

import pytest

from guidance.log import writer as commits
from guidance.log.writer import commit, commit_of_checkout, commit_of_install, versions

HASH = "0123456789abcdef0123456789abcdef01234567"
GIT = [
    "git",
    "-c",
    "user.name=t",
    "-c",
    "user.email=t@example.org",
    "-c",
    "init.defaultBranch=main",
]


def git(folder, *words):
    done = subprocess.run(
        [*GIT, "-C", str(folder), *words], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    folder = tmp_path / "checkout"
    folder.mkdir()
    (folder / "pyproject.toml").write_text("")
    git(folder, "init", "-q")
    git(folder, "commit", "-q", "--allow-empty", "-m", "first")
    return folder


def test_the_commit_equals_git_rev_parse_in_every_kind_of_checkout(checkout):
    assert commit_of_checkout(checkout) == git(checkout, "rev-parse", "HEAD")
    git(checkout, "commit", "-q", "--allow-empty", "-m", "second")
    second = git(checkout, "rev-parse", "HEAD")
    git(checkout, "pack-refs", "--all")
    assert not (checkout / ".git" / "refs" / "heads" / "main").exists()
    assert commit_of_checkout(checkout) == second
    git(checkout, "checkout", "-q", "HEAD~1")
    assert commit_of_checkout(checkout) == git(checkout, "rev-parse", "HEAD") != second
    other = checkout.parent / "other"
    git(checkout, "worktree", "add", "-q", str(other), "-b", "side", "main")
    (other / "pyproject.toml").write_text("")
    assert commit_of_checkout(other) == second


def test_a_foreign_repository_around_an_installation_is_ignored(checkout):
    (checkout / "pyproject.toml").unlink()
    assert commit_of_checkout(checkout) is None


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("HEAD", b""),
        ("HEAD", b"\xff\xfe"),
        ("HEAD", b"ref: refs/heads/gone"),
        ("HEAD", b"not a hash"),
    ],
)
def test_an_unreadable_head_gives_no_commit(checkout, name, content):
    (checkout / ".git" / name).write_bytes(content)
    assert commit_of_checkout(checkout) is None


def test_no_repository_gives_no_commit(tmp_path):
    (tmp_path / "pyproject.toml").write_text("")
    assert commit_of_checkout(tmp_path) is None
    (tmp_path / ".git").write_text("gitdir: nowhere")
    assert commit_of_checkout(tmp_path) is None


@pytest.mark.parametrize(
    ("noted", "known"),
    [
        (
            json.dumps(
                {"url": "https://example.org", "vcs_info": {"vcs": "git", "commit_id": HASH}}
            ),
            HASH,
        ),
        (json.dumps({"url": "file:///somewhere", "dir_info": {"editable": True}}), None),
        (json.dumps({"vcs_info": {"commit_id": "main"}}), None),
        (json.dumps([1]), None),
        ("{", None),
        (None, None),
    ],
)
def test_an_installation_gives_the_commit_that_pip_recorded(monkeypatch, noted, known):
    class Distribution:
        def read_text(self, name):
            assert name == "direct_url.json"
            return noted

    monkeypatch.setattr(commits, "distribution", lambda _: Distribution())
    assert commit_of_install() == known
    monkeypatch.setattr(commits, "commit_of_checkout", lambda _: None)
    assert versions().get("commit") == known


def test_a_package_that_is_not_installed_gives_no_commit(monkeypatch):
    monkeypatch.setattr(commits, "PACKAGE", "no-such-package")
    assert commit_of_install() is None


def test_this_checkout_gives_a_commit():
    root = Path(commits.__file__).parents[2]
    assert (commit() is not None) or not (root / ".git").exists()
