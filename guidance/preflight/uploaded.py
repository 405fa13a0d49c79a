"""The fence that was uploaded to the autopilot as a plan, read back item by item; and whether ours lies within it.

Sources: https://mavlink.io/en/services/mission.html (download of MAV_MISSION_TYPE_FENCE), MAV_CMD_NAV_FENCE_*.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from guidance.messages import FenceCount, FenceItem, FenceReceived, FenceRefused, FenceRequest, Message

MOST_ITEMS: Final = 1000
READ_AGAIN_S: Final = 15.0
"""Read again after this long: nobody announces that another fence was uploaded."""

_ASK_AGAIN_S: Final = 5.0
_POLYGONS: Final[Mapping[int, bool]] = {5001: True, 5002: False}
_CIRCLES: Final[Mapping[int, bool]] = {5003: True, 5004: False}
"""MAV_CMD_NAV_FENCE_*: True for an area to stay within, False for one to stay out of."""


class Area(NamedTuple):
    """Corners of a polygon, or the centre of a circle with its radius (zero for a polygon), in degrees and metres."""

    inclusion: bool
    corners_deg: tuple[tuple[float, float], ...]
    radius_m: float = 0.0

    @property
    def words(self) -> str:
        """As a person would name it."""
        shape = f"circle of {self.radius_m:g} m" if self.radius_m > 0.0 else f"polygon of {len(self.corners_deg)}"
        return shape if self.inclusion else f"{shape} to stay out of"


class Uploaded(NamedTuple):
    """What is known of the uploaded fence: `areas` None where it was not read yet, or why it cannot be."""

    areas: tuple[Area, ...] | None = None
    refused: int | None = None

    @property
    def holds_in(self) -> bool:
        """True where an area is there that the vehicle has to stay within."""
        return any(area.inclusion for area in self.areas or ())

    @property
    def words(self) -> str:
        """What was found, for a row."""
        if self.areas is None:
            why = "" if self.refused is None else f" (MISSION_ACK {self.refused})"
            return f"not read{why}"
        return ", ".join(area.words for area in self.areas) or "none"


class Reading:
    """Reads the fence, and reads it again now and then. Time is given; a link repeats what is not answered."""

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
        """Take in a message, whatever it is about."""
        if isinstance(message, FenceRefused) and not self._over and self._asked is not None:
            self.found, self._over = Uploaded(refused=message.result), True
        elif isinstance(message, FenceCount) and self._count is None and message.items <= MOST_ITEMS:
            self._count = message.items
        elif isinstance(message, FenceItem) and self._count is not None and message.sequence < self._count:
            self._items[message.sequence] = message

    def requests(self, now_s: float) -> tuple[FenceRequest | FenceReceived, ...]:
        """Return what is to be asked or said now."""
        if self._over:
            if now_s - self._begun_s < READ_AGAIN_S:
                return ()
            self._begin()
        if self._count is not None and len(self._items) == self._count:
            self.found, self._over = Uploaded(areas_of([self._items[n] for n in range(self._count)])), True
            return (FenceReceived(),)
        wanted = FenceRequest(None if self._count is None else self._missing(self._count))
        if wanted == self._asked and now_s - self._asked_s < _ASK_AGAIN_S:
            return ()
        if wanted.sequence is None:
            self._begun_s = now_s
        self._asked, self._asked_s = wanted, now_s
        return (wanted,)

    def _missing(self, count: int) -> int:
        return next(sequence for sequence in range(count) if sequence not in self._items)


def areas_of(items: Sequence[FenceItem]) -> tuple[Area, ...]:
    """Put the items together: as many corners as each polygon says it has; other items are no areas."""
    found: list[Area] = []
    corners: list[tuple[float, float]] = []
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
