"""Software versions for a record, and the commit, read from files without running git."""

import json
import platform
import re
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Final

PACKAGE: Final = "pursuit-guidance"
_RECORDED: Final = (PACKAGE, "numpy", "pymavlink", "mavsdk", "eclipse-zenoh", "mcap")
_HASH: Final = re.compile(r"[0-9a-f]{40}([0-9a-f]{24})?")
_LONGEST_BYTES: Final = 4 * 1024 * 1024


def versions() -> dict[str, str]:
    """Return the versions of Python, of the packages that determine the recorded data, and the commit if known."""
    made_at = commit()
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in _RECORDED},
        **({} if made_at is None else {"commit": made_at}),
    }


def commit() -> str | None:
    """Return the commit of the installed project, or None if unknown.

    In a checkout it is HEAD; uncommitted changes are not considered. Otherwise it is the commit that pip recorded when
    installing from a repository (PEP 610, `direct_url.json`).
    """
    return commit_of_checkout(Path(__file__).parents[2]) or commit_of_install()


def commit_of_checkout(root: Path) -> str | None:
    """Return the commit of HEAD of the repository at `root`, or None if there is none or it cannot be read."""
    try:
        if not (root / "pyproject.toml").is_file():
            return None  # installed inside another repository
        folder = _folder(root / ".git")
        head = _text(folder / "HEAD")
        if not head.startswith("ref: "):
            return _checked(head)
        common = folder / "commondir"
        shared = folder / _text(common) if common.is_file() else folder
        return _reference(head.removeprefix("ref: "), [folder, shared])
    except (OSError, ValueError):
        return None


def commit_of_install() -> str | None:
    """Return the commit of the repository that pip installed, or None."""
    try:
        noted = distribution(PACKAGE).read_text("direct_url.json")
        return _checked(str(json.loads(noted or "{}")["vcs_info"]["commit_id"]))
    except (PackageNotFoundError, OSError, ValueError, KeyError, TypeError):
        return None


def _folder(git: Path) -> Path:
    """Return the folder of the repository; in a worktree, `.git` is a file with its path."""
    return git if git.is_dir() else git.parent / _text(git).removeprefix("gitdir: ")


def _reference(name: str, folders: list[Path]) -> str | None:
    for folder in folders:
        if (folder / name).is_file():
            return _checked(_text(folder / name))
    for folder in folders:
        packed = folder / "packed-refs"
        lines = _text(packed).splitlines() if packed.is_file() else []
        for line in lines:
            found, _, what = line.partition(" ")
            if what == name:
                return _checked(found)
    return None


def _text(path: Path) -> str:
    with path.open("rb") as stream:
        return stream.read(_LONGEST_BYTES).decode("utf-8").strip()


def _checked(text: str) -> str | None:
    return text if _HASH.fullmatch(text) else None
