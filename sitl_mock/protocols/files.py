"""Files and logs on one link: FTP can list folders and read files; changes are refused.

Source: https://mavlink.io/en/services/ftp.html. Every request is answered at once, so that no client waits for a
timeout. One file can be open at a time. List and read requests carry their offset, so repeated ones are answered again.
The content of a file is made when it is read.

LOG_REQUEST_LIST (https://mavlink.io/en/messages/common.html#LOG_REQUEST_LIST): the mock writes no flight log, and says
so as an autopilot without one does (ArduCopter 4.5.7 before its first arming).
"""

from __future__ import annotations

import binascii
import posixpath
import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

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
    """The supported operations, and the two answers."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


_WRITING: Final = frozenset({6, 7, 8, 9, 10, 11, 12, 13})


class FtpError(IntEnum):
    """First data byte of a NAK."""

    FAIL_ERRNO = 2
    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_NOT_FOUND = 10


_READ_ONLY: Final = 30  # EROFS


class Entry(NamedTuple):
    """One entry of a folder: a file with its size, or a folder (size None)."""

    name: str
    size: int | None = None

    def encoded(self) -> bytes:
        """Return the entry in wire format."""
        text = f"D{self.name}" if self.size is None else f"F{self.name}\t{self.size}"
        return text.encode() + b"\0"


class Files(Protocol):
    """The files of a vehicle."""

    def entries(self, path: str) -> Sequence[Entry] | None:
        """Return the entries of a folder, None if it does not exist."""
        ...

    def content(self, path: str) -> bytes | None:
        """Return a file's bytes, None if it does not exist."""
        ...


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


class _Nak(Exception):  # noqa: N818 - an answer
    def __init__(self, error: FtpError, *more: int) -> None:
        super().__init__(error)
        self.data = bytes((error, *more))


class FtpProtocol:
    """FTP on one link, over the vehicle's files."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._open: bytes | None = None
        self._served: dict[int, Callable[[_Request], list[tuple[int, bytes]]]] = {
            Opcode.TERMINATE_SESSION: self._close,
            Opcode.RESET_SESSIONS: self._close,
            Opcode.LIST_DIRECTORY: self._list,
            Opcode.OPEN_FILE_RO: self._open_file,
            Opcode.READ_FILE: self._read,
            Opcode.CALC_FILE_CRC32: self._crc,
            Opcode.BURST_READ_FILE: self._burst,
        }

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
        """Return offset and data of each ACK."""
        served = self._served.get(request.opcode)
        if served is not None:
            return served(request)
        if request.opcode in _WRITING:
            raise _Nak(FtpError.FAIL_ERRNO, _READ_ONLY)
        raise _Nak(FtpError.UNKNOWN_COMMAND)

    def _close(self, _request: _Request) -> list[tuple[int, bytes]]:
        self._open = None
        return [(0, b"")]

    def _list(self, request: _Request) -> list[tuple[int, bytes]]:
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

    def _content(self, request: _Request) -> bytes:
        content = self._files.content(request.path)
        if content is None:
            raise _Nak(FtpError.FILE_NOT_FOUND)
        return content

    def _open_file(self, request: _Request) -> list[tuple[int, bytes]]:
        self._open = content = self._content(request)
        return [(0, struct.pack("<I", len(content)))]

    def _crc(self, request: _Request) -> list[tuple[int, bytes]]:
        return [
            (0, struct.pack("<I", binascii.crc32(self._content(request), 0xFFFFFFFF) ^ 0xFFFFFFFF))
        ]

    def _read(self, request: _Request, pieces: int = 1) -> list[tuple[int, bytes]]:
        if self._open is None:
            raise _Nak(FtpError.INVALID_SESSION)
        if request.offset >= len(self._open):
            raise _Nak(FtpError.END_OF_FILE)
        size = min(request.size or DATA, DATA)
        starts = range(request.offset, len(self._open), size)[:pieces]
        return [(start, self._open[start : start + size]) for start in starts]

    def _burst(self, request: _Request) -> list[tuple[int, bytes]]:
        return self._read(request, BURST)


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
        files: Absolute path to a function that returns the content.
        folders: Folders besides those of the files.
        hidden: Readable paths that are not listed (ArduPilot's ``@PARAM/param.pck``).
    """

    files: Mapping[str, Callable[[], bytes]]
    folders: frozenset[str] = frozenset()
    hidden: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)

    def entries(self, path: str) -> Sequence[Entry] | None:
        """Return the entries of a folder, None if it does not exist."""
        folder = _absolute(path)
        folders = {"/", *self.folders, *(posixpath.dirname(name) for name in self.files)}
        if folder not in folders:
            return None
        inside = [
            Entry(posixpath.basename(name)) for name in sorted(folders) if _lies_in(name, folder)
        ]
        inside += [
            Entry(posixpath.basename(name), len(make()))
            for name, make in self.files.items()
            if _lies_in(name, folder)
        ]
        return inside

    def content(self, path: str) -> bytes | None:
        """Return a file's bytes, None if it does not exist."""
        plain = path.partition("?")[0]
        make = self.hidden.get(plain) or self.files.get(_absolute(plain))
        return None if make is None else make()


def _absolute(path: str) -> str:
    return posixpath.normpath("/" + path.lstrip("/"))


def _lies_in(name: str, folder: str) -> bool:
    return name != "/" and posixpath.dirname(name) == folder


NO_LOG: Final[Reply] = ("LOG_ENTRY", 0, 0, 0, 0, 0)


class LogProtocol:
    """Flight logs on one link: none."""

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take LOG_REQUEST_LIST; requests for log data are not answered."""
        if message.get_type() == "LOG_REQUEST_LIST":
            return [NO_LOG]
        return []
