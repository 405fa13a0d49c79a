"""Reads back the fence that was uploaded to the autopilot, and checks that it encloses ours.

Source: https://mavlink.io/en/services/mission.html (download of
MAV_MISSION_TYPE_FENCE) and MAV_CMD_NAV_FENCE_*.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.autopilots import Autopilot, Finding, Verdict, Wants
from guidance.autopilots.rules import Quantities, fence_verdict
from guidance.control import Limits
from guidance.control.polygon import Point, corners_about_home
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
from guidance.preflight.areas import (
    MOST_EDGES,
    Ring,
    acts_inside,
    circle_sides,
    ring_of_circle,
    without_repeats,
)
from guidance.vehicle import VehicleState, local_frame

MOST_ITEMS: Final = 1000
READ_AGAIN_S: Final = 15.0
"""Period of reading. The autopilot does not announce a new upload."""

_ASK_AGAIN_S: Final = 5.0
_FEWEST_CORNERS: Final = 3
_RETURN_POINT: Final = 5000
_POLYGONS: Final[Mapping[int, bool]] = {5001: True, 5002: False}
_CIRCLES: Final[Mapping[int, bool]] = {5003: True, 5004: False}
"""MAV_CMD_NAV_FENCE_*: True for an inclusion area, False for an exclusion area."""

_NAME: Final = "uploaded fence"


class Area(NamedTuple):
    """A polygon by its corners in degrees, or a circle by its centre and its radius, which a polygon has not."""

    inclusion: bool
    corners_deg: tuple[Point, ...]
    radius_m: float | None = None

    @property
    def words(self) -> str:
        """Short description."""
        shape = f"polygon of {len(self.corners_deg)}"
        if self.radius_m is not None:
            shape = f"circle of {self.radius_m:g} m"
        return shape if self.inclusion else f"excluded {shape}"


class Uploaded(NamedTuple):
    """The uploaded fence.

    Attributes:
        areas: Its areas; None until all are read and can be judged.
        refused: The MISSION_ACK that refused the download.
        problem: Why it cannot be judged.
    """

    areas: tuple[Area, ...] | None = None
    refused: int | None = None
    problem: str = ""

    @property
    def words(self) -> str:
        """Short description."""
        if self.areas is not None:
            listed = [area.words for area in self.areas]
            return ", ".join(listed) if listed else "none"
        if self.problem:
            return self.problem
        return "not read" if self.refused is None else f"not read (MISSION_ACK {self.refused})"


class Reading:
    """Downloads the fence, and again every `READ_AGAIN_S`. The link repeats unanswered requests.

    Attributes:
        found: The result of the last download that ended.
        found_begun_s: When that download began.
        over: Whether no download is under way.
    """

    def __init__(self) -> None:
        self.found = Uploaded()
        self.found_begun_s = -math.inf
        self.begin()

    def begin(self) -> None:
        """Begin a download. An unfinished one is given up."""
        self.over = False
        self._begun_s = -math.inf
        self._items: dict[int, FenceItem] = {}
        self._count: int | None = None
        self._asked: FenceRequest | None = None
        self._asked_s = -math.inf

    @property
    def progress(self) -> str:
        """Number of items read, in words."""
        if self._count is None:
            return "not read again: no answer"
        return f"not read again: {len(self._items)} of {self._count} items so far"

    def observe(self, message: Message) -> None:
        """Handle a message of any kind."""
        if self.over or self._asked is None:
            return  # answers to somebody else
        if isinstance(message, FenceRefused):
            self._end(Uploaded(refused=message.result))
        elif isinstance(message, FenceCount) and self._count is None:
            self._count = message.items
            if message.items > MOST_ITEMS:
                problem = f"has {message.items} items, more than {MOST_ITEMS}"
                self._end(Uploaded(problem=problem))
        elif isinstance(message, FenceItem) and message.sequence in self._sequence():
            self._items[message.sequence] = message

    def _sequence(self) -> range:
        """Return the numbers of the items; none until their count is known."""
        return range(0 if self._count is None else self._count)

    def _end(self, uploaded: Uploaded) -> None:
        self.found = uploaded
        self.found_begun_s = self._begun_s
        self.over = True

    def requests(self, now_s: float) -> tuple[FenceRequest | FenceReceived, ...]:
        """Return the requests of this cycle."""
        if self.over:
            if now_s - self._begun_s < READ_AGAIN_S:
                return ()
            self.begin()
        if self._count is not None and len(self._items) == self._count:
            self._end(uploaded_of([self._items[number] for number in range(self._count)]))
            return (FenceReceived(),)
        missing = (number for number in self._sequence() if number not in self._items)
        request = FenceRequest(next(missing, None))
        if request == self._asked and now_s - self._asked_s < _ASK_AGAIN_S:
            return ()
        if self._asked is None:
            self._begun_s = now_s
        self._asked = request
        self._asked_s = now_s
        return (request,)


def uploaded_of(items: Sequence[FenceItem]) -> Uploaded:
    """Assemble the areas of mission items. Each item of a polygon gives its number of corners."""
    areas: list[Area] = []
    corners: list[Point] = []
    first: FenceItem | None = None
    for item in items:
        corner = (item.latitude_deg, item.longitude_deg)
        if first is not None and (item.command, item.size) != (first.command, first.size):
            return Uploaded(problem=_incomplete_polygon_words(first, corners))
        if item.command in _CIRCLES:
            areas.append(Area(_CIRCLES[item.command], (corner,), item.size))
        elif item.command in _POLYGONS:
            first = item
            corners.append(corner)
            if len(corners) >= item.size:
                areas.append(Area(_POLYGONS[item.command], without_repeats(corners)))
                corners = []
                first = None
        elif item.command != _RETURN_POINT:
            return Uploaded(problem=f"item {item.sequence} is unknown (command {item.command})")
    if first is not None:
        return Uploaded(problem=_incomplete_polygon_words(first, corners))
    return _checked_areas(tuple(areas))


def _incomplete_polygon_words(first: FenceItem, corners: Sequence[Point]) -> str:
    return (
        f"polygon at item {first.sequence} has {len(corners)} corners, but announces {first.size:g}"
    )


def _checked_areas(areas: tuple[Area, ...]) -> Uploaded:
    """Return the areas, or why they cannot be judged."""
    edges = 0
    for number, area in enumerate(areas, start=1):
        edges += len(area.corners_deg)
        if area.radius_m is None and len(area.corners_deg) < _FEWEST_CORNERS:
            return Uploaded(problem=f"area {number} is a {area.words} corners: needs at least 3")
        if area.radius_m is not None and not area.radius_m > 0.0:
            return Uploaded(problem=f"area {number} is a {area.words}: must be above 0")
        if area.radius_m is not None:
            edges += circle_sides(area.radius_m)
    if edges > MOST_EDGES:
        return Uploaded(problem=f"{edges} edges are more than {MOST_EDGES}, which can be judged")
    return Uploaded(areas)


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
    quantities: Quantities,
) -> Finding:
    """Judge the uploaded fence. If it does not enclose ours, the autopilot would act inside ours.

    A fence that is in use and was not read, or cannot be judged, is refused like one that is too small.

    Args:
        uploaded: The fence as it was read.
        wants: With our fence in metres about home.
        vehicle: Where home is.
        autopilot: Whether it heeds an uploaded fence, and how several areas count.
        quantities: Values of its parameters that were read.
    """
    row = Finding(_NAME, uploaded.words, "a fence that encloses ours, or none", Verdict.PASS)
    if uploaded.areas == ():
        return row
    if not autopilot.uploaded_fence_counts(quantities):
        return row._replace(value=f"{row.value}, not in use")
    row = row._replace(verdict=fence_verdict(wants))
    if uploaded.areas is None:
        advice = "it may act inside our fence; requested again every few seconds"
        if uploaded.problem:
            advice = "it may act inside our fence: upload one that can be judged, or order again"
        return row._replace(advice=advice)
    home = vehicle.latest.get(Home)
    frame = local_frame(vehicle, autopilot.projection)
    if home is None or frame is None:
        return row._replace(advice="home is not known yet")
    point = acts_inside(
        our_rings(wants.limits),
        tuple(ring_of(area, home, frame) for area in uploaded.areas),
        one_inclusion_is_enough=autopilot.one_inclusion_is_enough,
    )
    if point is None:
        return row._replace(verdict=Verdict.PASS)
    north_m, east_m = point
    advice = (
        f"it acts inside our fence at {north_m:.0f} m north, {east_m:.0f} m east of home: "
        "upload a wider one"
    )
    return row._replace(advice=advice)


def our_rings(limits: Limits) -> tuple[tuple[Point, ...], ...]:
    """Return the rings of our fence, metres north and east of home: its circle and its polygon."""
    rings: list[tuple[Point, ...]] = []
    if limits.fence_radius_m is not None:
        rings.append(ring_of_circle((0.0, 0.0), limits.fence_radius_m, larger=False))
    if limits.fence_polygon_ne_m is not None:
        rings.append(limits.fence_polygon_ne_m)
    return tuple(rings)


def ring_of(area: Area, home: Home, frame: LocalFrame) -> Ring:
    """Return an area about home. A circle is replaced so that it is judged as tighter than it is."""
    corners_m = corners_about_home(area.corners_deg, home.position_ned_m, frame)
    if area.radius_m is not None:
        corners_m = ring_of_circle(corners_m[0], area.radius_m, larger=not area.inclusion)
    return Ring(corners_m, area.inclusion)
