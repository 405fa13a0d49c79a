"""What the telemetry is made from: one vehicle at one instant."""

import math
from dataclasses import dataclass

from sitl_mock.brain import Brain
from sitl_mock.craft import Craft
from sitl_mock.dynamics import Setpoint
from sitl_mock.flavour import Flavour
from sitl_mock.world import Home

_INT16 = 32767


@dataclass(slots=True)
class Report:
    """One vehicle at one instant; the vehicle keeps one and renews its times.

    Attributes:
        flavour: What does not change.
        craft: Shared state.
        brain: The flavour's state.
        setpoint: What the motors are asked to do.
        boot_ms: Time since boot, as it goes on the wire (32 bits).
        boot_us: The same in microseconds, not wrapped.
        unix_us: Time of the autopilot's clock since 1970.
        place: Estimated place on Earth.
        sequence: Counts PING.
    """

    flavour: Flavour
    craft: Craft
    brain: Brain
    setpoint: Setpoint
    boot_ms: int = 0
    boot_us: int = 0
    unix_us: int = 0
    sequence: int = 0

    @property
    def place(self) -> Home:
        """Estimated place on Earth."""
        return self.craft.frame.to_geodetic(*self.craft.position_m)

    @property
    def relative_m(self) -> float:
        """Estimated height above home."""
        home = self.craft.home_m
        return (home[2] if home is not None else 0.0) - self.craft.position_m[2]


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Attitude as a unit quaternion w, x, y, z (aerospace order)."""
    c_r, s_r = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    c_p, s_p = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    c_y, s_y = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        c_r * c_p * c_y + s_r * s_p * s_y,
        s_r * c_p * c_y - c_r * s_p * s_y,
        c_r * s_p * c_y + s_r * c_p * s_y,
        c_r * c_p * s_y - s_r * s_p * c_y,
    )


def int16(value: float) -> int:
    """Round into a signed 16-bit field, clipped."""
    return int(min(max(value, -_INT16), _INT16))


def heading_cdeg(yaw_rad: float) -> int:
    """Heading as centidegrees in [0, 35999]."""
    return int(math.degrees(yaw_rad) * 100.0) % 36000
