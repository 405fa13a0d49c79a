"""Frames into a byte stream that may take only a part: the rest goes first next time, and whole frames are dropped."""

from collections.abc import Callable


class Tail:
    """Remembers the unsent end of the last frame, so that the stream never holds half a frame followed by another."""

    def __init__(self, write: Callable[[bytes], int]) -> None:
        self._write = write
        self._rest = b""
        self.sent = 0
        self.unsent = 0

    def send(self, frame: bytes) -> None:
        """Write without waiting. `write` returns how many bytes it took, and raises OSError when it can take none."""
        try:
            if self._rest:
                self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                self.unsent += 1
                return
            self._rest = frame[self._write(frame) :]
            self.sent += 1
        except BlockingIOError:
            self.unsent += 1
        except OSError:
            self.unsent += 1
            self._rest = b""

    def forget(self) -> None:
        """A new peer begins with a whole frame."""
        self._rest = b""
