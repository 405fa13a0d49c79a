"""Polygons that a person has drawn in QGroundControl: the one inclusion polygon of a plan file."""

import json
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from guidance.errors import ConfigError
from guidance.files import read_text


def corners_deg(path: Path, key: str) -> list[tuple[float, float]]:
    """Read the one inclusion polygon of a plan that a key names: latitude and longitude of each corner.

    A closed ring and repeated corners are accepted, and heights of corners are ignored. The first version of plans has
    one polygon, without circles. Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html.

    Raises:
        ConfigError: If the file is not a plan, or its fence is anything but one inclusion polygon.
    """
    setting = f"{key} = {str(path)!r}"
    try:
        plan = json.loads(read_text(path))
    except OSError as error:
        raise ConfigError(f"{setting}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{setting}: not JSON ({error})") from error
    fence = plan.get("geoFence") if isinstance(plan, dict) else None
    if not isinstance(fence, dict):
        raise ConfigError(
            f"{setting}: has no geoFence; save it from QGroundControl's Plan view with a fence drawn"
        )
    try:
        polygon = _polygon_of_plan(fence)
    except ValueError as error:
        raise ConfigError(f"{setting}: {error}") from error
    try:
        corners = [_corner_deg(corner) for corner in polygon]
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(
            f"{setting}: its polygon is not a list of latitude and longitude ({error})"
        ) from error
    # A corner that repeats the one before is left out; the last one joins the first.
    return [corner for before, corner in pairwise([*corners[-1:], *corners]) if corner != before]


def _polygon_of_plan(fence: Mapping[str, Any]) -> Any:  # noqa: ANN401 - whatever a file holds
    """Return the one inclusion polygon of a plan's geoFence.

    Raises:
        ValueError: If the fence is anything else; the message has the plan's own words.
    """
    polygons = fence.get("polygons")
    if polygons is None and "polygon" in fence:
        return fence["polygon"]  # version 1
    polygons = polygons or []
    circles = fence.get("circles") or []
    if not isinstance(polygons, list) or not isinstance(circles, list):
        raise ValueError("geoFence.polygons and geoFence.circles must be lists")  # noqa: TRY004 - one kind of error
    excluded = sum(
        not (isinstance(polygon, dict) and polygon.get("inclusion") is True) for polygon in polygons
    )
    if len(polygons) != 1 or excluded or circles:
        words = (
            f"{len(polygons)} polygons ({excluded} of them not for inclusion) and "
            f"{len(circles)} circles"
        )
        if circles:
            # The radii identify the circles: one of 0 m is invisible in the Plan view.
            shapes = [
                circle.get("circle") if isinstance(circle, dict) else None for circle in circles
            ]
            radii = [shape.get("radius") if isinstance(shape, dict) else None for shape in shapes]
            listed = [str(radius)[:20] for radius in radii[:5]]
            if len(radii) > len(listed):
                listed.append("…")
            words += f" (radius {', '.join(listed)})"
        allowed = "exactly one inclusion polygon (a circle about home is limits.fence_radius_m)"
        raise ValueError(f"its fence has {words}; must be {allowed}")
    return polygons[0].get("polygon")


def _corner_deg(corner: object) -> tuple[float, float]:
    """Return latitude and longitude of a corner of a plan; a height is ignored."""
    if not isinstance(corner, list) or len(corner) not in {2, 3}:
        raise ValueError(f"corner {str(corner)[:40]}")
    return float(corner[0]), float(corner[1])
