"""Whether the processes of a real-time test were kept from a processor, by the kernel's own count.

The kernel counts for every thread how long it was ready to run and had no processor. A failure while a thread had to
wait for a large part of a second says nothing about the code: the test is starved, neither passed nor failed.
"""

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

SAMPLED_EVERY_S = 0.5
STARVED_S = 0.15
"""In one sample. The service needs a processor within some 0.1 s: it reports a cycle that begins later."""


class Waiting:
    """Measures, in a thread, the longest time that a thread of this process or its children waited in a sample."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._before = dict(_waited_s(os.getpid()))
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Waiting":
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._done.set()
        self._thread.join()

    def starved(self) -> str:
        """Return in words how long a thread had to wait; empty if that is short."""
        self._sample()
        return (
            f"a thread waited {self.longest_s:.2f} s for a processor"
            if self.longest_s > STARVED_S
            else ""
        )

    def _run(self) -> None:
        while not self._done.wait(SAMPLED_EVERY_S):
            self._sample()

    def _sample(self) -> None:
        now = dict(_waited_s(os.getpid()))
        waited = (waited_s - self._before.get(thread, waited_s) for thread, waited_s in now.items())
        self.longest_s = max(self.longest_s, *waited)
        self._before = now


def _waited_s(process: int) -> Iterator[tuple[str, float]]:
    """Yield the threads of a process and of its children, with the total time for which each had to wait."""
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            with contextlib.suppress(OSError):  # it has ended
                yield task.name, int((task / "schedstat").read_text().split()[1]) * 1e-9
                for child in (task / "children").read_text().split():
                    yield from _waited_s(int(child))
