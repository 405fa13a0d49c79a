"""A vehicle file's evader: which reports of it are believed, and where they come from."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from guidance.config import Altitude, Latitude, Longitude, Section
from guidance.links.endpoint import taken_apart

SystemId = Annotated[int, Field(ge=1, le=255)]


def _is_url(url: str) -> str:
    taken_apart(url)
    return url


Url = Annotated[str, AfterValidator(_is_url)]

EvaderKind = Literal[
    "follow_target", "global_position", "odometry", "open_drone_id", "adsb", "json", "ros_pose", "ros_odometry"
]
_IN_METRES = ("odometry", "ros_pose", "ros_odometry")
ON_ZENOH = ("json", "ros_pose", "ros_odometry")


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
