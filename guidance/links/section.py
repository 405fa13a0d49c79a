"""The sections `[vehicle]` and `[ground_station]` of vehicle files: the link to the autopilot, and who else uses it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import AfterValidator, Field

from guidance.autopilots import AUTOPILOTS, Autopilot, AutopilotName, autopilot_named
from guidance.config import KindSection, Section, SystemId
from guidance.links.kinds import LINKS, LinkKind, LinkName
from guidance.links.port import is_px4, taken_apart

Url = Annotated[str, AfterValidator(lambda url: taken_apart(url) and url)]
"""A URL of a link; a ValueError explains why another text is not one."""


class Vehicle(KindSection):
    """The link to the autopilot."""

    kinds: ClassVar = LINKS
    kind_key: ClassVar = "link"

    autopilot: AutopilotName = Field(description="the vehicle's autopilot")
    link: LinkName = Field(
        "pymavlink",
        description="client library (only pymavlink can sign); zenoh makes guidance a flight mode of PX4",
    )
    url: Url = Field(
        description="udpin:// udpout:// tcpin:// tcpout:// serial:// or zenoh://; "
        'with link = "zenoh" the router of PX4, zenoh+tcp:// or zenoh+tls://'
    )
    parameters: Url | None = Field(
        None,
        description="with a link that is not MAVLink: MAVLink URL for parameters, uploaded fence and home",
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
    def kind(self) -> LinkKind:
        """The kind of its link."""
        return LINKS.named(self.link)

    @property
    def awaited(self) -> str:
        """The event that shows that it is there, in words."""
        if not self.kind.by_mavlink:
            return f"{self.kind.first} at {self.url}"
        return f"{self.kind.first} of system {self.system_id}, component {self.component_id} at {self.url}"

    def _faults(self) -> Iterator[str]:
        kind = self.kind
        named = f'link = "{self.link}"'
        if self.signing_key_file is not None and not kind.signs:
            yield f'vehicle.signing_key_file: {named} does not sign; use "pymavlink"'
        if kind.by_mavlink and is_px4(self.url):
            yield f"vehicle.url = {self.url!r}: {named} needs another URL"
        if kind.by_mavlink and self.parameters is not None:
            yield f"vehicle.parameters: not allowed with {named}; its url is MAVLink"
        if kind.flies(autopilot_named(self.autopilot), self) is None:
            flown = [name for name, one in AUTOPILOTS.items() if kind.flies(one, self) is not None]
            yield f'vehicle.autopilot = "{self.autopilot}": {named} is for {", ".join(flown)}'
        if self.parameters is not None and is_px4(self.parameters):
            yield f"vehicle.parameters = {self.parameters!r}: must be a MAVLink URL, as udpin://127.0.0.1:14540"

    @property
    def profile(self) -> Autopilot:
        """The autopilot as this link flies it."""
        autopilot = autopilot_named(self.autopilot)
        flown = self.kind.flies(autopilot, self)
        return autopilot if flown is None else flown

    @property
    def mavlink_url(self) -> str | None:
        """URL of the vehicle's MAVLink; None without MAVLink."""
        return self.url if self.kind.by_mavlink else self.parameters


class GroundStationSection(Section):
    """Guidance as ground stations on the vehicle's link see it: component 191, with texts and orders."""

    orders_from: tuple[SystemId, ...] = Field(
        (),
        max_length=8,
        description="system ids of the ground stations that may order hold, return and land; "
        "with vehicle.signing_key_file start and engage, too",
    )
