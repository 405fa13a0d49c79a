"""A vehicle's configuration: how it is reached, whom it pursues, which game it plays and within which limits."""

import math
import re
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, WithJsonSchema, field_validator, model_validator

from guidance.config import Section
from guidance.control import Polygon, SpeedLimits, Speeds
from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame
from guidance.links.endpoint import taken_apart
from guidance.links.wires.zenoh_access import ZenohSection
from guidance.strategies import COURSES, PURSUER_STRATEGIES

SystemId = Annotated[int, Field(ge=1, le=255)]
Latitude = Annotated[float, Field(ge=-85.0, le=85.0)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0)]
Altitude = Annotated[float, Field(ge=-500.0, le=9000.0)]


def _is_url(url: str) -> str:
    taken_apart(url)
    return url


Url = Annotated[str, AfterValidator(_is_url)]

_ABOVE_THE_FLOOR_M: Final = 1.0
"""Take-off ends up to 0.7 m low, and a hover wanders by some decimetres."""

EvaderKind = Literal[
    "follow_target", "global_position", "odometry", "open_drone_id", "adsb", "json", "ros_pose", "ros_odometry"
]
Policy = Annotated[
    str,
    WithJsonSchema({"type": "string", "enum": [name for name in PURSUER_STRATEGIES if name not in COURSES]}),
]
_IN_METRES = ("odometry", "ros_pose", "ros_odometry")
ON_ZENOH = ("json", "ros_pose", "ros_odometry")
MOST_FENCE_M = 20_000.0
_LOOPBACK = re.compile(r"(tcp|udp|ws)/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+|unixsock-stream/.+")
_BY_TLS = re.compile(r"tls/[^\s/]+:\d+")


class Vehicle(Section):
    """How the autopilot is reached."""

    autopilot: Literal["px4", "arducopter"] = Field(description="which autopilot is there")
    link: Literal["mavsdk", "pymavlink"] = Field(
        "pymavlink", description="which client speaks to it; only pymavlink signs"
    )
    url: Url = Field(description="udpin:// udpout:// tcpin:// tcpout:// serial:// or zenoh://")
    system_id: SystemId = Field(1, description="MAVLink system id of the vehicle")
    component_id: SystemId = Field(1, description="MAVLink component id of its autopilot")
    connect_timeout_s: float = Field(60.0, gt=0.0, le=3600.0, description="how long the first HEARTBEAT is waited for")
    signing_key_file: Path | None = Field(None, description="64 hexadecimal digits, readable by nobody else")

    @model_validator(mode="after")
    def _check_signing(self) -> Self:
        if self.signing_key_file is not None and self.link == "mavsdk":
            raise ValueError('vehicle.signing_key_file with link = "mavsdk": MAVSDK does not sign; use "pymavlink"')
        return self


class EvaderFrame(Section):
    """The evader's own local frame, for sources that report metres or heights that need a datum."""

    latitude_deg: Latitude = Field(description="of the frame's zero")
    longitude_deg: Longitude = Field(description="of the frame's zero")
    altitude_amsl_m: Altitude = Field(description="of the frame's zero, above mean sea level")
    home_altitude_amsl_m: Altitude | None = Field(None, description="of the evader's home, for heights above home")
    undulation_m: float | None = Field(None, ge=-120.0, le=120.0, description="of the geoid above the ellipsoid there")


class EvaderSection(Section):
    """Where reports of the evader come from. Without a `url` they come on the vehicle's own link."""

    kind: EvaderKind = Field(description="which message reports it")
    url: Url | None = Field(None, description="where its reports arrive; the vehicle's own link if not given")
    system_id: SystemId | None = Field(None, description="MAVLink system that is believed, and no other")
    component_id: SystemId | None = Field(None, description="and its component; any if not given")
    icao_address: int | None = Field(None, ge=1, le=0xFFFFFF, description="of ADSB_VEHICLE")
    id_or_mac: str | None = Field(
        None, pattern=r"^([0-9a-fA-F]{2}){1,20}$", description="hexadecimal, of OPEN_DRONE_ID"
    )
    request_rate_hz: float | None = Field(
        None, gt=0.0, le=50.0, description="asked of an evader that sends nothing itself"
    )
    timeout_s: float = Field(1.5, gt=0.0, le=30.0, description="silence after which the evader counts as lost")
    second_source: Literal["hold", "tell"] = Field(
        "hold", description="what two sources of one evader's reports lead to: the autopilot's hold, or an event only"
    )
    signing_key_file: Path | None = Field(
        None, description="64 hexadecimal digits; without url the vehicle's key holds for its evader too"
    )
    frame: EvaderFrame | None = Field(None, description="where its metres have their zero")

    @field_validator("url")
    @classmethod
    def _check_carrier(cls, url: str | None, info: ValidationInfo) -> str | None:
        if url is not None and info.data.get("kind") in ON_ZENOH:
            endpoint = taken_apart(url)
            if endpoint.scheme != "zenoh" or not endpoint.namespace:
                raise ValueError(f'kind = "{info.data["kind"]}" comes over Zenoh: allowed is zenoh://host:port/key')
        return url

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        if self.kind in ON_ZENOH and self.url is None:
            raise ValueError(f'evader.url: missing; kind = "{self.kind}" needs zenoh://host:port/key')
        if self.kind not in ON_ZENOH and self.system_id is None:
            raise ValueError(f'evader.system_id: missing; kind = "{self.kind}" hears one pinned MAVLink system only')
        if self.kind in _IN_METRES and self.frame is None:
            raise ValueError(f'evader.frame: missing; kind = "{self.kind}" reports metres about a place of its own')
        if self.kind in ON_ZENOH and self.request_rate_hz is not None:
            raise ValueError(f'evader.request_rate_hz: not allowed; kind = "{self.kind}" cannot be asked')
        if self.signing_key_file is not None and (self.kind in ON_ZENOH or self.url is None):
            raise ValueError(
                "evader.signing_key_file: not allowed; it is for MAVLink reports with a url of their own "
                "(on the vehicle's link its key holds, over Zenoh TLS does)"
            )
        if self.kind == "adsb" and self.icao_address is None:
            raise ValueError('evader.icao_address: missing; kind = "adsb" needs the aircraft\'s address')
        return self


class Place(Section):
    """A place on Earth."""

    latitude_deg: Latitude = Field(description="north is positive")
    longitude_deg: Longitude = Field(description="east is positive")
    altitude_amsl_m: Altitude = Field(0.0, description="for people only: heights in a game are differences")


class GameSection(Section):
    """What is played."""

    kind: Literal["pe", "tad"] = Field("pe", description="pursuit-evasion, or target-attacker-defender")
    speed_set: Literal["ball", "cylinder"] = Field(
        "cylinder", description="what the vehicle flies: one speed in all directions, or level, up and down apart"
    )
    speed_m_s: float = Field(gt=0.0, le=30.0, description="level speed that the game is played with")
    climb_m_s: float = Field(1.5, gt=0.0, le=10.0, description="and upwards")
    descent_m_s: float = Field(1.0, gt=0.0, le=10.0, description="and downwards")
    policy: Policy = Field("optimal", description="what the pursuer plays")
    navigation_gain: float = Field(3.0, ge=1.0, le=10.0, description="N of policy = proportional_navigation")
    evader_speed_m_s: float = Field(gt=0.0, le=30.0, description="what the evader says it never exceeds")
    standoff_radius_m: float = Field(8.0, gt=0.0, le=200.0, description="of the disc about the evader that is flown to")
    standoff_height_m: float = Field(8.0, ge=2.0, le=120.0, description="above the evader")
    tolerance_m: float = Field(1.0, gt=0.0, le=10.0, description="distance from the disc that counts as captured")
    target: Place | None = Field(None, description="TAD: the place that the evader wants to reach")
    target_velocity_m_s: tuple[float, float] = Field(
        (0.0, 0.0), description="TAD: velocity of that place, east and north, kept from the engagement on"
    )

    @property
    def speeds(self) -> Speeds:
        """What the game is played with."""
        return Speeds(self.speed_m_s, self.climb_m_s, self.descent_m_s)

    @model_validator(mode="after")
    def _check_game(self) -> Self:
        if self.speed_m_s <= self.evader_speed_m_s:
            raise ValueError(
                f"game.speed_m_s = {self.speed_m_s:g}: must be above game.evader_speed_m_s = "
                f"{self.evader_speed_m_s:g}; a slower pursuer is another game"
            )
        if self.kind == "tad" and self.target is None:
            raise ValueError(
                'game.target: missing; kind = "tad" needs the latitude_deg and longitude_deg of the place to defend'
            )
        moves = math.hypot(*self.target_velocity_m_s)
        if not moves < self.evader_speed_m_s or (moves > 0.0 and self.kind == "pe"):
            raise ValueError(
                f"game.target_velocity_m_s = {list(self.target_velocity_m_s)}: must be slower than "
                f'game.evader_speed_m_s = {self.evader_speed_m_s:g}, and only with kind = "tad"'
            )
        if self.kind == "pe" and self.target is not None:
            raise ValueError('game.target: not allowed with kind = "pe"; use kind = "tad"')
        return self


def _check_corners(corners_deg: tuple[tuple[float, float], ...]) -> None:
    """Refuse what is no polygon before it is flown: about its own first corner it is the same as about home."""
    if not corners_deg:
        raise ValueError("limits.fence_polygon_deg has 0 corners: at least 3 are wanted")
    frame = LocalFrame(*corners_deg[0], Amsl(0.0))
    places = [frame.ned_from_wgs84(latitude, longitude, frame.altitude) for latitude, longitude in corners_deg]
    try:
        Polygon(tuple((north, east) for north, east, _ in places))
    except ConfigError as error:
        raise ValueError(f"limits.fence_polygon_deg, in metres about its first corner: {error}") from error
    widest_m = max(math.hypot(north, east) for north, east, _ in places)
    if widest_m > MOST_FENCE_M:
        raise ValueError(
            f"limits.fence_polygon_deg reaches {widest_m:.0f} m from its first corner: at most {MOST_FENCE_M:g} m are "
            "allowed; are latitude and longitude exchanged?"
        )


class LimitsSection(SpeedLimits):
    """What the flight never leaves. Heights are above home, distances from home; speeds are those of every command."""

    floor_m: float = Field(5.0, ge=1.0, description="lowest height above home")
    ceiling_m: float = Field(60.0, gt=5.0, le=500.0, description="greatest height above home")
    fence_radius_m: float | None = Field(200.0, gt=10.0, le=10_000.0, description="greatest distance from home")
    fence_polygon_ne_m: tuple[tuple[float, float], ...] | None = Field(None, description="corners north, east of home")
    fence_polygon_deg: tuple[tuple[Latitude, Longitude], ...] | None = Field(
        None, description="corners by latitude, longitude"
    )
    fence_plan_file: Path | None = Field(
        None, description="a QGroundControl plan (.plan) whose one inclusion polygon is the fence"
    )
    fence_margin_m: float = Field(2.0, ge=0.0, description="how far inside the fence commands keep the vehicle")
    yaw_rate_deg_s: float = Field(45.0, gt=0.0, le=180.0, description="how fast it turns its nose")

    @model_validator(mode="after")
    def _check_fence(self) -> Self:
        if self.floor_m >= self.ceiling_m:
            raise ValueError(f"limits.floor_m = {self.floor_m:g}: must be below limits.ceiling_m = {self.ceiling_m:g}")
        polygons = {
            "limits.fence_polygon_ne_m": self.fence_polygon_ne_m,
            "limits.fence_polygon_deg": self.fence_polygon_deg,
            "limits.fence_plan_file": self.fence_plan_file,
        }
        given = [key for key, value in polygons.items() if value is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)}: one polygon only; leave the others out")
        if self.fence_radius_m is None and not given:
            raise ValueError(
                f"limits.fence_radius_m: missing; give it or one of {', '.join(polygons)}: no flight is unfenced"
            )
        if self.fence_polygon_deg is not None:
            _check_corners(self.fence_polygon_deg)
        return self

    @property
    def reach_m(self) -> float:
        """How far from home the fence lets the vehicle go; corners in degrees count once home is known."""
        corners = self.fence_polygon_ne_m or ()
        farthest_m = max((math.hypot(*corner) for corner in corners), default=math.inf)
        return min(farthest_m, self.fence_radius_m if self.fence_radius_m is not None else math.inf)


class ReserveSection(Section):
    """By what the battery that is needed to fly home is reckoned: how far it is, how fast, and against which wind."""

    endurance_s: float = Field(gt=0.0, le=1e5, description="that a full charge lasts in flight")
    left: float = Field(0.1, ge=0.0, lt=1.0, description="share of the charge that is to be left on the ground")
    return_speed_m_s: float = Field(5.0, gt=0.0, le=30.0, description="the autopilot's own, through the air")
    landing_speed_m_s: float = Field(0.7, gt=0.0, le=5.0, description="the autopilot's own, downwards")
    wind_m_s: float = Field(0.0, ge=0.0, lt=30.0, description="that is against it at worst")

    @model_validator(mode="after")
    def _check_wind(self) -> Self:
        if self.wind_m_s >= self.return_speed_m_s:
            raise ValueError(
                f"flight.reserve.wind_m_s = {self.wind_m_s:g}: must be below flight.reserve.return_speed_m_s = "
                f"{self.return_speed_m_s:g}: against such a wind nothing comes home"
            )
        return self


class FlightSection(Section):
    """How the flight goes around the game."""

    takeoff_height_m: float = Field(15.0, ge=2.0, le=120.0, description="above home")
    after_capture: Literal["hold", "shadow", "return"] = Field(
        "hold", description="stay, keep station on the moving evader, or fly home"
    )
    engage_on: Literal["command", "pilot_mode"] = Field(
        "command", description="who engages: an order, or the pilot's switch to the guided mode once standing by"
    )
    on_terminate: Literal["hold", "land", "return"] = Field("hold", description="what SIGTERM hands the vehicle to")
    battery_minimum: float = Field(0.25, ge=0.0, le=1.0, description="share of the charge below which it returns")
    reserve: ReserveSection | None = Field(
        None, description="returns by what it takes to come home from where it is, in place of battery_minimum"
    )
    operator_timeout_s: float | None = Field(
        None,
        ge=1.0,
        le=3600.0,
        description="without an order or `guidance ctl alive` for so long it holds; no sign of life asked if not given",
    )
    operator_return_s: float = Field(30.0, gt=0.0, le=3600.0, description="for so much longer: it returns")
    longest_chase_s: float | None = Field(
        None,
        gt=0.0,
        le=7200.0,
        description="of one chase with its pauses, then the autopilot's hold; unlimited if not given",
    )


class Preflight(Section):
    """What the autopilot has to be set to."""

    fence_required: bool = Field(True, description="whether the autopilot's own fence must stand behind ours")
    loss_time_limit_s: float = Field(
        1.5, gt=0.2, le=5.0, description="longest time that it may fly an old setpoint when ours stop"
    )
    origin_distance_limit_m: float = Field(
        1000.0, gt=0.0, description="farthest that its local frame's zero may be from home"
    )
    evader_height_limit_m: float = Field(30.0, gt=0.0, description="largest height of the evader above or below home")


class Control(Section):
    """Where orders come from: Zenoh queryables on loopback, or on a router that knows who may order by certificates."""

    endpoint: str = Field(
        "tcp/127.0.0.1:7448", description="Zenoh endpoint, on loopback; or a router's by TLS: docs/zenoh.md"
    )
    host: bool = Field(True, description="listen there; false connects to a Zenoh router that is there already")
    token_file: Path | None = Field(
        None, description="the secret that lets `guidance ctl` in; by default in the runtime folder, for its owner only"
    )

    @field_validator("endpoint")
    @classmethod
    def _check_loopback(cls, endpoint: str) -> str:
        if _LOOPBACK.fullmatch(endpoint) is None and _BY_TLS.fullmatch(endpoint) is None:
            raise ValueError(
                "must be on loopback, as tcp/127.0.0.1:7448, or a router by TLS, as tls/192.168.1.10:7447: who "
                "reaches it commands the vehicle"
            )
        return endpoint

    @property
    def by_tls(self) -> bool:
        """Whether orders come by a router that judges certificates."""
        return _BY_TLS.fullmatch(self.endpoint) is not None

    @model_validator(mode="after")
    def _check_host(self) -> Self:
        if self.by_tls and self.host:
            raise ValueError(
                f"control.endpoint = {self.endpoint!r}: a router of its own; control.host = false goes with it"
            )
        if self.by_tls and self.token_file is not None:
            raise ValueError(
                f"control.token_file = {str(self.token_file)!r}: not by TLS, where certificates say who we are"
            )
        return self


class LogSection(Section):
    """The log, on standard error."""

    format: Literal["console", "json"] = Field("console", description="lines for people, or a JSON object each")
    level: Literal["debug", "info", "warning", "error"] = Field("info", description="what is worth a line")


class MetricsSection(Section):
    """Prometheus, on loopback."""

    port: int | None = Field(None, ge=1, le=65535, description="of 127.0.0.1; none by default")


class RecordSection(Section):
    """The flight record."""

    folder: Path | None = Field(None, description="where each start begins an MCAP record; none by default")
    required: bool = Field(True, description="whether a record that cannot be written keeps the vehicle on the ground")
    rotate_s: float = Field(1800.0, ge=10.0, description="a longer flight goes on in a next file")
    rotate_mb: float = Field(256.0, ge=1.0, description="so does a larger one")


class Config(Section):
    """A whole vehicle file."""

    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,32}$", description="of the vehicle, in orders, metrics and records")
    vehicle: Vehicle
    evader: EvaderSection
    game: GameSection
    limits: LimitsSection = LimitsSection()
    flight: FlightSection = FlightSection()
    preflight: Preflight = Preflight()
    control: Control = Control()
    zenoh: ZenohSection = ZenohSection()
    log: LogSection = LogSection()
    metrics: MetricsSection = MetricsSection()
    record: RecordSection = RecordSection()

    @property
    def speed_limits(self) -> Speeds:
        """What no command exceeds."""
        return self.limits.speeds(self.game.speeds, section="game")

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        _ = self.speed_limits
        if self.control.by_tls and self.zenoh.tls_certificate_file is None:
            raise ValueError(
                f"control.endpoint = {self.control.endpoint!r}: needs zenoh.tls_certificate_file; without mutual TLS "
                "anybody could command the vehicle"
            )
        low, high = self.limits.floor_m, self.limits.ceiling_m
        if low <= self.flight.takeoff_height_m < low + _ABOVE_THE_FLOOR_M:
            raise ValueError(
                f"flight.takeoff_height_m = {self.flight.takeoff_height_m:g}: must be {_ABOVE_THE_FLOOR_M:g} m above "
                f"limits.floor_m = {low:g} at least: a vehicle sinks a little as the game begins"
            )
        for key, height_m in (
            ("flight.takeoff_height_m", self.flight.takeoff_height_m),
            ("game.standoff_height_m", self.game.standoff_height_m),
        ):
            if not low <= height_m <= high:
                raise ValueError(
                    f"{key} = {height_m:g}: allowed is limits.floor_m = {low:g} to limits.ceiling_m = {high:g}"
                )
        return self
