"""The mission protocol on one link: upload, download, clearing, choice of the current item.

Repeated requests of a download are answered again.
Source: https://mavlink.io/en/services/mission.html
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.command import MAV_FRAME_GLOBAL, coordinate
from sitl_mock.protocols.mission_upload import PLAN_KINDS, MissionUpload, acknowledge, read_item
from sitl_mock.protocols.plan import NAV_WAYPOINT, MissionResult, PlanItem, PlanKind, PlanStore
from sitl_mock.protocols.services import Place
from sitl_mock.protocols.session import Reply, source_of

if TYPE_CHECKING:
    from sitl_mock.mavlink import Message
    from sitl_mock.protocols.mission_upload import MissionRules

ALL_KINDS: Final = 255

ORDERS: Final = frozenset({2, 3})
"""Values of MISSION_ITEM.current that mean: fly there, or change the height."""

_FLOAT_FRAMES: Final = {5: 0, 6: 3}
"""Frames of a MISSION_ITEM instead of those of a MISSION_ITEM_INT."""

Guide = Callable[[float, PlanItem], bool]
SetCurrent = Callable[[float, int], list[Reply]]


class MissionProtocol:
    """Plans on one link, over the vehicle's store.

    Args:
        plans: The vehicle's plans.
        rules: The flavour's rules.
        set_current: ``set_current(now_s, seq)`` for MISSION_SET_CURRENT; its replies are sent.
        home: Returns home, for rules that have it as item 0.
        guide: ``guide(now_s, item)`` handles an item with current 2 or 3 (older clients' "fly there") and returns True
            if it is flown; None if the flavour has no such items.
        timed_out: Called when a client has ended neither its upload nor its download in time.
    """

    def __init__(
        self,
        plans: PlanStore,
        rules: MissionRules,
        set_current: SetCurrent,
        home: Callable[[], Place] = lambda: Place(0.0, 0.0, 0.0),
        guide: Guide | None = None,
        timed_out: Callable[[], None] = lambda: None,
    ) -> None:
        self._plans = plans
        self._rules = rules
        self._set_current = set_current
        self._home = home
        self._guide = guide
        self._timed_out = timed_out
        self._downloaded_s = -math.inf
        self._upload = MissionUpload(plans, rules)

    @property
    def is_idle(self) -> bool:
        """True unless this link has a transfer in progress."""
        return not self._upload.active and self._downloaded_s == -math.inf

    def handle(self, now_s: float, message: Message) -> list[Reply]:
        """Take any message of the mission protocol."""
        replies: list[Reply] = []
        match message.get_type():
            case "MISSION_COUNT":
                replies = self._upload.start(now_s, message)
            case "MISSION_WRITE_PARTIAL_LIST":
                replies = self._upload.start_partial(now_s, message)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                replies = self._take(now_s, message)
            case "MISSION_ACK":  # the end of a download, or a cancelled upload
                self._upload.cancel(message)
                self._downloaded_s = -math.inf
            case "MISSION_REQUEST_LIST":
                partner = source_of(message)
                kind = message.mission_type
                if kind in PLAN_KINDS:
                    count = len(self._plans.plans[PlanKind(kind)].items)
                    if count:
                        self._downloaded_s = now_s
                    replies = [("MISSION_COUNT", *partner, count, kind)]
                else:
                    replies = [acknowledge(partner, MissionResult.UNSUPPORTED, kind)]
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                replies = self._item(now_s, message)
            case "MISSION_CLEAR_ALL":
                replies = self._clear(now_s, message)
            case "MISSION_SET_CURRENT":
                replies = self._set_current(now_s, message.seq)
        return replies

    def advance(self, now_s: float) -> list[Reply]:
        """Request a missing item again, or give up the transfer."""
        is_uploading = self._upload.active
        replies = self._upload.advance(now_s)
        is_late = self._downloaded_s > -math.inf and not self._is_downloading(now_s)
        if is_late:
            self._downloaded_s = -math.inf
        if is_late or (is_uploading and not self._upload.active):
            self._timed_out()
        return replies

    def _is_downloading(self, now_s: float) -> bool:
        return now_s - self._downloaded_s < self._rules.timeout_s

    def _note_old(self, message: Message) -> None:
        """Note a message without integer coordinates, which the autopilot warns of."""
        kind = message.mission_type
        if self._rules.warns_of_old and kind in PLAN_KINDS:
            self._plans.old_messages.add((message.get_type(), PlanKind(kind)))

    def _take(self, now_s: float, message: Message) -> list[Reply]:
        if (
            self._guide is None
            or message.current not in ORDERS
            or message.mission_type != PlanKind.MISSION
        ):
            if message.get_type() == "MISSION_ITEM":
                self._note_old(message)
            return self._upload.take(now_s, message)
        obeyed = self._guide(now_s, read_item(message))
        result = MissionResult.ACCEPTED if obeyed else MissionResult.ERROR
        return [acknowledge(source_of(message), result, PlanKind.MISSION)]

    def _item(self, now_s: float, message: Message) -> list[Reply]:
        partner = source_of(message)
        kind = message.mission_type
        seq = message.seq
        if kind not in PLAN_KINDS:
            return [acknowledge(partner, MissionResult.UNSUPPORTED, kind)]
        items = self._plans.plans[PlanKind(kind)].items
        if seq == 0 and kind == PlanKind.MISSION and self._rules.home_first:
            # The first item of a download is home.
            home = self._home()
            latitude = round(home.latitude_deg * 1e7)
            longitude = round(home.longitude_deg * 1e7)
            items = (
                PlanItem(
                    0,
                    MAV_FRAME_GLOBAL,
                    NAV_WAYPOINT,
                    0,
                    1,
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                    latitude,
                    longitude,
                    home.altitude_m,
                ),
                *items[1:],
            )
        if seq >= len(items):
            return [acknowledge(partner, MissionResult.INVALID_SEQUENCE, kind)]
        if kind == PlanKind.RALLY and self._rules.rally_as_items:
            current = int(seq == 0)
        else:
            current = int(kind == PlanKind.MISSION and seq == self._plans.current)
        item = items[seq]._replace(seq=seq, current=current)
        if self._is_downloading(now_s):
            self._downloaded_s = now_s
        if message.get_type() == "MISSION_REQUEST_INT":
            return [("MISSION_ITEM_INT", *partner, *item, kind)]
        self._note_old(message)
        x, y = (coordinate(value, item.frame) for value in (item.x, item.y))
        frame = _FLOAT_FRAMES.get(item.frame, item.frame)
        return [("MISSION_ITEM", *partner, *item._replace(frame=frame, x=x, y=y), kind)]

    def _clear(self, now_s: float, message: Message) -> list[Reply]:
        partner = source_of(message)
        kind = message.mission_type
        if kind not in PLAN_KINDS | {ALL_KINDS}:
            return [acknowledge(partner, MissionResult.UNSUPPORTED, kind)]
        is_locked = self._plans.in_flight and kind in {PlanKind.MISSION, ALL_KINDS}
        if is_locked or self._upload.active or self._upload.busy(now_s, partner):
            return [acknowledge(partner, MissionResult.ERROR, kind)]
        if self._rules.deaf_in_download and self._is_downloading(now_s):
            return []
        for plan_kind in PlanKind if kind == ALL_KINDS else (PlanKind(kind),):
            self._plans.set_plan(plan_kind, ())
        return [acknowledge(partner, MissionResult.ACCEPTED, kind)]
