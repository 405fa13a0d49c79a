"""The vehicle file: how the vehicle and the evader are reached, which game is played, and within which limits."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from guidance.autopilots import Autopilot, AutopilotName, Mode, Preflight, autopilot_named
from guidance.config import (
    Altitude,
    Extended,
    Latitude,
    Longitude,
    Section,
    faults_of,
    parse_document,
)
from guidance.control import Limits, Speeds
from guidance.errors import ConfigError
from guidance.files import read_text
from guidance.flight.settings import FlightSection, TeamSection
from guidance.frames import Amsl, LocalFrame
from guidance.game import Extent
from guidance.game.rules import SpeedSetName
from guidance.links.evaders.kinds import (
    EVADER_KINDS,
    EvaderKind,
    EvaderKindName,
    evader_kind,
)
from guidance.links.port import is_px4, taken_apart
from guidance.links.px4.messages import name_bytes
from guidance.links.zenoh.access import ZenohSection
from guidance.messages import Datum
from guidance.registry import Registry
from guidance.strategies import COURSES, PURSUER_STRATEGIES
from guidance.strategies.own import as_one_text, is_own, policy_schema
from guidance.toml_files import read


class TargetSection(Section):
    """The evader's target: a place, and possibly a shape about it. The place is the game frame's origin."""

    latitude_deg: Latitude = Field(description="north is positive")
    longitude_deg: Longitude = Field(description="east is positive")
    altitude_amsl_m: Altitude = Field(
        0.0, description="information only: the game uses height differences"
    )
    polygon_deg: tuple[tuple[Latitude, Longitude], ...] = Field(
        (),
        description="latitude and longitude of the corners of a convex polygon, or of both ends of a line",
    )
    polygon_plan_file: Path | None = Field(
        None,
        description="a QGroundControl plan whose inclusion polygon is used instead; relative to this file",
    )
    radius_m: float = Field(
        0.0, ge=0.0, le=1000.0, description="what lies so near to place or polygon belongs to it"
    )

    @property
    def extent(self) -> Extent:
        """The shape about the place, x east and y north."""
        frame = LocalFrame(self.latitude_deg, self.longitude_deg, Amsl(0.0))
        places = [frame.ned_from_wgs84(*corner, frame.altitude) for corner in self.polygon_deg]
        if not places:
            return Extent(((0.0, 0.0),), self.radius_m)
        return Extent(tuple((east, north) for north, east, _ in places), self.radius_m)

    @model_validator(mode="before")
    @classmethod
    def _place_in_the_middle(cls, document: Any) -> Any:  # noqa: ANN401 - whatever a file holds
        """Without a place, take the middle of the corners."""
        corners = document.get("polygon_deg") if isinstance(document, dict) else None
        if not corners or {"latitude_deg", "longitude_deg"} & document.keys():
            return document
        middle = [sum(numbers) / len(corners) for numbers in zip(*corners, strict=True)]
        return {"latitude_deg": middle[0], "longitude_deg": middle[1], **document}

    def _faults(self) -> Iterator[str]:
        key = "game.target.polygon_deg, in metres east and north of the place"
        yield from faults_of(key, lambda: self.extent)


_PLANS: Final = {
    "limits.fence_plan_file": "fence_polygon_deg",
    "game.target.polygon_plan_file": "polygon_deg",
}
"""Keys of plans, and for each the key of its corners."""


def corners_deg(path: Path, key: str) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan that a key names: latitude and longitude of each corner.

    A closed ring and repeated corners are accepted, and heights of corners are ignored. The first version of plans has
    one polygon, without circles. Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html.

    Raises:
        ConfigError: If the file is not a plan, or its fence is anything but one inclusion polygon.
    """
    setting = f"{key} = {str(path)!r}"
    try:
        plan = json.loads(read_text(path))
    except OSError as error:
        raise ConfigError(f"{setting}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{setting}: not JSON ({error})") from error
    fence = plan.get("geoFence") if isinstance(plan, dict) else None
    if not isinstance(fence, dict):
        raise ConfigError(
            f"{setting}: has no geoFence; save it from QGroundControl's Plan view with a fence drawn"
        )
    try:
        polygon = _polygon_of_plan(fence)
    except ValueError as error:
        raise ConfigError(f"{setting}: {error}") from error
    try:
        corners = [_corner_deg(corner) for corner in polygon]
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(
            f"{setting}: its polygon is not a list of latitude and longitude ({error})"
        ) from error
    # A corner that repeats the one before is left out; the last one joins the first.
    return [corner for before, corner in pairwise([*corners[-1:], *corners]) if corner != before]


def _polygon_of_plan(fence: Mapping[str, Any]) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return the one inclusion polygon of a plan's geoFence.

    Raises:
        ValueError: If the fence is anything else; the message has the plan's own words.
    """
    polygons = fence.get("polygons")
    if polygons is None and "polygon" in fence:
        return fence["polygon"]  # version 1
    polygons = polygons or []
    circles = fence.get("circles") or []
    if not isinstance(polygons, list) or not isinstance(circles, list):
        raise ValueError("geoFence.polygons and geoFence.circles must be lists")  # noqa: TRY004 - one kind of error
    excluded = sum(
        not (isinstance(polygon, dict) and polygon.get("inclusion") is True) for polygon in polygons
    )
    if len(polygons) != 1 or excluded or circles:
        words = (
            f"{len(polygons)} polygons ({excluded} of them not for inclusion) and "
            f"{len(circles)} circles{_radii(circles)}"
        )
        allowed = "exactly one inclusion polygon (a circle about home is limits.fence_radius_m)"
        raise ValueError(f"its fence has {words}; must be {allowed}")
    return polygons[0].get("polygon")


def _radii(circles: Sequence[Any]) -> str:
    """Name the radius of every circle: one of 0 m is invisible in the Plan view."""
    if not circles:
        return ""
    shapes = [circle.get("circle") if isinstance(circle, dict) else None for circle in circles]
    radii = [shape.get("radius") if isinstance(shape, dict) else None for shape in shapes]
    words = [str(radius)[:20] for radius in radii[:5]]
    if len(radii) > len(words):
        words.append("…")
    return f" (radius {', '.join(words)})"


def _corner_deg(corner: object) -> tuple[float, float]:
    """Return latitude and longitude of a corner of a plan; a height is ignored."""
    if not isinstance(corner, list) or len(corner) not in {2, 3}:
        raise ValueError(f"corner {str(corner)[:40]}")
    return float(corner[0]), float(corner[1])


_ABOVE_THE_FLOOR_M: Final = 1.0
"""A take-off ends up to 0.7 m low, and a hover wanders by some decimetres."""

_LOOPBACK = re.compile(
    r"(tcp|udp|ws)/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+|unixsock-stream/.+"
)
_BY_TLS = re.compile(r"tls/[^\s/]+:\d+")

SystemId = Annotated[int, Field(ge=1, le=255)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]


_POLICIES: Final = [name for name in PURSUER_STRATEGIES if name not in COURSES]


def _known_policy(policy: str) -> str:
    if policy not in _POLICIES and not is_own(policy):
        raise ValueError(f"must be one of {', '.join(sorted(_POLICIES))}, or module:function")
    return policy


PolicyName = Annotated[
    str, BeforeValidator(as_one_text), AfterValidator(_known_policy), policy_schema(_POLICIES)
]


Url = Annotated[str, AfterValidator(lambda url: taken_apart(url) and url)]
"""A URL of a link; a ValueError explains why another text is not one."""


class EvaderFrame(Section):
    """The evader's local frame, for sources that report metres, and the zeros of its altitudes."""

    latitude_deg: Latitude | None = Field(None, description="of the frame's origin")
    longitude_deg: Longitude | None = Field(None, description="of the frame's origin")
    altitude_amsl_m: Altitude | None = Field(
        None, description="of the frame's origin, above mean sea level"
    )
    home_altitude_amsl_m: Altitude | None = Field(
        None, description='of home, for altitude_datum = "relative" in JSON reports'
    )
    undulation_m: float | None = Field(
        None,
        ge=-120.0,
        le=120.0,
        description="height of the geoid above the WGS-84 ellipsoid, for altitudes above the ellipsoid",
    )

    @property
    def local_frame(self) -> LocalFrame:
        """The frame; its origin is at sea level if no key names it, for sources that need none."""
        home = None if self.home_altitude_amsl_m is None else Amsl(self.home_altitude_amsl_m)
        if self.latitude_deg is None or self.longitude_deg is None or self.altitude_amsl_m is None:
            return LocalFrame(0.0, 0.0, Amsl(0.0), home, undulation_m=self.undulation_m)
        return LocalFrame(
            self.latitude_deg,
            self.longitude_deg,
            Amsl(self.altitude_amsl_m),
            home,
            undulation_m=self.undulation_m,
        )


def _add_keys_of_kinds(schema: dict[str, Any]) -> None:
    """Add the keys that kinds from outside have in `[evader]` to its JSON schema."""
    for kind in EVADER_KINDS.importable().values():
        if kind.section is not None:
            schema["properties"] |= kind.section.model_json_schema()["properties"]


class EvaderSection(Extended):
    """The source of evader reports. Without a `url`, they arrive on the vehicle's link."""

    model_config = ConfigDict(json_schema_extra=_add_keys_of_kinds)

    kind: EvaderKindName = Field(description="the message that reports the evader")
    url: str | None = Field(
        None, description="where its reports arrive; default: the vehicle's link"
    )
    system_id: SystemId | None = Field(
        None, description="the only MAVLink system id that is accepted"
    )
    component_id: SystemId | None = Field(None, description="its component id; default: any")
    icao_address: int | None = Field(None, ge=1, le=0xFFFFFF, description="of ADSB_VEHICLE")
    id_or_mac: str | None = Field(
        None, pattern=r"^([0-9a-fA-F]{2}){1,20}$", description="hexadecimal of OPEN_DRONE_ID"
    )
    altitude_datum: Literal["amsl", "ellipsoid"] | None = Field(
        None,
        description="zero of its altitudes: mean sea level, or the WGS-84 ellipsoid with frame.undulation_m; "
        "default: the message's own",
    )
    frame_id: str | None = Field(
        None, max_length=200, description='frame of ROS messages; default: "map"'
    )
    request_rate_hz: float | None = Field(
        None, gt=0.0, le=50.0, description="message rate to ask a silent evader for"
    )
    timeout_s: float = Field(
        1.5, gt=0.0, le=30.0, description="the evader is lost after this long without a report"
    )
    second_source: Literal["hold", "tell"] = Field(
        "hold", description="two sources report: hold, or only an event"
    )
    signing_key_file: Path | None = Field(
        None, description="64 hexadecimal digits; without url the vehicle's applies"
    )
    frame: EvaderFrame | None = Field(
        None, description="origin of its coordinates, and zeros of its altitudes"
    )

    @classmethod
    def further_keys(cls, document: Mapping[str, object]) -> type[Section] | None:
        """Return the keys of a kind from outside."""
        name = document.get("kind")
        if not isinstance(name, str) or name not in EVADER_KINDS.names:
            return None
        return evader_kind(name).section

    @classmethod
    def further_names(cls) -> list[str]:
        """Return the keys of the kinds from outside that are in use."""
        sections = [kind.section for kind in EVADER_KINDS.values() if kind.section is not None]
        return [name for section in sections for name in section.model_fields]

    @property
    def datum(self) -> Datum | None:
        """The zero of its altitudes; None if each report names its own, or reports metres."""
        if self.altitude_datum is not None:
            return Datum(self.altitude_datum)
        return evader_kind(self.kind).datum

    @property
    def local_frame(self) -> LocalFrame:
        """The evader's local frame."""
        frame = EvaderFrame() if self.frame is None else self.frame
        return frame.local_frame

    def _given(self) -> dict[str, Any]:
        """Return the keys that are set and not None; a dot leads into the frame."""
        values = {name: getattr(self, name) for name in self.model_fields_set - {"frame"}}
        if self.frame is not None:
            values |= {
                f"frame.{name}": getattr(self.frame, name) for name in self.frame.model_fields_set
            }
        return {name: value for name, value in values.items() if value is not None}

    @field_validator("url")
    @classmethod
    def _check_carrier(cls, url: str | None, info: ValidationInfo) -> str | None:
        name = info.data.get("kind")
        if url is None or name is None or evader_kind(name).transport == "other":
            return url
        endpoint = taken_apart(url)
        if evader_kind(name).transport == "mavlink":
            return url
        if endpoint.scheme != "zenoh" or not endpoint.namespace:
            raise ValueError(f'kind = "{name}" arrives over Zenoh: must be zenoh://host:port/key')
        return url

    def _faults(self) -> Iterator[str]:
        kind = evader_kind(self.kind)
        says = f'kind = "{self.kind}"'
        values = self._given()
        for key, reason in self._needed(kind).items():
            if key not in values:
                yield f"evader.{key}: missing; {says} {reason}"
        for key in sorted(values.keys() - kind.keys):
            yield f"evader.{key}: not allowed; {says} {_UNUSED.get(key, 'does not use it')}"
        if "signing_key_file" in values and kind.transport == "mavlink" and self.url is None:
            yield f"evader.signing_key_file: not allowed; {_OWN_URL}"
        if "altitude_datum" in kind.keys:
            undulation_m = None if self.frame is None else self.frame.undulation_m
            if self.datum is Datum.ELLIPSOID and undulation_m is None:
                reason = f"altitudes of {says} above the ellipsoid need the geoid's height there"
                yield f'evader.frame.undulation_m: missing; {reason}, or set evader.altitude_datum = "amsl"'
            if self.datum is Datum.AMSL and undulation_m is not None:
                reason = "altitudes above mean sea level do not use it"
                remedy = 'remove it, or set evader.altitude_datum = "ellipsoid"'
                yield f"evader.frame.undulation_m = {undulation_m:g}: not allowed; {reason}: {remedy}"

    def _needed(self, kind: EvaderKind) -> dict[str, str]:
        """Return the needed keys and why; the whole frame instead of its keys if it is missing."""
        if self.frame is not None:
            return dict(kind.needs)
        return {key.partition(".")[0]: reason for key, reason in kind.needs.items()}


_OWN_URL: Final = (
    "it signs MAVLink reports that have their own url "
    "(the vehicle's link uses the vehicle's key, Zenoh uses TLS)"
)
_UNUSED: Final = {
    "request_rate_hz": "cannot be asked for a rate",
    "signing_key_file": f"does not use it; {_OWN_URL}",
}
"""Why a key is not allowed, where more can be said than that it is not used."""


class GameSection(Section):
    """The game."""

    kind: Literal["pe", "tad"] = Field(
        "pe", description="pursuit-evasion, or target-attacker-defender"
    )
    speed_set: SpeedSetName = Field(
        "cylinder", description="one speed (ball), or own climb and descent rates"
    )
    speed_m_s: float = Field(
        gt=0.0, le=30.0, description="the pursuer's horizontal speed in the game"
    )
    climb_m_s: float = Field(1.5, gt=0.0, le=10.0, description="its climb rate")
    descent_m_s: float = Field(1.0, gt=0.0, le=10.0, description="its descent rate")
    policy: PolicyName = Field("optimal", description="the pursuer's strategy")
    navigation_gain: float = Field(
        3.0, ge=1.0, le=10.0, description="N of policy = proportional_navigation"
    )
    evader_speed_m_s: float = Field(gt=0.0, le=30.0, description="declared top speed of the evader")
    standoff_radius_m: float = Field(
        8.0, gt=0.0, le=200.0, description="radius of the disc around the evader"
    )
    standoff_height_m: float = Field(
        8.0, ge=2.0, le=120.0, description="height of the disc above the evader"
    )
    tolerance_m: float = Field(
        1.0, gt=0.0, le=10.0, description="distance from the disc that counts as capture"
    )
    target: TargetSection | None = Field(None, description="TAD: the evader's target")
    target_velocity_m_s: tuple[float, float] = Field(
        (0.0, 0.0),
        description="TAD: velocity of the target, east and north, constant from engagement",
    )

    @property
    def speeds(self) -> Speeds:
        """The pursuer's speeds in the game."""
        return Speeds(self.speed_m_s, self.climb_m_s, self.descent_m_s)

    def _faults(self) -> Iterator[str]:
        moves_m_s = math.hypot(*self.target_velocity_m_s)
        evader = f"game.evader_speed_m_s = {self.evader_speed_m_s:g}"
        if self.speed_m_s <= self.evader_speed_m_s:
            yield f"game.speed_m_s = {self.speed_m_s:g}: must be above {evader}; a slower pursuer is another game"
        if self.kind == "tad" and self.target is None:
            yield 'game.target: missing; kind = "tad" needs the latitude_deg and longitude_deg of the place to defend'
        if not moves_m_s < self.evader_speed_m_s or (moves_m_s > 0.0 and self.kind == "pe"):
            allowed = f'must be slower than {evader}, and only with kind = "tad"'
            yield f"game.target_velocity_m_s = {list(self.target_velocity_m_s)}: {allowed}"
        if self.kind == "pe" and self.target is not None:
            yield 'game.target: not allowed with kind = "pe"; use kind = "tad"'


class Vehicle(Section):
    """The link to the autopilot."""

    autopilot: AutopilotName = Field(description="the vehicle's autopilot")
    link: Literal["mavsdk", "pymavlink", "zenoh"] = Field(
        "pymavlink",
        description="client library (only pymavlink can sign); zenoh makes guidance a flight mode of PX4",
    )
    url: Url = Field(
        description="udpin:// udpout:// tcpin:// tcpout:// serial:// or zenoh://; "
        'with link = "zenoh" the router of PX4, zenoh+tcp:// or zenoh+tls://'
    )
    mode_name: str = Field(
        "Pursuit", description='with link = "zenoh": name of the flight mode on ground stations'
    )
    parameters: Url | None = Field(
        None, description='with link = "zenoh": MAVLink URL for parameters, uploaded fence and home'
    )
    system_id: SystemId = Field(1, description="MAVLink system id of the vehicle")
    component_id: SystemId = Field(1, description="MAVLink component id of its autopilot")
    connect_timeout_s: float = Field(
        60.0, gt=0.0, le=3600.0, description="longest wait for the first HEARTBEAT"
    )
    signing_key_file: Path | None = Field(
        None, description="64 hexadecimal digits; only the owner may read the file"
    )
    announce: bool = Field(
        False, description="show the evader on the maps of ground stations, as ADSB_VEHICLE"
    )

    @property
    def awaited(self) -> str:
        """The event that shows that it is there, in words."""
        if self.link == "zenoh":
            return f"PX4's VehicleStatus at {self.url}, and the registration of {self.mode_name!r}"
        return (
            f"a HEARTBEAT of system {self.system_id}, component {self.component_id} at {self.url}"
        )

    def _faults(self) -> Iterator[str]:
        if self.signing_key_file is not None and self.link == "mavsdk":
            yield 'vehicle.signing_key_file with link = "mavsdk": MAVSDK does not sign; use "pymavlink"'
        by_px4 = is_px4(self.url)
        if by_px4 is not (self.link == "zenoh"):
            needs = "zenoh+tcp:// or zenoh+tls://" if self.link == "zenoh" else "another URL"
            yield f'vehicle.url = {self.url!r}: link = "{self.link}" needs {needs}'
        if self.link != "zenoh":
            if self.parameters is not None:
                yield f'vehicle.parameters: not allowed with link = "{self.link}"; its url is MAVLink'
        elif autopilot_named(self.autopilot).as_mode is None:
            yield f'vehicle.autopilot = "{self.autopilot}": link = "zenoh" is for px4'
        if self.parameters is not None and is_px4(self.parameters):
            yield f"vehicle.parameters = {self.parameters!r}: must be a MAVLink URL, as udpin://127.0.0.1:14540"
        try:
            name_bytes(self.mode_name)
        except ValueError as error:
            yield f"vehicle.mode_name = {self.mode_name!r}: {error}"

    @property
    def profile(self) -> Autopilot:
        """The autopilot as this link flies it."""
        autopilot = autopilot_named(self.autopilot)
        if self.link != "zenoh" or autopilot.as_mode is None:
            return autopilot
        return replace(autopilot.as_mode, mode_titles={Mode.GUIDED: self.mode_name})

    @property
    def mavlink_url(self) -> str | None:
        """Where MAVLink is spoken with the vehicle; None if it is not."""
        return self.parameters if self.link == "zenoh" else self.url


class Control(Section):
    """Where orders arrive: Zenoh queryables on loopback, or on a router that checks certificates."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7448", description="Zenoh on loopback, or a router by TLS: docs/zenoh.md"
    )
    host: bool = Field(True, description="listen there; false connects to a running Zenoh router")
    token_file: Path | None = Field(
        None, description="secret of `guidance ctl`; default: runtime folder"
    )

    @field_validator("endpoint")
    @classmethod
    def _check_loopback(cls, endpoint: str) -> str:
        if _LOOPBACK.fullmatch(endpoint) is None and _BY_TLS.fullmatch(endpoint) is None:
            allowed = (
                "on loopback, as tcp/127.0.0.1:7448, or a router with TLS, as tls/192.168.1.10:7447"
            )
            raise ValueError(f"must be {allowed}: whoever can reach it commands the vehicle")
        return endpoint

    @property
    def by_tls(self) -> bool:
        """Whether orders arrive through a router that checks certificates."""
        return _BY_TLS.fullmatch(self.endpoint) is not None

    def _faults(self) -> Iterator[str]:
        if self.by_tls and self.host:
            yield f"control.endpoint = {self.endpoint!r}: is a router; set control.host = false"
        if self.by_tls and self.token_file is not None:
            yield f"control.token_file = {str(self.token_file)!r}: not allowed with TLS, where certificates identify us"


class LogSection(Section):
    """The log, on standard error."""

    format: Literal["console", "json"] = Field(
        "console", description="readable lines, or one JSON object per line"
    )
    level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="lowest level that is logged"
    )


class MetricsSection(Section):
    """The Prometheus endpoint, on loopback."""

    port: int | None = Field(
        None, ge=1, le=65535, description="port on 127.0.0.1; default: no metrics"
    )


class RecordSection(Section):
    """The flight record."""

    folder: Path | None = Field(
        None, description="folder of the MCAP records, one per start; default: no records"
    )
    required: bool = Field(
        True, description="whether an unwritable record keeps the vehicle on the ground"
    )
    rotate_s: float = Field(600.0, ge=10.0, description="a new file begins after this time")
    rotate_mb: float = Field(256.0, ge=1.0, description="a new file begins at this size")


class RosSection(Section):
    """The flight as ROS 2 topics, through a Zenoh router as rmw_zenoh uses it."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7447",
        pattern=r"^(tcp|tls)/[^\s/]+:\d+$",
        description="the Zenoh router of the ROS graph, such as rmw_zenohd; with tls/ by [zenoh]",
    )
    domain_id: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID")
    orders: bool = Field(
        False,
        description="services hold, land, return and engage: whoever reaches the router may order; "
        "only on loopback, or by TLS with a certificate",
    )

    @property
    def by_tls(self) -> bool:
        """Whether the router is reached by TLS."""
        return _BY_TLS.fullmatch(self.endpoint) is not None


class GroundStationSection(Section):
    """Guidance as ground stations on the vehicle's link see it: component 191, with texts and orders."""

    orders_from: tuple[SystemId, ...] = Field(
        (),
        max_length=8,
        description="system ids of the ground stations that may order hold, return and land; "
        "with vehicle.signing_key_file start and engage, too",
    )


class TeamEvader(EvaderSection):
    """An evader besides `[evader]`. On the vehicle's link only that one may report."""

    url: str = Field(description="where its reports arrive")
    speed_m_s: float = Field(gt=0.0, le=30.0, description="declared top speed of the evader")


class Team(TeamSection):
    """The team of the vehicle. Its messages pass the session of `[control]`, which all mates share."""

    name: Name = Field(description="of the team, in orders: guidance ctl engage --team NAME")
    mates: tuple[Name, ...] = Field(
        min_length=1, max_length=31, description="names of the other vehicles"
    )
    evader: Name = Field(
        description="name of the evader of [evader], against which the vehicle plays first"
    )
    evaders: dict[Name, SerializeAsAny[TeamEvader]] = Field(
        {}, description="[team.evaders.NAME]: the other evaders"
    )


SECTIONS: Final[Registry[type[Section]]] = Registry(
    "section of vehicle files", "section", "pursuit_guidance.sections", {}
)
"""Sections from outside, by their names in vehicle files."""

OwnSection = TypeVar("OwnSection", bound=Section)


@cache
def _sections_from_outside(names: tuple[str, ...]) -> type[Section]:
    fields: dict[str, Any] = {name: (SECTIONS.named(name) | None, None) for name in names}
    return create_model("Sections", __base__=Section, **fields)


class Config(Extended):
    """A whole vehicle file."""

    name: Name = Field(description="of the vehicle, in orders, metrics and records")
    vehicle: Vehicle
    evader: SerializeAsAny[EvaderSection]
    game: GameSection
    limits: Limits = Limits()
    flight: FlightSection = FlightSection()
    preflight: Preflight = Preflight()
    control: Control = Control()
    zenoh: ZenohSection = ZenohSection()
    log: LogSection = LogSection()
    metrics: MetricsSection = MetricsSection()
    record: RecordSection = RecordSection()
    ros: RosSection | None = None
    ground_station: GroundStationSection | None = None
    team: Team | None = None

    @classmethod
    def further_keys(cls, document: Mapping[str, object]) -> type[Section] | None:
        """Return the sections from outside that a file has."""
        names = tuple(sorted(document.keys() & {*SECTIONS.names} - Config.model_fields.keys()))
        return _sections_from_outside(names) if names else None

    @classmethod
    def further_names(cls) -> list[str]:
        """Return the names of all sections from outside."""
        return SECTIONS.names

    def section(self, model: type[OwnSection]) -> OwnSection | None:
        """Return the section of a package from outside; None if the file does not have it."""
        return next((part for _, part in self if isinstance(part, model)), None)

    @property
    def evaders(self) -> dict[str, EvaderSection]:
        """All evaders by name, the vehicle's first one first."""
        return (
            {"evader": self.evader}
            if self.team is None
            else {self.team.evader: self.evader, **self.team.evaders}
        )

    @property
    def on_ground_stations(self) -> bool:
        """Whether ground stations see anything of guidance."""
        return self.ground_station is not None or self.vehicle.announce

    @property
    def ordering_stations(self) -> tuple[int, ...]:
        """System ids of the ground stations that may give orders."""
        return () if self.ground_station is None else self.ground_station.orders_from

    @property
    def evader_height_limit_m(self) -> float:
        """Greatest height difference between the evader and home's ground for an engagement."""
        limit_m = self.preflight.evader_height_limit_m
        return 0.5 * self.game.standoff_height_m if limit_m is None else limit_m

    @property
    def speed_limits(self) -> Speeds:
        """Speed limits of every command."""
        return self.limits.speeds(self.game.speeds, section="game")

    def _faults(self) -> Iterator[str]:
        _ = self.speed_limits
        if self.control.by_tls and self.zenoh.tls_certificate_file is None:
            needs = "needs zenoh.tls_certificate_file; without mutual TLS anyone could command the vehicle"
            yield f"control.endpoint = {self.control.endpoint!r}: {needs}"
        if self.ros is not None:
            yield from self._ros_faults(self.ros)
        if self.vehicle.system_id in self.ordering_stations:
            key = f"ground_station.orders_from = {list(self.ordering_stations)}"
            yield f"{key}: has vehicle.system_id; name only ground stations, QGroundControl is 255"
        if self.vehicle.mavlink_url is None:
            yield from self._zenoh_faults()
        if self.team is not None:
            yield from self._team_faults(self.team)
        yield from self._height_faults()

    def _zenoh_faults(self) -> Iterator[str]:
        """Refuse what needs MAVLink."""
        needs = 'with link = "zenoh" needs vehicle.parameters, a MAVLink URL'
        if self.evader.url is None:
            yield f"evader.url: missing; a report on the vehicle's link {needs}"
        if self.on_ground_stations:
            key = "vehicle.announce" if self.ground_station is None else "ground_station"
            yield f"{key}: {needs}"
        if self.vehicle.signing_key_file is not None:
            yield f"vehicle.signing_key_file: {needs}"

    def _height_faults(self) -> Iterator[str]:
        low = self.limits.floor_m
        high = self.limits.ceiling_m
        takeoff_m = self.flight.takeoff_height_m
        disc_m = self.game.standoff_height_m
        if self.evader_height_limit_m >= disc_m:
            key = f"preflight.evader_height_limit_m = {self.evader_height_limit_m:g}"
            reason = "an evader whose reports are so much too low would be at the vehicle's height"
            yield f"{key}: must be below game.standoff_height_m = {disc_m:g}: {reason}"
        if low <= takeoff_m < low + _ABOVE_THE_FLOOR_M:
            above = f"{_ABOVE_THE_FLOOR_M:g} m above limits.floor_m = {low:g} at least"
            reason = "the vehicle sinks slightly when the game begins"
            yield f"flight.takeoff_height_m = {takeoff_m:g}: must be {above}: {reason}"
        for key, height_m in {
            "flight.takeoff_height_m": takeoff_m,
            "game.standoff_height_m": disc_m,
        }.items():
            if not low <= height_m <= high:
                yield f"{key} = {height_m:g}: allowed is limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"

    def _ros_faults(self, ros: RosSection) -> Iterator[str]:
        key = f"ros.endpoint = {ros.endpoint!r}"
        if ros.by_tls and self.zenoh.tls_ca_file is None:
            yield f"{key}: needs zenoh.tls_ca_file, which signed the router's certificate"
        proven = ros.by_tls and self.zenoh.tls_certificate_file is not None
        if ros.orders and not proven and _LOOPBACK.fullmatch(ros.endpoint) is None:
            allowed = "a router on loopback, or tls/ with zenoh.tls_certificate_file"
            yield f"{key}: with ros.orders = true must be {allowed}; else anyone could command the vehicle"

    def _team_faults(self, team: Team) -> Iterator[str]:
        if len({self.name, *team.mates}) <= len(team.mates):
            yield f"team.mates = {list(team.mates)}: must be other names than {self.name!r}, each once"
        if team.evader in team.evaders:
            yield f"team.evaders.{team.evader}: is [evader] already (team.evader); name only the others"
        if any(self.game.target_velocity_m_s):
            moves = f"game.target_velocity_m_s = {list(self.game.target_velocity_m_s)}"
            reason = "the vehicles would count the target's way from different moments"
            yield f"{moves}: must be zero with [team]: {reason}"
        for name, evader in team.evaders.items():
            if evader.speed_m_s >= self.game.speed_m_s:
                key = f"team.evaders.{name}.speed_m_s"
                allowed = f"game.speed_m_s = {self.game.speed_m_s:g}"
                yield f"{key} = {evader.speed_m_s:g}: must be below {allowed}"


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of vehicle files, with the sections of all installed packages."""
    installed = tuple(sorted(SECTIONS.importable()))
    model = create_model("Config", __base__=(_sections_from_outside(installed), Config))
    return model.model_json_schema()


def load_vehicle(path: Path) -> Config:
    """Read a vehicle file and the plans it names. Relative names are relative to the vehicle file's folder.

    Raises:
        ConfigError: If a file cannot be read or is wrong.
    """
    text, document = read(path)
    for name, corners_key in _PLANS.items():  # every plan is replaced by its corners in degrees
        section: Any = document
        *keys, plan_key = name.split(".")
        for key in keys:
            section = section.get(key) if isinstance(section, dict) else None
        if (
            isinstance(section, dict)
            and isinstance(section.get(plan_key), str)
            and corners_key not in section
        ):
            section[corners_key] = corners_deg(path.parent / section.pop(plan_key), name)
    config = parse_document(Config, document, source=str(path), text=text)
    return config.model_copy(update={"zenoh": config.zenoh.beside(path.parent.absolute())})
