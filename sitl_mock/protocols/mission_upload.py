"""Upload of a plan: the vehicle requests each item, and requests lost items again.

A plan replaces the old one only when all its items have arrived and pass the checks. Source: https://mavlink.io/en/services/mission.html#uploading_mission
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.protocols.command import GLOBAL_FRAMES, INT32_NAN, MISSION_FRAME
from sitl_mock.protocols.plan import (
    MissionResult,
    PlanItem,
    PlanKind,
    PlanStore,
    item_fault,
    plan_fault,
)
from sitl_mock.protocols.session import Reply, source_of
from sitl_mock.protocols.stored_items import (
    ARDUPILOT_COMMANDS,
    PX4_COMMANDS,
    as_sent,
    stored_by_ardupilot,
    stored_by_px4,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.mavlink import Message


@dataclass(frozen=True, slots=True)
class MissionRules:
    """Rules of a flavour for transfers of plans.

    Attributes:
        capacity: Most items of each kind.
        commands: Accepted mission commands.
        partial: MISSION_WRITE_PARTIAL_LIST is supported.
        cancel_on_timeout: A timed-out upload is answered with OPERATION_CANCELLED.
        resend_s: Time after which a missing item is requested again.
        timeout_s: Time without an item after which an upload is given up.
        asks_with: Message that requests an item.
        home_first: Item 0 of a mission is home, even of an empty mission.
        any_place: Coordinates and heights are not checked: latitudes of 91 degrees and waypoints without a height are
            stored (PX4, measured).
        any_radius: A fence circle's radius is not checked (PX4); else a plan with one of 0 or less is refused.
        warns_of_old: MISSION_ITEM and MISSION_REQUEST are answered with a warning, once for each kind of plan.
        deaf_in_download: MISSION_CLEAR_ALL is not answered while a client downloads.
        stored: What is stored of a mission's item, or why it is refused.
        keeps_part: The items before a refused one replace those of the old mission (ArduPilot).
        compares: An upload of the plan that is there changes nothing, and another mission does not start at its first
            item unless the client calls that one current (PX4).
    """

    capacity: Mapping[PlanKind, int]
    commands: frozenset[int]
    partial: bool
    cancel_on_timeout: bool
    resend_s: float = 0.05
    timeout_s: float = 5.0
    asks_with: str = "MISSION_REQUEST_INT"
    home_first: bool = False
    any_place: bool = False
    any_radius: bool = False
    warns_of_old: bool = False
    deaf_in_download: bool = False
    compares: bool = False
    keeps_part: bool = False
    rally_as_items: bool = False
    stored: Callable[[PlanItem], PlanItem | MissionResult] = as_sent


PX4_MISSION_RULES: Final = MissionRules(
    capacity={PlanKind.MISSION: 10000, PlanKind.FENCE: 64, PlanKind.RALLY: 32},
    commands=PX4_COMMANDS,
    stored=stored_by_px4,
    partial=False,
    cancel_on_timeout=False,
    any_place=True,
    any_radius=True,
    deaf_in_download=True,
    compares=True,
    rally_as_items=True,
)
"""PX4 requests again after 250 ms; with 50 ms, 500 items pass 10 % loss each way within seconds."""

ARDUPILOT_MISSION_RULES: Final = MissionRules(
    capacity={PlanKind.MISSION: 724, PlanKind.FENCE: 84, PlanKind.RALLY: 12},
    commands=ARDUPILOT_COMMANDS,
    stored=stored_by_ardupilot,
    keeps_part=True,
    partial=True,
    cancel_on_timeout=True,
    timeout_s=8.0,
    asks_with="MISSION_REQUEST",
    home_first=True,
    warns_of_old=True,
)


PLAN_KINDS: Final = frozenset(PlanKind)
_WHOLE_FRAMES: Final = {0: 5, 3: 6}
"""MAV_FRAME of whole degrees by that of floats, absolute and relative."""
_WARNING: Final = 4  # MAV_SEVERITY
_REFUSED: Final[tuple[Reply, ...]] = tuple(
    ("STATUSTEXT", _WARNING, text, 0, 0)
    for text in ("Non-positive circle radius", "Fence validation failed")
)
"""ArduPilot's texts for a fence with a circle of no radius."""


@dataclass(slots=True)
class _Transfer:
    """Upload of items ``len(head)`` to ``last``; ``items`` have arrived, head and tail come from the old plan."""

    kind: PlanKind
    partner: tuple[int, int]
    last: int
    head: tuple[PlanItem, ...] = ()
    tail: tuple[PlanItem, ...] = ()
    items: list[PlanItem] = field(default_factory=list)
    asked_s: float = 0.0
    heard_s: float = 0.0

    @property
    def wanted(self) -> int:
        return len(self.head) + len(self.items)


class _Finished(NamedTuple):
    """The last accepted upload, for a client that missed the ACK and resends its last item."""

    kind: int
    partner: tuple[int, int]
    last: int


class MissionUpload:
    """Uploads on one link; at most one at a time for the vehicle."""

    def __init__(self, plans: PlanStore, rules: MissionRules) -> None:
        self._plans = plans
        self._rules = rules
        self._transfer: _Transfer | None = None
        self._finished: _Finished | None = None

    @property
    def active(self) -> bool:
        """True if this link has an upload in progress."""
        return self._transfer is not None

    def busy(self, now_s: float, partner: tuple[int, int]) -> bool:
        """True if another client, on any link, is uploading."""
        if self._transfer is not None:
            return self._transfer.partner != partner
        return self._plans.uploader is not None and now_s < self._plans.uploader_until_s

    def start(self, now_s: float, message: Message) -> list[Reply]:
        """Take MISSION_COUNT."""
        partner = source_of(message)
        if message.mission_type not in PLAN_KINDS:
            return [acknowledge(partner, MissionResult.UNSUPPORTED, message.mission_type)]
        kind = PlanKind(message.mission_type)
        if self.busy(now_s, partner):
            return [acknowledge(partner, MissionResult.ERROR, kind)]
        self._end()
        if message.count > self._rules.capacity[kind]:
            return [acknowledge(partner, MissionResult.NO_SPACE, kind)]
        if message.count == 0:
            self._plans.set_plan(kind, ())
            return [acknowledge(partner, MissionResult.ACCEPTED, kind)]
        return self._begin(now_s, _Transfer(kind, partner, message.count - 1))

    def start_partial(self, now_s: float, message: Message) -> list[Reply]:
        """Take MISSION_WRITE_PARTIAL_LIST."""
        partner = source_of(message)
        if not self._rules.partial or message.mission_type != PlanKind.MISSION:
            return [acknowledge(partner, MissionResult.UNSUPPORTED, message.mission_type)]
        old = self._plans.mission.items
        first = message.start_index
        last = message.end_index
        if self.busy(now_s, partner) or not 0 <= first <= last < len(old):
            return [acknowledge(partner, MissionResult.ERROR, PlanKind.MISSION)]
        return self._begin(
            now_s, _Transfer(PlanKind.MISSION, partner, last, old[:first], old[last + 1 :])
        )

    def take(self, now_s: float, message: Message) -> list[Reply]:
        """Take MISSION_ITEM_INT or MISSION_ITEM."""
        transfer = self._transfer
        partner = source_of(message)
        if transfer is None:
            # Nobody has requested this item. It may be the last one of a finished upload, whose answer was lost.
            is_last = self._finished == _Finished(message.mission_type, partner, message.seq)
            result = MissionResult.ACCEPTED if is_last else MissionResult.ERROR
            return [acknowledge(partner, result, message.mission_type)]
        if partner != transfer.partner or message.mission_type != transfer.kind:
            return []
        self._heard(now_s, transfer)
        if message.seq != transfer.wanted:  # repeated or early: requested again in its turn
            refusal = acknowledge(partner, MissionResult.INVALID_SEQUENCE, transfer.kind)
            return [refusal] if message.seq > transfer.last else []
        item = self._checked(transfer.kind, read_item(message))
        if isinstance(item, MissionResult):
            self._end()
            # Some flavours keep the items that came before the refused one.
            if self._rules.keeps_part and transfer.kind is PlanKind.MISSION:
                new = (*transfer.head, *transfer.items)
                old = self._plans.mission.items[len(new) : transfer.last + 1]
                if new:
                    self._plans.set_plan(transfer.kind, (*new, *old, *transfer.tail))
            return [acknowledge(partner, item, transfer.kind)]
        transfer.items.append(item)
        if transfer.wanted <= transfer.last:
            return self._ask(now_s, transfer)
        plan_items = (*transfer.head, *transfer.items, *transfer.tail)
        self._end()
        fault = plan_fault(transfer.kind, plan_items, any_radius=self._rules.any_radius)
        if fault is MissionResult.ACCEPTED:
            self._plans.set_plan(transfer.kind, plan_items, compares=self._rules.compares)
            self._finished = _Finished(transfer.kind, transfer.partner, transfer.last)
        texts = _REFUSED if fault is MissionResult.ERROR else ()
        return [*texts, acknowledge(transfer.partner, fault, transfer.kind)]

    def _checked(self, kind: PlanKind, item: PlanItem) -> PlanItem | MissionResult:
        """Return what is stored of an item, or why it is refused."""
        if kind is PlanKind.MISSION:
            stored = self._rules.stored(item)
        elif kind is PlanKind.RALLY and self._rules.rally_as_items:
            stored = item._replace(frame=_WHOLE_FRAMES.get(item.frame, item.frame))
        else:
            stored = item
        if isinstance(stored, MissionResult):
            return stored
        fault = item_fault(kind, stored, self._rules.commands, any_place=self._rules.any_place)
        return stored if fault is MissionResult.ACCEPTED else fault

    def cancel(self, message: Message) -> None:
        """Take a client's MISSION_ACK, which cancels the upload."""
        transfer = self._transfer
        if transfer is not None and (source_of(message), message.mission_type) == (
            transfer.partner,
            transfer.kind,
        ):
            self._end()

    def advance(self, now_s: float) -> list[Reply]:
        """Request a missing item again, or give up the upload."""
        transfer = self._transfer
        if transfer is None:
            return []
        if now_s - transfer.heard_s >= self._rules.timeout_s:
            self._end()
            answer = acknowledge(transfer.partner, MissionResult.OPERATION_CANCELLED, transfer.kind)
            if self._rules.cancel_on_timeout:
                return [answer]
            return []
        if now_s - transfer.asked_s >= self._rules.resend_s:
            return self._ask(now_s, transfer)
        return []

    def _begin(self, now_s: float, transfer: _Transfer) -> list[Reply]:
        self._transfer = transfer
        self._finished = None
        self._plans.uploader = self
        self._heard(now_s, transfer)
        return self._ask(now_s, transfer)

    def _heard(self, now_s: float, transfer: _Transfer) -> None:
        transfer.heard_s = now_s
        self._plans.uploader_until_s = now_s + self._rules.timeout_s

    def _ask(self, now_s: float, transfer: _Transfer) -> list[Reply]:
        transfer.asked_s = now_s
        return [(self._rules.asks_with, *transfer.partner, transfer.wanted, int(transfer.kind))]

    def _end(self) -> None:
        if self._plans.uploader is self:
            self._plans.uploader = None
        self._transfer = None


def acknowledge(partner: tuple[int, int], result: MissionResult, kind: int) -> Reply:
    """Return a MISSION_ACK."""
    return ("MISSION_ACK", *partner, int(result), int(kind))


def read_item(message: Message) -> PlanItem:
    """Return the item in a MISSION_ITEM_INT or, with its coordinates scaled, in a MISSION_ITEM."""
    x = message.x
    y = message.y
    if message.get_type() == "MISSION_ITEM":
        if message.frame == MISSION_FRAME:
            scale = 1.0
        elif message.frame in GLOBAL_FRAMES:
            scale = 1e7
        else:
            scale = 1e4
        x, y = (
            INT32_NAN
            if math.isnan(value)
            else round(min(max(value * scale, -(2.0**31)), 2.0**31 - 2))
            for value in (x, y)
        )
    return PlanItem(
        message.seq,
        message.frame,
        message.command,
        message.current,
        message.autocontinue,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        x,
        y,
        message.z,
    )
