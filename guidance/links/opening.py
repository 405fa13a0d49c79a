"""Open wires, vehicle links and evader sources from URLs and settings. Importing this loads every wire library."""

import contextlib
import time
from collections.abc import Callable, Collection, Mapping
from typing import Final, NamedTuple, TypeVar

from pymavlink.dialects.v20 import common as mavlink

from guidance.errors import ConfigError, LinkError
from guidance.frames import LocalFrame
from guidance.links.carriers import CARRIERS, EvaderIdentity
from guidance.links.frames import Frame, FrameReader, SignatureCheck, SigningKey, Station
from guidance.links.mavlink_evader import MavlinkEvader
from guidance.links.mavsdk_link import MavsdkLink
from guidance.links.port import Clock, Endpoint, EvaderSource, VehicleLink, Wire, parse
from guidance.links.pymavlink_link import PymavlinkLink, own_heartbeat
from guidance.links.streams import SerialWire, TcpWire
from guidance.links.udp import UdpWire
from guidance.links.zenoh_access import NO_CREDENTIALS, Credentials
from guidance.links.zenoh_evader import KEYS, ZenohEvader
from guidance.links.zenoh_wire import Session, ZenohWire, open_session

KINDS: Final = ("mavsdk", "pymavlink")
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
        url: See `guidance.links.port`.
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
        return ZenohWire(clock, _session(endpoint, credentials, timeout_s), endpoint.namespace)
    if endpoint.scheme == "serial":
        return SerialWire(clock, device=endpoint.host, baud=endpoint.port)
    listen = endpoint.scheme.endswith("in")
    if endpoint.scheme.startswith("udp"):
        checks = {system_id: SignatureCheck(key) for system_id, key in (keys or {}).items()}
        return UdpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, systems=systems, checks=checks)
    return TcpWire(clock, host=endpoint.host, port=endpoint.port, listen=listen, timeout_s=timeout_s)


def _session(endpoint: Endpoint, credentials: Credentials, timeout_s: float) -> Session:
    router = credentials.endpoint(endpoint.host, endpoint.port)
    return open_session(router, timeout_s=timeout_s, credentials=credentials)


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
        for name, value in ids.items():
            if not 1 <= value <= 255:
                raise ConfigError(f"{name} = {value}: allowed are 1 to 255")
        if kind not in KINDS:
            raise ConfigError(f"link = {kind!r}: allowed are {', '.join(KINDS)}")
        if kind == "mavsdk" and signing_key is not None:
            raise ConfigError("link = 'mavsdk' with a signing key: MAVSDK does not sign; use link = 'pymavlink'")
        opened = MavsdkLink if kind == "mavsdk" else PymavlinkLink
        link = opened(
            wire,
            clock,
            system_id=system_id,
            component_id=component_id,
            own_system_id=own_system_id,
            own_component_id=own_component_id,
            signing_key=signing_key,
        )
        closing.callback(link.close)
        wait_until_heard(link, clock=clock, timeout_s=timeout_s, sleep=sleep, who=who)
        closing.pop_all()
    return link


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

    def look() -> bool:
        link.poll()
        return link.heard

    if not _waited(look, link.send_heartbeat, clock, timeout_s, sleep):
        others = ", ".join(map(str, sorted(link.others))) or "none"
        raise LinkError(
            f"{who}: no HEARTBEAT within {timeout_s:g} s; other systems heard: {others}. "
            "Is it running, does it send here, and is its system id right?"
        )


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
    reader, station, heard = FrameReader({"HEARTBEAT"}), Station(*_OWN), 0

    def look() -> Found | None:
        nonlocal heard
        frames = [frame for _, data in wire.receive() for frame in reader.read(data, stream=wire.stream)]
        heard += len(frames)
        return next(filter(None, map(_found, frames)), None)

    found = _waited(look, lambda: wire.send(station.pack(own_heartbeat())), clock, timeout_s, sleep)
    if found is None:
        raise LinkError(
            f"{who}: no autopilot's HEARTBEAT within {timeout_s:g} s ({heard + reader.unused} other frames heard); is "
            "it running, and does it send here?"
        )
    return found


T = TypeVar("T")


def _waited(look: Callable[[], T], beat: Callable[[], None], clock: Clock, timeout_s: float, sleep: Sleep) -> T:
    """Look until there is an answer or the time is up, with a HEARTBEAT every second; return the last answer."""
    beat_s = clock()
    deadline_s = beat_s + timeout_s
    while True:
        if clock() >= beat_s:
            beat()
            beat_s += _HEARTBEAT_EVERY_S
        answer = look()
        if answer or clock() >= deadline_s:
            return answer
        sleep(_LOOK_EVERY_S)


def _found(frame: Frame) -> Found | None:
    beat = frame.fields
    if frame.name != "HEARTBEAT" or beat.type == mavlink.MAV_TYPE_GCS:
        return None
    if beat.autopilot == mavlink.MAV_AUTOPILOT_INVALID:  # a ground station, companion computer or camera
        return None
    armed = bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return Found(frame.system_id, frame.component_id, beat.autopilot, beat.type, armed)


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
        kind: A name in `CARRIERS` (MAVLink) or in `KEYS` (Zenoh).
        url: As for links; for Zenoh zenoh://host:port/key.
        clock: Stamps what arrives.
        frame: The evader's declared local frame, for the datum and for positions in metres.
        identity: The evader.
        wire: For MAVLink: an open wire to use instead of `url`.
        signing_key: MAVLink reports must be signed with it; None asks for no signature.
        credentials: For a Zenoh router.
        timeout_s: Limit for connecting, in real time.

    Raises:
        ConfigError: If an argument is wrong or missing.
        LinkError: If the wire cannot be opened.
    """
    if kind in KEYS:
        endpoint = parse(url)
        key, read = KEYS[kind](frame, endpoint.namespace)
        return ZenohEvader(clock, _session(endpoint, credentials, timeout_s), key, read)
    if kind not in CARRIERS:
        raise ConfigError(f"evader.kind = {kind!r}: allowed are {', '.join((*CARRIERS, *KEYS))}")
    system_id = identity.system_id
    if system_id is None:
        raise ConfigError(f"evader.system_id is missing: {kind} reads the messages of one MAVLink system")
    carrier = CARRIERS[kind](frame, identity)
    if wire is None:
        keys = {} if signing_key is None else {system_id: signing_key}
        wire = open_wire(
            url, clock=clock, systems=(system_id,), keys=keys, credentials=credentials, timeout_s=timeout_s
        )
    component_id = identity.component_id
    return MavlinkEvader(
        wire, carrier, system_id=system_id, component_id=component_id, clock=clock, signing_key=signing_key
    )
