"""What the autopilot believes about its motion, and how sure it is: estimate = truth + error.

The error is a damped oscillator driven by seeded noise, per axis: its position and velocity parts belong together
(the one is the derivative of the other), with standard deviations as measured between PX4's estimate and its
simulator's truth. Jumps and drifts are added to it. The control loop follows the estimate, so the truth wanders.
"""

import math
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

from sitl_mock.conditions import Conditions
from sitl_mock.world import Vector

_DAMPING = 0.5
_NOISE_STEP_S = 0.05
_RESET_M = 0.3
_RESET_LIMIT = 256


class Noise(NamedTuple):
    """Standard deviations of the estimate's error, north, east, down, and how fast uncertainty grows without GPS."""

    position_m: Vector
    velocity_m_s: Vector


PX4_NOISE = Noise((0.13, 0.21, 0.31), (0.17, 0.30, 0.16))
ARDUPILOT_NOISE = Noise((0.05, 0.05, 0.05), (0.03, 0.03, 0.03))


@dataclass(slots=True)
class Estimator:
    """The estimate's error and its validity.

    Attributes:
        noise: Size of the error; None for none.
        random: Source of the noise, seeded.
        ready_s: When the estimate becomes valid.
        position_limit_m: Horizontal uncertainty beyond which the position is invalid (COM_POS_FS_EPH).
        dead_reckoning_s: How long positions stay valid without GPS (EKF2_NOAID_TOUT).
        position_error_m: Present error.
        velocity_error_m_s: Present error.
        yaw_error_rad: Present error.
        eph_m: Horizontal uncertainty.
        position_valid: Local position and velocity may be used.
        global_valid: Global position may be used.
        altitude_valid: Height may be used.
        gps_ok: The receiver has a fix.
        reset_counter: Jumps so far, modulo 256 (ODOMETRY).
    """

    noise: Noise | None
    random: Random
    ready_s: float
    position_limit_m: float = 5.0
    dead_reckoning_s: float = 5.0
    position_error_m: Vector = (0.0, 0.0, 0.0)
    velocity_error_m_s: Vector = (0.0, 0.0, 0.0)
    yaw_error_rad: float = 0.0
    offset_m: Vector = (0.0, 0.0, 0.0)
    eph_m: float = 0.4
    position_valid: bool = False
    global_valid: bool = False
    altitude_valid: bool = False
    gps_ok: bool = False
    reset_counter: int = 0
    _lost_gps_s: float = math.inf
    _next_s: float = 0.0
    _wander_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _wander_m_s: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def advance(self, now_s: float, conditions: Conditions, *, flying: bool) -> None:
        """Move the error and the validity on to now_s."""
        if now_s + 1e-9 < self._next_s:
            return
        self._next_s = now_s + _NOISE_STEP_S
        if self.noise is not None and flying:
            self._wander(self.noise)
        self._judge(now_s, conditions)

    def jump(self, by_m: Vector) -> None:
        """Reset the position estimate: it moves by by_m at once and the reset counter rises."""
        north, east, down = self.offset_m
        self.offset_m = (north + by_m[0], east + by_m[1], down + by_m[2])
        self._sum()
        self.reset_counter = (self.reset_counter + 1) % _RESET_LIMIT

    def jump_yaw(self, by_rad: float) -> None:
        """Reset the heading estimate."""
        self.yaw_error_rad += by_rad
        self.reset_counter = (self.reset_counter + 1) % _RESET_LIMIT

    def _wander(self, noise: Noise) -> None:
        gauss, dt = self.random.gauss, _NOISE_STEP_S
        for axis in range(3):
            rate = noise.velocity_m_s[axis] / noise.position_m[axis]
            position, velocity = self._wander_m[axis], self._wander_m_s[axis]
            kick = noise.velocity_m_s[axis] * math.sqrt(4.0 * _DAMPING * rate * dt) * gauss(0.0, 1.0)
            velocity += (-rate * rate * position - 2.0 * _DAMPING * rate * velocity) * dt + kick
            self._wander_m[axis] = position + velocity * dt
            self._wander_m_s[axis] = velocity
        north, east, down = self._wander_m_s
        self.velocity_error_m_s = (north, east, down)
        self._sum()

    def _sum(self) -> None:
        (n, e, d), (o_n, o_e, o_d) = self._wander_m, self.offset_m
        self.position_error_m = (n + o_n, e + o_e, d + o_d)

    def _judge(self, now_s: float, conditions: Conditions) -> None:
        ready = now_s >= self.ready_s
        gps_lost = conditions.gps_lost
        self.gps_ok = ready and not gps_lost
        if not gps_lost:
            self._lost_gps_s = math.inf
        elif self._lost_gps_s == math.inf:
            self._lost_gps_s = now_s
        blind_s = max(0.0, now_s - self._lost_gps_s)
        self.eph_m = max(0.4 + 0.2 * blind_s * blind_s, conditions.eph_m)
        usable = ready and not conditions.estimator_invalid
        self.altitude_valid = usable
        self.position_valid = usable and blind_s < self.dead_reckoning_s
        self.global_valid = self.position_valid and self.eph_m <= self._limit()

    def _limit(self) -> float:
        """Hysteresis: once valid, an uncertainty of 2.5 times the limit is borne."""
        return self.position_limit_m * (2.5 if self.global_valid else 1.0)
