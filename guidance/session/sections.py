"""The sections of a vehicle file that a flight is made of: the evader, the game, and what the flight never leaves."""

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, WithJsonSchema, field_validator, model_validator

from guidance.config import Altitude, Latitude, Longitude, Section
from guidance.control import Polygon, SpeedLimits, Speeds
from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame
from guidance.links.endpoint import taken_apart
from guidance.strategies import COURSES, PURSUER_STRATEGIES

SystemId = Annotated[int, Field(ge=1, le=255)]

EvaderKind = Literal[
    "follow_target", "global_position", "odometry", "open_drone_id", "adsb", "json", "ros_pose", "ros_odometry"
]
_IN_METRES = ("odometry", "ros_pose", "ros_odometry")
ON_ZENOH = ("json", "ros_pose", "ros_odometry")
Policy = Annotated[
    str,
    WithJsonSchema({"type": "string", "enum": [name for name in PURSUER_STRATEGIES if name not in COURSES]}),
]
MOST_FENCE_M = 20_000.0


def _is_url(url: str) -> str:
    taken_apart(url)
    return url


Url = Annotated[str, AfterValidator(_is_url)]


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
