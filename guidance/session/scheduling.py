"""The processor when it is wanted: real-time scheduling where it is permitted, and said which was had.

Every thread of the process is raised, not the loop's alone: whichever of them holds the interpreter when a busy
machine takes the processor away keeps the loop waiting just as well. Garbage is collected between cycles and never
within one.
"""

import contextlib
import gc
import math
import os
import sys
from pathlib import Path
from typing import Final

PRIORITY: Final = 10
NICE: Final = -10
SWITCH_S: Final = 0.0005
"""Longest that a thread keeps the interpreter from another one that is ready, ten times less than Python's own."""

YOUNG_EVERY_S: Final = 0.5
OLD_EVERY_S: Final = 30.0
OVERDUE_S: Final = 10.0
"""A loop that never has the time collects nevertheless: a late cycle is less than no memory left."""

_YOUNG_NEEDS_S: Final = 0.004
_OLD_NEEDS_S: Final = 0.012


def claim() -> str:
    """Take what is permitted, and name it: `realtime 10`, `nice -10` or `as others`."""
    sys.setswitchinterval(SWITCH_S)
    if not hasattr(os, "sched_setscheduler"):  # not Linux
        return "as others"
    policy = os.sched_getscheduler(0)
    if policy in {os.SCHED_FIFO, os.SCHED_RR}:  # as systemd was told
        return f"realtime {os.sched_getparam(0).sched_priority}"
    for words, raise_one in ((f"realtime {PRIORITY}", _to_real_time), (f"nice {NICE}", _to_nice)):
        try:
            raise_one(0)
        except PermissionError:
            continue
        for thread in _threads():
            with contextlib.suppress(ProcessLookupError, PermissionError):  # a thread may have just ended
                raise_one(thread)
        return words
    return "as others"


def _to_real_time(thread: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(PRIORITY))


def _to_nice(thread: int) -> None:
    os.setpriority(os.PRIO_PROCESS, thread, NICE)


def _threads() -> list[int]:
    return [int(path.name) for path in Path("/proc/self/task").iterdir()]


class GcScheduler:
    """Collects garbage between cycles, when there is time for it, and not at the interpreter's own moments.

    Args:
        enabled: False leaves it to the interpreter, as in virtual time, where nothing waits.
    """

    def __init__(self, *, enabled: bool = True) -> None:
        self._enabled = enabled
        self._young_s = self._old_s = 0.0

    def begin(self, now_s: float) -> None:
        """From now on nothing is collected but here; what was made so far stays, and is not looked at again."""
        if not self._enabled:
            return
        gc.collect()
        gc.freeze()
        gc.disable()
        self._young_s = self._old_s = now_s

    def between(self, now_s: float, free_s: float) -> None:
        """Collect, if it is time to and `free_s` until the next cycle are enough for it, or it is long overdue."""
        if not self._enabled:
            return
        if now_s - self._young_s >= OVERDUE_S:
            free_s = math.inf
        if now_s - self._old_s >= OLD_EVERY_S and free_s >= _OLD_NEEDS_S:
            self._old_s = self._young_s = now_s
            gc.collect()
        elif now_s - self._young_s >= YOUNG_EVERY_S and free_s >= _YOUNG_NEEDS_S:
            self._young_s = now_s
            gc.collect(0)

    def end(self) -> None:
        """Leave it to the interpreter again."""
        if not self._enabled:
            return
        gc.enable()
        gc.unfreeze()
