"""The pilot: sticks and a mode switch, from a radio or from MANUAL_CONTROL; and who else is on the links."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Final, NamedTuple

_NEVER_S = -math.inf
OVERRIDE_S: Final = 3.0
"""RC_CHANNELS_OVERRIDE holds for so long (RC_OVERRIDE_TIME)."""
THROTTLE: Final = 3
SWITCH_STEPS_US: Final = (1231, 1361, 1491, 1621, 1750)
SWITCHED_LEAST_US, SWITCHED_MOST_US = 800, 2200


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
        radio_s: When a radio of its own was last heard, and not a client's MANUAL_CONTROL or RC_CHANNELS_OVERRIDE.
        channels: Pulse widths of RC_CHANNELS_OVERRIDE's channels that hold, by number from 1 (µs).
    """

    sticks: Sticks = CENTRED
    heard_s: float = _NEVER_S
    moved: float = 0.0
    held: bool = False
    radio_s: float = _NEVER_S
    channels: dict[int, int] = field(default_factory=dict)

    def hear(self, now_s: float, sticks: Sticks) -> None:
        """Take new stick positions."""
        if self.heard_s > _NEVER_S:
            self.moved = max(self.moved, *(abs(a - b) for a, b in zip(sticks, self.sticks, strict=True)))
        self.sticks = sticks
        self.heard_s = now_s

    def radio_lost(self, now_s: float, timeout_s: float = 0.5) -> bool:
        """Whether there was a radio of its own and it has gone."""
        return self.radio_s > _NEVER_S and now_s - self.radio_s > timeout_s

    def throttle_below(self, now_s: float, least_us: float) -> bool:
        """Whether the throttle's channel, as a client overrides it, is below a pulse width."""
        return self.fresh(now_s, OVERRIDE_S) and self.channels.get(THROTTLE, SWITCHED_MOST_US) < least_us

    def switch_position(self, channel: int) -> int | None:
        """Position, 1 to 6, of the mode switch on a channel that a client overrides; None where it is not known."""
        pulse = self.channels.get(channel)
        if pulse is None or not SWITCHED_LEAST_US < pulse < SWITCHED_MOST_US:
            return None
        return 1 + bisect_right(SWITCH_STEPS_US, pulse)

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
