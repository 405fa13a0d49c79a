"""A QGroundControl plan as the fence of a vehicle file.

The plan's inclusion polygon replaces the file's name, so the corners are in the configuration and in every record.
Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html.
"""

import json
from pathlib import Path
from typing import Any, Final

from guidance.errors import ConfigError

_KEY: Final = "fence_plan_file"


def with_fence_plan(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a vehicle file's document with the plan replaced by its corners in degrees.

    Raises:
        ConfigError: If the plan cannot be read, or its fence is anything but one inclusion polygon.
    """
    limits = document.get("limits")
    if not isinstance(limits, dict) or not isinstance(limits.get(_KEY), str) or "fence_polygon_deg" in limits:
        return document
    corners = corners_deg(folder / limits[_KEY])
    kept = {key: value for key, value in limits.items() if key != _KEY}
    return {**document, "limits": {**kept, "fence_polygon_deg": corners}}


def corners_deg(path: Path) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan: latitude and longitude of each corner.

    Raises:
        ConfigError: If the file is not a plan, or its fence is anything but one inclusion polygon.
    """
    said = f"limits.{_KEY} = {str(path)!r}"
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
