"""`VehicleLink` to PX4 over Zenoh: guidance is a flight mode there, and no MAVLink is needed to fly.

The loop reads the same types as over MAVLink, made from PX4's own messages. Arming checks are answered on Zenoh's
thread by the last readiness, so that a busy loop does not delay them. Setpoints are sent only while PX4 flies in our
mode: PX4 would fly them in other modes too. Commands are the mode's executor's while that is in charge.

Parameters, the uploaded fence, texts and home are not on this wire. A MAVLink link beside it brings them; without one,
home is where the vehicle was last seen disarmed.
"""

import contextlib
import math
import queue
import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import zenoh

from guidance import messages
from guidance.autopilots.description import (
    AUTOPILOT_VERSION,
    HOME_POSITION,
    MAV_CMD_DO_SET_MODE,
    MAV_CMD_REQUEST_MESSAGE,
    MAV_CMD_SET_MESSAGE_INTERVAL,
)
from guidance.autopilots.px4 import OWN_MODE, PX4, custom_mode
from guidance.errors import ConfigError, LinkError
from guidance.frames import Ned
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.opening import Sleep
from guidance.links.port import Clock, Endpoint
from guidance.links.px4.messages import FROM_PX4, TO_PX4, TYPES, TopicFields
from guidance.links.px4.mode import ARMED, FlightMode, Outgoing, Readiness
from guidance.links.wires.base import Arrivals
from guidance.links.zenoh.credentials import Credentials
from guidance.links.zenoh.session import (
    Session,
    close_all,
    direct_session,
    is_over,
    open_session,
)
from guidance.vehicle import is_plausible

_AT_ONCE: Final = frozenset(
    {
        "register_ext_component_reply",
        "arming_check_request",
        "mode_completed",
        "vehicle_status",
    }
)
"""Topics that the mode takes on Zenoh's thread."""

_KEPT: Final = 4
"""Messages of such a topic that Zenoh keeps, so that one of another version does not take the place of the newest."""

_POSITION: Final = "vehicle_local_position"

_LEAST_APART_S: Final = {_POSITION: 0.0, "vehicle_global_position": 0.09, "battery_status": 0.45}
"""PX4 sends these more often than anybody reads them. Zenoh keeps the newest, which takes a third of the processor time
of a call of Python for each. All but positions are stamped when they are fetched."""

UNREAD_BESIDE: Final = frozenset(
    {
        "ATTITUDE",
        "ESTIMATOR_STATUS",
        "EXTENDED_SYS_STATE",
        "GLOBAL_POSITION_INT",
        "GPS_GLOBAL_ORIGIN",
        "LOCAL_POSITION_NED",
        "ODOMETRY",
        "POSITION_TARGET_LOCAL_NED",
        "SYS_STATUS",
    }
)
"""Names of MAVLink messages that a link beside this one need not read, because they come over Zenoh."""

_BESIDE: Final = (
    messages.Parameter,
    messages.AutopilotVersion,
    messages.FenceCount,
    messages.FenceItem,
    messages.FenceRefused,
    messages.StatusText,
    messages.Timesync,
    messages.Home,
    messages.GpsFix,
    messages.Aircraft,
)
"""Messages from the MAVLink link beside this one; all others come over Zenoh."""

_BESIDE_EVERY_S: Final = 0.1
"""Period of reading these messages; none is needed sooner."""

_OF_BESIDE: Final = frozenset({"used_unsaved", "impostors", "unsigned", "refused"})
"""Counters of the MAVLink link beside this one that are shown to people."""

_ASKED_BESIDE: Final = frozenset({AUTOPILOT_VERSION, HOME_POSITION})

_OWN_MODE_PARAMS: Final = (1.0, float(OWN_MODE >> 16 & 0xFF), float(OWN_MODE >> 24))
"""Of DO_SET_MODE: flag of a custom mode, main mode and sub mode."""

_PREARM_CHECK: Final = 1 << 28
_STANDBY: Final = 3
_ACTIVE: Final = 4
"""MAV_STATE."""

_LANDED: Final = 1
_IN_AIR: Final = 2
"""MAV_LANDED_STATE."""

_ORIGIN_EVERY_S: Final = 1.0
_BOOT_US: Final = 2**32 * 1000
"""time_boot_ms has 32 bits; PX4's microseconds are cut to the same range."""

_BATTERY_SILENT_S: Final = 1.0
"""After this without BatteryStatus the charge is unknown."""

_OUTBOX_LENGTH: Final = 64
_OVER_EVERY_S: Final = 0.5
_SETPOINT_LASTS_S: Final = 0.1
"""A setpoint that could not be sent within this time is not sent."""

_LOOK_EVERY_S: Final = 0.02
_ROUTER_S: Final = 5.0
"""Longest time for reaching the router."""

_COUNTED: Final = (
    "received",
    "invalid",
    "other_version",
    "foreign",
    "unsent",
    "setpoints_sent",
    "setpoints_withheld",
    "setpoints_late",
    "requests_sent",
    "requests_unsupported",
    "arming_checks_answered",
)


class _Arrived(NamedTuple):
    received_s: float
    topic: str
    data: bytes


class _Departing(NamedTuple):
    topic: str
    data: bytes
    until_s: float


class Px4Link:
    """A vehicle with PX4 on a Zenoh router.

    Args:
        session: On the router; closed with the link.
        clock: Stamps arrivals.
        mode_name: Of the flight mode, 24 characters at most.
        domain_id: PX4's ZENOH_DOMAIN_ID.
        beside: A MAVLink link to the same vehicle; closed with this one.
        draw: Draws the numbers of requests.

    Raises:
        ValueError: If PX4 cannot keep the name of the mode.
    """

    def __init__(
        self,
        session: Session,
        clock: Clock,
        *,
        mode_name: str,
        domain_id: int = 0,
        beside: PymavlinkLink | None = None,
        draw: Callable[[], int] = lambda: secrets.randbits(63),
    ) -> None:
        self._session = session
        self._clock = clock
        self._beside = beside
        self._lock = threading.Lock()
        self._closed = False
        self._over = threading.Event()
        self._arrivals = Arrivals[_Arrived]()
        self._kept: dict[str, zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]] = {}
        self._fetched_s = dict.fromkeys(_LEAST_APART_S, -math.inf)
        self._looked_s = -math.inf
        self._beside_s = -math.inf
        self._keys = {
            topic: TYPES[name].key(domain_id, f"fmu/out/{topic}")
            for topic, name in FROM_PX4.items()
        }
        self.mode = FlightMode(mode_name, draw)
        self._telemetry = _Telemetry(self.mode, derives_home=beside is None)
        self.counts: Counter[str] = Counter()
        self.other_versions: dict[str, str] = {}
        """Messages of a version that is not known: the key by the topic."""
        self._publishers = {
            topic: session.declare_publisher(
                TYPES[name].key(domain_id, f"fmu/in/{topic}"),
                # Once a router's queue to PX4 was full, it drops for ever what may be dropped
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
            )
            for topic, name in TO_PX4.items()
        }
        self._outbox = queue.SimpleQueue[_Departing | None]()
        self._sender = threading.Thread(target=self._send_waiting, name="to PX4")
        self._sender.start()
        self._ends: list[Callable[[], object]] = []
        remote = zenoh.Locality.REMOTE
        for topic in FROM_PX4:
            # The router then sends a number for this key, and Zenoh compares no names for each message
            session.declare_keyexpr(self._keys[topic])
            # Any type and hash, so that another version of a message is seen and named
            keys = f"{domain_id}/fmu/out/{topic}/*/*"
            if topic in _LEAST_APART_S:
                ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(_KEPT)
                kept = session.declare_subscriber(keys, ring, allowed_origin=remote)
                self._kept[topic] = kept
                self._ends.append(kept.undeclare)
            else:
                # Not by a thread of its own for every topic, which an answer would have to wait for
                hear = zenoh.handlers.Callback(partial(self._hear, topic), indirect=False)
                heard = session.declare_subscriber(keys, hear, allowed_origin=remote)
                self._ends.append(heard.undeclare)

    def _hear(self, topic: str, sample: "zenoh.Sample") -> None:
        """Take one message on Zenoh's thread."""
        if self._is_known(topic, sample):
            self._put(topic, sample, self._clock())

    def _is_known(self, topic: str, sample: "zenoh.Sample") -> bool:
        """Return whether a message is of the version that we read; another one is counted and named."""
        if str(sample.key_expr) == self._keys[topic]:
            return True
        self.counts["other_version"] += 1
        self.other_versions[topic] = str(sample.key_expr)
        return False

    def _put(self, topic: str, sample: "zenoh.Sample", received_s: float) -> None:
        kind = TYPES[FROM_PX4[topic]]
        if len(sample.payload) > kind.most_bytes:
            self.counts["invalid"] += 1
            return
        data = sample.payload.to_bytes()
        self._arrivals.put(_Arrived(received_s, topic, data))
        if topic in _AT_ONCE:
            try:
                fields = kind.decode(data)
            except ValueError:
                return  # counted by `receive`
            with self._lock:
                outgoing = self.mode.hear(topic, fields, received_s)
            self._send_all(outgoing)

    def _fetch(self, topic: str, now_s: float) -> None:
        """Take the newest message of those that Zenoh keeps, on the loop's thread."""
        newest = None
        while (sample := self._kept[topic].try_recv()) is not None:
            if self._is_known(topic, sample):
                newest = sample
        if newest is None:
            return
        self._fetched_s[topic] = now_s
        received_s = now_s
        if topic == _POSITION and newest.timestamp is not None:
            # The router stamps each sample, by a clock of its own: never believed further back than our last look
            age_s = self._session.new_timestamp().get_diff_duration(newest.timestamp)
            received_s = min(now_s, max(self._looked_s, now_s - age_s.total_seconds()))
        self._put(topic, newest, received_s)

    def _send_all(self, outgoing: Sequence[Outgoing]) -> None:
        for topic, values in outgoing:
            self._send(topic, TYPES[TO_PX4[topic]].encode(**values))
            if topic == "arming_check_reply":
                self.counts["arming_checks_answered"] += 1

    def _send(self, topic: str, data: bytes, until_s: float = math.inf) -> None:
        if self._closed:
            return
        if self._outbox.qsize() < _OUTBOX_LENGTH:
            self._outbox.put(_Departing(topic, data, until_s))
        else:
            self.counts["unsent"] += 1

    def _send_waiting(self) -> None:
        """Send the waiting messages, on a thread of its own: a stuck router delays neither the loop nor an answer."""
        while not is_over(self._over):
            try:
                departing = self._outbox.get(timeout=_OVER_EVERY_S)
            except queue.Empty:
                continue
            if departing is None:
                return
            if self._clock() > departing.until_s:
                self.counts["setpoints_late"] += 1
                continue
            try:
                self._publishers[departing.topic].put(departing.data)
            except zenoh.ZError:
                self.counts["unsent"] += 1

    def tend(self) -> None:
        """Send the mode's due messages; arrivals stay for `receive`."""
        with self._lock:
            due = self.mode.due(self._clock())
        self._send_all(due)

    def receive(self) -> Sequence[messages.Message]:
        """Return the messages since the last call, of positions the newest, and send the mode's due messages."""
        if self._closed:
            return []
        self.tend()
        now_s = self._clock()
        for topic, least_apart_s in _LEAST_APART_S.items():
            if now_s - self._fetched_s[topic] >= least_apart_s:
                self._fetch(topic, now_s)
        self._looked_s = now_s
        received: list[messages.Message] = []
        for received_s, topic, data in self._arrivals.take():
            try:
                fields = TYPES[FROM_PX4[topic]].decode(data)
                made = self._telemetry.take(topic, fields, received_s)
            except (ValueError, OverflowError):
                self.counts["invalid"] += 1
                continue
            self.counts["received"] += 1
            received += made
        if self._beside is not None and now_s - self._beside_s >= _BESIDE_EVERY_S:
            self._beside_s = now_s
            for one in self._beside.receive():
                if isinstance(one, messages.Home):
                    self._telemetry.hear_home(one)
                if isinstance(one, _BESIDE):
                    received.append(one)
            received.sort(key=lambda one: one.received_s)
        return received

    def send_setpoint(self, setpoint: messages.Setpoint) -> None:
        """Send one TrajectorySetpoint now, if PX4 flies in our mode.

        Raises:
            ValueError: If it is not finite; it is not sent then.
        """
        velocity = setpoint.velocity_ned_m_s
        acceleration = setpoint.acceleration_ned_m_s2
        yaw_rad = setpoint.yaw_rad
        if not math.isfinite(math.hypot(*velocity, *(acceleration or ()), yaw_rad or 0.0)):
            raise ValueError(f"{setpoint}: a setpoint must be finite; it was not sent")
        if self._closed or not self.mode.entered:
            self.counts["setpoints_withheld"] += 1
            return
        free = (math.nan, math.nan, math.nan)
        values = {"yaw": math.nan if yaw_rad is None else yaw_rad, "yawspeed": math.nan}
        for name, vector in (
            ("position", free),
            ("velocity", velocity),
            ("acceleration", free if acceleration is None else acceleration),
            ("jerk", free),
        ):
            values |= {f"{name}_{index}": part for index, part in enumerate(vector)}
        data = TYPES["TrajectorySetpoint"].encode(**values)
        self._send("trajectory_setpoint", data, until_s=self._clock() + _SETPOINT_LASTS_S)
        self.counts["setpoints_sent"] += 1

    def request(self, request: messages.Request) -> None:
        """Send a command once. Parameters and the fence are requested on the link beside, if there is one.

        Raises:
            ValueError: If it cannot be encoded.
        """
        if self._closed:
            return
        if not isinstance(request, messages.Command):
            self._request_beside(request)
        elif request.command == MAV_CMD_REQUEST_MESSAGE:
            if request.params[0] in _ASKED_BESIDE:
                self._request_beside(request)
        elif request.command != MAV_CMD_SET_MESSAGE_INTERVAL:  # PX4 sends everything here
            if any(math.isinf(value) for value in request.params):
                raise ValueError(f"command {request.command}: infinite values are not allowed")
            changes_mode = request.command == MAV_CMD_DO_SET_MODE
            with self._lock:
                if changes_mode and request.params[:3] == _OWN_MODE_PARAMS:
                    entering = self.mode.enter()
                    outgoing = [] if entering is None else [entering]
                else:
                    outgoing = [self.mode.command(request.command, *request.params)]
                    if changes_mode:
                        outgoing = [*self.mode.completed(), *outgoing]
            self._send_all(outgoing)
            self.counts["requests_sent"] += len(outgoing)

    def _request_beside(self, request: messages.Request) -> None:
        if self._beside is None:
            self.counts["requests_unsupported"] += 1
        else:
            self._beside.request(request)

    def tell(self, readiness: Readiness) -> None:
        """Set the readiness for answers to arming checks."""
        with self._lock:
            outgoing = self.mode.judge(readiness)
        self._send_all(outgoing)

    def send_heartbeat(self) -> None:
        """Send our HEARTBEAT on the link beside. Over Zenoh our answers to arming checks show that we live."""
        if self._beside is not None and not self._closed:
            self._beside.send_heartbeat()

    def counters(self) -> Mapping[str, int]:
        """Return how many messages were received, sent and dropped, by reason.

        Those of the link beside begin with `mavlink_`, except for the ones that tell of attacks.
        """
        beside = {} if self._beside is None else self._beside.counters()
        return {
            **dict.fromkeys(_COUNTED, 0),
            **{
                name if name in _OF_BESIDE else f"mavlink_{name}": count
                for name, count in beside.items()
            },
            **self.counts,
            "wire_dropped": self._arrivals.dropped,
        }

    def problem(self) -> str:
        """Return the problem that bars a flight on this link, for people; empty without one."""
        problems = [
            f"PX4 sends another version of {FROM_PX4[topic]} ({key}); use PX4 v1.17"
            for topic, key in self.other_versions.items()
        ]
        if self.mode.registration is None:
            refused = self.mode.refused or "it does not answer"
            problems.append(f"PX4 has not registered the mode {self.mode.name!r}: {refused}")
        if self._beside is None:
            problems.append(
                "parameters and the uploaded fence are not on this wire: "
                "give a MAVLink URL for them, vehicle.parameters or --parameters"
            )
        return "; ".join(problems)

    def close(self) -> None:
        """Take the mode off PX4's list, and end. May be called twice."""
        if self._closed:
            return
        self._send_all(self.mode.farewell())
        self._closed = True
        self._outbox.put(None)
        self._sender.join(_ROUTER_S)
        self._over.set()
        self._arrivals.close()
        close_all(*self._ends, self._session.close)
        self._sender.join()
        if self._beside is not None:
            self._beside.close()


class _Telemetry:
    """Makes the loop's messages of PX4's.

    Args:
        mode: Knows which mode is ours, and whether the vehicle is armed.
        derives_home: Whether home is the vehicle's last place while disarmed, because no message reports it.
    """

    def __init__(self, mode: FlightMode, *, derives_home: bool) -> None:
        self._mode = mode
        self._derives_home = derives_home
        self._home: messages.Home | None = None
        self._local: messages.LocalPosition | None = None
        self._origin: tuple[float, float, float] | None = None
        self._origin_s = -math.inf
        self._resets: int | None = None
        self._landed = False
        self._prearm = False
        self._battery_s = -math.inf
        self._readers = {
            "vehicle_status": self._status,
            "vehicle_local_position": self._position,
            "vehicle_global_position": self._on_map,
            "vehicle_land_detected": self._land_detected,
            "battery_status": self._battery,
            "vehicle_command_ack": self._acknowledged,
            "register_ext_component_reply": self._clock_answer,
        }

    def take(self, topic: str, fields: TopicFields, received_s: float) -> list[messages.Message]:
        """Return the messages made from a message of PX4.

        Raises:
            ValueError: If its values are unknown or implausible.
        """
        read = self._readers.get(topic)
        made = [] if read is None else [*read(fields, received_s)]
        for one in made:
            if not is_plausible(one):
                raise ValueError(f"{one}: implausible")
        return made

    def hear_home(self, home: messages.Home) -> None:
        """Take home from the link beside."""
        self._home = home

    def _status(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        registration = self._mode.registration
        nav_state = fields.nav_state
        shown = custom_mode(nav_state)
        if registration is not None and nav_state == registration.mode_id:
            shown = OWN_MODE
        armed = fields.arming_state == ARMED
        self._prearm = bool(fields.pre_flight_checks_pass)
        state = _ACTIVE if armed else _STANDBY
        yield messages.Heartbeat(
            received_s, shown, armed, state, PX4.autopilot_id, fields.system_type
        )
        if received_s - self._battery_s > _BATTERY_SILENT_S:
            yield self._system_status(received_s, math.nan, math.nan)

    def _battery(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        self._battery_s = received_s
        known = fields.connected and 0.0 <= fields.remaining <= 1.0
        remaining = fields.remaining if known else math.nan
        volts = fields.voltage_v if known and fields.voltage_v > 0.0 else math.nan
        yield self._system_status(received_s, remaining, volts)

    def _system_status(
        self, received_s: float, remaining: float, volts: float
    ) -> messages.SystemStatus:
        health = _PREARM_CHECK if self._prearm else 0
        return messages.SystemStatus(received_s, _PREARM_CHECK, health, remaining, volts)

    def _position(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        if not (fields.xy_valid and fields.z_valid and fields.v_xy_valid and fields.v_z_valid):
            raise ValueError("the position is not valid")
        boot_s = _boot_s(fields)
        position = Ned((fields.x, fields.y, fields.z))
        velocity = Ned((fields.vx, fields.vy, fields.vz))
        self._local = messages.LocalPosition(received_s, boot_s, position, velocity)
        yield self._local
        yield messages.Attitude(received_s, boot_s, fields.heading)
        counters = ("xy", "z", "vxy", "vz", "heading")
        resets = sum(getattr(fields, f"{name}_reset_counter") for name in counters) % 256
        if resets != self._resets:
            self._resets = resets
            yield messages.Odometry(received_s, resets)
        origin = (fields.ref_lat, fields.ref_lon, fields.ref_alt)
        is_due = origin != self._origin or received_s - self._origin_s >= _ORIGIN_EVERY_S
        if fields.xy_global and fields.z_global and is_due:
            self._origin = origin
            self._origin_s = received_s
            yield messages.Origin(received_s, *origin)

    def _on_map(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        local = self._local
        if not (fields.lat_lon_valid and fields.alt_valid) or local is None:
            raise ValueError("the position is not valid")
        place = (fields.lat, fields.lon, fields.alt)
        if self._derives_home and self._landed and not self._mode.armed:
            self._home = messages.Home(received_s, *place, local.position_ned_m)
            yield self._home
        if self._home is not None:
            above_m = fields.alt - self._home.altitude_amsl_m
            velocity = local.velocity_ned_m_s
            yield messages.GlobalPosition(received_s, _boot_s(fields), *place, above_m, velocity)

    def _land_detected(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        self._landed = bool(fields.landed)
        yield messages.LandedState(received_s, _LANDED if fields.landed else _IN_AIR)

    def _acknowledged(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        yield messages.CommandAck(received_s, fields.command, fields.result)

    def _clock_answer(self, fields: TopicFields, received_s: float) -> Iterator[messages.Message]:
        answer = self._mode.clock_answer(fields, received_s)
        if answer is not None:
            yield answer


def _boot_s(fields: TopicFields) -> float:
    """Return PX4's time of a message, in the range of time_boot_ms."""
    return float(fields.timestamp % _BOOT_US / 1e6)


def px4_session(endpoint: Endpoint, credentials: Credentials, timeout_s: float) -> Session:
    """Open a session on the router of PX4's own Zenoh. Where none runs on this computer, this session is the router.

    Raises:
        LinkError: If it can neither listen there nor connect.
    """
    protocol = "tls" if endpoint.scheme == "zenoh+tls" else "tcp"
    address = f"{protocol}/{endpoint.host}:{endpoint.port}"
    if protocol == "tcp":
        listening = {"endpoints": [address], "timeout_ms": 0, "exit_on_failure": True}
        with contextlib.suppress(zenoh.ZError):  # a router runs there, or it is another computer
            return direct_session("router", {"listen": listening})
    return open_session(address, timeout_s=timeout_s, credentials=credentials)


def open_px4_link(
    endpoint: Endpoint,
    *,
    mode_name: str,
    beside: PymavlinkLink | None,
    clock: Clock,
    credentials: Credentials,
    timeout_s: float,
    system_id: int | None = None,
    sleep: Sleep = time.sleep,
) -> Px4Link:
    """Open a link, and wait until PX4 is heard and has registered the mode.

    Args:
        endpoint: The router, and PX4's domain.
        mode_name: Of the flight mode.
        beside: A MAVLink link to the same vehicle; closed with this one, also if opening fails.
        clock: Stamps arrivals.
        credentials: For the router.
        timeout_s: Longest wait.
        system_id: The vehicle's MAVLink system id; None accepts any.
        sleep: Waits between two looks, s.

    Raises:
        ConfigError: If PX4 cannot keep the name of the mode.
        LinkError: If there is no router, another daemon owns the vehicle, or as `wait_until_registered`.
    """
    who = f"{endpoint.scheme}://{endpoint.host}:{endpoint.port}/{endpoint.namespace}"
    with contextlib.ExitStack() as closing:
        if beside is not None:
            closing.callback(beside.close)
        session = px4_session(endpoint, credentials, min(timeout_s, _ROUTER_S))
        closing.callback(close_all, session.close)
        try:
            link = Px4Link(
                session,
                clock,
                mode_name=mode_name,
                domain_id=int(endpoint.namespace),
                beside=beside,
            )
        except ValueError as error:
            raise ConfigError(f"vehicle.mode_name = {mode_name!r}: {error}") from error
        closing.callback(link.close)
        wait_until_registered(link, clock=clock, timeout_s=timeout_s, sleep=sleep, who=who)
        found = None if link.mode.status is None else link.mode.status.system_id
        if system_id is not None and found != system_id:
            raise LinkError(
                f"{who}: PX4 there is system {found}, not vehicle.system_id = {system_id}"
            )
        closing.pop_all()
    return link


def wait_until_registered(
    link: Px4Link, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str
) -> None:
    """Wait until PX4 is heard and has registered the mode. In the air it registers none; then PX4 is only heard.

    Args:
        link: The link.
        clock: Measures the time.
        timeout_s: How long to wait.
        sleep: Waits between two looks, s.
        who: Names the vehicle in errors.

    Raises:
        LinkError: If PX4 is not there, speaks another version, or refuses the mode.
    """
    mode = link.mode
    deadline_s = clock() + timeout_s
    while True:
        link.tend()
        if mode.status is not None and (mode.registration is not None or mode.armed):
            return
        if mode.status is not None and mode.refused:
            raise LinkError(f"{who}: PX4 refused the mode {mode.name!r}: {mode.refused}")
        if clock() >= deadline_s:
            break
        sleep(_LOOK_EVERY_S)
    if "vehicle_status" in link.other_versions:
        key = link.other_versions["vehicle_status"]
        ask = "this link knows the messages of PX4 v1.17: use that version"
        raise LinkError(f"{who}: PX4 sends another version of VehicleStatus ({key}); {ask}")
    if mode.status is None:
        ask = "does PX4 run its zenoh module (ZENOH_ENABLE 1, or `zenoh start`), and on this router and domain?"
        raise LinkError(f"{who}: no VehicleStatus within {timeout_s:g} s; {ask}")
    ask = "is its RegisterExtComponentRequest of another version? This link knows that of PX4 v1.17"
    raise LinkError(f"{who}: PX4 did not answer the registration of {mode.name!r}; {ask}")
