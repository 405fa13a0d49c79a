"""From a configuration's words to a source of evader reports. Importing this imports every wire library."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, NamedTuple

from guidance.errors import ConfigError
from guidance.frames import LocalFrame
from guidance.links.arrivals import Clock
from guidance.links.endpoint import parse
from guidance.links.evaders.broadcasts import AdsbVehicle, OpenDroneIdLocation
from guidance.links.evaders.mavlink import Carrier, FollowTarget, GlobalPositionInt, MavlinkEvader, OdometryCarrier
from guidance.links.evaders.ros import ODOMETRY_TYPE, POSE_TYPE, RosPose, rmw_key
from guidance.links.evaders.zenoh import Reader, ZenohEvader, read_json
from guidance.links.opening import open_wire
from guidance.links.port import EvaderSource, Wire
from guidance.links.signing import SigningKey
from guidance.links.wires.zenoh_access import NO_CREDENTIALS, Credentials


class EvaderIdentity(NamedTuple):
    """Who the evader is, as far as its carrier asks: a MAVLink system, an aircraft's address, a relayed identity."""

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
"""Carriers on a MAVLink wire, by the name a configuration gives them."""

ZENOH: Final[Mapping[str, Callable[[LocalFrame, str], tuple[str, Reader]]]] = {
    "json": lambda frame, key: (key, partial(read_json, frame=frame, source=key)),
    "ros_pose": lambda frame, topic: (rmw_key(topic, POSE_TYPE), RosPose(frame).pose_stamped),
    "ros_odometry": lambda frame, topic: (rmw_key(topic, ODOMETRY_TYPE), RosPose(frame).odometry),
}
"""Payloads on a Zenoh key, likewise; the URL's path is the key, or the ROS topic."""


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
        clock: Monotonic seconds; arrival times are its.
        frame: The evader's declared local frame, for the datum and for positions in metres.
        identity: Who the evader is.
        wire: Used in place of `url` for `MAVLINK` kinds, where the vehicle's link shares its wire.
        signing_key: With which `MAVLINK` reports have to be signed; None asks for no signature.
        credentials: For a Zenoh router.
        timeout_s: Bound of connecting, in real time.

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
    if identity.system_id is None:
        raise ConfigError(f"evader.system_id is missing: {kind} hears one pinned MAVLink system only")
    carrier = MAVLINK[kind](frame, identity)
    used = wire
    if used is None:
        systems = (identity.system_id,)
        used = open_wire(url, clock=clock, systems=systems, credentials=credentials, timeout_s=timeout_s)
    return MavlinkEvader(
        used,
        carrier,
        system_id=identity.system_id,
        component_id=identity.component_id,
        clock=clock,
        signing_key=signing_key,
        unix_s=time.time_ns() / 1e9,
    )
