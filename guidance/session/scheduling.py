"""The processor when it is wanted: real-time scheduling where it is permitted, and said which was had.

Every thread of the process is raised, not the loop's alone: whichever of them holds the interpreter when a busy
machine takes the processor away keeps the loop waiting just as well.
"""

import contextlib
import os
import sys
from pathlib import Path
from typing import Final

PRIORITY: Final = 10
NICE: Final = -10
SWITCH_S: Final = 0.0005
"""Longest that a thread keeps the interpreter from another one that is ready, ten times less than Python's own."""


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
