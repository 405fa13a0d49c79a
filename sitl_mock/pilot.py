"""The pilot: sticks and a mode switch, from a radio or from MANUAL_CONTROL; and who else is on the links."""

import math
from dataclasses import dataclass
from typing import NamedTuple

_NEVER_S = -math.inf


class Sticks(NamedTuple):
    """Stick positions in [-1, 1]: right, forward, up and clockwise are positive, centre is 0."""

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


CENTRED = Sticks()


@dataclass(slots=True)
class Pilot:
    """What the radio says.

    Attributes:
        sticks: The last stick positions.
        heard_s: When they came; minus infinity if there never was a radio.
        moved: How far any stick has moved since the mode was entered, a fraction of full travel.
        held: The radio is injected and sends without end (a fixed source), so `heard_s` follows the clock.
    """

    sticks: Sticks = CENTRED
    heard_s: float = _NEVER_S
    moved: float = 0.0
    held: bool = False

    def hear(self, now_s: float, sticks: Sticks) -> None:
        """Take new stick positions."""
        if self.heard_s > _NEVER_S:
            self.moved = max(self.moved, *(abs(a - b) for a, b in zip(sticks, self.sticks, strict=True)))
        self.sticks = sticks
        self.heard_s = now_s

    def settle(self) -> None:
        """Forget how far the sticks have moved: a mode begins."""
        self.moved = 0.0

    @property
    def known(self) -> bool:
        """Whether there ever was a radio."""
        return self.heard_s > _NEVER_S

    def fresh(self, now_s: float, timeout_s: float) -> bool:
        """Whether the radio was heard within the timeout."""
        return now_s - self.heard_s <= timeout_s


@dataclass(slots=True)
class Peers:
    """When HEARTBEATs of a ground station and of an onboard computer were last heard (seconds, -inf: never)."""

    ground_s: float = _NEVER_S
    onboard_s: float = _NEVER_S

    def hear(self, now_s: float, vehicle_type: int) -> None:
        """Take a HEARTBEAT of MAV_TYPE_GCS (6) or MAV_TYPE_ONBOARD_CONTROLLER (18); others do not count."""
        if vehicle_type == 6:
            self.ground_s = now_s
        elif vehicle_type == 18:
            self.onboard_s = now_s
