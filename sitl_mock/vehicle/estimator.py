"""The autopilot's position and velocity estimate and its validity: estimate = truth + error.

The error varies as measured on the real autopilot; jumps and drifts are added to it. The control loop uses the
estimate, so a wrong estimate moves the true vehicle.
"""

import math
from dataclasses import dataclass
from random import Random
from typing import Final

from sitl_mock.dynamics import Errors, Wander
from sitl_mock.vector import ZERO, Vector
from sitl_mock.vehicle.conditions import Conditions

STEP_S: Final = 0.1
ARDUPILOT_WANDER: Final = Wander(Vector((0.03, 0.03, 0.03)), Vector((0.05, 0.05, 0.05)))
"""Small: height held within 0.1 m over 200 m (measured on ArduCopter 4.5.7)."""
_DRIFT_M_S2: Final = 0.1
_BLIND_GROWTH_M_S2: Final = 0.2
EPH_M: Final = 0.4
"""Horizontal uncertainty with a good receiver."""
_RESET_LIMIT: Final = 256


@dataclass(slots=True)
class Estimator:
    """The estimate's error and its validity.

    Attributes:
        wander: Size of the error, None for none.
        ground_wander: The same on the ground; None: it rests there.
        random: Source of the noise, seeded.
        ready_s: When the estimate becomes valid.
        position_limit_m: Horizontal uncertainty beyond which the position is invalid (COM_POS_FS_EPH).
        dead_reckoning_s: How long positions stay valid without GPS (EKF2_NOAID_TOUT).
        position_error_m: Present error.
        velocity_error_m_s: Present error.
        yaw_error_rad: Present error.
        offset_m: The part of the position error that jumps and drifts have made.
        eph_m: Horizontal uncertainty.
        position_valid: Local position and velocity may be used.
        global_valid: Global position may be used.
        altitude_valid: Height may be used.
        gps_ok: The receiver has a fix.
        reset_counter: Jumps so far, modulo 256 (ODOMETRY).
    """

    wander: Wander | None
    random: Random
    ready_s: float
    position_limit_m: float = 5.0
    dead_reckoning_s: float = 5.0
    ground_wander: Wander | None = None
    errors: Errors = Errors()  # noqa: RUF009 - an immutable value
    position_error_m: Vector = ZERO
    velocity_error_m_s: Vector = ZERO
    yaw_error_rad: float = 0.0
    offset_m: Vector = ZERO
    eph_m: float = EPH_M
    position_valid: bool = False
    global_valid: bool = False
    altitude_valid: bool = False
    gps_ok: bool = False
    reset_counter: int = 0
    lost_gps_s: float = math.inf

    def advance(self, now_s: float, conditions: Conditions, *, flying: bool) -> None:
        """Move the error and the validity on to now_s; called every STEP_S."""
        wander = self.wander if flying else self.ground_wander
        if wander is not None:
            self.errors = wander.after(self.errors, self.random, STEP_S)
        elif not flying:
            self.errors = Errors(self.errors.position_ned_m)  # standing still is noticed

        ready = now_s >= self.ready_s - 1e-9
        gps_lost = conditions.gps_lost
        self.gps_ok = ready and not gps_lost
        if not gps_lost:
            # With a fix again, the estimate is reset to it.
            if self.lost_gps_s < math.inf:
                self.lost_gps_s = math.inf
                north, east, _ = self.offset_m
                self.jump(Vector((-north, -east, 0.0)))
        elif self.lost_gps_s == math.inf:
            self.lost_gps_s = now_s
        blind_s = max(0.0, now_s - self.lost_gps_s)
        self.eph_m = max(EPH_M + _BLIND_GROWTH_M_S2 * blind_s * blind_s, conditions.eph_m)
        usable = ready and not conditions.estimator_invalid
        self.altitude_valid = usable
        self.position_valid = usable and blind_s < self.dead_reckoning_s
        # Hysteresis: once valid, an uncertainty of 2.5 times the limit is borne.
        self.global_valid = self.position_valid and self.eph_m <= (
            self.position_limit_m * (2.5 if self.global_valid else 1.0)
        )

        if flying and self.lost_gps_s < math.inf:
            # Without GPS the estimate slides away, in a direction of the seed's choosing.
            step_m = _DRIFT_M_S2 * (now_s - self.lost_gps_s) * STEP_S
            bearing = self.random.gauss(0.0, 0.2)
            north, east, down = self.offset_m
            self.offset_m = Vector(
                (
                    north + step_m * math.cos(bearing),
                    east + step_m * math.sin(bearing),
                    down,
                )
            )
        if conditions.drift_m_s != ZERO:
            self.offset_m = self.offset_m.after(conditions.drift_m_s, STEP_S)
        self._sum()

    def jump(self, by_m: Vector) -> None:
        """Reset the position estimate: it moves by by_m at once and the reset counter rises."""
        self.offset_m += by_m
        self._sum()
        self.reset_counter = (self.reset_counter + 1) % _RESET_LIMIT

    def jump_yaw(self, by_rad: float) -> None:
        """Reset the heading estimate."""
        self.yaw_error_rad += by_rad
        self.reset_counter = (self.reset_counter + 1) % _RESET_LIMIT

    def _sum(self) -> None:
        self.position_error_m = self.errors.position_ned_m + self.offset_m
        self.velocity_error_m_s = self.errors.velocity_ned_m_s
