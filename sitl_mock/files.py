"""Folders and files that a vehicle offers over FTP, made when they are asked for."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sitl_mock.protocols import Entry

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


@dataclass(frozen=True)
class FileTree:
    """A tree of files.

    Attributes:
        files: Absolute path to what makes its content.
        folders: Folders beside those that the files lie in.
        hidden: Paths that are read but not listed, as they are asked for (ArduPilot's ``@PARAM/param.pck``).
    """

    files: Mapping[str, Callable[[], bytes]]
    folders: frozenset[str] = frozenset()
    hidden: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)

    def entries(self, path: str) -> Sequence[Entry] | None:
        """What a folder holds, None where there is no such folder."""
        folder = _absolute(path)
        folders = {"/", *self.folders, *(posixpath.dirname(name) for name in self.files)}
        if folder not in folders:
            return None
        inside = [Entry(posixpath.basename(name)) for name in sorted(folders) if _lies_in(name, folder)]
        inside += [
            Entry(posixpath.basename(name), len(make())) for name, make in self.files.items() if _lies_in(name, folder)
        ]
        return inside

    def content(self, path: str) -> bytes | None:
        """A file's bytes, None where there is no such file."""
        plain = path.partition("?")[0]
        make = self.hidden.get(plain) or self.files.get(_absolute(plain))
        return None if make is None else make()


def _absolute(path: str) -> str:
    return posixpath.normpath("/" + path.lstrip("/"))


def _lies_in(name: str, folder: str) -> bool:
    return name != "/" and posixpath.dirname(name) == folder
