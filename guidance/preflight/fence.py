"""Reads back the fence that was uploaded to the autopilot, and checks that it encloses ours.

The check samples points on the outlines. Source: https://mavlink.io/en/services/mission.html (download of
MAV_MISSION_TYPE_FENCE) and MAV_CMD_NAV_FENCE_*.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from guidance.autopilots import Autopilot, Finding, Verdict, Wants
from guidance.autopilots.rules import Parameters, fence_verdict
from guidance.control.polygon import Point, Polygon, corners_about_home
from guidance.errors import ConfigError
from guidance.frames import LocalFrame, Projection
from guidance.messages import (
    FenceCount,
    FenceItem,
    FenceReceived,
    FenceRefused,
    FenceRequest,
    Home,
    Message,
)
from guidance.vehicle import VehicleState, local_frame

MOST_ITEMS: Final = 1000
READ_AGAIN_S: Final = 15.0
"""Period of reading. The autopilot does not announce a new upload."""

_ASK_AGAIN_S: Final = 5.0
_POLYGONS: Final[Mapping[int, bool]] = {5001: True, 5002: False}
_CIRCLES: Final[Mapping[int, bool]] = {5003: True, 5004: False}
"""MAV_CMD_NAV_FENCE_*: True for an inclusion area, False for an exclusion area."""

_NAME: Final = "uploaded fence"
_ROUND: Final = 72
_PER_EDGE: Final = 8


class Area(NamedTuple):
    """A polygon by its corners, or a circle by its centre (degrees) and radius (m; zero for a polygon)."""

    inclusion: bool
    corners_deg: tuple[Point, ...]
    radius_m: float = 0.0

    @property
    def words(self) -> str:
        """Short description."""
        shape = (
            f"circle of {self.radius_m:g} m"
            if self.radius_m > 0.0
            else f"polygon of {len(self.corners_deg)}"
        )
        return shape if self.inclusion else f"excluded {shape}"


class Uploaded(NamedTuple):
    """The uploaded fence. `areas` is None until it was read; `refused` is the MISSION_ACK that refused it."""

    areas: tuple[Area, ...] | None = None
    refused: int | None = None

    @property
    def words(self) -> str:
        """Short description."""
        if self.areas is None:
            return "not read" if self.refused is None else f"not read (MISSION_ACK {self.refused})"
        return ", ".join(area.words for area in self.areas) or "none"


class Reading:
    """Downloads the fence, and again every `READ_AGAIN_S`. The link repeats unanswered requests."""

    def __init__(self) -> None:
        self.found = Uploaded()
        self._begin()
        self._begun_s = -math.inf

    def _begin(self) -> None:
        self._items: dict[int, FenceItem] = {}
        self._count: int | None = None
        self._asked: FenceRequest | None = None
        self._asked_s = -math.inf
        self._over = False

    def observe(self, message: Message) -> None:
        """Handle a message of any kind."""
        if isinstance(message, FenceRefused) and not self._over and self._asked is not None:
            self.found = Uploaded(refused=message.result)
            self._over = True
        elif (
            isinstance(message, FenceCount) and self._count is None and message.items <= MOST_ITEMS
        ):
            self._count = message.items
        elif (
            isinstance(message, FenceItem)
            and self._count is not None
            and message.sequence < self._count
        ):
            self._items[message.sequence] = message

    def requests(self, now_s: float) -> tuple[FenceRequest | FenceReceived, ...]:
        """Return the requests of this cycle."""
        if self._over:
            if now_s - self._begun_s < READ_AGAIN_S:
                return ()
            self._begin()
        if self._count is not None and len(self._items) == self._count:
            self.found = Uploaded(areas_of([self._items[n] for n in range(self._count)]))
            self._over = True
            return (FenceReceived(),)
        missing = (number for number in range(self._count or 0) if number not in self._items)
        wanted = FenceRequest(next(missing, None))
        if wanted == self._asked and now_s - self._asked_s < _ASK_AGAIN_S:
            return ()
        if wanted.sequence is None:
            self._begun_s = now_s
        self._asked = wanted
        self._asked_s = now_s
        return (wanted,)


def areas_of(items: Sequence[FenceItem]) -> tuple[Area, ...]:
    """Assemble areas from mission items. Each polygon item gives its number of corners."""
    found: list[Area] = []
    corners: list[Point] = []
    for item in items:
        place = (item.latitude_deg, item.longitude_deg)
        if item.command in _CIRCLES:
            found.append(Area(_CIRCLES[item.command], (place,), max(item.size, 1e-3)))
        elif item.command in _POLYGONS:
            corners.append(place)
            if len(corners) >= round(item.size):
                found.append(Area(_POLYGONS[item.command], tuple(corners)))
                corners = []
    return tuple(found)


def about_home(wants: Wants, vehicle: VehicleState, projection: Projection) -> Wants:
    """Replace a fence in degrees by the same one in metres about home, once home is known."""
    corners_deg = wants.limits.fence_polygon_deg
    home = vehicle.latest.get(Home)
    frame = local_frame(vehicle, projection)
    if corners_deg is None or home is None or frame is None:
        return wants
    corners = corners_about_home(corners_deg, home.position_ned_m, frame)
    limits = wants.limits.model_copy(
        update={"fence_polygon_ne_m": corners, "fence_polygon_deg": None}
    )
    return wants._replace(limits=limits)


def uploaded_row(
    uploaded: Uploaded,
    wants: Wants,
    vehicle: VehicleState,
    autopilot: Autopilot,
    parameters: Parameters,
) -> Finding:
    """Judge the uploaded fence. If it does not enclose ours, the autopilot would act inside ours.

    Args:
        uploaded: What was read.
        wants: With our fence in metres about home.
        vehicle: Where home is.
        autopilot: Whether it heeds an uploaded fence, and how several areas count.
        parameters: Its parameters.
    """
    row = Finding(_NAME, uploaded.words, "a fence that encloses ours, or none", Verdict.WARN)
    if uploaded.areas is None:
        return row._replace(advice="it may act inside our fence; requested again every few seconds")
    in_use = autopilot.uploaded_fence_counts(parameters)
    if not uploaded.areas or not in_use:
        return row._replace(
            verdict=Verdict.PASS, value=row.value if in_use else f"{row.value}, not in use"
        )
    home = vehicle.latest.get(Home)
    frame = local_frame(vehicle, autopilot.projection)
    if home is None or frame is None:
        return row._replace(advice="home is not known yet")
    try:
        areas = [(area.inclusion, _contains(area, home, frame)) for area in uploaded.areas]
    except ConfigError as error:
        return row._replace(advice=f"cannot be judged: {error}")
    enough = any if autopilot.one_inclusion_is_enough else all
    for north, east in outline(wants):
        within = [contains((north, east)) for inclusion, contains in areas if inclusion] or [True]
        excluded = any(contains((north, east)) for inclusion, contains in areas if not inclusion)
        if excluded or not enough(within):
            advice = f"it acts inside our fence at {north:.0f} m north, {east:.0f} m east of home: upload a wider one"
            return row._replace(verdict=fence_verdict(wants), advice=advice)
    return row._replace(verdict=Verdict.PASS)


def outline(wants: Wants) -> list[Point]:
    """Return points on the outline of our fence, metres north and east of home."""
    corners = wants.limits.fence_polygon_ne_m
    radius_m = wants.limits.fence_radius_m
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
        points += [
            (north + share * (to_north - north), east + share * (to_east - east))
            for share in shares
        ]
    return [point for point in points if radius_m is None or math.hypot(*point) <= radius_m + 1e-6]


def _contains(area: Area, home: Home, frame: LocalFrame) -> Callable[[Point], bool]:
    """Return the function that says whether a point, north and east of home, is in an area."""
    corners = corners_about_home(area.corners_deg, home.position_ned_m, frame)
    if area.radius_m > 0.0:
        return lambda point: math.dist(corners[0], point) <= area.radius_m
    return Polygon(corners).contains
