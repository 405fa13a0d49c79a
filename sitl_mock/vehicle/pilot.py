"""The pilot's sticks and mode switch, from a radio or from MANUAL_CONTROL, and the heartbeats of other systems."""

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

_NEVER_S = -math.inf
RADIO_HELD_S: Final = 3.0
"""A radio's last stick positions stay in force for this long after its signal is lost."""
OVERRIDE_TIME: Final = "RC_OVERRIDE_TIME"
ROLL: Final = 1
PITCH: Final = 2
THROTTLE: Final = 3
YAW: Final = 4
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


class Override(NamedTuple):
    """One overridden channel: pulse width (µs) and arrival of the message that set it."""

    pulse_us: int
    heard_s: float


def override_time_s(parameters: Mapping[str, float]) -> float:
    """Time for which an overridden channel keeps its value (ArduPilot's RC_OVERRIDE_TIME).

    A negative value means for ever; 0 turns overrides off.
    """
    time_s = float(parameters.get(OVERRIDE_TIME, 0.0))
    return time_s if time_s >= 0.0 else math.inf


def stick_of(pulse_us: int) -> float:
    """Stick position in [-1, 1] for a pulse width."""
    return min(max((pulse_us - 1500) / 500.0, -1.0), 1.0)


@dataclass(slots=True)
class Pilot:
    """The pilot's input.

    Attributes:
        sticks: The last stick positions.
        heard_s: Their arrival; minus infinity before the first.
        moved: Largest stick movement since the mode was entered, as a fraction of full travel.
        speed_1_s: Greatest speed of a stick since then, in full travels per second.
        radio_s: Last signal of a radio (not MANUAL_CONTROL or RC_CHANNELS_OVERRIDE).
        channels: Overridden channels, by number from 1.
        overridden_s: Arrival of the last override; minus infinity before the first.
    """

    sticks: Sticks = CENTRED
    heard_s: float = _NEVER_S
    moved: float = 0.0
    speed_1_s: float = 0.0
    radio_s: float = _NEVER_S
    channels: dict[int, Override] = field(default_factory=dict)
    overridden_s: float = _NEVER_S

    def hear(self, now_s: float, sticks: Sticks) -> None:
        """Take new stick positions."""
        if self.heard_s > _NEVER_S:
            moved = max(abs(a - b) for a, b in zip(sticks, self.sticks, strict=True))
            self.moved = max(self.moved, moved)
            if now_s > self.heard_s:
                self.speed_1_s = max(self.speed_1_s, moved / (now_s - self.heard_s))
        self.sticks = sticks
        self.heard_s = now_s

    def radio_lost(self, now_s: float, timeout_s: float = 0.5) -> bool:
        """True if a radio was there and its signal is lost."""
        return self.radio_s > _NEVER_S and now_s - self.radio_s > timeout_s

    def override(self, now_s: float, channel: int, pulse_us: int) -> None:
        """Override one channel."""
        self.channels[channel] = Override(pulse_us, now_s)
        self.overridden_s = now_s

    def release(self, channel: int) -> None:
        """Give one channel back to the radio."""
        self.channels.pop(channel, None)

    def pulse_us(self, channel: int, now_s: float, time_s: float) -> int | None:
        """Pulse width of an overridden channel; None if it is not overridden, or longer ago than `time_s`."""
        override = self.channels.get(channel)
        if override is None or now_s - override.heard_s >= time_s:
            return None
        return override.pulse_us

    def overriding(self, sticks: Sticks, now_s: float, time_s: float) -> Sticks:
        """Return stick positions with the overridden channels in their place."""
        pulses = (self.pulse_us(channel, now_s, time_s) for channel in (ROLL, PITCH, THROTTLE, YAW))
        roll, pitch, throttle, yaw = pulses
        return Sticks(
            sticks.roll if roll is None else stick_of(roll),
            sticks.pitch if pitch is None else -stick_of(pitch),
            sticks.throttle if throttle is None else stick_of(throttle),
            sticks.yaw if yaw is None else stick_of(yaw),
        )

    def throttle_below(self, now_s: float, time_s: float, least_us: float) -> bool:
        """True if a client overrides the throttle with less than a pulse width."""
        pulse_us = self.pulse_us(THROTTLE, now_s, time_s)
        return pulse_us is not None and pulse_us < least_us

    def switch_position(self, channel: int, now_s: float, time_s: float) -> int | None:
        """Position (1 to 6) of the mode switch on an overridden channel; None if unknown."""
        pulse_us = self.pulse_us(channel, now_s, time_s)
        if pulse_us is None or not SWITCHED_LEAST_US < pulse_us < SWITCHED_MOST_US:
            return None
        return 1 + bisect_right(SWITCH_STEPS_US, pulse_us)

    def settle(self) -> None:
        """Reset the stick movements when a mode begins."""
        self.moved = 0.0
        self.speed_1_s = 0.0

    @property
    def known(self) -> bool:
        """True if there has ever been pilot input."""
        return max(self.heard_s, self.overridden_s) > _NEVER_S

    def fresh(self, now_s: float, timeout_s: float) -> bool:
        """True if the last pilot input is within the timeout."""
        return now_s - max(self.heard_s, self.overridden_s) <= timeout_s


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
