"""FTP refused properly: every request gets a NAK at once, so that no client waits for a timeout.

Source: https://mavlink.io/en/services/ftp.html. ``ResetSessions`` and ``TerminateSession`` succeed: there is nothing
that could be open.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.reply import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message

PAYLOAD: Final = 251
_HEAD: Final = struct.Struct("<HBBBBBBI")
_BY_NAME: Final = frozenset({3, 4, 6, 7, 8, 9, 10, 11, 13, 14})  # operations that name a file or a folder


class Opcode(IntEnum):
    """The operations that matter here."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """First data byte of a NAK."""

    INVALID_SESSION = 4
    UNKNOWN_COMMAND = 7
    FILE_NOT_FOUND = 10


class FtpRefusal:
    """FTP on one link."""

    def handle(self, now_s: float, message: Message) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Take FILE_TRANSFER_PROTOCOL."""
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return []
        sequence, session, opcode, *_ = _HEAD.unpack(bytes(message.payload[: _HEAD.size]))
        if opcode in {Opcode.ACK, Opcode.NAK}:
            return []
        if opcode in {Opcode.TERMINATE_SESSION, Opcode.RESET_SESSIONS}:
            return [_reply(message, sequence, session, Opcode.ACK, opcode, b"")]
        error = FtpError.FILE_NOT_FOUND if opcode in _BY_NAME else FtpError.INVALID_SESSION
        if not 0 < opcode <= 15:
            error = FtpError.UNKNOWN_COMMAND
        return [_reply(message, sequence, session, Opcode.NAK, opcode, bytes((error,)))]

    def advance(self, now_s: float) -> list[Reply]:  # noqa: ARG002 - a Piece
        """Return nothing."""
        return []


def _reply(message: Message, sequence: int, session: int, opcode: Opcode, asked: int, data: bytes) -> Reply:
    head = _HEAD.pack((sequence + 1) & 0xFFFF, session, opcode, len(data), asked, 0, 0, 0)
    return ("FILE_TRANSFER_PROTOCOL", 0, *source_of(message), (head + data).ljust(PAYLOAD, b"\0"))
