"""Source of the telemetry: one vehicle at one time."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from sitl_mock.dynamics import Setpoint
from sitl_mock.dynamics.shaping import Reference
from sitl_mock.flavour import Commander, Flavour
from sitl_mock.protocols import EventLog
from sitl_mock.vehicle_state import VehicleState
from sitl_mock.world import Home

_INT16 = 32767


@dataclass(slots=True)
class Report:
    """One vehicle at one time; each vehicle has one and updates its times.

    Attributes:
        flavour: Constant data.
        state: Shared state.
        commander: The flavour's state.
        setpoint: The present setpoint.
        events: Events sent so far.
        boot_ms: Time since boot in wire format (32 bits).
        boot_us: The same in microseconds, not wrapped.
        epoch_us: Time of the autopilot's clock since 1970 at time 0.
        place: Estimated place on Earth.
        sequence: Counter of PING.
        reference: Returns the controller's reference motion, or None.
    """

    flavour: Flavour
    state: VehicleState
    commander: Commander
    setpoint: Setpoint
    events: EventLog
    epoch_us: int
    reference: Callable[[], Reference | None]
    boot_ms: int = 0
    boot_us: int = 0
    sequence: int = 0

    @property
    def standard_modes(self) -> dict[int, int]:
        """MAV_STANDARD_MODE by custom_mode."""
        return {mode.number: mode.standard for mode in self.flavour.modes.available()}

    @property
    def unix_us(self) -> int:
        """Time of the autopilot's clock since 1970, in microseconds."""
        return self.epoch_us + int(self.state.now_s * 1e6)

    @property
    def place(self) -> Home:
        """Estimated place on Earth."""
        return self.state.frame.to_geodetic(*self.state.position_m)

    @property
    def relative_m(self) -> float:
        """Estimated height above home."""
        home = self.state.home_m
        return (home[2] if home is not None else 0.0) - self.state.position_m[2]


def int16(value: float) -> int:
    """Round into a signed 16-bit field, clipped."""
    if -_INT16 <= value <= _INT16:
        return int(value)
    return int(min(max(value, -_INT16), _INT16))


def heading_cdeg(yaw_rad: float) -> int:
    """Heading as centidegrees in [0, 35999]."""
    return int(math.degrees(yaw_rad) * 100.0) % 36000
