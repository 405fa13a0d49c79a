"""What QGroundControl asks a vehicle for when it connects, asked in its order.

Source: QGroundControl's InitialConnectStateMachine, ComponentInformationManager, StandardModes, ParameterManager,
PlanManager, GimbalController and QGCCameraManager.
"""

import re
import struct
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from tests.acceptance.relay import wait

AUTOPILOT = 1
ALL = 0
GCS = 255
GCS_COMPONENT = 190
ANSWER_S = 1.2
TRIES = 3
LIST_S = 90.0
QUIET_S = 1.0

COMPONENT_METADATA = 397
"""pymavlink has no class for it; its file is named in its bytes."""

_FILE = re.compile(rb"mftp://([\x20-\x7e]+)")
_OPEN_FILE = 4
_READ_FILE = 5
_TERMINATE = 1
_FTP_ACK = 128
_FTP = struct.Struct("<HBBBBBBI")
_FTP_BYTES = 239
_PLANS = {"mission": 0, "fence": 1, "rally": 2}


def _refuses_message(message: Any) -> bool:
    """Return whether a message refuses to send a requested one; other commands have ACKs of their own."""
    return bool(
        message.get_type() == "COMMAND_ACK"
        and message.command == mavlink.MAV_CMD_REQUEST_MESSAGE
        and message.result not in {mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS}
    )


class Handshake:
    """QGroundControl's questions through a ground station.

    Args:
        station: Sends and keeps what it hears: `say(message)`, `heard`, `components` and `raw`.
        ardupilot: Whether the autopilot is ArduPilot's, of which parameters are first read as a file.
    """

    def __init__(self, station: Any, *, ardupilot: bool) -> None:
        self._station = station
        self._ardupilot = ardupilot
        self._sequence = 0

    def run(self) -> dict[str, object]:
        """Ask for everything; return what was answered, by question. None was not answered."""
        answers = dict[str, object]()
        answers["version"] = self._version()
        answers["modes"] = self._modes()
        answers["metadata"] = self._metadata()
        answers["parameters"] = self._parameters()
        for plan, number in _PLANS.items():
            answers[plan] = self._plan(number)
        home = self._message("HOME_POSITION", mavlink.MAVLINK_MSG_ID_HOME_POSITION)
        answers["home"] = None if home is None else (home.latitude, home.longitude)
        answers["interval"] = self._command(
            AUTOPILOT,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
            250_000,
        )
        for component in sorted(self._station.components):
            answers[f"gimbal of {component}"] = self._command(
                component,
                mavlink.MAV_CMD_REQUEST_MESSAGE,
                mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
            )
        answers["cameras"] = sum(100 <= component <= 105 for component in self._station.components)
        return answers

    def _next(self, since: int, fits: Callable[[Any], bool], within_s: float) -> Any | None:
        """Wait for a message after number `since` that `fits`; return it, None if none comes."""
        heard = self._station.heard
        checked = since
        until_s = time.monotonic() + within_s
        while time.monotonic() < until_s:
            while checked < len(heard):
                checked += 1
                if fits(heard[checked - 1]):
                    return heard[checked - 1]
            time.sleep(0.005)
        return None

    def _send_command(self, component: int, command: int, *parameters: float, number: int) -> None:
        seven = [*parameters, *[0.0] * (7 - len(parameters))]
        message = mavlink.MAVLink_command_long_message(1, component, command, number, *seven)
        self._station.say(message)

    def _command(self, component: int, command: int, *parameters: float) -> int | None:
        """Send a command up to three times; return MAV_RESULT, None without an answer."""
        for number in range(TRIES):
            since = len(self._station.heard)
            self._send_command(component, command, *parameters, number=number)
            answer = self._next(
                since,
                lambda message: (
                    message.get_type() == "COMMAND_ACK"
                    and message.get_srcComponent() == component
                    and message.command == command
                ),
                ANSWER_S,
            )
            if answer is not None:
                return int(answer.result)
        return None

    def _message(self, name: str, message_id: int, index: int = 0) -> Any | None:
        """Request a message of the autopilot; return its fields, None if it does not come."""
        for number in range(TRIES):
            since = len(self._station.heard)
            self._send_command(
                AUTOPILOT, mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, index, number=number
            )
            answer = self._next(
                since,
                lambda message: (
                    message.get_srcComponent() == AUTOPILOT
                    and (message.get_type() == name or _refuses_message(message))
                ),
                ANSWER_S,
            )
            if answer is not None:
                return answer if answer.get_type() == name else None
        return None

    def _version(self) -> str | None:
        told = self._message("AUTOPILOT_VERSION", mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        if told is None:
            return None
        number = told.flight_sw_version
        return f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}"

    def _modes(self) -> int:
        """Return how many modes the autopilot lists."""
        first = self._message("AVAILABLE_MODES", mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 1)
        if first is None:
            return 0
        rest = [
            self._message("AVAILABLE_MODES", mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, number)
            for number in range(2, first.number_modes + 1)
        ]
        return 1 + sum(mode is not None for mode in rest)

    def _metadata(self) -> int | None:
        """Return the size of the file that describes the component, in bytes; None without one."""
        self._station.raw.clear()
        result = self._command(AUTOPILOT, mavlink.MAV_CMD_REQUEST_MESSAGE, COMPONENT_METADATA)
        if result == mavlink.MAV_RESULT_ACCEPTED:
            wait(lambda: self._station.raw, ANSWER_S)
        named = _FILE.search(b"".join(self._station.raw))
        return None if named is None else self._file_bytes(named[1])

    def _parameters(self) -> str:
        """Read all parameters: of ArduPilot also as a file. Missing ones are asked for by number."""
        words = ""
        if self._ardupilot:
            words = f", {self._file_bytes(b'@PARAM/param.pck')} bytes as a file"
        heard = self._station.heard
        since = len(heard)
        self._station.say(mavlink.MAVLink_param_request_list_message(1, ALL))
        indices = set[int]()
        count = 0
        began_s = time.monotonic()
        heard_s = began_s
        seen = since
        while time.monotonic() - began_s < LIST_S and not 0 < count == len(indices):
            while seen < len(heard):
                message = heard[seen]
                seen += 1
                if message.get_type() == "PARAM_VALUE" and message.param_index != 0xFFFF:
                    heard_s = time.monotonic()
                    count = message.param_count
                    indices.add(message.param_index)
            if count and time.monotonic() - heard_s > QUIET_S:
                heard_s = time.monotonic()
                for index in sorted(set(range(count)) - indices)[:10]:
                    message = mavlink.MAVLink_param_request_read_message(1, AUTOPILOT, b"", index)
                    self._station.say(message)
            time.sleep(0.01)
        return f"{len(indices)} of {count}{words}"

    def _plan(self, kind: int) -> int | None:
        """Download a plan; return its number of items, None if the autopilot does not tell."""
        since = len(self._station.heard)
        for _ in range(TRIES):
            self._station.say(mavlink.MAVLink_mission_request_list_message(1, AUTOPILOT, kind))
            told = self._next(
                since,
                lambda message: (
                    message.get_type() == "MISSION_COUNT"
                    and message.mission_type == kind
                    and message.target_system == GCS
                    and message.target_component in {0, GCS_COMPONENT}
                ),
                ANSWER_S,
            )
            if told is not None:
                break
        else:
            return None
        items = 0
        for number in range(told.count):
            since = len(self._station.heard)
            request = mavlink.MAVLink_mission_request_int_message(1, AUTOPILOT, number, kind)
            self._station.say(request)
            item = self._next(
                since, lambda message: message.get_type() == "MISSION_ITEM_INT", ANSWER_S
            )
            items += item is not None
        self._station.say(mavlink.MAVLink_mission_ack_message(1, AUTOPILOT, 0, kind))
        return items

    def _ftp(
        self,
        operation: int,
        *,
        session: int = 0,
        offset: int = 0,
        data: bytes = b"",
        size: int = 0,
    ) -> tuple[int, bytes] | None:
        """Ask for one step of a file's transfer; return the session and the data, None if it is refused."""
        self._sequence = (self._sequence + 1) % 0x10000
        head = _FTP.pack(self._sequence, session, operation, size, 0, 0, 0, offset)
        payload = (head + data).ljust(251, b"\0")
        for _ in range(TRIES):
            since = len(self._station.heard)
            message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, AUTOPILOT, payload)
            self._station.say(message)
            answer = self._next(
                since,
                lambda message: (
                    message.get_type() == "FILE_TRANSFER_PROTOCOL"
                    and bytes(message.payload[4:6])[1] == operation
                    and message.target_system in {0, GCS}
                ),
                ANSWER_S,
            )
            if answer is not None:
                reply = bytes(answer.payload)
                _, session, done, length, *_ = _FTP.unpack_from(reply)
                if done != _FTP_ACK:
                    return None
                return session, reply[_FTP.size : _FTP.size + length]
        return None

    def _file_bytes(self, path: bytes) -> int | None:
        """Read a file; return its size, None if it cannot be read."""
        opened = self._ftp(_OPEN_FILE, data=path, size=len(path))
        if opened is None:
            return None
        session, _ = opened
        read = 0
        while True:
            part = self._ftp(_READ_FILE, session=session, offset=read, size=_FTP_BYTES)
            if part is None or not part[1]:
                break
            read += len(part[1])
        self._ftp(_TERMINATE, session=session)
        return read
