"""From a URL to a wire, from a wire to a vehicle that was heard. Importing this imports every wire library."""

import time
from collections.abc import Callable, Collection
from typing import Final, NamedTuple

from guidance.errors import ConfigError, LinkError
from guidance.links.arrivals import Clock
from guidance.links.decode import MAV_MODE_FLAG_SAFETY_ARMED
from guidance.links.encode import Station
from guidance.links.endpoint import parse
from guidance.links.framing import CRC_EXTRA, NAMES, Frame, Framer, fields_of
from guidance.links.mavsdk_link import MavsdkLink
from guidance.links.port import VehicleLink, Wire
from guidance.links.pymavlink_link import OWN_HEARTBEAT, PymavlinkLink
from guidance.links.signing import SigningKey
from guidance.links.wires.streams import SerialWire, TcpWire
from guidance.links.wires.udp import UdpWire
from guidance.links.wires.zenoh import ZenohWire
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials

KINDS: Final = ("mavsdk", "pymavlink")
_LOOK_EVERY_S: Final = 0.02
_HEARTBEAT_EVERY_S: Final = 1.0
MAV_AUTOPILOT_INVALID: Final = 8
"""What a ground station, a companion computer or a camera calls itself."""

MAV_TYPE_GCS: Final = 6
_OWN: Final = (255, 191)

Sleep = Callable[[float], None]


def open_wire(
    url: str,
    *,
    clock: Clock,
    systems: Collection[int] | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    timeout_s: float = 5.0,
) -> Wire:
    """Open the bytes behind a URL.

    Args:
        url: `udpin://`, `udpout://`, `tcpout://`, `serial://` or `zenoh://`.
        clock: Stamps what arrives.
        systems: The MAVLink system ids that are waited for, where anybody could call (`udpin`); None takes any.
        credentials: For a Zenoh router.
        timeout_s: Bounds the connecting (TCP, Zenoh), in real time.

    Raises:
        ConfigError: If the URL is none of those allowed.
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
        return UdpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, systems=systems)
    return TcpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, timeout_s=timeout_s)


def open_vehicle_link(
    kind: str,
    url: str,
    *,
    system_id: int,
    clock: Clock,
    component_id: int = 1,
    own_system_id: int | None = None,
    own_component_id: int = 195,
    signing_key: SigningKey | None = None,
    timeout_s: float = 10.0,
    sleep: Sleep = time.sleep,
) -> VehicleLink:
    """Open a link and wait until the vehicle was heard.

    Args:
        kind: "mavsdk" or "pymavlink".
        url: Where the vehicle is, see `guidance.links.endpoint`.
        system_id: The vehicle's MAVLink system id; nobody else is heard.
        clock: Monotonic seconds; all arrival times and deadlines are its.
        component_id: The autopilot's component id.
        own_system_id: Ours; a companion computer shares its vehicle's (the default).
        own_component_id: Ours; 195 is what MAVSDK calls a companion computer.
        signing_key: Sign what is sent and refuse what is not signed (pymavlink only: MAVSDK cannot).
        timeout_s: How long to wait for the wire, and then for the first HEARTBEAT.
        sleep: How to wait between looks.

    Raises:
        ConfigError: If an argument is wrong.
        LinkError: If the wire cannot be opened, or no HEARTBEAT came in time.
    """
    for name, value in (
        ("system_id", system_id),
        ("component_id", component_id),
        ("own_component_id", own_component_id),
    ):
        if not 1 <= value <= 255:
            raise ConfigError(f"{name} = {value}: 1 to 255 are allowed")
    _check_kind(kind, signing_key)
    wire = open_wire(url, clock=clock, systems=(system_id,), timeout_s=timeout_s)
    return link_over(
        wire,
        kind,
        clock=clock,
        who=f"{url}: system {system_id}",
        system_id=system_id,
        component_id=component_id,
        own_system_id=own_system_id,
        own_component_id=own_component_id,
        signing_key=signing_key,
        timeout_s=timeout_s,
        sleep=sleep,
    )


def link_over(
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
    """The same over a wire that is open, which is closed with the link.

    Args:
        wire: Open; it is closed with the link.
        kind: `mavsdk` or `pymavlink`.
        system_id: The vehicle's.
        clock: Stamps what arrives and what is sent.
        who: Names the vehicle in errors.
        component_id: Its autopilot's.
        own_system_id: Ours; None takes the vehicle's, as its companion computer.
        own_component_id: Ours.
        signing_key: For MAVLink 2 signing; None signs nothing.
        timeout_s: How long the first HEARTBEAT is waited for.
        sleep: Waits between two looks, s.

    Raises:
        ConfigError: If an argument is wrong.
        LinkError: If no HEARTBEAT came in time; the wire is closed then.
    """
    _check_kind(kind, signing_key)
    ids = {"system_id": system_id, "component_id": component_id, "own_component_id": own_component_id}
    link: MavsdkLink | PymavlinkLink
    if kind == "mavsdk":
        link = MavsdkLink(wire, clock, own_system_id=own_system_id, **ids)
    else:
        # Signing alone needs the calendar: its timestamps must rise from flight to flight.
        calendar_s = time.time_ns() / 1e9
        link = PymavlinkLink(
            wire, clock, own_system_id=own_system_id, signing_key=signing_key, unix_s=calendar_s, **ids
        )
    try:
        wait_until_heard(link, clock=clock, timeout_s=timeout_s, sleep=sleep, who=who)
    except BaseException:
        link.close()
        raise
    return link


def _check_kind(kind: str, signing_key: SigningKey | None) -> None:
    if kind not in KINDS:
        raise ConfigError(f"link = {kind!r}: allowed are {', '.join(KINDS)}")
    if kind == "mavsdk" and signing_key is not None:
        raise ConfigError("link = 'mavsdk' with a signing key: MAVSDK does not sign; use link = 'pymavlink'")


def wait_until_heard(
    link: MavsdkLink | PymavlinkLink, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str
) -> None:
    """Poll until the first HEARTBEAT, sending our own meanwhile; what comes is kept for `receive`.

    Args:
        link: Of which the first HEARTBEAT is awaited.
        clock: By which time passes.
        timeout_s: How long at most.
        sleep: Waits between two looks, s.
        who: Names the vehicle in the error.

    Raises:
        LinkError: If none came in time.
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
    """An autopilot by its HEARTBEAT: MAV_AUTOPILOT, MAV_TYPE, and whether it is armed."""

    system_id: int
    component_id: int
    autopilot: int
    vehicle_type: int
    armed: bool


def find_autopilot(wire: Wire, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str) -> Found:
    """Wait for the first HEARTBEAT of an autopilot. The wire stays open; what else arrived meanwhile is gone.

    Our own HEARTBEAT (a companion computer's) goes out once a second, since a vehicle that is called by UDP answers
    only then.

    Args:
        wire: Open.
        clock: By which time passes.
        timeout_s: How long at most.
        sleep: Waits between two looks, s.
        who: Names the vehicle in the error.

    Raises:
        LinkError: If none came within `timeout_s`.
    """
    framer, station = Framer(CRC_EXTRA), Station(*_OWN)
    deadline_s, beat_s, others = clock() + timeout_s, clock(), 0
    while True:
        if clock() >= beat_s:
            beat_s += _HEARTBEAT_EVERY_S
            wire.send(station.pack("HEARTBEAT", OWN_HEARTBEAT))
        for _, data in wire.receive():
            for frame in framer.feed(data, stream=wire.stream):
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


def _found(frame: Frame) -> Found | None:
    if NAMES[frame.message_id] != "HEARTBEAT":
        return None
    beat = fields_of(frame)
    if beat["autopilot"] == MAV_AUTOPILOT_INVALID or beat["type"] == MAV_TYPE_GCS:
        return None
    armed = bool(beat["base_mode"] & MAV_MODE_FLAG_SAFETY_ARMED)
    return Found(frame.system_id, frame.component_id, beat["autopilot"], beat["type"], armed)
