"""Signs of life to systemd, by sd_notify(3): datagrams to $NOTIFY_SOCKET."""

import contextlib
import math
import socket
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from guidance.log.sink import FlightIdentity, Report, Sink
from guidance.session.orders.answers import shown_state

ENDING: Final = "ending"
"""Message of a daemon that begins to end."""

_WATCHDOG_SHARE: Final = 3.0
"""Signs of life per watchdog time."""


class Notifier(Sink):
    """Sends sd_notify messages; does nothing without NOTIFY_SOCKET. Never waits.

    Args:
        environment: Of the process: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
        process_id: Its number.
    """

    def __init__(
        self, environment: Mapping[str, str] = MappingProxyType({}), process_id: int = 0
    ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        microseconds = environment.get("WATCHDOG_USEC", "")
        meant = environment.get("WATCHDOG_PID", str(process_id)) == str(process_id)
        watched = meant and microseconds.isdecimal() and int(microseconds) > 0
        # An abstract one
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._every_s = int(microseconds) * 1e-6 / _WATCHDOG_SHARE if watched else None
        self._alive_s = -math.inf
        self._status = ""
        self._ready = False

    def begin(self, _identity: FlightIdentity) -> None:
        """Send READY=1 with the first flight: the daemon hears its vehicle and takes orders."""
        if not self._ready:
            self._ready = True
            self.send("READY=1")

    def report(self, report: Report) -> None:
        """Send a sign of life, and a line for `systemctl status` when it changes."""
        self.alive(report.now_s)
        if report.counters is not None:
            self.status(f"{shown_state(report.flight)}, mode {report.flight.mode_name}")

    def say(self, _level: int, message: str, _fields: Mapping[str, Any]) -> None:
        """Send STOPPING=1 when the daemon begins to end."""
        if message == ENDING:
            self.send("STOPPING=1")

    def alive(self, now_s: float) -> None:
        """Say so, as often as the watchdog wants it; called by the loop, so that a loop that hangs says nothing."""
        if self._every_s is not None and now_s - self._alive_s >= self._every_s:
            self._alive_s = now_s
            self.send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Show a line in `systemctl status`, when it changes."""
        if text != self._status:
            self._status = text
            self.send(f"STATUS={text}")

    def send(self, text: str) -> None:
        """Send a message."""
        if self._address:
            with (
                contextlib.suppress(OSError),
                socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client,
            ):
                client.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)
