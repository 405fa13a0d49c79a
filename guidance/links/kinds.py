"""The kinds of links to a vehicle: what each needs of `[vehicle]`, which URLs it has, and how it opens.

A kind is one description. `LINKS.add` adds another from outside, so a vehicle with another protocol is one module and
its test. MAVSDK and Zenoh are imported only when a link that uses them is opened.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Final, NamedTuple

from pydantic import AfterValidator, Field

from guidance.autopilots import Autopilot, Mode
from guidance.config import Section
from guidance.errors import ConfigError
from guidance.links.mavlink.frames import SigningKey
from guidance.links.port import PX4_SCHEMES, Clock, VehicleLink, Wire, parse, taken_apart
from guidance.links.px4.messages import name_bytes
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.registry import Registry


class LinkOrder(NamedTuple):
    """Arguments for opening a link.

    Attributes:
        section: `[vehicle]`, an instance of the kind's own section if it has one.
        clock: Stamps arrivals.
        autopilot: The vehicle's, as this link flies it.
        wire: Open, with the vehicle's MAVLink, and closed with the link; None without MAVLink.
        signing_key: Of MAVLink; None without signing.
        credentials: For a Zenoh router.
    """

    section: Any
    clock: Clock
    autopilot: Autopilot
    wire: Wire | None = None
    signing_key: SigningKey | None = None
    credentials: Credentials = NO_CREDENTIALS


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkKind:
    """One kind of link to a vehicle.

    Attributes:
        name: The value of `vehicle.link`.
        first: The vehicle's first message, in words for people.
        by_mavlink: Whether `vehicle.url` carries MAVLink, which is then opened as `LinkOrder.wire`. If not, the kind
            opens its URL itself, and MAVLink beside it, if any, is at `vehicle.parameters`.
        signs: Whether it signs MAVLink.
        section: The kind's own keys of `[vehicle]`. One that declares `url` checks it: any scheme is allowed.
        flies: Returns an autopilot as this link flies it; None if it does not fly it.
        open: Opens the link, and waits until the vehicle was heard, `section.connect_timeout_s` at most. Raises
            ConfigError for wrong values, and LinkError if the vehicle cannot be reached.
    """

    name: str
    first: str
    by_mavlink: bool
    signs: bool = False
    section: type[Section] | None = None
    flies: Callable[[Autopilot, Any], Autopilot | None] = lambda autopilot, _section: autopilot
    open: Callable[[LinkOrder], VehicleLink]


def _px4_url(url: str) -> str:
    if taken_apart(url).scheme not in PX4_SCHEMES:
        raise ValueError('link = "zenoh" needs zenoh+tcp:// or zenoh+tls://')
    return url


class Px4Keys(Section):
    """Keys of `[vehicle]` with link = "zenoh"."""

    url: Annotated[str, AfterValidator(_px4_url)] = Field(
        description="the router of PX4, zenoh+tcp:// or zenoh+tls://"
    )
    mode_name: Annotated[str, AfterValidator(lambda name: name_bytes(name) and name)] = Field(
        "Pursuit", description='with link = "zenoh": name of the flight mode on ground stations'
    )


def _as_mode(autopilot: Autopilot, section: Any) -> Autopilot | None:  # noqa: ANN401 - see LinkOrder
    if autopilot.as_mode is None:
        return None
    return replace(autopilot.as_mode, mode_titles={Mode.GUIDED: section.mode_name})


def _open_px4(order: LinkOrder) -> VehicleLink:
    # Only this kind needs Zenoh
    from guidance.links.mavlink.pymavlink_link import PymavlinkLink  # noqa: PLC0415
    from guidance.links.px4.link import UNREAD_BESIDE, open_px4_link  # noqa: PLC0415

    vehicle = order.section
    beside = None
    if order.wire is not None:
        beside = PymavlinkLink(
            order.wire,
            order.clock,
            system_id=vehicle.system_id,
            component_id=vehicle.component_id,
            autopilot=order.autopilot.autopilot_id,
            signing_key=order.signing_key,
            unread=UNREAD_BESIDE,
        )
    return open_px4_link(
        parse(vehicle.url),
        mode_name=vehicle.mode_name,
        beside=beside,
        clock=order.clock,
        credentials=order.credentials,
        timeout_s=vehicle.connect_timeout_s,
        system_id=vehicle.system_id,
    )


def _open_mavlink(client: str, order: LinkOrder) -> VehicleLink:
    # MAVSDK takes a moment
    from guidance.links.opening import open_link  # noqa: PLC0415

    vehicle = order.section
    if order.wire is None:
        raise ConfigError(f'vehicle.url = {vehicle.url!r}: link = "{client}" needs MAVLink')
    return open_link(
        order.wire,
        client,
        clock=order.clock,
        who=f"{vehicle.url}: system {vehicle.system_id}",
        system_id=vehicle.system_id,
        component_id=vehicle.component_id,
        autopilot=order.autopilot.autopilot_id,
        signing_key=order.signing_key,
        timeout_s=vehicle.connect_timeout_s,
    )


MAVSDK: Final = LinkKind(
    name="mavsdk",
    first="a HEARTBEAT",
    by_mavlink=True,
    open=partial(_open_mavlink, "mavsdk"),
)
PYMAVLINK: Final = LinkKind(
    name="pymavlink",
    first="a HEARTBEAT",
    by_mavlink=True,
    signs=True,
    open=partial(_open_mavlink, "pymavlink"),
)
ZENOH: Final = LinkKind(
    name="zenoh",
    first="PX4's VehicleStatus, and the registration of its mode,",
    by_mavlink=False,
    signs=True,
    section=Px4Keys,
    flies=_as_mode,
    open=_open_px4,
)

LINKS: Final[Registry[LinkKind]] = Registry(
    "link",
    "vehicle.link",
    "pursuit_guidance.links",
    {kind.name: kind for kind in (MAVSDK, PYMAVLINK, ZENOH)},
)
"""The kinds of links, by name. Add one with `LINKS.add`."""


LinkName = Annotated[str, AfterValidator(LINKS.checked_name), LINKS.names_in_schema()]
"""Type of a key that names a kind of link."""
