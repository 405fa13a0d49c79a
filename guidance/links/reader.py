"""A thread that reads a socket or a port, so that a piece is stamped when it arrives, not when the loop looks."""

import contextlib
import threading
from collections.abc import Callable

from guidance.links.arrivals import Arrivals


class Reader:
    """Calls `read` until closed. `read` waits a short while at most, and returns b"" for nothing or raises OSError."""

    def __init__(self, read: Callable[[], bytes], arrivals: Arrivals[bytes], *, name: str) -> None:
        self._read = read
        self._arrivals = arrivals
        self._stop = threading.Event()
        self.errors = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            data = b""
            try:
                data = self._read()
            except OSError:
                self.errors += 1
                self._stop.wait(0.05)  # a refused or vanished peer may come back: neither spin nor give up
            if data:
                self._arrivals.put(data)

    def close(self) -> None:
        """End the thread and wait for it, so that the socket can be closed under nobody's feet."""
        self._stop.set()
        if self._thread is not threading.current_thread():
            with contextlib.suppress(RuntimeError):
                self._thread.join()
