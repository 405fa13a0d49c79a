"""A serial port, through pyserial."""

import contextlib
import os
import termios
import threading
from collections.abc import Mapping, Sequence
from typing import Final

import serial

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Reader, Wake
from guidance.links.wires.stream import Tail

_WAIT_S: Final = 0.1
_MOST_BYTES: Final = 4096


class SerialWire:
    """One port, opened for ourselves alone, and opened again when it comes back after being unplugged."""

    stream = True

    def __init__(self, clock: Clock, *, device: str, baud: int, on_arrival: Wake | None = None) -> None:
        """Open the port.

        Raises:
            LinkError: If it is not there, is in use, or cannot do this speed.
        """
        try:
            self._port = serial.Serial(device, baud, timeout=_WAIT_S, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise LinkError(
                f"serial {device}:{baud}: {error}; is it plugged in, free, able to do this speed, and may you open it "
                "(the group dialout, as a rule)?"
            ) from error
        self._closed = False
        self._lock = threading.Lock()
        self._tail = Tail(self._write)
        self._arrivals = Arrivals[bytes](clock, on_arrival=on_arrival)
        self._reader = Reader(self._read, self._arrivals, name=f"serial {device}")

    def _read(self) -> bytes:
        try:
            if not self._port.is_open:
                self._reopen()
            return bytes(self._port.read(min(self._port.in_waiting, _MOST_BYTES) or 1))
        except (OSError, termios.error) as error:
            with self._lock, contextlib.suppress(OSError):
                self._port.close()
            raise ConnectionError("the port went away") from error

    def _reopen(self) -> None:
        with self._lock:
            self._port.open()
            self._tail.forget()

    def _write(self, data: bytes) -> int:
        return os.write(self._port.fileno(), data)  # pyserial's own write spins while the port is full

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Pieces of the stream since the last call."""
        return self._arrivals.take()

    def send(self, frame: bytes) -> None:
        """Write one frame; what the port does not take at once waits for the next, which is dropped if it must."""
        with self._lock:
            if not self._closed:
                self._tail.send(frame)

    def counters(self) -> Mapping[str, int]:
        """Frames sent and not sent, and pieces dropped for want of room."""
        dropped = self._arrivals.dropped
        return {"wire_sent": self._tail.sent, "wire_unsent": self._tail.unsent, "wire_dropped": dropped}

    def close(self) -> None:
        """End the reader, then the port."""
        if not self._closed:
            self._closed = True
            self._reader.close()
            self._port.close()
