"""The links of a vehicle file: the vehicle, the evaders' sources, orders, and the log."""

import logging
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, closing
from pathlib import Path

from guidance.clock import Clock
from guidance.files import text_of
from guidance.links import EvaderSource, SigningKey, Wire, parse
from guidance.links.evaders.kinds import EVADER_KINDS, SourceOrder
from guidance.links.evaders.section import EvaderSection
from guidance.links.kinds import LinkOrder
from guidance.links.mavlink.ground_link import GroundLink
from guidance.links.mavlink.signed_streams import state_folder
from guidance.links.opening import open_wire
from guidance.links.port import is_px4, scheme_of
from guidance.links.px4.link import px4_session
from guidance.links.section import Vehicle
from guidance.links.wires.base import TappedWire, share
from guidance.links.world import World
from guidance.links.zenoh.access import credentials_of
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.links.zenoh.session import Session, close_all
from guidance.links.zenoh.wire import session_to
from guidance.session.fly.daemon import Equipment
from guidance.session.observe.log import Log
from guidance.session.observe.signs_of_life import Notifier
from guidance.session.orders.control_bus import control_bus, owner_token
from guidance.session.orders.mailbox import Mailbox, startup_answers
from guidance.session.vehicle_file import Config

_REST_S = 0.1
"""Messages beside a link may be stamped so late: parameters, texts and home are no telemetry."""


def open_control(config: Config, mailbox: Mailbox) -> AbstractContextManager[Session]:
    """Take orders at a configuration's endpoint, with its certificates if a router judges who may order.

    Raises:
        ConfigError: If a certificate or its key is wrong.
        OutputError: If the token cannot be written.
        LinkError: If no session can be opened, or another daemon owns the vehicle.
    """
    credentials = credentials_of(config.zenoh) if config.control.by_tls else NO_CREDENTIALS
    team = config.team
    if team is None:
        return control_bus(config.name, mailbox, config.control, credentials, "", ())
    return control_bus(config.name, mailbox, config.control, credentials, team.name, team.mates)


def open_all(
    config: Config,
    clock: Clock,
    world: World,
    *,
    tapped: bool,
    wires: Mapping[str, Wire] | None = None,
) -> None:
    """Claim the vehicle, open its link and the evaders' sources in a world, and wait until the vehicle was heard.

    Args:
        config: Of vehicle and evader.
        clock: Arrival times are its.
        world: Closes everything opened here.
        tapped: Whether the record gets the raw frames.
        wires: Wires open already, by the names of vehicle and evaders; the world closes them.

    Raises:
        ConfigError: If a URL or the signing key is wrong.
        LinkError: If something cannot be opened, the vehicle is not heard, or another daemon owns it.
    """
    vehicle = config.vehicle
    evader = config.evader
    closed = world.closing
    opened = {} if wires is None else dict(wires)
    credentials = credentials_of(config.zenoh)
    keys = _Keys(closed)
    key = keys.open(vehicle.signing_key_file, "vehicle")
    _claim_on_its_bus(vehicle, credentials, closed)
    wire = opened.get(config.name)
    if wire is None and vehicle.mavlink_url is not None:
        # The evader's reports arrive on it too, unless they have a URL of their own.
        systems = (vehicle.system_id, evader.system_id if evader.url is None else None)
        is_beside = vehicle.mavlink_url != vehicle.url and evader.url is not None
        wire = open_wire(
            vehicle.mavlink_url,
            clock=clock.now_s,
            systems=systems,
            signing_key=key,
            credentials=credentials,
            rest_s=_REST_S if is_beside else 0.0,
        )
    if wire is not None:
        closed.callback(wire.close)
        if tapped:
            wire = TappedWire(wire, clock.now_s, config.name)
            world.taps.append(wire)
        if evader.url is None:
            wire, opened[next(iter(config.evaders))] = share(wire, 2)
        if config.on_ground_stations:
            wire, ground_wire = share(wire, 2)
            ground_link = GroundLink(
                ground_wire,
                clock.now_s,
                system_id=config.vehicle.system_id,
                stations=config.ordering_stations,
                signing_key=key,
            )
            closed.callback(ground_link.close)
            world.ground_links[config.name] = ground_link
    link = vehicle.kind.open(
        LinkOrder(
            section=vehicle,
            clock=clock.now_s,
            autopilot=vehicle.profile,
            wire=wire,
            signing_key=key,
            credentials=credentials,
        )
    )
    closed.callback(link.close)
    world.links[config.name] = link
    sources = dict[str, EvaderSource]()
    world.evaders[config.name] = sources
    for name, section in config.evaders.items():
        sources[name] = _open_source(vehicle, section, clock, credentials, keys, opened.get(name))
        closed.callback(sources[name].close)


def _claim_on_its_bus(vehicle: Vehicle, credentials: Credentials, closed: ExitStack) -> None:
    """Claim a vehicle behind Zenoh on its own bus: all possible owners are there."""
    timeout_s = min(vehicle.connect_timeout_s, 5.0)
    if is_px4(vehicle.url):
        endpoint = parse(vehicle.url)
        session = px4_session(endpoint, credentials, timeout_s)
        owned = f"{endpoint.namespace}/guidance"
    elif scheme_of(vehicle.url) == "zenoh":
        endpoint = parse(vehicle.url)
        session = session_to(endpoint, credentials, timeout_s)
        owned = f"{endpoint.namespace}/guidance" if endpoint.namespace else "guidance"
    else:
        return
    closed.callback(close_all, session.close)
    closed.callback(close_all, owner_token(session, owned).undeclare)


def _open_source(
    vehicle: Vehicle,
    evader: EvaderSection,
    clock: Clock,
    credentials: Credentials,
    keys: "_Keys",
    wire: Wire | None,
) -> EvaderSource:
    """Open an evader's source, on this wire if there is one, and have it ask for reports if they must be requested."""
    url = vehicle.url if evader.url is None else evader.url
    kind = EVADER_KINDS.named(evader.kind)
    key = None
    if kind.transport == "mavlink":
        if evader.url is None:
            key = keys.open(vehicle.signing_key_file, "vehicle")
        else:
            key = keys.open(evader.signing_key_file, "evader")
        if wire is None:
            wire = open_wire(
                url,
                clock=clock.now_s,
                systems=(evader.system_id,),
                signing_key=key,
                credentials=credentials,
            )
    return kind.open(
        SourceOrder(
            kind=evader.kind,
            url=url,
            clock=clock.now_s,
            frame=evader.local_frame,
            wire=wire,
            system_id=evader.system_id,
            component_id=evader.component_id,
            request_rate_hz=evader.request_rate_hz,
            icao_address=evader.icao_address,
            id_or_mac=evader.id_or_mac,
            altitude_datum=evader.datum,
            frame_id=evader.frame_id,
            section=evader,
            signing_key=key,
            credentials=credentials,
        )
    )


class _Keys:
    """The signing keys of one world, each with one list of streams, which is closed with the world."""

    def __init__(self, closed: ExitStack) -> None:
        self._closed = closed
        self._keys: dict[bytes, SigningKey] = {}

    def open(self, path: Path | None, section: str) -> SigningKey | None:
        """Return the key of a file; None without one.

        Raises:
            ConfigError: As `signing_key`.
        """
        key = signing_key(path, section)
        if key is None:
            return None
        if key.secret not in self._keys:
            self._keys[key.secret] = key
            if key.streams is not None:
                self._closed.callback(key.streams.close)
        return self._keys[key.secret]


def signing_key(path: Path | None, section: str = "vehicle") -> SigningKey | None:
    """Read a signing key, None if there is none; `section` of the file names it.

    Raises:
        ConfigError: If it cannot be read, others may read it too, or it is not 64 hexadecimal digits.
    """
    if path is None:
        return None
    digits = text_of(path, f"{section}.signing_key_file = {str(path)!r}", secret=True)
    return SigningKey.from_hex(digits, streams=state_folder())


def open_equipment(mailbox: Mailbox, config: Config, stack: ExitStack) -> Equipment:
    """Open the log according to a vehicle file, and signs of life to systemd."""
    log = stack.enter_context(closing(Log(config.log.format, config.log.level)))
    return Equipment(mailbox=mailbox, sinks=[log, Notifier(os.environ, os.getpid())])


def open_vehicle(
    config: Config, clock: Clock, stack: ExitStack, *, tapped: bool
) -> tuple[World, Session, Equipment]:
    """Open all that a vehicle file names, and wait until the vehicle was heard; orders are answered meanwhile.

    Args:
        config: The vehicle file.
        clock: The process's.
        stack: Closes everything opened here.
        tapped: Whether the record gets the raw frames.

    Returns:
        Its world, the Zenoh session of its orders, and a daemon's equipment with mailbox, log and notifier.

    Raises:
        GuidanceError: For everything that the user can fix.
    """
    mailbox = Mailbox()
    vehicle = config.vehicle
    limit_s = config.vehicle.connect_timeout_s
    mailbox.meanwhile = startup_answers(config.name, vehicle.awaited, limit_s, clock)
    equipment = open_equipment(mailbox, config, stack)
    session = stack.enter_context(open_control(config, mailbox))
    fields = {"url": vehicle.url, "system": vehicle.system_id, "component": vehicle.component_id}
    waiting = f"waiting for {vehicle.kind.first}"
    equipment.say(logging.INFO, waiting, name=config.name, **fields, at_most_s=limit_s)
    world = stack.enter_context(closing(World()))
    open_all(config, clock, world, tapped=tapped)
    return world, session, equipment
