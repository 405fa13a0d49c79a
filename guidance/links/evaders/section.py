"""The section `[evader]` of vehicle files: the source of its reports, and the zeros of its coordinates."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import Field, ValidationInfo, field_validator

from guidance.config import AltitudeAmsl, KindSection, Latitude, Longitude, Section, SystemId
from guidance.frames import Amsl, LocalFrame
from guidance.links.evaders.kinds import EVADER_KINDS, EvaderKindName
from guidance.links.port import taken_apart
from guidance.messages import Datum

_OWN_URL: Final = (
    "it signs MAVLink reports that have their own url "
    "(the vehicle's link uses the vehicle's key, Zenoh uses TLS)"
)

_UNUSED: Final = {
    "request_rate_hz": "cannot be asked for a rate",
    "signing_key_file": f"does not use it; {_OWN_URL}",
}
"""Reasons why a key is not allowed; by default, the kind does not use it."""


class EvaderFrame(Section):
    """The evader's local frame, for sources that report metres, and the zeros of its altitudes."""

    latitude_deg: Latitude | None = Field(None, description="of the frame's origin")
    longitude_deg: Longitude | None = Field(None, description="of the frame's origin")
    altitude_amsl_m: AltitudeAmsl | None = Field(
        None, description="of the frame's origin, above mean sea level"
    )
    home_altitude_amsl_m: AltitudeAmsl | None = Field(
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


class EvaderSection(KindSection):
    """The source of evader reports. Without a `url`, they arrive on the vehicle's link."""

    kinds: ClassVar = EVADER_KINDS
    kind_key: ClassVar = "kind"

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

    @property
    def datum(self) -> Datum | None:
        """The zero of its altitudes; None if each report names its own, or reports metres."""
        if self.altitude_datum is not None:
            return Datum(self.altitude_datum)
        return EVADER_KINDS.named(self.kind).datum

    @property
    def local_frame(self) -> LocalFrame:
        """The evader's local frame."""
        frame = EvaderFrame() if self.frame is None else self.frame
        return frame.local_frame

    @field_validator("url")
    @classmethod
    def _check_carrier(cls, url: str | None, info: ValidationInfo) -> str | None:
        name = info.data.get("kind")
        if url is None or name is None or EVADER_KINDS.named(name).transport == "other":
            return url
        endpoint = taken_apart(url)
        if EVADER_KINDS.named(name).transport == "mavlink":
            return url
        if endpoint.scheme != "zenoh" or not endpoint.namespace:
            raise ValueError(f'kind = "{name}" arrives over Zenoh: must be zenoh://host:port/key')
        return url

    def _faults(self) -> Iterator[str]:
        kind = EVADER_KINDS.named(self.kind)
        says = f'kind = "{self.kind}"'
        # A dot leads into the frame.
        values = {name: getattr(self, name) for name in self.model_fields_set - {"frame"}}
        if self.frame is not None:
            values |= {
                f"frame.{name}": getattr(self.frame, name) for name in self.frame.model_fields_set
            }
        values = {name: value for name, value in values.items() if value is not None}
        # The whole frame instead of its keys if it is missing.
        if self.frame is not None:
            needed = dict(kind.needs)
        else:
            needed = {key.partition(".")[0]: reason for key, reason in kind.needs.items()}
        for key, reason in needed.items():
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
