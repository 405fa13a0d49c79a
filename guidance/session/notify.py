"""systemd's notification protocol (sd_notify(3)): plain datagrams to $NOTIFY_SOCKET."""

import contextlib
import socket
from collections.abc import Mapping
from typing import Final

_WATCHDOG_SHARE: Final = 3.0
"""Signs of life per watchdog time."""


class Notifier:
    """Says what there is to say, or nothing where nobody listens. Never waits.

    Args:
        address: Of the datagram socket; None sends nothing. A leading "@" is an abstract one.
        watchdog_s: Time without a sign of life after which systemd ends the process; None sends none.
    """

    def __init__(self, address: str | None, watchdog_s: float | None) -> None:
        self._address = "\0" + address[1:] if address and address.startswith("@") else address
        self._every_s = None if watchdog_s is None else watchdog_s / _WATCHDOG_SHARE
        self._alive_s = float("-inf")
        self._status = ""
        self._socket = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)

    @classmethod
    def from_environment(cls, environment: Mapping[str, str], process_id: int) -> "Notifier":
        """Read NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID."""
        microseconds = environment.get("WATCHDOG_USEC", "")
        meant = environment.get("WATCHDOG_PID", str(process_id)) == str(process_id)
        watched = meant and microseconds.isdecimal() and int(microseconds) > 0
        return cls(environment.get("NOTIFY_SOCKET"), int(microseconds) * 1e-6 if watched else None)

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
        if self._socket is not None and self._address is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(text.encode(), self._address)
