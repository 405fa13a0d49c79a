"""The pilot's sticks and mode switch, from a radio or from MANUAL_CONTROL, and the heartbeats of other systems."""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Final, NamedTuple

_NEVER_S = -math.inf
OVERRIDE_S: Final = 3.0
"""RC_CHANNELS_OVERRIDE stays in force for this long (RC_OVERRIDE_TIME)."""
THROTTLE: Final = 3
SWITCH_STEPS_US: Final = (1231, 1361, 1491, 1621, 1750)
SWITCHED_LEAST_US = 800
SWITCHED_MOST_US = 2200


class Sticks(NamedTuple):
    """Stick positions in [-1, 1]: right, forward, up and clockwise are positive, centre is 0."""

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


CENTRED = Sticks()


@dataclass(slots=True)
class Pilot:
    """The pilot's input.

    Attributes:
        sticks: The last stick positions.
        heard_s: Their arrival; minus infinity before the first.
        moved: Largest stick movement since the mode was entered, as a fraction of full travel.
        radio_s: Last signal of a radio (not MANUAL_CONTROL or RC_CHANNELS_OVERRIDE).
        channels: Pulse widths (µs) of overridden channels, by number from 1.
    """

    sticks: Sticks = CENTRED
    heard_s: float = _NEVER_S
    moved: float = 0.0
    radio_s: float = _NEVER_S
    channels: dict[int, int] = field(default_factory=dict)

    def hear(self, now_s: float, sticks: Sticks) -> None:
        """Take new stick positions."""
        if self.heard_s > _NEVER_S:
            self.moved = max(
                self.moved, *(abs(a - b) for a, b in zip(sticks, self.sticks, strict=True))
            )
        self.sticks = sticks
        self.heard_s = now_s

    def radio_lost(self, now_s: float, timeout_s: float = 0.5) -> bool:
        """True if a radio was there and its signal is lost."""
        return self.radio_s > _NEVER_S and now_s - self.radio_s > timeout_s

    def throttle_below(self, now_s: float, least_us: float) -> bool:
        """True if a client overrides the throttle with less than a pulse width."""
        return (
            self.fresh(now_s, OVERRIDE_S)
            and self.channels.get(THROTTLE, SWITCHED_MOST_US) < least_us
        )

    def switch_position(self, channel: int) -> int | None:
        """Position (1 to 6) of the mode switch on an overridden channel; None if unknown."""
        pulse = self.channels.get(channel)
        if pulse is None or not SWITCHED_LEAST_US < pulse < SWITCHED_MOST_US:
            return None
        return 1 + bisect_right(SWITCH_STEPS_US, pulse)

    def settle(self) -> None:
        """Reset `moved` when a mode begins."""
        self.moved = 0.0

    @property
    def known(self) -> bool:
        """True if there has ever been pilot input."""
        return self.heard_s > _NEVER_S

    def fresh(self, now_s: float, timeout_s: float) -> bool:
        """True if the last pilot input is within the timeout."""
        return now_s - self.heard_s <= timeout_s


@dataclass(slots=True)
class Peers:
    """Arrival of the last HEARTBEAT of a ground station and of an onboard computer (seconds, -inf: never)."""

    ground_s: float = _NEVER_S
    onboard_s: float = _NEVER_S

    def hear(self, now_s: float, vehicle_type: int) -> None:
        """Take a HEARTBEAT of MAV_TYPE_GCS (6) or MAV_TYPE_ONBOARD_CONTROLLER (18); others do not count."""
        if vehicle_type == 6:
            self.ground_s = now_s
        elif vehicle_type == 18:
            self.onboard_s = now_s
