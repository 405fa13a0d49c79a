"""The autopilot's uploaded fence against ours, and home against ours: both by points on the outlines."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from guidance.autopilots import Finding, Verdict, Wants
from guidance.control import Polygon
from guidance.errors import ConfigError
from guidance.frames import LocalFrame
from guidance.messages import Home
from guidance.preflight.uploaded import Area, Uploaded

Point = tuple[float, float]

_NAME: Final = "uploaded fence"
_ROUND: Final = 72
_PER_EDGE: Final = 8


def about_home(wants: Wants, home: Home | None, frame: LocalFrame | None) -> Wants:
    """Put a fence that is wanted by degrees about home, as soon as that is known, with how far it reaches."""
    if wants.fence_corners_deg is None or home is None or frame is None:
        return wants
    corners = _about(home, frame, wants.fence_corners_deg)
    farthest_m = max(math.hypot(*corner) for corner in corners)
    return replace(wants, fence_corners_ne_m=corners, fence_radius_m=min(wants.fence_radius_m, farthest_m))


def home_row(wants: Wants) -> Iterator[Finding]:
    """A vehicle whose home is outside its fence could not begin."""
    if wants.fence_corners_ne_m is None:
        return
    inside = Polygon(wants.fence_corners_ne_m).contains((0.0, 0.0))
    found, verdict = ("inside", Verdict.PASS) if inside else ("outside", Verdict.REFUSE)
    yield Finding("home in our fence", found, "inside", verdict, "" if inside else "another field? See limits.fence_*")


def uploaded_row(
    uploaded: Uploaded, wants: Wants, home: Home | None, frame: LocalFrame | None, *, in_use: bool, any_inclusion: bool
) -> Finding:
    """Judge the uploaded fence: where ours is not within it, the autopilot would act inside ours.

    Args:
        uploaded: What was read.
        wants: With our fence about home.
        home: As the vehicle has it.
        frame: The vehicle's local frame.
        in_use: Whether the autopilot heeds an uploaded fence at all.
        any_inclusion: Whether it is enough to be within one of several areas (PX4), or all count (ArduCopter).
    """
    wanted = "ours within it, where there is one"
    if uploaded.areas is None:
        advice = "it cannot be known whether it would act inside ours; asked for again every few seconds"
        return Finding(_NAME, uploaded.words, wanted, Verdict.WARN, advice)
    if not uploaded.areas or not in_use:
        return Finding(_NAME, uploaded.words if in_use else f"{uploaded.words}, not in use", wanted, Verdict.PASS)
    if home is None or frame is None:
        return Finding(_NAME, uploaded.words, wanted, Verdict.WARN, "home is not known yet")
    try:
        areas = [(area, _shape(area, home, frame)) for area in uploaded.areas]
    except ConfigError as error:
        return Finding(_NAME, uploaded.words, wanted, Verdict.WARN, f"it cannot be judged: {error}")
    outside = [point for point in outline(wants) if not _allowed(point, areas, any_inclusion=any_inclusion)]
    if not outside:
        return Finding(_NAME, uploaded.words, wanted, Verdict.PASS)
    north, east = outside[0]
    verdict = Verdict.REFUSE if wants.fence_required else Verdict.WARN
    advice = f"it would act inside ours, as at {north:.0f} m north, {east:.0f} m east of home: upload a wider one"
    return Finding(_NAME, uploaded.words, wanted, verdict, advice)


def outline(wants: Wants) -> list[Point]:
    """Points on the outline of where our fences let the vehicle be, metres north and east of home."""
    corners, radius_m = wants.fence_corners_ne_m, wants.fence_circle_m
    points: list[Point] = []
    if radius_m is not None:
        turns = [math.tau * n / _ROUND for n in range(_ROUND)]
        points += [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    if corners is None:
        return points
    polygon = Polygon(corners)
    points = [point for point in points if polygon.contains(point)]
    for (north, east), (to_north, to_east) in polygon.edges():
        shares = [n / _PER_EDGE for n in range(_PER_EDGE)]
        points += [(north + share * (to_north - north), east + share * (to_east - east)) for share in shares]
    return [point for point in points if radius_m is None or math.hypot(*point) <= radius_m + 1e-6]


Shape = tuple[Point, float] | Polygon


def _about(home: Home, frame: LocalFrame, corners_deg: Sequence[Point]) -> tuple[Point, ...]:
    north_m, east_m, _ = home.position_ned_m
    places = [frame.ned_from_wgs84(latitude, longitude, frame.altitude) for latitude, longitude in corners_deg]
    return tuple((north - north_m, east - east_m) for north, east, _ in places)


def _shape(area: Area, home: Home, frame: LocalFrame) -> Shape:
    corners = _about(home, frame, area.corners_deg)
    return (corners[0], area.radius_m) if area.radius_m > 0.0 else Polygon(corners)


def _allowed(point: Point, areas: Sequence[tuple[Area, Shape]], *, any_inclusion: bool) -> bool:
    inside = [(area.inclusion, _contains(shape, point)) for area, shape in areas]
    within = [found for inclusion, found in inside if inclusion]
    kept = not within or (any(within) if any_inclusion else all(within))
    return kept and not any(found for inclusion, found in inside if not inclusion)


def _contains(shape: Shape, point: Point) -> bool:
    if isinstance(shape, Polygon):
        return shape.contains(point)
    centre, radius_m = shape
    return math.dist(centre, point) <= radius_m
