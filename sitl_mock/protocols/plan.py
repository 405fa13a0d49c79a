"""Plans: mission, fence and rally points as MAVLink mission items, with their checks.

Source: https://mavlink.io/en/services/mission.html, MAV_CMD. A vehicle has one ``PlanStore``; links change it only by
a whole upload that passed all checks, and each change raises the plan's revision.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.protocols.command import GLOBAL_FRAMES, INT32_NAN, MISSION_FRAME, coordinate

if TYPE_CHECKING:
    from collections.abc import Sequence

NAV_WAYPOINT: Final = 16
NEEDS_ALTITUDE: Final = frozenset({16, 17, 18, 19, 31})
WITH_PLACE: Final = frozenset({16, 17, 18, 19, 21, 22, 31, 82, 84, 85})
POLYGONS: Final = frozenset({5001, 5002})
CIRCLES: Final = frozenset({5003, 5004})
FENCE_RETURN: Final = 5000
RALLY_POINT: Final = 5100


class PlanKind(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class PlanItem(NamedTuple):
    """One item, with the fields of MISSION_ITEM_INT.

    Attributes:
        seq: Position in the plan.
        frame: MAV_FRAME.
        command: MAV_CMD.
        current: 1 if the sender calls it the current item.
        autocontinue: 1 to go on to the next item.
        param1: Command's parameter.
        param2: Command's parameter.
        param3: Command's parameter.
        param4: Command's parameter, mostly yaw in degrees.
        x: Latitude in 1e-7 degrees, or local x in 1e-4 m.
        y: Longitude in 1e-7 degrees, or local y in 1e-4 m.
        z: Altitude in metres, meant by the frame.
    """

    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float

    @property
    def latitude_deg(self) -> float:
        """Latitude in degrees, NaN if not given."""
        return coordinate(self.x, self.frame)

    @property
    def longitude_deg(self) -> float:
        """Longitude in degrees, NaN if not given."""
        return coordinate(self.y, self.frame)


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan as last accepted.

    Attributes:
        items: Its items.
        revision: Rises with each upload and each clearing.
        opaque_id: CRC-32 of the items, 0 for an empty plan.
    """

    items: tuple[PlanItem, ...] = ()
    revision: int = 0
    opaque_id: int = 0


_MISSION: Final = PlanKind.MISSION
"""By this name it is found faster than in its class; the commander asks at every step."""


@dataclass(slots=True)
class PlanStore:
    """The three plans of one vehicle.

    Attributes:
        plans: By kind.
        current: Sequence number of the mission item being flown; the autopilot keeps it.
        uploader: The present upload; a second link is refused meanwhile.
        uploader_until_s: End of that refusal, so that a vanished link does not block others.
        news: Replaced plans that an autopilot has yet to report.
        old_messages: Messages without integer coordinates that clients have used, with the kind of plan.
        in_flight: The mission is being flown and cannot be cleared (ArduPilot).
    """

    plans: dict[PlanKind, Plan] = field(default_factory=lambda: {kind: Plan() for kind in PlanKind})
    current: int = 0
    uploader: object | None = None
    uploader_until_s: float = 0.0
    news: set[PlanKind] = field(default_factory=set)
    old_messages: set[tuple[str, PlanKind]] = field(default_factory=set)
    in_flight: bool = False

    @property
    def mission(self) -> Plan:
        """The mission."""
        return self.plans[_MISSION]

    @property
    def fence(self) -> Plan:
        """The fence."""
        return self.plans[PlanKind.FENCE]

    @property
    def rally(self) -> Plan:
        """The rally points."""
        return self.plans[PlanKind.RALLY]

    def set_plan(
        self, kind: PlanKind, items: Sequence[PlanItem], *, compares: bool = False
    ) -> None:
        """Replace one plan; a new mission keeps the number of the present item, a cleared one has none.

        Args:
            kind: Of the plan.
            items: Of the plan.
            compares: A plan with the items of the present one changes nothing. Another mission starts at the item
                that the client calls current, or without one at the present number (PX4).
        """
        if compares and items and _contents(items) == _contents(self.plans[kind].items):
            return
        before = len(self.plans[kind].items)
        self.plans[kind] = Plan(
            tuple(items), self.plans[kind].revision + 1, zlib.crc32(_packed(items))
        )
        self.news.add(kind)
        if kind is PlanKind.MISSION:
            if compares:
                # The last item marked as current; else the present number, or the last item of a shorter mission.
                marked = [item.seq for item in items if item.current]
                self.current = max(min(self.current, before - 1, len(items) - 1), 0)
                if marked:
                    self.current = marked[-1]
            elif not items:
                self.current = 0


def _contents(items: Sequence[PlanItem]) -> bytes:
    """Return what PX4 compares: every field but which item is current."""
    return _packed([item._replace(current=0) for item in items])


def _packed(items: Sequence[PlanItem]) -> bytes:
    return b"".join(struct.pack("<HBHBBffffiif", *item) for item in items)


def item_fault(
    kind: PlanKind, item: PlanItem, commands: frozenset[int], *, any_place: bool
) -> MissionResult:
    """Check one item.

    Args:
        kind: Of its plan.
        item: The item.
        commands: Mission commands that the flavour knows.
        any_place: Whether coordinates and height are left unchecked, as PX4 does.
    """
    known = {
        PlanKind.MISSION: commands,
        PlanKind.FENCE: POLYGONS | CIRCLES | {FENCE_RETURN},
        PlanKind.RALLY: {RALLY_POINT},
    }
    if item.command not in known[kind]:
        return MissionResult.UNSUPPORTED
    if item.command in POLYGONS and not 3.0 <= item.param1 < math.inf:
        return MissionResult.ERROR
    has_place = item.command in WITH_PLACE or kind is not PlanKind.MISSION
    if item.frame not in GLOBAL_FRAMES and (has_place or item.frame != MISSION_FRAME):
        return MissionResult.UNSUPPORTED_FRAME
    fault = MissionResult.ACCEPTED
    if has_place and not any_place:
        free = item.command in WITH_PLACE and item.command != NAV_WAYPOINT  # optional
        if not (abs(item.latitude_deg) <= 90.0 or (free and item.x == INT32_NAN)):
            fault = MissionResult.INVALID_PARAM5_X
        elif not (abs(item.longitude_deg) <= 180.0 or (free and item.y == INT32_NAN)):
            fault = MissionResult.INVALID_PARAM6_Y
        elif math.isinf(item.z) or (math.isnan(item.z) and item.command in NEEDS_ALTITUDE):
            fault = MissionResult.INVALID_PARAM7
    return fault


def plan_fault(kind: PlanKind, items: Sequence[PlanItem], *, any_radius: bool) -> MissionResult:
    """Check a whole plan: each polygon's vertices are consecutive and complete, and a circle has a positive radius.

    Args:
        kind: Of the plan.
        items: Of the plan.
        any_radius: Whether the radius of a circle is left unchecked, as PX4 does.
    """
    if kind is not PlanKind.FENCE:
        return MissionResult.ACCEPTED
    if not any_radius and any(
        item.command in CIRCLES and not 0.0 < item.param1 < math.inf for item in items
    ):
        return MissionResult.ERROR
    at = 0
    while at < len(items):
        item = items[at]
        size = int(item.param1) if item.command in POLYGONS else 1
        group = items[at : at + size]
        if len(group) < size or any(
            (other.command, other.param1) != (item.command, item.param1) for other in group
        ):
            return MissionResult.INVALID
        at += size
    return MissionResult.ACCEPTED
