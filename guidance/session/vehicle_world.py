"""From a configuration to an open link and evader source. Importing this imports every wire library."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from guidance.autopilots.description import MAV_CMD_SET_MESSAGE_INTERVAL
from guidance.clock import Clock
from guidance.files import text_of
from guidance.frames import Amsl, LocalFrame
from guidance.links.carriers import carrier_of
from guidance.links.frames import SigningKey
from guidance.links.mavlink_evader import MavlinkEvader
from guidance.links.opening import open_link, open_source, open_wire
from guidance.links.port import EvaderSource, VehicleLink, Wire, parse
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.wires import TappedWire, share
from guidance.links.world import World
from guidance.links.zenoh_access import NO_CREDENTIALS, Credentials, credentials_of
from guidance.links.zenoh_wire import Session, session_to
from guidance.messages import Command, EvaderReport
from guidance.session.control_bus import OwnerToken, control_bus
from guidance.session.orders import Mailbox
from guidance.session.vehicle_file import ON_ZENOH, Config, EvaderFrame, EvaderSection

_CLAIM_LIMIT_S = 5.0
OWN_ID = 255
"""System id towards the evader: a ground station's. The vehicle's own id would mean a part of the vehicle."""

_MESSAGE_IDS = {"follow_target": 144, "global_position": 33, "odometry": 331, "open_drone_id": 12901, "adsb": 246}


def open_control(config: Config, mailbox: Mailbox) -> contextlib.AbstractContextManager[Session]:
    """Take orders where a configuration says, by the certificates of its router where that judges who may order.

    Raises:
        ConfigError: If a certificate or its key is wrong.
        OutputError: If the token cannot be written.
        LinkError: If no session can be opened, or another daemon owns the vehicle.
    """
    credentials = credentials_of(config.zenoh) if config.control.by_tls else NO_CREDENTIALS
    team, mates = ("", ()) if config.team is None else (config.team.name, config.team.mates)
    return control_bus(config.name, mailbox, config.control, credentials, team, mates)


def open_all(
    config: Config, clock: Clock, *, tapped: bool, wire: Wire | None = None, evaders: Mapping[str, Wire] | None = None
) -> World:
    """Claim the vehicle, open its link and the evaders' sources, and wait until the vehicle was heard.

    Args:
        config: Of vehicle and evader.
        clock: Arrival times are its.
        tapped: Whether raw frames are passed on.
        wire: The vehicle's, if it is open already; it is closed with the world.
        evaders: The evaders' wires by name, likewise.

    Raises:
        ConfigError: If a URL or the signing key is wrong.
        LinkError: If something cannot be opened, the vehicle is not heard, or another daemon owns it.
    """
    vehicle, evader, taps, wires = config.vehicle, config.evader, list[TappedWire](), dict(evaders or {})
    credentials, key = credentials_of(config.zenoh), signing_key(vehicle.signing_key_file)
    with contextlib.ExitStack() as closing:
        endpoint = parse(vehicle.url)
        if endpoint.scheme == "zenoh":  # claim the vehicle on its own bus: all possible owners are there
            session = session_to(endpoint, credentials, _CLAIM_LIMIT_S)
            closing.callback(session.close)
            token = OwnerToken(session, f"{endpoint.namespace}/guidance" if endpoint.namespace else "guidance")
            closing.callback(token.close)
        if wire is None:  # the evader's reports arrive on it too, unless they have a URL of their own
            both = (vehicle.system_id, evader.system_id if evader.url is None else None)
            wire = open_wire(vehicle.url, clock=clock.now_s, systems=both, signing_key=key, credentials=credentials)
        closing.callback(wire.close)
        if tapped:
            wire = TappedWire(wire, clock.now_s, config.name)
            taps.append(wire)
        if evader.url is None:
            wire, wires[next(iter(config.evaders))] = share(wire, 2)
        who, limit_s = f"{vehicle.url}: system {vehicle.system_id}", vehicle.connect_timeout_s
        ids: dict[str, Any] = {"system_id": vehicle.system_id, "component_id": vehicle.component_id}
        link = open_link(wire, vehicle.link, clock=clock.now_s, who=who, **ids, signing_key=key, timeout_s=limit_s)
        closing.callback(link.close)
        sources = {}
        for name, section in config.evaders.items():
            sources[name] = _open_source(config, section, clock, credentials, wires.get(name))
            closing.callback(sources[name].close)
        return World({config.name: link}, {config.name: sources}, taps, closing.pop_all())


def _open_source(
    config: Config, evader: EvaderSection, clock: Clock, credentials: Credentials, wire: Wire | None
) -> EvaderSource:
    """Open an evader's source, on this wire if there is one, and have it ask for reports if they must be requested."""
    url, now_s, frame = evader.url or config.vehicle.url, clock.now_s, _frame(evader.frame)
    if evader.kind in ON_ZENOH:
        return open_source(evader.kind, url, clock=now_s, frame=frame, credentials=credentials)
    carrier = carrier_of(evader.kind, frame, icao_address=evader.icao_address, id_or_mac=evader.id_or_mac)
    key, rate_hz, system_id = _evader_key(config, evader), evader.request_rate_hz, evader.system_id or 0
    if wire is None:
        wire = open_wire(url, clock=now_s, systems=(system_id,), signing_key=key, credentials=credentials)
    wire, asked = share(wire, 2) if rate_hz is not None else (wire, wire)
    ids: dict[str, Any] = {"system_id": system_id, "component_id": evader.component_id}
    source = MavlinkEvader(wire, carrier, **ids, clock=now_s, signing_key=key)
    if rate_hz is None:
        return source
    ids["component_id"] = evader.component_id or 1
    link = PymavlinkLink(asked, now_s, **ids, own_system_id=OWN_ID, signing_key=key)
    return PolledEvader(source, link, now_s, message_id=_MESSAGE_IDS[evader.kind], rate_hz=rate_hz)


def _frame(given: EvaderFrame | None) -> LocalFrame:
    """Return the declared frame; by default one at sea level, for sources that need no frame."""
    if given is None:
        return LocalFrame(0.0, 0.0, Amsl(0.0))
    home, place = given.home_altitude_amsl_m, (given.latitude_deg, given.longitude_deg, Amsl(given.altitude_amsl_m))
    return LocalFrame(*place, None if home is None else Amsl(home), undulation_m=given.undulation_m)


def _evader_key(config: Config, evader: EvaderSection) -> SigningKey | None:
    """Return the key that signs an evader's reports; on the vehicle's link the vehicle's key."""
    vehicle = config.vehicle
    if evader.url is None and vehicle.signing_key_file is not None:
        return signing_key(vehicle.signing_key_file)
    return signing_key(evader.signing_key_file, "evader")


def signing_key(path: Path | None, section: str = "vehicle") -> SigningKey | None:
    """Read a signing key, None if there is none; `section` of the file names it.

    Raises:
        ConfigError: If it cannot be read, others may read it too, or it is not 64 hexadecimal digits.
    """
    if path is None:
        return None
    return SigningKey.from_hex(text_of(path, f"{section}.signing_key_file = {str(path)!r}", secret=True))


ASK_AGAIN_S: Final = 3.0
"""Repeat the request after this time without a report: the evader may have restarted."""

HEARTBEAT_S: Final = 1.0


class PolledEvader:
    """`EvaderSource` around another, which asks the evader for its reports by a link of its own to it."""

    def __init__(
        self, source: EvaderSource, link: VehicleLink, clock: Callable[[], float], *, message_id: int, rate_hz: float
    ) -> None:
        self._source, self._link, self._clock = source, link, clock
        parameters = (float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._request = Command(MAV_CMD_SET_MESSAGE_INTERVAL, parameters)
        self._asked_s = self._beat_s = float("-inf")

    def receive(self) -> Sequence[EvaderReport]:
        """As the source's; asks meanwhile."""
        reports = self._source.receive()
        self._link.receive()
        now_s = self._clock()
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            self._link.send_heartbeat()
        if reports:
            self._asked_s = now_s
        elif now_s - self._asked_s >= ASK_AGAIN_S:
            self._asked_s = now_s
            self._link.request(self._request)
        return reports

    def counters(self) -> Mapping[str, int]:
        """The source's counters, and the number of requests."""
        return {**self._source.counters(), "requests_sent": self._link.counters().get("requests_sent", 0)}

    def close(self) -> None:
        """Close both; may be called twice."""
        self._source.close()
        self._link.close()
