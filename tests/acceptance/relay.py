"""A relay between an autopilot and its client: forwards every frame, records some, and can act as the pilot.

The service under test listens on a loopback port, so one vehicle with one URL is enough. The relay sees both
directions, even after the service is killed, and can switch modes as a ground station does.
"""

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from pymavlink.dialects.v20 import all as dialect
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import AUTOPILOTS, Autopilot, Mode
from guidance.links.mavlink.frames import Frame, FrameReader
from guidance.links.opening import Found, find_autopilot, open_wire
from guidance.links.port import Endpoint, Wire, parse
from guidance.links.px4.messages import TYPES
from guidance.links.wires.udp import UdpWire
from guidance.links.zenoh.session import Session, open_session

PILOT = (254, 190)
"""Another sender than the ground stations: an autopilot forwards nobody's HEARTBEAT to a link where it heard him."""

HOME_POSITION = 242
ARMED = 128
SET_UP = {
    "px4": {"GF_MAX_HOR_DIST": 305.0, "GF_MAX_VER_DIST": 125.0, "RTL_RETURN_ALT": 10.0, "RTL_DESCEND_ALT": 8.0},
    "arducopter": {"GUID_TIMEOUT": 1.0, "FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0, "FENCE_RADIUS": 305.0,
                   "FENCE_ALT_MAX": 125.0},
}  # fmt: skip
"""The parameters that `guidance check --apply` sets; the mocks start with them."""

POLL_S = 5e-3
"""How often each wire is read. Every millisecond, a relay without a client took 0.07 of a processor; now 0.06."""

EXTERNAL_MODES = [4 << 16 | sub << 24 for sub in range(11, 19)]
"""HEARTBEAT.custom_mode of the modes that programs register with PX4."""

LASTING = ("BATT_CAPACITY", 50_000.0)
"""ArduPilot's simulator empties its 3,300 mAh in four flights, and preflight refuses the fifth."""


@dataclass
class Seen:
    """Recorded messages, by the relay's clock: (time, custom_mode, armed) and (time, NED position m, speed m/s)."""

    beats: list[tuple[float, int, bool]] = field(default_factory=list)
    setpoints_s: list[float] = field(default_factory=list)
    positions: list[tuple[float, tuple[float, float, float], float]] = field(default_factory=list)
    parameters: dict[str, tuple[float, float, int]] = field(default_factory=dict)


class Relay:
    """A relay from the vehicle at a URL to a client on a loopback port.

    With `station_ports` it forwards between the client and the ground stations there too, as autopilots do. With
    `mode_url`, PX4's router, the client flies as a mode of PX4 there, and has the relay for its parameters only.

    Raises:
        GuidanceError: If there is no vehicle, or its autopilot is not supported.
    """

    def __init__(
        self,
        url: str,
        client_port: int,
        *,
        station_ports: Sequence[int] = (),
        mode_url: str | None = None,
        timeout_s: float = 20.0,
    ) -> None:
        self.client_url = f"udpin://127.0.0.1:{client_port}"
        self.mode_url = mode_url
        self.seen = Seen()
        self._over = threading.Event()
        self._wire = open_wire(url, clock=time.monotonic)
        self.found: Found = find_autopilot(
            self._wire, clock=time.monotonic, timeout_s=timeout_s, sleep=time.sleep, who=url
        )
        self.profile: Autopilot = next(
            one for one in AUTOPILOTS.values() if one.autopilot_id == self.found.autopilot
        )
        self._client = UdpWire(time.monotonic, "127.0.0.1", client_port)
        self._stations = [UdpWire(time.monotonic, "127.0.0.1", port) for port in station_ports]
        self._down = FrameReader(dialect=dialect)
        self._up = FrameReader(dialect=dialect)
        self._pilot = mavlink.MAVLink(None, *PILOT)
        self._reader = mavlink.MAVLink(None)
        self._lock = threading.Lock()
        self._passing = [
            threading.Thread(target=self._pass_on, args=way, daemon=True) for way in self._ways()
        ]
        for one in self._passing:
            one.start()
        self._router = None if mode_url is None else self._overhear(parse(mode_url))

    def _overhear(self, router: Endpoint) -> Session:
        """Note the setpoints that go to PX4 by its own topics."""
        session = open_session(f"tcp/{router.host}:{router.port}")
        key = TYPES["TrajectorySetpoint"].key(int(router.namespace), "fmu/in/trajectory_setpoint")
        session.declare_subscriber(key, lambda _: self.seen.setpoints_s.append(time.monotonic()))
        return session

    @property
    def options(self) -> Sequence[str]:
        """The options of `guidance fly` and `guidance check` that reach the vehicle."""
        if self.mode_url is None:
            return ("--vehicle", self.client_url)
        return ("--vehicle", self.mode_url, "--parameters", self.client_url)

    def _ways(self) -> list[tuple[Wire, Callable[[float, bytes], None]]]:
        ways: list[tuple[Wire, Callable[[float, bytes], None]]] = [
            (self._wire, self._from_vehicle),
            (self._client, self._from_client),
        ]
        ways += [(station, partial(self._from_station, station)) for station in self._stations]
        return ways

    def _from_station(self, sender: Wire, _now_s: float, data: bytes) -> None:
        """Forward a ground station's messages to the vehicle and to all others, as autopilots do between links."""
        self._client.send(data)
        for station in self._stations:
            if station is not sender:
                station.send(data)
        with self._lock:
            self._wire.send(data)

    def _pass_on(self, wire: Wire, pass_on: Callable[[float, bytes], None]) -> None:
        while not self._over.is_set():
            time.sleep(POLL_S)
            for now_s, data in wire.receive():
                pass_on(now_s, data)

    def _from_vehicle(self, now_s: float, data: bytes) -> None:
        for frame in self._down.read(data):
            self._client.send(frame.data)
            for station in self._stations:
                station.send(frame.data)
            if (frame.system_id, frame.component_id) == self.found[:2]:
                self._note(now_s, frame)
        # Messages outside the dialect are forwarded too, if a datagram holds them completely.

    def _from_client(self, now_s: float, data: bytes) -> None:
        for frame in self._up.read(data):
            with self._lock:
                self._wire.send(frame.data)
            for station in self._stations:
                station.send(frame.data)
            if frame.name == "SET_POSITION_TARGET_LOCAL_NED":
                self.seen.setpoints_s.append(now_s)

    def _note(self, now_s: float, frame: Frame) -> None:
        name = frame.name
        message = frame.fields
        if name == "HEARTBEAT":
            self.seen.beats.append((now_s, message.custom_mode, bool(message.base_mode & ARMED)))
        elif name == "PARAM_VALUE":
            self.seen.parameters[message.param_id] = (
                now_s,
                message.param_value,
                message.param_type,
            )
        elif name == "LOCAL_POSITION_NED":
            place = (message.x, message.y, message.z)
            self.seen.positions.append(
                (now_s, place, math.hypot(message.vx, message.vy, message.vz))
            )

    @property
    def armed(self) -> bool:
        """Whether the last HEARTBEAT reports armed."""
        return bool(self.seen.beats) and self.seen.beats[-1][2]

    def mode(self) -> Mode | None:
        """Return the mode of the last HEARTBEAT; None before the first."""
        if not self.seen.beats:
            return None
        number = self.seen.beats[-1][1]
        if self.mode_url is not None and number in EXTERNAL_MODES:
            return Mode.GUIDED
        return self.profile.mode_of(number)

    def say(self, message: mavlink.MAVLink_message) -> None:
        """Send as a ground station."""
        with self._lock:
            self._wire.send(bytes(message.pack(self._pilot)))
            self._pilot.seq = (self._pilot.seq + 1) % 256

    def switch(self, mode: Mode) -> None:
        """Switch the mode, as a pilot does."""
        main, sub = self.profile.set_mode(mode).params[1:3]
        self.say(
            mavlink.MAVLink_command_long_message(
                *self.found[:2], 176, 0, 1.0, main, sub, 0, 0, 0, 0
            )
        )

    def set(self, name: str, value: float, *, within_s: float = 3.0) -> float | None:
        """Set a float parameter, or an integer of ArduPilot; return its previous value, or None without an answer."""
        self.say(mavlink.MAVLink_param_request_read_message(*self.found[:2], name.encode(), -1))
        if not wait(lambda: name in self.seen.parameters, within_s):
            return None
        asked_s, before, kind = self.seen.parameters[name]
        self.say(mavlink.MAVLink_param_set_message(*self.found[:2], name.encode(), value, kind))
        wait(lambda: self.seen.parameters[name][0] > asked_s, within_s)
        return before

    def bring_down(self, *, within_s: float) -> bool:
        """Switch a vehicle that is still armed to RETURN; wait until it is disarmed."""
        if wait(lambda: bool(self.seen.beats) and not self.armed, 2.0):
            return True
        self.switch(Mode.RETURN)
        return wait(lambda: not self.armed, within_s)

    def close(self) -> None:
        """Close both wires."""
        self._over.set()
        for one in self._passing:
            one.join()
        self._client.close()
        for station in self._stations:
            station.close()
        self._wire.close()
        if self._router is not None:
            self._router.close()


def wait(condition, within_s: float) -> bool:
    """Check a condition every 0.05 s; return whether it held in time."""
    until_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.05)
    return True
