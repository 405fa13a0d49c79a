"""Message streams of one link: their schedule, and the requests that change it.

SET_MESSAGE_INTERVAL (511), GET_MESSAGE_INTERVAL (510), REQUEST_DATA_STREAM (66). Each stream has its own time grid, so
that a late cycle delays a message but does not slow the stream down.

The rates of the real links were measured on PX4 v1.17.0 (SIH), on its onboard link (14540) and its ground station's
(14550), and on ArduCopter 4.5.7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from heapq import heapify, heapreplace
from itertools import chain
from typing import TYPE_CHECKING, Final

from sitl_mock.mavlink import SPEC_BY_ID, Message
from sitl_mock.protocols.command import Result

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sitl_mock.protocols.session import Reply

GOLDEN: Final = 0.618_033_988_749_895  # its multiples modulo 1 spread the streams' phases evenly
ALL_STREAMS: Final = 0
SLACK_S: Final = 1e-6


@dataclass(frozen=True, slots=True)
class StreamRules:
    """Rules of a flavour for requests.

    Attributes:
        fixed: Messages whose rate cannot be changed.
        unlisted: Messages that are sent but that SET_MESSAGE_INTERVAL does not know.
        on_change: Messages that an accepted interval does not repeat: they come when they change, and on request.
        begun_hz: Rates of messages that come from the start but have no default: asking for it silences them.
        unknown_interval: Answer to SET_MESSAGE_INTERVAL for an unknown message.
        empty_request: Answer to a request for a message that has no content yet, as home before its position is known.
        unknown_request: Answer to REQUEST_MESSAGE for one.
        shortest_s: Shortest interval.
        longest_s: Longest interval.
        groups: Messages of each MAV_DATA_STREAM; empty if REQUEST_DATA_STREAM is ignored.
        old_requests: Commands older than REQUEST_MESSAGE, and the message that each requests.
    """

    fixed: frozenset[str] = frozenset()
    unlisted: frozenset[str] = frozenset()
    on_change: frozenset[str] = frozenset()
    begun_hz: Mapping[str, float] = field(default_factory=dict)
    unknown_interval: Result = Result.FAILED
    empty_request: Result = Result.DENIED
    unknown_request: Result = Result.DENIED
    shortest_s: float = 0.001
    longest_s: float = 2147.0  # MESSAGE_INTERVAL holds 2^31 µs
    groups: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    old_requests: Mapping[int, int] = field(default_factory=dict)


class Streams:
    """The streams of one link.

    Args:
        offered: Names of all messages that the vehicle can send.
        default_hz: Default rates; offered messages without one are silent.
        rules: The flavour's rules.
    """

    def __init__(
        self, offered: frozenset[str], default_hz: Mapping[str, float], rules: StreamRules
    ) -> None:
        self.rules = rules
        self._offered = offered
        self._default_s = {
            name: 1.0 / hz for name, hz in default_hz.items() if name in offered and hz > 0.0
        }
        begun_s = {name: 1.0 / hz for name, hz in rules.begun_hz.items() if name in offered}
        self._interval_s = self._default_s | begun_s
        self._queue: list[tuple[float, int, str, float]] = []  # when, which first, what, how often
        self._order = {
            name: index
            for index, name in enumerate((*default_hz, *sorted(offered - set(default_hz))))
        }
        self._started = False

    def is_due(self, now_s: float) -> bool:
        """True if there is a message to send."""
        if not self._started:
            return True
        if not self._queue:
            return False
        return self._queue[0][0] <= now_s + SLACK_S

    def due(self, now_s: float) -> list[str]:
        """Return the names of the messages to send now, each at most once."""
        if not self._started:
            self._start(now_s)
        queue = self._queue
        names: list[str] = []
        limit_s = now_s + SLACK_S
        while queue:
            at_s, order, name, interval_s = queue[0]
            if at_s > limit_s:
                break
            next_s = at_s + interval_s
            if next_s <= limit_s:  # after a stall: skip missed messages, keep the grid
                next_s = at_s + interval_s * (math.floor((limit_s - at_s) / interval_s) + 1)
            heapreplace(queue, (next_s, order, name, interval_s))
            names.append(name)
        return names

    def interval_us(self, message_id: int) -> int:
        """Return the interval for MESSAGE_INTERVAL: microseconds, -1 for a silent message, 0 for an unknown one."""
        name = self._offered_name(message_id)
        if name is None:
            return 0
        interval_s = self._interval_s.get(name)
        return -1 if interval_s is None else round(interval_s * 1e6)

    def set_interval(self, now_s: float, message_id: int, interval_us: float) -> Result:
        """Change one stream: microseconds, 0 for the default, -1 for silence.

        Args:
            now_s: Present time; a changed stream starts at once.
            message_id: MAVLink message id, as param1 of SET_MESSAGE_INTERVAL.
            interval_us: param2.
        """
        name = self._offered_name(message_id)
        if name is None or name in self.rules.unlisted:
            return self.rules.unknown_interval
        if name in self.rules.fixed or not math.isfinite(interval_us) or interval_us < -1:
            return Result.FAILED
        if interval_us == 0:
            self._set(now_s, name, self._default_s.get(name))
        elif interval_us < 0:
            self._set(now_s, name, None)
        else:
            self._set(
                now_s,
                name,
                min(max(interval_us * 1e-6, self.rules.shortest_s), self.rules.longest_s),
            )
        return Result.ACCEPTED

    def request_data_stream(self, now_s: float, stream: int, rate_hz: int, *, start: bool) -> None:
        """Set all messages of a MAV_DATA_STREAM to one rate, or silence them.

        Args:
            now_s: Present time.
            stream: MAV_DATA_STREAM.
            rate_hz: Rate of every message in it.
            start: Send the messages (true) or silence them.
        """
        groups = self.rules.groups
        chosen = list(groups.values())
        if stream != ALL_STREAMS:
            chosen = [groups.get(stream, ())]
        interval_s = 1.0 / rate_hz if start and rate_hz > 0 else None
        for name in dict.fromkeys(chain.from_iterable(chosen)):
            if name in self._offered and name not in self.rules.fixed:
                self._set(now_s, name, interval_s)

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take REQUEST_DATA_STREAM; it has no answer."""
        if message.get_type() == "REQUEST_DATA_STREAM":
            self.request_data_stream(
                now_s,
                message.req_stream_id,
                message.req_message_rate,
                start=bool(message.start_stop),
            )
        return []

    def _start(self, now_s: float) -> None:
        self._started = True
        for index, (name, interval_s) in enumerate(self._interval_s.items()):
            if name in self.rules.on_change:
                continue
            phase = 0.0 if name in self.rules.fixed or name == "HEARTBEAT" else index * GOLDEN % 1.0
            self._queue.append((now_s + phase * interval_s, self._order[name], name, interval_s))
        heapify(self._queue)

    def _set(self, now_s: float, name: str, interval_s: float | None) -> None:
        if not self._started:
            self._start(now_s)
        if interval_s == self._interval_s.get(name):
            return
        self._queue = [entry for entry in self._queue if entry[2] != name]
        self._interval_s.pop(name, None)
        if interval_s is not None:
            self._interval_s[name] = interval_s
        if interval_s is not None and name not in self.rules.on_change:
            self._queue.append((now_s, self._order[name], name, interval_s))
        heapify(self._queue)

    def _offered_name(self, message_id: int) -> str | None:
        spec = SPEC_BY_ID.get(message_id)
        return spec.name if spec is not None and spec.name in self._offered else None


PX4_ONBOARD_HZ: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 100.0,
    "ATTITUDE_QUATERNION": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "HIGHRES_IMU": 50.0,
    "LOCAL_POSITION_NED": 30.0,
    "ODOMETRY": 30.0,
    "ALTITUDE": 10.0,
    "ATTITUDE_TARGET": 10.0,
    "POSITION_TARGET_LOCAL_NED": 10.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "VFR_HUD": 10.0,
    "TIMESYNC": 10.0,
    "DISTANCE_SENSOR": 10.0,
    "GPS_RAW_INT": 8.0,
    "SYS_STATUS": 5.0,
    "EXTENDED_SYS_STATE": 5.0,
    "POSITION_TARGET_GLOBAL_INT": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "PING": 1.0,
    "SYSTEM_TIME": 1.0,
    "MISSION_CURRENT": 1.0,
    "SCALED_PRESSURE": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
    "GNSS_INTEGRITY": 1.0,
    "LINK_NODE_STATUS": 1.0,
    "HOME_POSITION": 0.5,
    "BATTERY_STATUS": 0.5,
    "CURRENT_MODE": 0.5,
    "VIBRATION": 0.5,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
}

PX4_GCS_HZ: Final[dict[str, float]] = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 50.0,
    "ATTITUDE_QUATERNION": 50.0,
    "ATTITUDE_TARGET": 50.0,
    "GLOBAL_POSITION_INT": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "POSITION_TARGET_LOCAL_NED": 50.0,
    "SERVO_OUTPUT_RAW": 50.0,
    "GPS_RAW_INT": 5.0,
    "POSITION_TARGET_GLOBAL_INT": 5.0,
    "VFR_HUD": 4.0,
    "ALTITUDE": 1.0,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "MISSION_CURRENT": 1.0,
    "SCALED_PRESSURE": 1.0,
    "OPEN_DRONE_ID_LOCATION": 1.0,
    "OPEN_DRONE_ID_SYSTEM": 1.0,
    "GNSS_INTEGRITY": 1.0,
    "LINK_NODE_STATUS": 1.0,
    "HOME_POSITION": 0.5,
    "BATTERY_STATUS": 0.5,
    "CURRENT_MODE": 0.5,
    "ESTIMATOR_STATUS": 0.5,
    "DISTANCE_SENSOR": 0.5,
    "PING": 0.1,
    "VIBRATION": 0.1,
    "TIME_ESTIMATE_TO_TARGET": 0.5,
    "CURRENT_EVENT_SEQUENCE": 1.0 / 3.0,
}

QUIET_HZ: Final[dict[str, float]] = {"HEARTBEAT": 1.0}
"""A link with only the requested streams, like PX4's MAVLink mode `custom`; saves time in simulations."""

ARDUPILOT_HZ: Final[dict[str, float]] = {"HEARTBEAT": 1.0, "TIMESYNC": 0.1}
"""Other streams only on request (SR0_* are 0); TIMESYNC comes occasionally."""

PX4_STREAM_RULES: Final = StreamRules(
    fixed=frozenset({"HEARTBEAT"}),
    unlisted=frozenset({"CURRENT_EVENT_SEQUENCE", "MISSION_CURRENT"}),
    on_change=frozenset({"COMPONENT_METADATA", "GPS_GLOBAL_ORIGIN", "STATUSTEXT"}),
    begun_hz={"STATUSTEXT": 20.0},
    unknown_interval=Result.FAILED,
    unknown_request=Result.DENIED,
    old_requests={410: 242, 519: 300, 525: 261, 528: 264},
)
"""Old requests: home, PROTOCOL_VERSION, STORAGE_INFORMATION, FLIGHT_INFORMATION."""

ARDUPILOT_STREAM_RULES: Final = StreamRules(
    unlisted=frozenset({"TIMESYNC"}),
    unknown_interval=Result.DENIED,
    unknown_request=Result.FAILED,
    empty_request=Result.ACCEPTED,
    longest_s=60.0,
    groups={
        1: ("RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE"),
        2: (
            "SYS_STATUS",
            "POWER_STATUS",
            "MISSION_CURRENT",
            "GPS_RAW_INT",
            "NAV_CONTROLLER_OUTPUT",
            "FENCE_STATUS",
            "POSITION_TARGET_GLOBAL_INT",
        ),
        3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
        6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
        10: ("ATTITUDE", "AHRS2"),
        11: ("VFR_HUD",),
        12: (
            "AHRS",
            "SYSTEM_TIME",
            "WIND",
            "DISTANCE_SENSOR",
            "BATTERY_STATUS",
            "EKF_STATUS_REPORT",
            "VIBRATION",
        ),
    },
)
"""Groups: MAV_DATA_STREAM as ArduCopter's ``GCS_Mavlink.cpp`` fills them."""
