"""Open wires and vehicle links from URLs and settings. Importing this loads every wire library."""

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from guidance.errors import LinkError
from guidance.links.mavlink.frames import FrameReader, SignatureCheck, SigningKey, Station
from guidance.links.mavlink.mavsdk_link import MavsdkLink
from guidance.links.mavlink.pymavlink_link import PymavlinkLink, own_heartbeat
from guidance.links.port import Clock, VehicleLink, Wire, parse
from guidance.links.wires.streams import SerialWire, TcpWire
from guidance.links.wires.tcp_in import TcpInWire
from guidance.links.wires.udp import AddressPins, UdpWire
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.wire import ZenohWire, session_to

_LINKS: Final = {"mavsdk": MavsdkLink, "pymavlink": PymavlinkLink}
MAVLINK_LINKS: Final = tuple(_LINKS)
_LOOK_EVERY_S: Final = 0.02
_HEARTBEAT_EVERY_S: Final = 1.0
_OWN: Final = (255, 191)

Sleep = Callable[[float], None]


def open_wire(
    url: str,
    *,
    clock: Clock,
    systems: Collection[int | None] | None = None,
    signing_key: SigningKey | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    timeout_s: float = 5.0,
    rest_s: float = 0.0,
) -> Wire:
    """Open the wire behind a URL.

    Args:
        url: See `guidance.links.port`.
        clock: Stamps arrivals.
        systems: MAVLink system ids that may call a listening port; None accepts any.
        signing_key: Theirs: each is accepted from an address or a connection only after a validly signed frame.
        credentials: For a Zenoh router.
        timeout_s: Limit for connecting (TCP, Zenoh), in real time.
        rest_s: How late a stamp may be over UDP, to wake the processor less often.

    Raises:
        ConfigError: If the URL has none of the allowed forms.
        LinkError: If it cannot be opened.
    """
    endpoint = parse(url)
    if endpoint.scheme == "zenoh":
        return ZenohWire(clock, session_to(endpoint, credentials, timeout_s), endpoint.namespace)
    if endpoint.scheme == "serial":
        return SerialWire(clock, device=endpoint.host, baud=endpoint.port)
    checks = {
        system_id: SignatureCheck(signing_key)
        for system_id in systems or ()
        if signing_key is not None
    }
    host = endpoint.host
    port = endpoint.port
    match endpoint.scheme:
        case "udpin":
            return UdpWire(clock, host, port, pins=AddressPins(systems, checks), rest_s=rest_s)
        case "udpout":
            return UdpWire(clock, host, port, rest_s=rest_s)
        case "tcpin":
            return TcpInWire(clock, host=host, port=port, systems=systems, checks=checks)
    return TcpWire(clock, host=host, port=port, timeout_s=timeout_s)


def open_link(
    wire: Wire,
    kind: str,
    *,
    system_id: int,
    clock: Clock,
    who: str,
    component_id: int = 1,
    autopilot: int | None = None,
    signing_key: SigningKey | None = None,
    timeout_s: float = 10.0,
    sleep: Sleep = time.sleep,
) -> VehicleLink:
    """Open a link over an open wire and wait for the vehicle's first HEARTBEAT.

    Args:
        wire: Closed with the link, also if opening fails.
        kind: One of `MAVLINK_LINKS`.
        system_id: The vehicle's MAVLink system id; messages of others are dropped.
        clock: Time of arrivals, setpoints and repeated requests.
        who: Names the vehicle in errors.
        component_id: Its autopilot's.
        autopilot: Its MAV_AUTOPILOT; by default that of its first HEARTBEAT.
        signing_key: Sign our frames and refuse unsigned ones (pymavlink only; MAVSDK cannot sign).
        timeout_s: How long to wait for the first HEARTBEAT.
        sleep: Waits between two looks, s.

    Raises:
        LinkError: If no HEARTBEAT arrived in time.
    """
    with contextlib.ExitStack() as closing:
        closing.callback(wire.close)
        link = _LINKS[kind](
            wire,
            clock,
            system_id=system_id,
            component_id=component_id,
            autopilot=autopilot,
            signing_key=signing_key,
        )
        closing.callback(link.close)
        wait_until_heard(link, clock=clock, timeout_s=timeout_s, sleep=sleep, who=who)
        closing.pop_all()
    return link


def wait_until_heard(
    link: PymavlinkLink, *, clock: Clock, timeout_s: float, sleep: Sleep, who: str
) -> None:
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
    for _ in _looks(link.send_heartbeat, clock, timeout_s, sleep):
        link.poll()
        if link.heard:
            return
    others = ", ".join(map(str, sorted(link.others))) or "none"
    ask = "Is it running, does it send here, and is its system id right?"
    raise LinkError(
        f"{who}: no HEARTBEAT within {timeout_s:g} s; other systems heard: {others}. {ask}"
    )


class Found(NamedTuple):
    """An autopilot's ids and its HEARTBEAT: MAV_AUTOPILOT and MAV_TYPE."""

    system_id: int
    component_id: int
    autopilot: int
    vehicle_type: int


def find_autopilot(
    wire: Wire,
    *,
    clock: Clock,
    timeout_s: float,
    sleep: Sleep,
    who: str,
    fits: Callable[[Found], bool] = lambda _: True,
) -> Found:
    """Wait for the first HEARTBEAT of an autopilot that fits. The wire stays open; other frames that arrive are lost.

    Our own HEARTBEAT (a companion computer's) is sent once a second: over UDP some vehicles answer only then.

    Args:
        wire: Open.
        clock: Measures the time.
        timeout_s: How long to wait.
        sleep: Waits between two looks, s.
        who: Names the vehicle in the error.
        fits: Whether this is the wanted autopilot. Cameras, gimbals and radios on the same wire send HEARTBEATs too,
            so listening continues after one that does not fit.

    Raises:
        LinkError: If none arrived within `timeout_s`.
    """
    reader = FrameReader({"HEARTBEAT"})
    station = Station(wire, *_OWN)
    heard = 0
    for _ in _looks(lambda: station.send(own_heartbeat()), clock, timeout_s, sleep):
        for frame in [frame for _, data in wire.receive() for frame in reader.read(data)]:
            beat = frame.fields
            # INVALID: a ground station, companion computer or camera. No sender has the id 0, which means all.
            is_autopilot = (
                frame.system_id != 0
                and frame.component_id != 0
                and beat.type != mavlink.MAV_TYPE_GCS
                and beat.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            )
            sender = Found(frame.system_id, frame.component_id, beat.autopilot, beat.type)
            if is_autopilot and fits(sender):
                return sender
            heard += 1
    others = f"{heard + reader.unused} other frames heard"
    ask = "is it running, and does it send here?"
    raise LinkError(f"{who}: no autopilot's HEARTBEAT within {timeout_s:g} s ({others}); {ask}")


def _looks(
    beat: Callable[[], None], clock: Clock, timeout_s: float, sleep: Sleep
) -> Iterator[None]:
    """Yield again and again until the time is up, with a HEARTBEAT every second."""
    beat_s = clock()
    deadline_s = beat_s + timeout_s
    while True:
        if clock() >= beat_s:
            beat()
            beat_s += _HEARTBEAT_EVERY_S
        yield
        if clock() >= deadline_s:
            return
        sleep(_LOOK_EVERY_S)
