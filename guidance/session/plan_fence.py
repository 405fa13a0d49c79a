"""The fence of a QGroundControl plan: its inclusion polygon takes the place of the file's name in the configuration.

The plan file format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. The corners are in
the configuration from then on, and so in the record of every flight, wherever the file goes.
"""

import json
from pathlib import Path
from typing import Any, Final

from guidance.config import load, parse
from guidance.errors import ConfigError
from guidance.session.vehicle_file import Config

_KEY: Final = "limits.fence_plan_file"


def load_vehicle(path: Path) -> Config:
    """Read a vehicle file, and the plan that it names; relative names of both count from the vehicle file's folder.

    Raises:
        ConfigError: If either cannot be read or is wrong.
    """
    config = load(Config, path)
    config = config.model_copy(update={"zenoh": config.zenoh.beside(path.parent.absolute())})
    named = config.limits.fence_plan_file
    if named is None:
        return config
    document = config.model_dump(mode="json")
    corners = corners_deg(path.parent / named)
    document["limits"] |= {"fence_plan_file": None, "fence_polygon_deg": corners}
    return parse(Config, document, source=f"{path} with the fence of {named}")


def corners_deg(path: Path) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan: latitude and longitude of each corner.

    Raises:
        ConfigError: If the file is no plan, or its fence is anything but one inclusion polygon.
    """
    said = f"{_KEY} = {str(path)!r}"
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
            f"{len(circles)} circles; exactly one inclusion polygon is wanted (a circle about home is "
            "limits.fence_radius_m)"
        )
    corners: Any = polygons[0].get("polygon")
    try:
        return [(float(latitude), float(longitude)) for latitude, longitude in corners]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{said}: its polygon is no list of latitude and longitude ({error})") from error
