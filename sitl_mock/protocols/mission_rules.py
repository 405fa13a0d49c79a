"""What differs between the flavours in the mission protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sitl_mock.protocols.plan import PlanKind

if TYPE_CHECKING:
    from collections.abc import Mapping

_COMMON: Final = frozenset(
    {16, 17, 19, 20, 21, 22, 31, 82, 84, 85, 93, 112, 114, 115, 177, 178, 179, 183, 189, 195, 197}
)
_PAYLOAD: Final = frozenset({181, 184, 201, 203, 205, 206, 211, 1000, 2000, 2001, 2500, 2501, 530, 531, 600})


@dataclass(frozen=True, slots=True)
class MissionRules:
    """How a flavour transfers plans.

    Attributes:
        capacity: Most items of each kind.
        commands: Mission commands that are taken.
        partial: MISSION_WRITE_PARTIAL_LIST is served.
        cancel_on_timeout: An upload given up for silence is answered with OPERATION_CANCELLED.
        resend_s: A missing item is asked for again after this time.
        timeout_s: An upload without any item for this long is given up.
        asks_with: Message that asks for an item.
        home_first: Item 0 of a mission is home, also where there is no mission.
    """

    capacity: Mapping[PlanKind, int]
    commands: frozenset[int]
    partial: bool
    cancel_on_timeout: bool
    resend_s: float = 0.05
    timeout_s: float = 5.0
    asks_with: str = "MISSION_REQUEST_INT"
    home_first: bool = False


PX4_MISSION_RULES: Final = MissionRules(
    capacity={PlanKind.MISSION: 2000, PlanKind.FENCE: 64, PlanKind.RALLY: 32},
    commands=_COMMON | _PAYLOAD | {4501},
    partial=False,
    cancel_on_timeout=False,
)
"""PX4 asks again after 250 ms; 50 ms lets 500 items through 10 % loss each way in seconds."""

ARDUPILOT_MISSION_RULES: Final = MissionRules(
    capacity={PlanKind.MISSION: 724, PlanKind.FENCE: 84, PlanKind.RALLY: 12},
    commands=_COMMON | _PAYLOAD | {18, 92, 94, 218, 222, 223},
    partial=True,
    cancel_on_timeout=True,
    timeout_s=8.0,
    asks_with="MISSION_REQUEST",
    home_first=True,
)
