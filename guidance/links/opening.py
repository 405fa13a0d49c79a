"""Open wires, vehicle links and evader sources from URLs and settings. Importing this loads every wire library."""

import contextlib
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Final, NamedTuple

from guidance.errors import ConfigError, LinkError
from guidance.frames import LocalFrame
from guidance.links.codec import MAV_MODE_FLAG_SAFETY_ARMED
from guidance.links.endpoint import parse
from guidance.links.evaders.carriers import (
    AdsbVehicle,
    Carrier,
    FollowTarget,
    GlobalPositionInt,
    OdometryCarrier,
    OpenDroneIdLocation,
)
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.evaders.zenoh import (
    ODOMETRY_TYPE,
    POSE_TYPE,
    PayloadReader,
    RosPose,
    ZenohEvader,
    read_json,
    rmw_key,
)
from guidance.links.frames import Decoded, FrameReader, SignatureCheck, SigningKey, Station, ticks
from guidance.links.mavsdk_link import MavsdkLink
from guidance.links.port import Clock, EvaderSource, VehicleLink, Wire
from guidance.links.pymavlink_link import PymavlinkLink, own_heartbeat
from guidance.links.wires.streams import SerialWire, TcpWire
from guidance.links.wires.udp import UdpWire
from guidance.links.wires.zenoh import ZenohWire
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials

KINDS: Final = ("mavsdk", "pymavlink")
MAV_AUTOPILOT_INVALID: Final = 8
"""HEARTBEAT.autopilot of ground stations, companion computers and cameras."""

MAV_TYPE_GCS: Final = 6
_LOOK_EVERY_S: Final = 0.02
_HEARTBEAT_EVERY_S: Final = 1.0
_OWN: Final = (255, 191)

Sleep = Callable[[float], None]


def open_wire(
    url: str,
    *,
    clock: Clock,
    systems: Collection[int] | None = None,
    keys: Mapping[int, SigningKey] | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    timeout_s: float = 5.0,
) -> Wire:
    """Open the wire behind a URL.

    Args:
        url: See `guidance.links.endpoint`.
        clock: Stamps what arrives.
        systems: MAVLink system ids that may call a listening UDP port; None accepts any.
        keys: Signing keys by system id. Such a system is accepted from an address only after a validly signed frame.
        credentials: For a Zenoh router.
        timeout_s: Limit for connecting (TCP, Zenoh), in real time.

    Raises:
        ConfigError: If the URL has none of the allowed forms.
        LinkError: If it cannot be opened.
    """
    endpoint = parse(url)
    if endpoint.scheme == "zenoh":
        return ZenohWire(
            clock,
            namespace=endpoint.namespace,
            endpoint=credentials.endpoint(endpoint.host, endpoint.port),
            credentials=credentials,
            timeout_s=timeout_s,
        )
    if endpoint.scheme == "serial":
        return SerialWire(clock, device=endpoint.host, baud=endpoint.port)
    listen = endpoint.scheme.endswith("in")
    if endpoint.scheme.startswith("udp"):
        now = ticks(unix_now_s())
        checks = {system_id: SignatureCheck(key, now) for system_id, key in (keys or {}).items()}
        return UdpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, systems=systems, checks=checks)
    return TcpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, timeout_s=timeout_s)


def unix_now_s() -> float:
    """Return Unix time. Only signing needs it: its timestamps must increase from flight to flight."""
    return time.time_ns() / 1e9


def open_link(
    wire: Wire,
    kind: str,
    *,
    system_id: int,
    clock: Clock,
    who: str,
    component_id: int = 1,
    own_system_id: int | None = None,
    own_component_id: int = 195,
    signing_key: SigningKey | None = None,
    timeout_s: float = 10.0,
    sleep: Sleep = time.sleep,
) -> VehicleLink:
    """Open a link over an open wire and wait for the vehicle's first HEARTBEAT.

    Args:
        wire: Closed with the link, also if opening fails.
        kind: "mavsdk" or "pymavlink".
        system_id: The vehicle's MAVLink system id; messages of others are dropped.
        clock: Time of arrivals, setpoints and repeated requests.
        who: Names the vehicle in errors.
        component_id: Its autopilot's.
        own_system_id: Ours; None takes the vehicle's, as its companion computer.
        own_component_id: Ours; 195 is MAVSDK's for a companion computer.
        signing_key: Sign our frames and refuse unsigned ones (pymavlink only; MAVSDK cannot sign).
        timeout_s: How long to wait for the first HEARTBEAT.
        sleep: Waits between two looks, s.

    Raises:
        ConfigError: If an argument is wrong.
        LinkError: If no HEARTBEAT arrived in time.
    """
    ids = {"system_id": system_id, "component_id": component_id, "own_component_id": own_component_id}
    with contextlib.ExitStack() as closing:
        closing.callback(wire.close)
        _check(kind, ids, signing_key)
        link: PymavlinkLink
        if kind == "mavsdk":
            link = MavsdkLink(wire, clock, own_system_id=own_system_id, **ids)
        else:
            link = PymavlinkLink(
                wire, clock, own_system_id=own_system_id, signing_key=signing_key, unix_s=unix_now_s(), **ids
            )
        closing.callback(link.close)
        wait_until_heard(link, clock=clock, timeout_s=timeout_s, sleep=sleep, who=who)
        closing.pop_all()
    return link


def _check(kind: str, ids: Mapping[str, int], signing_key: SigningKey | None) -> None:
    for name, value in ids.items():
        if not 1 <= value <= 255:
            raise ConfigError(f"{name} = {value}: allowed are 1 to 255")
    if kind not in KINDS:
        raise ConfigError(f"link = {kind!r}: allowed are {', '.join(KINDS)}")
    if kind == "mavsdk" and signing_key is not None:
        raise ConfigError("link = 'mavsdk' with a signing key: MAVSDK does not sign; use link = 'pymavlink'")


def wait_until_heard(link: PymavlinkLink, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str) -> None:
    """Wait for the vehicle's first HEARTBEAT, and send our own once a second. `receive` returns what arrives meanwhile.

    Args:
        link: The link.
        clock: Measures the time.
        timeout_s: How long to wait.
        sleep: Waits between two looks, s.
        who: Names the vehicle in the error.

    Raises:
        LinkError: If none arrived in time.
    """
    deadline_s = clock() + timeout_s
    next_heartbeat_s = clock()
    while not link.heard:
        if clock() >= deadline_s:
            others = ", ".join(map(str, sorted(link.others))) or "none"
            raise LinkError(
                f"{who}: no HEARTBEAT within {timeout_s:g} s; other systems heard: {others}. "
                "Is it running, does it send here, and is its system id right?"
            )
        if clock() >= next_heartbeat_s:
            link.send_heartbeat()
            next_heartbeat_s += _HEARTBEAT_EVERY_S
        link.poll()
        if not link.heard:
            sleep(_LOOK_EVERY_S)


class Found(NamedTuple):
    """An autopilot's ids and its HEARTBEAT: MAV_AUTOPILOT, MAV_TYPE, and whether it is armed."""

    system_id: int
    component_id: int
    autopilot: int
    vehicle_type: int
    armed: bool


def find_autopilot(wire: Wire, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str) -> Found:
    """Wait for the first HEARTBEAT of any autopilot. The wire stays open; other frames that arrive are lost.

    Our own HEARTBEAT (a companion computer's) is sent once a second: over UDP some vehicles answer only then.

    Args:
        wire: Open.
        clock: Measures the time.
        timeout_s: How long to wait.
        sleep: Waits between two looks, s.
        who: Names the vehicle in the error.

    Raises:
        LinkError: If none arrived within `timeout_s`.
    """
    reader, station = FrameReader(), Station(*_OWN)
    deadline_s, beat_s, others = clock() + timeout_s, clock(), 0
    while True:
        if clock() >= beat_s:
            beat_s += _HEARTBEAT_EVERY_S
            wire.send(station.pack(own_heartbeat()))
        for _, data in wire.receive():
            for frame in reader.read(data, stream=wire.stream):
                found = _found(frame)
                if found is not None:
                    return found
                others += 1
        if clock() >= deadline_s:
            raise LinkError(
                f"{who}: no autopilot's HEARTBEAT within {timeout_s:g} s ({others} other frames heard); is it running, "
                "and does it send here?"
            )
        sleep(_LOOK_EVERY_S)


def _found(frame: Decoded) -> Found | None:
    if frame.get_type() != "HEARTBEAT" or frame.autopilot == MAV_AUTOPILOT_INVALID or frame.type == MAV_TYPE_GCS:
        return None
    armed = bool(frame.base_mode & MAV_MODE_FLAG_SAFETY_ARMED)
    return Found(frame.get_srcSystem(), frame.get_srcComponent(), frame.autopilot, frame.type, armed)


class EvaderIdentity(NamedTuple):
    """The evader's identity, as far as its carrier needs it: MAVLink ids, an ICAO address, a remote id."""

    system_id: int | None = None
    component_id: int | None = None
    icao_address: int | None = None
    id_or_mac: bytes | None = None


def _adsb(frame: LocalFrame, identity: EvaderIdentity) -> Carrier:
    if identity.icao_address is None:
        raise ConfigError("evader.icao_address is missing: ADSB_VEHICLE needs the aircraft's address")
    return AdsbVehicle(frame, identity.icao_address)


MAVLINK: Final[Mapping[str, Callable[[LocalFrame, EvaderIdentity], Carrier]]] = {
    "follow_target": lambda _frame, _identity: FollowTarget(),
    "global_position": lambda _frame, _identity: GlobalPositionInt(),
    "odometry": lambda frame, _identity: OdometryCarrier(frame),
    "open_drone_id": lambda frame, identity: OpenDroneIdLocation(frame, identity.id_or_mac),
    "adsb": _adsb,
}
"""Carriers on a MAVLink wire, by their name in a configuration."""

ZENOH: Final[Mapping[str, Callable[[LocalFrame, str], tuple[str, PayloadReader]]]] = {
    "json": lambda frame, key: (key, partial(read_json, frame=frame, source=key)),
    "ros_pose": lambda frame, topic: (rmw_key(topic, POSE_TYPE), RosPose(frame).pose_stamped),
    "ros_odometry": lambda frame, topic: (rmw_key(topic, ODOMETRY_TYPE), RosPose(frame).odometry),
}
"""Payloads on a Zenoh key, by their name in a configuration. The URL's path is the key, or the ROS topic."""


def open_source(
    kind: str,
    url: str,
    *,
    clock: Clock,
    frame: LocalFrame,
    identity: EvaderIdentity,
    wire: Wire | None = None,
    signing_key: SigningKey | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    timeout_s: float = 5.0,
) -> EvaderSource:
    """Open the source of reports called `kind` at `url`.

    Args:
        kind: A key of `MAVLINK` or `ZENOH`.
        url: As for links; for `ZENOH` kinds zenoh://host:port/key.
        clock: Stamps what arrives.
        frame: The evader's declared local frame, for the datum and for positions in metres.
        identity: The evader.
        wire: For `MAVLINK` kinds: an open wire to use instead of `url`.
        signing_key: `MAVLINK` reports must be signed with it; None asks for no signature.
        credentials: For a Zenoh router.
        timeout_s: Limit for connecting, in real time.

    Raises:
        ConfigError: If an argument is wrong or missing.
        LinkError: If the wire cannot be opened.
    """
    if kind in ZENOH:
        endpoint = parse(url)
        if endpoint.scheme != "zenoh" or not endpoint.namespace:
            raise ConfigError(f"evader.url = {url!r}: {kind} needs zenoh://host:port/key")
        key, read = ZENOH[kind](frame, endpoint.namespace)
        router = credentials.endpoint(endpoint.host, endpoint.port)
        return ZenohEvader(clock, key, read, endpoint=router, credentials=credentials, timeout_s=timeout_s)
    if kind not in MAVLINK:
        raise ConfigError(f"evader.kind = {kind!r}: allowed are {', '.join((*MAVLINK, *ZENOH))}")
    system_id = identity.system_id
    if system_id is None:
        raise ConfigError(f"evader.system_id is missing: {kind} reads the messages of one MAVLink system")
    carrier = MAVLINK[kind](frame, identity)
    if wire is None:
        keys = {} if signing_key is None else {system_id: signing_key}
        wire = open_wire(
            url, clock=clock, systems=(system_id,), keys=keys, credentials=credentials, timeout_s=timeout_s
        )
    return MavlinkEvader(
        wire,
        carrier,
        system_id=system_id,
        component_id=identity.component_id,
        clock=clock,
        signing_key=signing_key,
        unix_s=unix_now_s(),
    )
