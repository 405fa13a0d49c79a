"""A stored fence in flight: its areas, and which of them a position violates."""

import math
from collections.abc import Iterator, Sequence

from sitl_mock.protocols import PlanItem
from sitl_mock.vector import Vector
from sitl_mock.world import LocalFrame

_INSIDE_POLYGON = 5001
_OUTSIDE_POLYGON = 5002
_INSIDE_CIRCLE = 5003
_OUTSIDE_CIRCLE = 5004  # MAV_CMD_NAV_FENCE_*


def violated(items: Sequence[PlanItem], frame: LocalFrame, position_m: Vector) -> bool:
    """True if a position is outside an inclusion area or inside an exclusion area."""
    north, east, _ = position_m
    for command, points, radius_m in _areas(items, frame):
        if command in {_INSIDE_CIRCLE, _OUTSIDE_CIRCLE}:
            (n, e) = points[0]
            within = math.hypot(north - n, east - e) < radius_m
        else:
            within = _within(points, north, east)
        if within == (command in {_OUTSIDE_POLYGON, _OUTSIDE_CIRCLE}):
            return True
    return False


def inclusion_polygons(
    items: Sequence[PlanItem], frame: LocalFrame, position_m: Vector
) -> Iterator[Sequence[tuple[float, float]]]:
    """Yield the corners (north, east) of each inclusion polygon that contains a position."""
    for command, points, _ in _areas(items, frame):
        if command == _INSIDE_POLYGON and _within(points, position_m[0], position_m[1]):
            yield points


def _areas(
    items: Sequence[PlanItem], frame: LocalFrame
) -> Iterator[tuple[int, list[tuple[float, float]], float]]:
    """Yield each area: its command, its corners or centre in local metres, and its radius."""
    polygon: list[tuple[float, float]] = []
    for item in items:
        point = frame.to_local(item.latitude_deg, item.longitude_deg, frame.origin.alt_amsl_m)[:2]
        if item.command in {_INSIDE_CIRCLE, _OUTSIDE_CIRCLE}:
            yield item.command, [point], item.param1
        elif item.command in {_INSIDE_POLYGON, _OUTSIDE_POLYGON}:
            polygon.append(point)
            if len(polygon) >= int(item.param1):
                yield item.command, polygon, 0.0
                polygon = []


def _within(corners: Sequence[tuple[float, float]], north: float, east: float) -> bool:
    """Even-odd rule: a ray to the east crosses the outline an odd number of times."""
    inside = False
    before_n, before_e = corners[-1]
    for corner_n, corner_e in corners:
        if (corner_n > north) != (before_n > north):
            crossing_e = corner_e + (north - corner_n) * (before_e - corner_e) / (
                before_n - corner_n
            )
            inside = inside != (east < crossing_e)
        before_n = corner_n
        before_e = corner_e
    return inside
