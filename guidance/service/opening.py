"""From a configuration to an open link and target source. Importing this imports every wire library."""

import contextlib
import stat
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame
from guidance.links.endpoint import parse
from guidance.links.mavsdk_link import MavsdkLink
from guidance.links.opening import open_wire, wait_until_heard
from guidance.links.port import TargetSource, VehicleLink, Wire
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.shared_wire import share
from guidance.links.signing import SigningKey
from guidance.links.tap import Passed, TappedWire
from guidance.links.targets.opening import TargetIdentity, open_target
from guidance.links.zenoh_session import open_session
from guidance.service.asked_target import AskedTarget
from guidance.service.bus import OwnerToken
from guidance.service.clock import Clock
from guidance.service.model import ON_ZENOH, Config, Target

_WIRE_LIMIT_S = 5.0
OWN_ID = 255
"""Who asks a target: a ground station's id, since the vehicle's own would make us a part of the vehicle."""

_MESSAGE_IDS = {"follow_target": 144, "global_position": 33, "odometry": 331, "open_drone_id": 12901, "adsb": 246}


@dataclass(slots=True)
class Opened:
    """What was opened; `taps` pass on the raw frames of the vehicle's wire."""

    link: VehicleLink
    target: TargetSource
    taps: list[TappedWire] = field(default_factory=list)
    closing: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def drain(self) -> Sequence[Passed]:
        """All raw frames since the last call."""
        return [passed for tap in self.taps for passed in tap.drain()]

    def close(self) -> None:
        """Close everything; may be called twice."""
        self.closing.close()


def open_all(
    config: Config, clock: Clock, *, tapped: bool, wire: Wire | None = None, target_wire: Wire | None = None
) -> Opened:
    """Claim the vehicle, open its link and the target's source, and wait until the vehicle was heard.

    Args:
        config: Whom to talk to.
        clock: Arrival times are its.
        tapped: Whether raw frames are passed on.
        wire: The vehicle's, where it is open already; closed with what is opened.
        target_wire: The target's, likewise.

    Raises:
        ConfigError: If a URL or the signing key is wrong.
        LinkError: If something cannot be opened, the vehicle is not heard, or another daemon owns it.
    """
    with contextlib.ExitStack() as closing:
        _claim(config, closing)
        taps: list[TappedWire] = []
        if wire is None:
            wire = _open_wire(config, clock)
        closing.callback(wire.close)
        link, spare = _open_link(config, clock, wire, taps if tapped else None)
        closing.callback(link.close)
        target = _open_source(config, clock, spare if target_wire is None else target_wire)
        closing.callback(target.close)
        return Opened(link, target, taps, closing.pop_all())


def _claim(config: Config, closing: contextlib.ExitStack) -> None:
    """Claim the vehicle on its own bus, where it has one: there every daemon that could fly it can be seen."""
    endpoint = parse(config.vehicle.url)
    if endpoint.scheme != "zenoh":
        return
    session = open_session(f"tcp/{endpoint.host}:{endpoint.port}", timeout_s=_WIRE_LIMIT_S)
    closing.callback(session.close)
    token = OwnerToken(session, f"{endpoint.namespace}/guidance" if endpoint.namespace else "guidance")
    closing.callback(token.close)


def _open_wire(config: Config, clock: Clock) -> Wire:
    vehicle, target = config.vehicle, config.target
    systems = {vehicle.system_id}
    if target.url is None and target.system_id is not None:
        systems.add(target.system_id)
    return open_wire(vehicle.url, clock=clock.now_s, systems=systems, timeout_s=_WIRE_LIMIT_S)


def _open_link(
    config: Config, clock: Clock, wire: Wire, taps: list[TappedWire] | None
) -> tuple[VehicleLink, Wire | None]:
    """Open the link; the second is a share of its wire for the target, where it is wanted and can be had."""
    vehicle = config.vehicle
    now_s = clock.now_s
    key = None if vehicle.signing_key_file is None else signing_key(vehicle.signing_key_file)
    if taps is not None:
        wire = TappedWire(wire, now_s, config.name)
        taps.append(wire)
    ours, spare = wire, None
    if config.target.url is None:
        ours, spare = share(wire, 2)
    who = f"{vehicle.url}: system {vehicle.system_id}"
    if vehicle.link == "mavsdk":
        mavsdk = MavsdkLink(
            ours,
            now_s,
            system_id=vehicle.system_id,
            component_id=vehicle.component_id,
            sleep=time.sleep,
            who=who,
            timeout_s=vehicle.connect_timeout_s,
        )
        return mavsdk, spare
    pymavlink = PymavlinkLink(
        ours,
        now_s,
        system_id=vehicle.system_id,
        component_id=vehicle.component_id,
        signing_key=key,
        unix_s=time.time_ns() / 1e9,  # signing alone needs the calendar: its timestamps must rise from flight to flight
    )
    wait_until_heard(pymavlink, clock=now_s, timeout_s=vehicle.connect_timeout_s, sleep=time.sleep, who=who)
    return pymavlink, spare


def _open_source(config: Config, clock: Clock, spare: Wire | None) -> TargetSource:
    target = config.target
    url = target.url if target.url is not None else config.vehicle.url
    asked = None
    if target.request_rate_hz is not None and target.system_id is not None:
        wire = spare
        if wire is None:
            wire = open_wire(url, clock=clock.now_s, systems=(target.system_id,), timeout_s=_WIRE_LIMIT_S)
        spare, asked = share(wire, 2)
    source = open_target(
        target.kind,
        url,
        clock=clock.now_s,
        frame=_frame(target),
        identity=TargetIdentity(
            target.system_id,
            target.component_id,
            target.icao_address,
            None if target.id_or_mac is None else bytes.fromhex(target.id_or_mac),
        ),
        wire=None if target.kind in ON_ZENOH else spare,
        timeout_s=_WIRE_LIMIT_S,
    )
    if asked is None or target.system_id is None or target.request_rate_hz is None:
        return source
    link = PymavlinkLink(
        asked, clock.now_s, system_id=target.system_id, component_id=target.component_id or 1, own_system_id=OWN_ID
    )
    return AskedTarget(source, link, clock.now_s, message_id=_MESSAGE_IDS[target.kind], rate_hz=target.request_rate_hz)


def _frame(target: Target) -> LocalFrame:
    """Return the declared frame; where none is needed, one that knows no datum besides sea level."""
    if target.frame is None:
        return LocalFrame(0.0, 0.0, Amsl(0.0))
    given = target.frame
    home = None if given.home_altitude_amsl_m is None else Amsl(given.home_altitude_amsl_m)
    return LocalFrame(
        given.latitude_deg, given.longitude_deg, Amsl(given.altitude_amsl_m), home, undulation_m=given.undulation_m
    )


def signing_key(path: Path) -> SigningKey:
    """Read a signing key.

    Raises:
        ConfigError: If it cannot be read, others may read it too, or it is not 64 hexadecimal digits.
    """
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"vehicle.signing_key_file = {str(path)!r}: cannot be read ({error})") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"vehicle.signing_key_file = {str(path)!r}: others may read it; chmod 600 it")
    return SigningKey.from_hex(text)
