"""A ground vehicle: speed along the nose, a turn-rate limit, and no sideways motion."""

import math
from dataclasses import dataclass

from sitl_mock.dynamics.multicopter import body_at
from sitl_mock.dynamics.values import (
    Body,
    Estimate,
    Kind,
    Motion,
    Setpoint,
    Surroundings,
    within,
    wrap_rad,
    zero_where_ignored,
)
from sitl_mock.vector import Vector


@dataclass(frozen=True)
class Rover:
    """A skid-steered rover with its parameters.

    Attributes:
        speed_max_m_s: Maximum speed (CRUISE_SPEED is below it).
        accel_m_s2: Maximum acceleration and braking (ATC_ACCEL_MAX).
        turn_rate_max_rad_s: Maximum turn rate, also on the spot (ATC_STR_RAT_MAX).
        heading_gain_1_s: Turn rate per heading error.
        turn_lag_s: Time constant of the turn rate.
        place_gain_1_s: Speed per remaining distance to a position setpoint.
        reached_m: Radius within which a position counts as reached.
    """

    speed_max_m_s: float = 5.0
    accel_m_s2: float = 2.0
    turn_rate_max_rad_s: float = math.radians(90.0)
    heading_gain_1_s: float = 3.0
    turn_lag_s: float = 0.15
    place_gain_1_s: float = 0.7
    reached_m: float = 0.3

    def reference(self, _motion: Motion) -> None:
        """None: the rover's control has no reference motion."""

    def initial(self, position_ned_m: Vector, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A rover at rest; `flying` raises ValueError."""
        if flying:
            msg = "a rover cannot start in the air: leave flying=False"
            raise ValueError(msg)
        return Motion(body_at(position_ned_m, yaw_rad, on_ground=True), None)

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """True position and velocity plus the estimator errors in `around`."""
        return Estimate(
            body.position_ned_m + around.position_error_ned_m,
            body.velocity_ned_m_s + around.velocity_error_ned_m_s,
        )

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """Turn towards the desired velocity, and drive at its component along the nose.

        Args:
            motion: Present motion.
            setpoint: Setpoint in force.
            around: Estimator errors; its other fields have no effect on a rover.
            dt_s: Length of the step.
        """
        body = motion.body
        wanted_n, wanted_e = self._wanted(body, setpoint, around)
        wanted_m_s = math.hypot(wanted_n, wanted_e)
        forward_n = math.cos(body.yaw_rad)
        forward_e = math.sin(body.yaw_rad)
        yaw_rate = 0.0
        if not math.isnan(setpoint.yaw_rate_rad_s):
            yaw_rate = setpoint.yaw_rate_rad_s
        elif wanted_m_s > 0.05:
            yaw_rate = self.heading_gain_1_s * wrap_rad(
                math.atan2(wanted_e, wanted_n) - body.yaw_rad
            )
        elif not math.isnan(setpoint.yaw_rad) and setpoint.kind > Kind.IDLING:
            yaw_rate = self.heading_gain_1_s * wrap_rad(setpoint.yaw_rad - body.yaw_rad)
        yaw_rate = within(yaw_rate, -self.turn_rate_max_rad_s, self.turn_rate_max_rad_s)
        yaw_rate = yaw_rate + (body.yaw_rate_rad_s - yaw_rate) * math.exp(-dt_s / self.turn_lag_s)
        moving = (
            wanted_m_s or yaw_rate or any(body.velocity_ned_m_s) or any(body.acceleration_ned_m_s2)
        )
        if not moving and body.position_ned_m[2] == around.ground_down_m:
            return motion
        yaw = math.remainder(body.yaw_rad + yaw_rate * dt_s, math.tau)

        # The component along the nose is not negative, so the rover turns on the spot before it drives back.
        along = within(wanted_n * forward_n + wanted_e * forward_e, 0.0, self.speed_max_m_s)
        speed = body.velocity_ned_m_s[0] * forward_n + body.velocity_ned_m_s[1] * forward_e
        max_change_m_s = self.accel_m_s2 * dt_s
        speed += within(along - speed, -max_change_m_s, max_change_m_s)
        velocity = Vector((speed * math.cos(yaw), speed * math.sin(yaw), 0.0))
        was = body.velocity_ned_m_s
        position_m = body.position_ned_m
        return Motion(
            Body(
                Vector(
                    (
                        position_m[0] + 0.5 * (was[0] + velocity[0]) * dt_s,
                        position_m[1] + 0.5 * (was[1] + velocity[1]) * dt_s,
                        around.ground_down_m,
                    )
                ),
                velocity,
                Vector(((velocity[0] - was[0]) / dt_s, (velocity[1] - was[1]) / dt_s, 0.0)),
                0.0,
                0.0,
                0.0,
                0.0,
                yaw,
                yaw_rate,
                0.0,
                on_ground=True,
            ),
            None,
        )

    def _wanted(self, body: Body, setpoint: Setpoint, around: Surroundings) -> tuple[float, float]:
        """Desired horizontal velocity from the position and velocity setpoints, within the speed limit."""
        if setpoint.kind <= Kind.IDLING or setpoint.kind is Kind.BRAKE:
            return 0.0, 0.0
        n, e, _ = zero_where_ignored(setpoint.velocity_ned_m_s)
        to_n, to_e = setpoint.position_ned_m[:2]
        if not math.isnan(to_n + to_e):
            position_m = self.estimate(body, around).position_ned_m
            gone_n = to_n - position_m[0]
            gone_e = to_e - position_m[1]
            if math.hypot(gone_n, gone_e) > self.reached_m:
                n += self.place_gain_1_s * gone_n
                e += self.place_gain_1_s * gone_e
        limit = (
            self.speed_max_m_s
            if math.isnan(setpoint.speed_m_s)
            else min(setpoint.speed_m_s, self.speed_max_m_s)
        )
        speed = math.hypot(n, e)
        if speed > limit:
            return (n * limit / speed, e * limit / speed)
        return (n, e)
