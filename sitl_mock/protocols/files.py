"""Files on one link: FTP lists folders, reads files, and keeps what a client writes.

Source: https://mavlink.io/en/services/ftp.html. Every request is answered at once, so that no client waits for a
timeout. One file can be open at a time. List and read requests carry their offset, so repeated ones are answered again.
The content of a file is made when it is read.
"""

from __future__ import annotations

import binascii
import posixpath
import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.logs import LogBook
from sitl_mock.protocols.session import Reply, source_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sitl_mock.mavlink import Message

PAYLOAD: Final = 251
_HEAD: Final = struct.Struct("<HBBBBBBI")
DATA: Final = PAYLOAD - _HEAD.size
BURST: Final = 20
"""Frames of a burst; the client requests the next burst from its end."""


class Opcode(IntEnum):
    """The operations, and the two answers."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """First data byte of a NAK."""

    FAIL_ERRNO = 2
    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


_NO_SPACE: Final = 28  # ENOSPC
_NOT_EMPTY: Final = 39  # ENOTEMPTY
STORAGE_BYTES: Final = 4 << 20
STORAGE_ENTRIES: Final = 200
"""Clients can fill the mock's storage, but not the computer's memory."""


class Entry(NamedTuple):
    """One entry of a folder: a file with its size, or a folder (size None)."""

    name: str
    size: int | None = None

    def encoded(self) -> bytes:
        """Return the entry in wire format."""
        text = f"D{self.name}" if self.size is None else f"F{self.name}\t{self.size}"
        return text.encode() + b"\0"


class Storage:
    """What clients have written, by absolute path, and the flight logs; it outlives a reboot.

    Args:
        logs: The vehicle's logs, which have a limit of their own.
    """

    def __init__(self, logs: LogBook | None = None) -> None:
        self.files: dict[str, bytes] = {}
        self.folders: set[str] = set()
        self.logs = LogBook() if logs is None else logs

    def takes(self, more_bytes: int) -> bool:
        """Return True if there is space for some bytes and one more entry."""
        used_bytes = sum(len(content) for content in self.files.values())
        entries = len(self.files) + len(self.folders)
        return used_bytes + more_bytes <= STORAGE_BYTES and entries < STORAGE_ENTRIES


class _Request(NamedTuple):
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        return self.data.rstrip(b"\0").decode(errors="replace")


def file_crc(content: bytes) -> int:
    """Return MAVLink's CRC-32 of a file, which begins at 0 and is not inverted at the end."""
    return binascii.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


class _Nak(Exception):  # noqa: N818 - an answer
    def __init__(self, error: FtpError, *more: int) -> None:
        super().__init__(error)
        self.data = bytes((error, *more))


class FtpProtocol:
    """FTP on one link, over the vehicle's files.

    A path of the storage can be changed; the vehicle's own files are protected.
    """

    def __init__(self, files: FileTree) -> None:
        self._files = files
        self._storage = files.storage
        self._open: bytes | None = None
        self._written: str | None = None

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take FILE_TRANSFER_PROTOCOL."""
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return []
        raw = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEAD.unpack_from(raw)
        if opcode in {Opcode.ACK, Opcode.NAK}:
            return []
        request = _Request(
            sequence, session, opcode, size, offset, raw[_HEAD.size :][: min(size, DATA)]
        )
        try:
            pieces = self._serve(request)
        except _Nak as nak:
            return [_reply(message, request, Opcode.NAK, offset, nak.data)]
        last = len(pieces) - 1
        return [
            _reply(message, request, Opcode.ACK, at, data, after=number, complete=number == last)
            for number, (at, data) in enumerate(pieces)
        ]

    def _serve(self, request: _Request) -> list[tuple[int, bytes]]:
        """Return the pieces of the answer, each with its offset in the file.

        Raises:
            _Nak: The request is refused, or its operation is unknown.
        """
        match request.opcode:
            case Opcode.TERMINATE_SESSION | Opcode.RESET_SESSIONS:
                self._open = None
                self._written = None
                return [(0, b"")]
            case Opcode.LIST_DIRECTORY:
                entries = self._files.entries(request.path)
                if entries is None:
                    raise _Nak(FtpError.FILE_NOT_FOUND)
                if request.offset >= len(entries):
                    raise _Nak(FtpError.END_OF_FILE)
                listed = b""
                for entry in entries[request.offset :]:
                    line = entry.encoded()
                    if len(listed) + len(line) > DATA:
                        break
                    listed += line
                return [(request.offset, listed)]
            case Opcode.OPEN_FILE_RO:
                self._open = content = self._content(request)
                return [(0, struct.pack("<I", len(content)))]
            case Opcode.READ_FILE | Opcode.BURST_READ_FILE:
                if self._open is None:
                    raise _Nak(self._files.unopened)
                if request.offset >= len(self._open):
                    raise _Nak(FtpError.END_OF_FILE)
                size = min(request.size, DATA) if request.size else DATA
                most = 1 if request.opcode == Opcode.READ_FILE else BURST
                starts = range(request.offset, len(self._open), size)[:most]
                return [(start, self._open[start : start + size]) for start in starts]
            case Opcode.CALC_FILE_CRC32:
                crc = file_crc(self._content(request))
                return [(0, struct.pack("<I", crc))]
        return [self._change(request)]

    def _change(self, request: _Request) -> tuple[int, bytes]:
        """Carry out an operation that changes the storage; return the only piece of its answer."""
        files = self._storage.files
        match request.opcode:
            case Opcode.CREATE_FILE:
                path = self._new_path(request.path)
                files[path] = b""
                self._written = path
            case Opcode.OPEN_FILE_WO:
                self._written = self._stored_file(request.path)
                return (0, struct.pack("<I", len(files[self._written])))
            case Opcode.WRITE_FILE:
                self._write(request)
                return (request.offset, b"")
            case Opcode.TRUNCATE_FILE:
                path = self._stored_file(request.path)
                if not self._storage.takes(request.offset):
                    raise _Nak(FtpError.FAIL_ERRNO, _NO_SPACE)
                files[path] = files[path][: request.offset].ljust(request.offset, b"\0")
            case Opcode.REMOVE_FILE:
                if not self._storage.logs.remove(absolute(request.path)):
                    del files[self._stored_file(request.path)]
            case Opcode.CREATE_DIRECTORY:
                self._storage.folders.add(self._new_path(request.path))
            case Opcode.REMOVE_DIRECTORY:
                self._remove_folder(absolute(request.path))
            case Opcode.RENAME:
                old, _, new = request.path.partition("\0")
                self._rename(absolute(old), new)
            case _:
                raise _Nak(FtpError.UNKNOWN_COMMAND)
        return (0, b"")

    def _content(self, request: _Request) -> bytes:
        content = self._files.content(request.path)
        if content is None:
            raise _Nak(FtpError.FILE_NOT_FOUND)
        return content

    def _write(self, request: _Request) -> None:
        before = None
        if self._written is not None:
            before = self._storage.files.get(self._written)
        if self._written is None or before is None:
            raise _Nak(self._files.unopened)
        end = request.offset + len(request.data)
        if not self._storage.takes(end - len(before)):
            raise _Nak(FtpError.FAIL_ERRNO, _NO_SPACE)
        head = before[: request.offset].ljust(request.offset, b"\0")
        self._storage.files[self._written] = head + request.data + before[end:]

    def _remove_folder(self, path: str) -> None:
        entries = self._files.entries(path)
        if entries is None:
            raise _Nak(FtpError.FILE_NOT_FOUND)
        if entries:
            raise _Nak(FtpError.FAIL_ERRNO, self._files.full_folder)
        if path not in self._storage.folders:
            raise _Nak(FtpError.FILE_PROTECTED)
        self._storage.folders.remove(path)

    def _rename(self, path: str, new: str) -> None:
        if path in self._storage.folders and not self._files.entries(path):
            self._storage.folders.add(self._new_path(new))
            self._storage.folders.remove(path)
            return
        content = self._storage.files[self._stored_file(path)]
        self._storage.files[self._new_path(new)] = content
        del self._storage.files[path]

    def _new_path(self, name: str) -> str:
        """Return the path of a new file or folder.

        Raises:
            _Nak: It exists, its folder does not, or the storage is full.
        """
        path = absolute(name)
        if self._files.entries(posixpath.dirname(path)) is None:
            raise _Nak(FtpError.FILE_NOT_FOUND)
        if self._files.content(path) is not None or self._files.entries(path) is not None:
            raise _Nak(FtpError.FILE_EXISTS)
        if not self._storage.takes(0):
            raise _Nak(FtpError.FAIL_ERRNO, _NO_SPACE)
        return path

    def _stored_file(self, name: str) -> str:
        """Return the path of a file that a client has written.

        Raises:
            _Nak: There is no such file, or it is the vehicle's own.
        """
        path = absolute(name)
        if path in self._storage.files:
            return path
        if self._files.content(path) is None:
            raise _Nak(FtpError.FILE_NOT_FOUND)
        raise _Nak(FtpError.FILE_PROTECTED)


def _reply(
    message: Message,
    request: _Request,
    opcode: Opcode,
    offset: int,
    data: bytes,
    *,
    after: int = 0,
    complete: bool = False,
) -> Reply:
    burst = int(complete and request.opcode == Opcode.BURST_READ_FILE)
    sequence = (request.sequence + 1 + after) & 0xFFFF
    head = _HEAD.pack(
        sequence, request.session, opcode, len(data), request.opcode, burst, 0, offset
    )
    return ("FILE_TRANSFER_PROTOCOL", 0, *source_of(message), (head + data).ljust(PAYLOAD, b"\0"))


@dataclass(frozen=True)
class FileTree:
    """A tree of files.

    Attributes:
        files: The vehicle's own: absolute path to a function that returns the content.
        folders: Folders besides those of the files.
        hidden: Readable paths that are not listed (ArduPilot's ``@PARAM/param.pck``); the text behind ``?`` is given.
        hidden_folders: Listed folders of such paths (ArduPilot's ``@SYS``), which tell more than can be read.
        unopened: Answer to reading or writing without an open file.
        full_folder: The system's error for the removal of a folder that is not empty.
        storage: What clients have written.
    """

    files: Mapping[str, Callable[[], bytes]]
    folders: frozenset[str] = frozenset()
    hidden: Mapping[str, Callable[[str], bytes]] = field(default_factory=dict)
    hidden_folders: Mapping[str, Sequence[Entry]] = field(default_factory=dict)
    unopened: FtpError = FtpError.INVALID_SESSION
    full_folder: int = _NOT_EMPTY
    storage: Storage = field(default_factory=Storage)

    def entries(self, path: str) -> Sequence[Entry] | None:
        """Return the entries of a folder, None if it does not exist."""
        if path.rstrip("/") in self.hidden_folders:
            return self.hidden_folders[path.rstrip("/")]
        folder = absolute(path)
        folders = {"/", *self.folders, *self.storage.folders}
        for name in (*self.files, *self.storage.logs.files):
            while (name := posixpath.dirname(name)) not in folders:
                folders.add(name)
        if folder not in folders:
            return None
        names = sorted(name for name in folders if _lies_in(name, folder))
        inside = [Entry(posixpath.basename(name)) for name in names]
        for name, make in self.files.items():
            if _lies_in(name, folder):
                inside.append(Entry(posixpath.basename(name), len(make())))
        for name, content in (*self.storage.logs.files.items(), *self.storage.files.items()):
            if _lies_in(name, folder):
                inside.append(Entry(posixpath.basename(name), len(content)))
        return inside

    def content(self, path: str) -> bytes | None:
        """Return a file's bytes, None if it does not exist."""
        plain, _, query = path.partition("?")
        hidden = self.hidden.get(plain)
        if hidden is not None:
            return hidden(query)
        place = absolute(plain)
        make = self.files.get(place)
        if make is not None:
            return make()
        log = self.storage.logs.files.get(place)
        return self.storage.files.get(place) if log is None else bytes(log)


def absolute(path: str) -> str:
    """Return a path from the root, without dots."""
    return posixpath.normpath("/" + path.lstrip("/"))


def _lies_in(name: str, folder: str) -> bool:
    return name != "/" and posixpath.dirname(name) == folder
