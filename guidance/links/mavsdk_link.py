"""A vehicle through the MAVSDK client: raw messages with their time fields, and one frame for one call.

MAVSDK is given its bytes through its `raw://` connection, over the same wires as the other link: only whole frames of
the one vehicle get in, and whoever listens in on the wire (the record) sees both directions. Its own UDP, TCP and
serial connections show no bytes to anybody, and two of them may share a port without a word.

The Offboard plugin is not used, since it resends the last velocity at 20 Hz by itself: a guidance loop that hangs
would fly on. Nothing is called on MAVSDK after it was destroyed, which would be a segmentation fault.
"""

import contextlib
import ctypes
import json
import logging
import math
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from mavsdk import Autopilot, Configuration, ConnectionResult, Mavsdk
from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.system import System

from guidance.errors import LinkError
from guidance.links.arrivals import Arrivals, Clock, Wake
from guidance.links.conversation import HEARD, Conversation
from guidance.links.decode import MAV_AUTOPILOT_PX4, is_bytewise
from guidance.links.dialect import CRC_EXTRA, IDS
from guidance.links.framing import Framer
from guidance.links.mavsdk_parameters import IntegerParameters
from guidance.links.port import Wire
from guidance.messages import Message, Request, Setpoint

_LOOK_EVERY_S: Final = 0.02
_WANTED: Final = frozenset(IDS[name] for name in (*HEARD, "AUTOPILOT_VERSION"))
"""What MAVSDK gets to see: what the link hears, and what MAVSDK itself asks of an autopilot."""


LOGGER: Final = logging.getLogger("guidance.links.mavsdk")
_LEVELS: Final = (logging.DEBUG, logging.DEBUG, logging.INFO, logging.WARNING)  # one lower: MAVSDK's INFO is chatter


def _log(level: int, message: bytes | None, _file: bytes | None, _line: int, _user: ctypes.c_void_p) -> bool:
    LOGGER.log(_LEVELS[min(max(level, 0), 3)], "%s", (message or b"").decode(errors="replace"))
    return True  # handled: nothing is printed


_callback = LogCallback(_log)


def route_to_logging() -> None:
    """Take over MAVSDK's log, for the whole process; calling it again changes nothing.

    The library's own `log_subscribe` is not used since it prints an error when a vehicle sends text that is not UTF-8.
    """
    if not any(isinstance(handler, logging.NullHandler) for handler in LOGGER.handlers):
        LOGGER.addHandler(logging.NullHandler())  # silent unless the program sets logging up
        _cmavsdk_lib.mavsdk_log_subscribe(_callback, None)


class MavsdkLink:
    """`VehicleLink` over MAVSDK 4.1 and a wire."""

    def __init__(
        self,
        wire: Wire,
        clock: Clock,
        *,
        system_id: int,
        sleep: Callable[[float], None],
        who: str,
        component_id: int = 1,
        own_system_id: int | None = None,
        own_component_id: int = 195,
        timeout_s: float = 10.0,
        on_arrival: Wake | None = None,
    ) -> None:
        """Take over a wire, which is closed with the link, and wait until the vehicle's HEARTBEAT was heard.

        Args:
            wire: To the vehicle, and to whoever else is there.
            clock: Monotonic seconds.
            system_id: The vehicle's.
            sleep: How to wait between looks.
            who: Names the vehicle in errors.
            component_id: The autopilot's.
            own_system_id: Ours; the vehicle's by default.
            own_component_id: Ours.
            timeout_s: How long to wait, by the clock.
            on_arrival: Called on MAVSDK's thread whenever something arrived; it may only wake the loop.

        Raises:
            LinkError: If the vehicle was not heard within `timeout_s`.
        """
        route_to_logging()
        own = own_system_id or system_id, own_component_id
        self._clock = clock
        self._wire = wire
        self._from = (system_id, component_id)
        self._framer = Framer(CRC_EXTRA)
        self._others: set[int] = set()
        self._arrivals = Arrivals[tuple[str, str]](clock, on_arrival=on_arrival)
        self._dropped: Counter[str] = Counter()
        self._conversation = Conversation(self._send, system_id=system_id, component_id=component_id, own=own)
        self._gate = threading.Lock()
        self._closed = False
        self._direct: MavlinkDirect | None = None
        self._parameters: IntegerParameters | None = None
        configuration = Configuration.create_manual(*own, True)
        self._mavsdk = Mavsdk(configuration)
        configuration.destroy()
        try:
            self._connect()
            system = self._wait_for(timeout_s, sleep, who=who)
            if system.autopilot_type() == Autopilot.PX4:
                self._conversation.autopilot = MAV_AUTOPILOT_PX4
            self._direct = MavlinkDirect(system)
            self._parameters = IntegerParameters(system, self._deliver_integer)
            for name in sorted(HEARD):
                self._direct.subscribe_message(name, self._hear)
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._wire.send)
        result = self._mavsdk.add_any_connection("raw://")
        if result != ConnectionResult.SUCCESS:
            raise LinkError(f"raw://: MAVSDK cannot connect ({result.name})")
        self._wire.hand_to(self._pass_in)

    def _pass_in(self, _received_s: float, data: bytes) -> None:
        """On the wire's thread: whole frames of the one vehicle, and nothing else."""
        for frame in self._framer.feed(data, stream=self._wire.stream):
            if (frame.system_id, frame.component_id) != self._from:
                self._dropped["foreign"] += 1
                self._others.add(frame.system_id)
                continue
            if frame.message_id not in _WANTED:
                self._dropped["unused"] += 1
                continue
            with self._gate:
                if not self._closed:
                    self._mavsdk.pass_received_raw_bytes(frame.data)

    def _wait_for(self, timeout_s: float, sleep: Callable[[float], None], *, who: str) -> System:
        system_id, component_id = self._from
        deadline_s = self._clock() + timeout_s
        while True:
            for system in self._mavsdk.get_systems():
                if system.get_system_id() == system_id and component_id in system.component_ids():
                    return system
            if self._clock() >= deadline_s:
                heard = ", ".join(map(str, sorted(self._others))) or "none"
                raise LinkError(
                    f"{who}: no HEARTBEAT of system {system_id} component {component_id} within {timeout_s:g} s; "
                    f"other systems heard: {heard}"
                )
            sleep(_LOOK_EVERY_S)

    def _hear(self, message: MavlinkMessage, _user: object) -> None:
        """On MAVSDK's only callback thread: keep it and be gone."""
        self._arrivals.put((message.message_name, message.fields_json))

    def _deliver_integer(self, name: str, value: int) -> None:
        fields = json.dumps({"param_id": name, "param_integer": value})
        self._arrivals.put(("PARAM_VALUE", fields))

    @property
    def heartbeats(self) -> int:
        """How many HEARTBEATs of the vehicle were heard so far, not counting those of the discovery."""
        return self._conversation.heartbeats

    def receive(self) -> Sequence[Message]:
        """All messages of the vehicle since the last call, oldest first."""
        if self._closed:
            return []
        for received_s, (name, text) in self._arrivals.take():
            self._interpret(name, text, received_s)
        self._conversation.tend(self._clock())
        return self._conversation.take()

    def _interpret(self, name: str, text: str, received_s: float) -> None:
        try:
            fields: dict[str, Any] = json.loads(text)
        except ValueError:
            self._dropped["refused"] += 1
            return
        if self._parameters is not None and name == "PARAM_VALUE":
            if self._is_unreadable(fields):
                if self._conversation.awaits_parameter(fields["param_id"]):
                    self._parameters.read(fields["param_id"])
                return
            self._parameters.done(fields["param_id"])
        self._conversation.hear(name, fields, received_s)

    def _is_unreadable(self, fields: Mapping[str, Any]) -> bool:
        lost = fields.get("param_value", 0.0) is None
        return lost and is_bytewise(fields, autopilot=self._conversation.autopilot)

    def _send(self, name: str, fields: Mapping[str, Any]) -> None:
        if self._closed or self._direct is None:
            return
        plain = {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in fields.items()}
        try:
            self._direct.send_message(MavlinkMessage(name, fields_json=json.dumps(plain)))
        except MavlinkDirectError:
            self._dropped["unsent"] += 1

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Put one setpoint frame on the wire, now.

        Raises:
            ValueError: If it is not finite; nothing is sent then.
        """
        if not self._closed:
            self._conversation.setpoint(setpoint, self._clock())

    def request(self, request: Request) -> None:
        """Send a command, once, or a question, which is repeated from `receive` until it is answered.

        MAVSDK's own `send_command` is not used: it repeats a mode change blindly, whatever a pilot does meanwhile.
        """
        if not self._closed:
            self._conversation.request(request, self._clock())

    def send_heartbeat(self) -> None:
        """Nothing: MAVSDK sends ours once a second by itself."""

    def counters(self) -> Mapping[str, int]:
        """What was received, sent and dropped, and why."""
        return {
            "foreign": 0,
            "unused": 0,
            "refused": 0,
            "unsent": 0,
            **self._dropped,
            "garbage_bytes": self._framer.garbage_bytes,
            "unknown": self._framer.unknown,
            "queue_dropped": self._arrivals.dropped,
            "parameters_failed": self._parameters.failed if self._parameters is not None else 0,
            **self._conversation.counters(),
            **self._wire.counters(),
        }

    def close(self) -> None:
        """First nothing comes in any more, then nothing is asked, then MAVSDK goes. May be called twice."""
        with self._gate:
            if self._closed:
                return
            self._closed = True
        self._arrivals.close()
        self._wire.close()
        with contextlib.ExitStack() as stack:
            stack.callback(self._mavsdk.destroy)
            if self._direct is not None:
                stack.callback(self._direct.destroy)
            if self._parameters is not None:
                stack.callback(self._parameters.close)
