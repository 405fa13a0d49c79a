"""A ground station on one vehicle's link: pymavlink underneath, a HEARTBEAT each second, and waits that end."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from typing import Any, Self

os.environ["MAVLINK20"] = "1"  # before the import of mavutil, which otherwise speaks MAVLink 1
os.environ["MAVLINK_DIALECT"] = "all"  # its default lacks LOGGING_DATA

from pymavlink import mavutil
from pymavlink.dialects.v20 import all as dialect

ANSWER_S = 3.0
"""Longest wait for an answer; the real autopilots answer within 0.5 s."""
READY_S = 120.0
"""Longest wait for a simulator to know its position."""
RESTART_S = 3.0
"""Time that a simulator takes to restart."""
LANDED_S = 90.0
"""Longest wait for a vehicle to land and disarm."""
PORT_FREE_S = 5.0
"""Longest wait for a port."""
STREAM_HZ = 4
GROUND_STATION = 255
ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED
FORCE = 21196
"""Of a command to disarm: in the air too."""


def address_of(url: str) -> str:
    """Return pymavlink's form of MAVSDK's URL: ``udpin:127.0.0.1:14540``."""
    scheme, _, place = url.partition("://")
    return f"{'tcp' if scheme == 'tcpout' else scheme}:{place}"


class Client:
    """Talks to the autopilot at a URL; use it as a context manager."""

    def __init__(self, url: str, station: int = GROUND_STATION) -> None:
        self.url = url
        self.station = station
        self.is_silent = False
        self._beaten_s = 0.0
        self.component = 1
        self._connect()

    def _connect(self) -> None:
        self.link = self._opened()
        self.send = self.link.mav
        heartbeat = self.link.wait_heartbeat(timeout=30.0)
        if heartbeat is None:
            raise TimeoutError(f"{self.url}: no HEARTBEAT within 30 s")
        self.system = heartbeat.get_srcSystem()
        self.autopilot = heartbeat.autopilot

    def _opened(self) -> Any:
        """Open the link, whose port a program that was ended may still have for a moment."""
        end_s = time.monotonic() + PORT_FREE_S
        while True:
            try:
                return mavutil.mavlink_connection(
                    address_of(self.url), source_system=self.station, retries=20
                )
            except OSError:
                if time.monotonic() > end_s:
                    raise
            time.sleep(0.2)

    def reconnect(self) -> None:
        """Connect again some seconds later, as after a reboot, which closes a TCP link."""
        self.link.close()
        time.sleep(RESTART_S)
        self._connect()

    @contextlib.contextmanager
    def lent(self) -> Iterator[str]:
        """Leave the link to another program, which needs its port; afterwards bring the vehicle down."""
        if self.autopilot == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
            # ArduPilot sends only what some client has asked for on this link.
            self.send.request_data_stream_send(self.system, 1, 0, STREAM_HZ, 1)
        self.link.close()
        try:
            yield self.url
        finally:
            self._connect()
            self.bring_down()

    def bring_down(self) -> None:
        """Land and wait until the vehicle is disarmed; PX4 then waits in its hold, ArduCopter in STABILIZE."""
        end_s = time.monotonic() + LANDED_S
        while self.is_armed() and time.monotonic() < end_s:
            self.command(21)
            self.wait("HEARTBEAT", lambda beat: not beat.base_mode & ARMED, 5.0)
        if self.is_armed():
            self.command(400, 0, FORCE)
        if self.autopilot == dialect.MAV_AUTOPILOT_PX4:
            self.command(176, 1, 4, 3)
        else:
            self.command(176, 1, 0)

    def is_armed(self) -> bool:
        """Return whether the next HEARTBEAT says that the vehicle is armed."""
        beat = self.wait("HEARTBEAT")
        return beat is not None and bool(beat.base_mode & ARMED)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def receive(self, seconds: float) -> Any | None:
        """Return the next message of the autopilot, or None after some seconds."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            self._beat()
            message = self.link.recv_match(blocking=True, timeout=min(left_s, 0.2))
            if message is None or message.get_type() == "BAD_DATA":
                continue
            sender = (message.get_srcSystem(), message.get_srcComponent())
            if message.get_type().startswith("UNKNOWN_"):
                sender = tuple(
                    message.data[5:7]
                )  # pymavlink reads no sender of a message that it does not know
            if sender == (self.system, self.component):
                return message
        return None

    def wait(
        self,
        names: str,
        condition: Callable[[Any], bool] = lambda _: True,
        seconds: float = ANSWER_S,
    ) -> Any | None:
        """Return the first message of some names (divided by spaces) that meets a condition, or None."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            message = self.receive(left_s)
            if message is not None and message.get_type() in names.split() and condition(message):
                return message
        return None

    def gather(self, names: str, seconds: float) -> list[Any]:
        """Return all messages of some names within some seconds."""
        end_s = time.monotonic() + seconds
        gathered = []
        while (left_s := end_s - time.monotonic()) > 0.0:
            message = self.receive(left_s)
            if message is not None and message.get_type() in names.split():
                gathered.append(message)
        return gathered

    def drain(self) -> None:
        """Drop what has come."""
        while self.link.recv_msg() is not None:
            pass

    def command(self, number: int, *parameters: float, whole: bool = False) -> str:
        """Send COMMAND_LONG, or COMMAND_INT if `whole`; return the answer's result in words."""
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        if whole:
            self.send.command_int_send(
                self.system,
                self.component,
                0,
                number,
                0,
                0,
                *filled[:4],
                int(filled[4]),
                int(filled[5]),
                filled[6],
            )
        else:
            self.send.command_long_send(self.system, self.component, number, 0, *filled)
        answer = self.wait("COMMAND_ACK", lambda message: message.command == number)
        return "no answer" if answer is None else result_name(answer.result)

    def wait_for_home(self) -> None:
        """Wait until the autopilot has a home, which it sets when its position is known."""
        end_s = time.monotonic() + READY_S
        while time.monotonic() < end_s:
            self.send.command_long_send(self.system, self.component, 410, 0, 0, 0, 0, 0, 0, 0, 0)
            if self.wait("HOME_POSITION", seconds=1.0) is not None:
                return
        raise TimeoutError(f"no home within {READY_S:.0f} s")

    def wait_for_position(self) -> None:
        """Wait until an ArduCopter's estimator uses GPS, which it begins some seconds after it has a home."""
        if self.autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
            return
        self.command(511, dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 500_000)
        report = self.wait(
            "EKF_STATUS_REPORT", lambda m: bool(m.flags & dialect.EKF_POS_HORIZ_ABS), READY_S
        )
        self.command(511, dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 0)
        if report is None:
            raise TimeoutError(f"no position within {READY_S:.0f} s")

    def request(self, message_id: int, argument: float = 0.0) -> str:
        """Request one message; return the answer's result in words and whether the message came."""
        name = dialect.mavlink_map[message_id].msgname if message_id in dialect.mavlink_map else ""
        self.send.command_long_send(
            self.system, self.component, 512, 0, message_id, argument, 0, 0, 0, 0, 0
        )
        end_s = time.monotonic() + ANSWER_S
        result = ""
        has_come = False
        while time.monotonic() < end_s and not (result and (has_come or result != "accepted")):
            message = self.receive(end_s - time.monotonic())
            if message is None:
                break
            if message.get_type() == "COMMAND_ACK" and message.command == 512:
                result = result_name(message.result)
            has_come = has_come or message.get_type() == name
        came = " and sent" if has_come and result == "accepted" else ""
        return f"{result or 'no answer'}{came}"

    def set_parameter(self, name: str, value: float, kind: int) -> None:
        """Set a parameter and wait for its echo."""
        self.send.param_set_send(self.system, self.component, name.encode(), value, kind)
        self.wait("PARAM_VALUE", lambda message: message.param_id == name)

    def read_parameter(self, name: str) -> float:
        """Read a parameter; NaN without an answer."""
        self.send.param_request_read_send(self.system, self.component, name.encode(), -1)
        answer = self.wait("PARAM_VALUE", lambda message: message.param_id == name)
        return float("nan") if answer is None else float(answer.param_value)

    def arm(self) -> str:
        """Arm as soon as the autopilot is ready; return the last answer."""
        end_s = time.monotonic() + READY_S
        while (answer := self.command(400, 1)) != "accepted" and time.monotonic() < end_s:
            self.gather("HEARTBEAT", 2.0)
        return answer

    def _beat(self) -> None:
        now_s = time.monotonic()
        if now_s - self._beaten_s > 1.0 and not self.is_silent:
            self._beaten_s = now_s
            self.send.heartbeat_send(6, 8, 0, 0, 4)


def result_name(result: int) -> str:
    """Return a command's result in words: ``temporarily rejected``."""
    return enum_name("MAV_RESULT", result, "MAV_RESULT_")


def enum_name(enumeration: str, value: int, prefix: str) -> str:
    """Return the name of an enumeration's value, without its prefix and in small letters."""
    entry = dialect.enums[enumeration].get(value)
    return (
        str(value) if entry is None else entry.name.removeprefix(prefix).replace("_", " ").lower()
    )
