"""A shell over MAVLink: SERIAL_CONTROL carries what is typed, and back the echo, the answers and the prompt.

Source: https://mavlink.io/en/messages/common.html#SERIAL_CONTROL, PX4 1.17's ``mavlink_shell.cpp`` and ``pxh.cpp``. One
shell per link. Long answers are sent over several cycles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.session import Reply

_PIECE: Final = 70
"""Bytes in one message."""
PROMPT: Final = b"pxh> "
_SHELL: Final = 10  # SERIAL_CONTROL_DEV_SHELL
_REPLY: Final = 1  # SERIAL_CONTROL_FLAG
_RESPOND: Final = 2
_PIECES: Final = 10
"""Messages in one cycle."""
_LONGEST_LINE: Final = 256
_LONGEST_ANSWER: Final = 200_000


class ShellProtocol:
    """The shell of one link.

    Args:
        run: Returns the answer to a line, with its line ends; None without a shell.
    """

    def __init__(self, run: Callable[[str], str | None]) -> None:
        self._run = run
        self._typed = bytearray()
        self._answer = bytearray()

    def handle(self, _now_s: float, message: Message) -> list[Reply]:
        """Take SERIAL_CONTROL for the shell; without the flag RESPOND the shell closes."""
        if message.device != _SHELL or message.flags & _REPLY:
            return []
        if 0 < message.count <= _PIECE:
            for letter in bytes(message.data[: message.count]):
                if letter == ord("\n"):
                    line = self._typed.decode(errors="replace")
                    self._typed.clear()
                    answered = self._run(line)
                    if answered is None:
                        continue
                    answer = f"{line}\n{answered}".encode()
                    self._answer += answer[: _LONGEST_ANSWER - len(self._answer)] + PROMPT
                elif len(self._typed) < _LONGEST_LINE:
                    self._typed.append(letter)
        if not message.flags & _RESPOND:
            self._typed.clear()
            self._answer.clear()
        return self._pieces()

    @property
    def is_idle(self) -> bool:
        """True if every answer has been sent."""
        return not self._answer

    def advance(self, _now_s: float) -> list[Reply]:
        """Return the next part of the answers."""
        return self._pieces() if self._answer else []

    def _pieces(self) -> list[Reply]:
        replies: list[Reply] = []
        while self._answer and len(replies) < _PIECES:
            data = bytes(self._answer[:_PIECE])
            del self._answer[:_PIECE]
            replies.append(
                ("SERIAL_CONTROL", _SHELL, _REPLY, 0, 0, len(data), data.ljust(_PIECE, b"\0"))
            )
        return replies
