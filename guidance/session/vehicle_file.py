"""The vehicle file: the sections of all features, each defined beside its feature, and the rules between them."""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import Field, SerializeAsAny, create_model

from guidance.autopilots import Preflight
from guidance.config import Extended, Name, Section, parse_document
from guidance.control import Limits, Speeds
from guidance.cycle.section import GameSection
from guidance.flight.settings import FlightSection
from guidance.links.evaders.section import EvaderSection
from guidance.links.section import GroundStationSection, Vehicle
from guidance.links.zenoh.access import ZenohSection
from guidance.registry import Registry
from guidance.session.drawn_plan import corners_deg
from guidance.session.orders_section import Control
from guidance.session.output_sections import LogSection, MetricsSection, RecordSection, RosSection
from guidance.session.team_section import Team
from guidance.toml_files import read

_PLANS: Final = {
    "limits.fence_plan_file": "fence_polygon_deg",
    "game.target.polygon_plan_file": "polygon_deg",
}
"""Keys of plans, and for each the key of its corners."""

_ABOVE_THE_FLOOR_M: Final = 1.0
"""A take-off ends up to 0.7 m low, and a hover wanders by some decimetres."""

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
    vehicle: SerializeAsAny[Vehicle]
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
        further = sorted(document.keys() - Config.model_fields.keys())
        names = tuple(name for name in further if SECTIONS.knows(name))
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
        """True if ground stations see anything of guidance."""
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
            yield from self.ros.faults_beside(self.zenoh)
        if self.vehicle.system_id in self.ordering_stations:
            key = f"ground_station.orders_from = {list(self.ordering_stations)}"
            yield f"{key}: has vehicle.system_id; name only ground stations, QGroundControl is 255"
        if self.vehicle.mavlink_url is None:
            # Refuse settings that need MAVLink.
            needs = f'with link = "{self.vehicle.link}" needs vehicle.parameters, a MAVLink URL'
            if self.evader.url is None:
                yield f"evader.url: missing; a report on the vehicle's link {needs}"
            if self.on_ground_stations:
                key = "vehicle.announce" if self.ground_station is None else "ground_station"
                yield f"{key}: {needs}"
            if self.vehicle.signing_key_file is not None:
                yield f"vehicle.signing_key_file: {needs}"
        if self.team is not None:
            yield from self.team.faults_beside(self.name, self.game)
        yield from self._height_faults()

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


def vehicle_schema() -> dict[str, Any]:
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
