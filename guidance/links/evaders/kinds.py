"""The kinds of sources of evader reports: what each needs of a vehicle file, its zero of altitude, and how it opens.

A kind is one description. `EVADER_KINDS.add` adds another from outside, so a new source is one module and its test.
Zenoh is imported only when a source that uses it is opened.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import AfterValidator

from guidance.config import Section
from guidance.errors import ConfigError
from guidance.frames import LocalFrame
from guidance.links.evaders.carriers import carrier_of
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.frames import SigningKey
from guidance.links.port import Clock, EvaderSource, Wire
from guidance.links.zenoh.credentials import NO_CREDENTIALS, Credentials
from guidance.messages import Datum
from guidance.registry import Registry

COMMON_KEYS: Final = frozenset({"kind", "url", "timeout_s", "second_source", "speed_m_s"})
"""Keys of `[evader]` that every kind takes; `speed_m_s` belongs to the evaders of a team."""

MAVLINK_KEYS: Final = frozenset({"component_id", "request_rate_hz", "signing_key_file"})
"""Keys that a kind over MAVLink takes in addition to its `system_id`."""

_ONE_SYSTEM: Final = {"system_id": "accepts one MAVLink system only"}
_A_KEY: Final = {"url": "needs zenoh://host:port/key"}
_IN_METRES: Final = dict.fromkeys(
    ("frame.latitude_deg", "frame.longitude_deg", "frame.altitude_amsl_m"),
    "reports metres about an origin of its own",
)


class SourceOrder(NamedTuple):
    """Arguments for opening a source: the keys of `[evader]`, and objects made from them.

    Attributes:
        kind: The name of the kind.
        url: Where its reports arrive; the vehicle's URL if they share its link.
        clock: Stamps arrivals.
        frame: The declared local frame of the evader, with undulation and home where they are given.
        wire: For a kind over MAVLink: open, and closed with the source. None for other kinds.
        system_id: The only accepted MAVLink system.
        component_id: Its component; None accepts any.
        request_rate_hz: Rate to request; None waits for reports.
        icao_address: The aircraft of ADSB_VEHICLE.
        id_or_mac: The drone of OPEN_DRONE_ID_LOCATION, hexadecimal.
        altitude_datum: The zero of its altitudes; None is the message's own.
        frame_id: The frame of ROS messages.
        section: `[evader]` itself, an instance of the kind's own section if it has one.
        signing_key: Of MAVLink; None without signing.
        credentials: For a Zenoh router.
    """

    kind: str
    url: str
    clock: Clock
    frame: LocalFrame
    wire: Wire | None = None
    system_id: int | None = None
    component_id: int | None = None
    request_rate_hz: float | None = None
    icao_address: int | None = None
    id_or_mac: str | None = None
    altitude_datum: Datum | None = None
    frame_id: str | None = None
    section: Any = None
    signing_key: SigningKey | None = None
    credentials: Credentials = NO_CREDENTIALS


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaderKind:
    """One kind of source of evader reports.

    Attributes:
        name: The value of `evader.kind`.
        message: The message that reports the evader, in words for people.
        transport: "mavlink" shares the vehicle's link without a `url`; "zenoh" has a key in its URL; "other" opens
            and checks its URL itself, which may have any scheme.
        needs: Keys of `[evader]` that must be set, and why; a dot leads into `[evader.frame]`.
        takes: Further keys that may be set. Any other key is an error, because it would be ignored.
        section: The kind's own keys of `[evader]`, which `SourceOrder.section` has.
        datum: The zero of its altitudes by the message's definition; None if every report names its own, or if it
            reports metres.
        open: Opens the source. Raises ConfigError for wrong values; an unreachable source is retried.
    """

    name: str
    message: str
    transport: Literal["mavlink", "zenoh", "other"]
    needs: Mapping[str, str]
    takes: frozenset[str] = frozenset()
    section: type[Section] | None = None
    datum: Datum | None = None
    open: Callable[[SourceOrder], EvaderSource]

    @property
    def keys(self) -> frozenset[str]:
        """All keys that a vehicle file may set."""
        own = () if self.section is None else self.section.model_fields
        return (COMMON_KEYS | self.needs.keys() | self.takes).union(own)


def _open_mavlink(order: SourceOrder) -> EvaderSource:
    if order.wire is None or order.system_id is None:
        raise ConfigError(
            f'evader.kind = "{order.kind}": needs a MAVLink wire and evader.system_id'
        )
    carrier = carrier_of(
        order.kind,
        order.frame,
        icao_address=order.icao_address,
        id_or_mac=order.id_or_mac,
        datum=order.altitude_datum,
    )
    return MavlinkEvader(
        order.wire,
        carrier,
        system_id=order.system_id,
        component_id=order.component_id,
        request_rate_hz=order.request_rate_hz,
        clock=order.clock,
        signing_key=order.signing_key,
    )


def _open_zenoh(order: SourceOrder) -> EvaderSource:
    # Only Zenoh's kinds need Zenoh
    from guidance.links.evaders.zenoh import MAP_FRAME, open_source_patiently  # noqa: PLC0415

    return open_source_patiently(
        order.kind,
        order.url,
        clock=order.clock,
        frame=order.frame,
        credentials=order.credentials,
        frame_id=MAP_FRAME if order.frame_id is None else order.frame_id,
    )


_DATUM_KEYS: Final = frozenset({"altitude_datum", "frame.undulation_m"})

_BUILT_IN: Final = (
    EvaderKind(
        name="follow_target",
        message="FOLLOW_TARGET, as QGroundControl on a phone sends it",
        transport="mavlink",
        needs=_ONE_SYSTEM,
        takes=MAVLINK_KEYS | _DATUM_KEYS,
        datum=Datum.AMSL,
        open=_open_mavlink,
    ),
    EvaderKind(
        name="global_position",
        message="MAVLink GLOBAL_POSITION_INT",
        transport="mavlink",
        needs=_ONE_SYSTEM,
        takes=MAVLINK_KEYS | _DATUM_KEYS,
        datum=Datum.AMSL,
        open=_open_mavlink,
    ),
    EvaderKind(
        name="odometry",
        message="ODOMETRY, metres in its own frame",
        transport="mavlink",
        needs=_ONE_SYSTEM | _IN_METRES,
        takes=MAVLINK_KEYS,
        open=_open_mavlink,
    ),
    EvaderKind(
        name="open_drone_id",
        message="OPEN_DRONE_ID_LOCATION",
        transport="mavlink",
        needs=_ONE_SYSTEM,
        takes=MAVLINK_KEYS | _DATUM_KEYS | {"id_or_mac"},
        datum=Datum.ELLIPSOID,
        open=_open_mavlink,
    ),
    EvaderKind(
        name="adsb",
        message="ADSB_VEHICLE",
        transport="mavlink",
        needs={
            **_ONE_SYSTEM,
            "icao_address": "needs the aircraft's address",
            "frame.undulation_m": "may report altitudes above the ellipsoid",
        },
        takes=MAVLINK_KEYS,
        open=_open_mavlink,
    ),
    EvaderKind(
        name="json",
        message="a JSON object on a Zenoh key",
        transport="zenoh",
        needs=_A_KEY,
        takes=frozenset({"frame.undulation_m", "frame.home_altitude_amsl_m"}),
        open=_open_zenoh,
    ),
    EvaderKind(
        name="ros_pose",
        message="geometry_msgs/PoseStamped through rmw_zenoh",
        transport="zenoh",
        needs=_A_KEY | _IN_METRES,
        takes=frozenset({"frame_id"}),
        open=_open_zenoh,
    ),
    EvaderKind(
        name="ros_odometry",
        message="nav_msgs/Odometry through rmw_zenoh",
        transport="zenoh",
        needs=_A_KEY | _IN_METRES,
        takes=frozenset({"frame_id"}),
        open=_open_zenoh,
    ),
)

EVADER_KINDS: Final[Registry[EvaderKind]] = Registry(
    "evader source",
    "evader.kind",
    "pursuit_guidance.evader_sources",
    {kind.name: kind for kind in _BUILT_IN},
)
"""The kinds of sources, by name. Add one with `EVADER_KINDS.add`."""


EvaderKindName = Annotated[
    str, AfterValidator(EVADER_KINDS.checked_name), EVADER_KINDS.names_in_schema()
]
"""Type of a key that names a kind of source."""
