"""The process of a daemon: priority, garbage collection between cycles, and signs of life to systemd.

The priority of every thread is raised. Any thread may hold the interpreter's lock, and if a busy machine takes the
processor from it, the loop waits. Signs of life follow sd_notify(3): datagrams to $NOTIFY_SOCKET.
"""

import contextlib
import gc
import math
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
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

_WATCHDOG_SHARE: Final = 3.0
"""Signs of life per watchdog time."""


def claim() -> str:
    """Raise the priority as far as permitted, and name it: `realtime 10`, `nice -10` or `as others`."""
    sys.setswitchinterval(SWITCH_S)
    if not hasattr(os, "sched_setscheduler"):  # not Linux
        return "as others"
    policy = os.sched_getscheduler(0)
    if policy in {os.SCHED_FIFO, os.SCHED_RR}:  # set by systemd
        return f"realtime {os.sched_getparam(0).sched_priority}"
    threads = [int(path.name) for path in Path("/proc/self/task").iterdir()]
    claims: Sequence[tuple[str, Callable[[int], None]]] = (
        (f"realtime {PRIORITY}", lambda thread: os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(PRIORITY))),
        (f"nice {NICE}", lambda thread: os.setpriority(os.PRIO_PROCESS, thread, NICE)),
    )
    for words, raise_one in claims:
        with contextlib.suppress(PermissionError):
            raise_one(0)
            for thread in threads:
                with contextlib.suppress(ProcessLookupError, PermissionError):  # a thread may have just ended
                    raise_one(thread)
            return words
    return "as others"


class GcScheduler:
    """Collects garbage between cycles, when there is time for it, and not at the interpreter's own moments."""

    def __init__(self, now_s: float, *, collect: bool = True) -> None:
        """Collect now, if wanted, and only here from now on. Existing objects are not scanned again before `end`."""
        if collect:
            gc.collect()
        gc.freeze()
        gc.disable()
        self._young_s = self._old_s = now_s

    def between(self, now_s: float, free_s: float) -> None:
        """Collect, if it is time to and `free_s` until the next cycle are enough for it, or it is long overdue."""
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
        gc.enable()
        gc.unfreeze()


class Notifier:
    """Sends sd_notify messages; does nothing without NOTIFY_SOCKET. Never waits.

    Args:
        environment: Of the process: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
        process_id: Its number.
    """

    def __init__(self, environment: Mapping[str, str] = MappingProxyType({}), process_id: int = 0) -> None:
        address, microseconds = environment.get("NOTIFY_SOCKET", ""), environment.get("WATCHDOG_USEC", "")
        meant = environment.get("WATCHDOG_PID", str(process_id)) == str(process_id)
        watched = meant and microseconds.isdecimal() and int(microseconds) > 0
        self._address = "\0" + address[1:] if address.startswith("@") else address  # an abstract one
        self._every_s = int(microseconds) * 1e-6 / _WATCHDOG_SHARE if watched else None
        self._alive_s, self._status = -math.inf, ""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        if self._socket is not None:
            self._socket.setblocking(False)

    def ready(self) -> None:
        """The daemon hears its vehicle and takes orders."""
        self._send("READY=1")

    def alive(self, now_s: float) -> None:
        """Say so, as often as the watchdog wants it; called by the loop, so that a loop that hangs says nothing."""
        if self._every_s is not None and now_s - self._alive_s >= self._every_s:
            self._alive_s = now_s
            self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Show a line in `systemctl status`, when it changes."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """The daemon is about to end."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(text.encode(), self._address)
