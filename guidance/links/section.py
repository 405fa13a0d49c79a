"""The sections `[vehicle]` and `[ground_station]` of vehicle files: the link to the autopilot, and who else uses it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from guidance.autopilots import Autopilot, AutopilotName, Mode, autopilot_named
from guidance.config import Section, SystemId
from guidance.links.port import is_px4, taken_apart
from guidance.links.px4.messages import name_bytes

Url = Annotated[str, AfterValidator(lambda url: taken_apart(url) and url)]
"""A URL of a link; a ValueError explains why another text is not one."""


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


class GroundStationSection(Section):
    """Guidance as ground stations on the vehicle's link see it: component 191, with texts and orders."""

    orders_from: tuple[SystemId, ...] = Field(
        (),
        max_length=8,
        description="system ids of the ground stations that may order hold, return and land; "
        "with vehicle.signing_key_file start and engage, too",
    )
