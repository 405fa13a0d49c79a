"""GPS receiver and barometer: the truth, sampled at their own rate, with white noise.

The estimator's error (`estimator.py`) varies slowly, that of a sensor does not; clients see both.
"""

import math
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple

from sitl_mock.dynamics import ZERO, Body
from sitl_mock.vector import Vector

_CALM_SD: Final = Vector((0.0, 0.0, 0.0))


class Fix(NamedTuple):
    """One GPS reading.

    Attributes:
        at_s: Its time; minus infinity before the first.
        position_m: North, east, down in the local frame.
        velocity_m_s: North, east, down.
    """

    at_s: float = -math.inf
    position_m: Vector = ZERO
    velocity_m_s: Vector = ZERO


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of the readings, and the interval of GPS readings.

    Attributes:
        position_sd_m: Receiver's position, north, east, down.
        velocity_sd_m_s: Receiver's velocity, north, east, down.
        fix_s: Interval of the receiver's readings.
        barometer_sd_m: Barometer's height.
        attitude_sd_rad: Estimated roll and pitch on the ground; the heading's is three times as much.
        gyro_sd_rad_s: Body rates.
        accelerometer_sd_m_s2: Specific force.
        magnetometer_sd_gauss: Field.
        still_sd: Estimated position (metres) and velocity (m/s) on the ground, without a `ground_wander`.
    """

    position_sd_m: Vector = _CALM_SD
    velocity_sd_m_s: Vector = _CALM_SD
    fix_s: float = 0.125
    barometer_sd_m: float = 0.0
    attitude_sd_rad: float = 0.0
    gyro_sd_rad_s: float = 0.0
    accelerometer_sd_m_s2: float = 0.0
    magnetometer_sd_gauss: float = 0.0
    still_sd: float = 0.0


@dataclass(slots=True)
class Sensors:
    """A receiver and a barometer.

    Attributes:
        noise: Their noise.
        random: Its seeded source.
        fix: The receiver's last reading.
        barometer_down_m: The barometer's reading at that time, in the local frame.
    """

    noise: SensorNoise
    random: Random
    fix: Fix = Fix()  # noqa: RUF009 - an immutable value
    barometer_down_m: float = 0.0
    _next_s: float = -math.inf
    _scatters: tuple[tuple[float, ...], ...] = ()
    _spare: float | None = None

    def normals(self, count: int) -> list[float]:
        """Return `count` normal deviates; they are drawn in pairs, and an odd one is kept for the next call."""
        uniform = self.random.random
        if self._spare is None:
            drawn = []
        else:
            drawn = [self._spare]
        while len(drawn) < count:
            turn = uniform() * math.tau
            far = math.sqrt(-2.0 * math.log(1.0 - uniform()))
            drawn += (math.cos(turn) * far, math.sin(turn) * far)
        self._spare = drawn.pop() if len(drawn) > count else None
        return drawn

    def scatter(self) -> tuple[float, ...]:
        """Return nine normal deviates from a table drawn once, which makes noise cheap."""
        if not self._scatters:
            self._scatters = tuple(tuple(self.normals(9)) for _ in range(_SCATTERS))
        return self._scatters[int(self.random.random() * _SCATTERS)]

    def advance(self, now_s: float, body: Body) -> None:
        """Take a reading when one is due."""
        if now_s < self._next_s - 1e-9:
            return
        noise = self.noise
        self._next_s = (
            now_s + noise.fix_s if self._next_s == -math.inf else self._next_s + noise.fix_s
        )
        self.fix = Fix(
            now_s,
            self._scattered(body.position_ned_m, noise.position_sd_m),
            self._scattered(body.velocity_ned_m_s, noise.velocity_sd_m_s),
        )
        self.barometer_down_m = body.position_ned_m[2] + noise.barometer_sd_m * self.normals(1)[0]

    def _scattered(self, vector: Vector, sd: Vector) -> Vector:
        if sd is _CALM_SD:
            return vector
        north, east, down = self.normals(3)
        return vector + sd.scaled(Vector((north, east, down)))


_SCATTERS: Final = 257
EXACT: Final = SensorNoise()
"""Readings without noise."""
PX4_SENSORS: Final = SensorNoise(
    Vector((0.2, 0.2, 0.5)), Vector((0.06, 0.077, 0.158)), 0.125, 0.063, 0.0003, 0.0066, 0.07, 0.015
)
"""PX4 v1.17's simulated receiver and barometer; the recorded chase shows the same scatter (0.21 and 0.54 m at 8 Hz)."""
ARDUPILOT_SENSORS: Final = SensorNoise(
    attitude_sd_rad=1.2e-5,
    gyro_sd_rad_s=3e-4,
    accelerometer_sd_m_s2=0.0025,
    still_sd=2.5e-4,
)
"""ArduCopter 4.5.7's simulator at rest (measured); its receiver and barometer move by less than their last place."""
