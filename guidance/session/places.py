"""Places of a vehicle file: the evader's target with its shape, and polygons from QGroundControl's plans."""

import json
from pathlib import Path
from typing import Any, Final, Self

from pydantic import Field, model_validator

from guidance.config import Altitude, Latitude, Longitude, Section
from guidance.errors import ConfigError
from guidance.frames import Amsl, LocalFrame
from guidance.game import Extent

_PLANS: Final = (
    (("limits",), "fence_plan_file", "fence_polygon_deg"),
    (("game", "target"), "polygon_plan_file", "polygon_deg"),
)
"""Section, key of a plan, and key of its corners."""


class Place(Section):
    """A place on Earth."""

    latitude_deg: Latitude = Field(description="north is positive")
    longitude_deg: Longitude = Field(description="east is positive")
    altitude_amsl_m: Altitude = Field(0.0, description="information only: the game uses height differences")


class Target(Place):
    """The evader's target: a place, and possibly a shape about it. The place is the game frame's origin."""

    polygon_deg: tuple[tuple[Latitude, Longitude], ...] = Field(
        (), description="latitude and longitude of the corners of a convex polygon, or of both ends of a line"
    )
    polygon_plan_file: Path | None = Field(
        None, description="a QGroundControl plan whose inclusion polygon is used instead; relative to this file"
    )
    radius_m: float = Field(0.0, ge=0.0, le=1000.0, description="what lies so near to place or polygon belongs to it")

    @property
    def extent(self) -> Extent:
        """The shape about the place, x east and y north."""
        frame = LocalFrame(self.latitude_deg, self.longitude_deg, Amsl(0.0))
        places = [frame.ned_from_wgs84(*corner, frame.altitude) for corner in self.polygon_deg]
        return Extent(tuple((east, north) for north, east, _ in places) or ((0.0, 0.0),), self.radius_m)

    @model_validator(mode="before")
    @classmethod
    def _place_in_the_middle(cls, given: Any) -> Any:  # noqa: ANN401 - whatever a file holds
        """Without a place, take the middle of the corners."""
        corners = given.get("polygon_deg") if isinstance(given, dict) else None
        if not corners or {"latitude_deg", "longitude_deg"} & given.keys():
            return given
        middle = [sum(numbers) / len(corners) for numbers in zip(*corners, strict=True)]
        return {"latitude_deg": middle[0], "longitude_deg": middle[1], **given}

    @model_validator(mode="after")
    def _check_polygon(self) -> Self:
        try:
            _ = self.extent
        except ConfigError as error:
            raise ValueError(f"game.target.polygon_deg, in metres east and north of the place: {error}") from error
        return self


def with_plans(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Replace every plan of a vehicle file's document by its corners in degrees, and return the document.

    Raises:
        ConfigError: If a plan cannot be read, or its fence is anything but one inclusion polygon.
    """
    for keys, plan_key, corners_key in _PLANS:
        section: Any = document
        for key in keys:
            section = section.get(key) if isinstance(section, dict) else None
        if isinstance(section, dict) and isinstance(section.get(plan_key), str) and corners_key not in section:
            name = ".".join((*keys, plan_key))
            section[corners_key] = corners_deg(folder / section.pop(plan_key), name)
    return document


def corners_deg(path: Path, key: str) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan that a key names: latitude and longitude of each corner.

    Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html.

    Raises:
        ConfigError: If the file is not a plan, or its fence is anything but one inclusion polygon.
    """
    said = f"{key} = {str(path)!r}"
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{said}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise ConfigError(f"{said}: not JSON ({error})") from error
    fence = plan.get("geoFence") if isinstance(plan, dict) else None
    if not isinstance(fence, dict):
        raise ConfigError(f"{said}: has no geoFence; save it from QGroundControl's Plan view with a fence drawn")
    polygons, circles = (fence.get(key) or [] for key in ("polygons", "circles"))
    excluded = [one for one in polygons if not (isinstance(one, dict) and one.get("inclusion") is True)]
    if len(polygons) != 1 or excluded or circles:
        raise ConfigError(
            f"{said}: its fence has {len(polygons)} polygons ({len(excluded)} of them not for inclusion) and "
            f"{len(circles)} circles; must be exactly one inclusion polygon (a circle about home is "
            "limits.fence_radius_m)"
        )
    corners: Any = polygons[0].get("polygon")
    try:
        return [(float(latitude), float(longitude)) for latitude, longitude in corners]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{said}: its polygon is not a list of latitude and longitude ({error})") from error
