"""ArduCopter's position control: GUIDED setpoints shaped by jerk and acceleration, then P on position, PID on velocity.

Parameters have ArduCopter's names and defaults. GUIDED speeds are not limited (measured: 15.2 m/s with WPNAV_SPEED
500); above WPNAV_SPEED_UP and WPNAV_SPEED_DN the vertical acceleration and jerk grow with the speed (overspeed gain 2).
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from sitl_mock.dynamics.shaping import (
    Reference,
    TravelLimits,
    advance,
    approach_gain_1_s,
    approach_one,
    approach_pair,
    shape_one,
    shape_turn,
    travel,
    turning_first,
)
from sitl_mock.dynamics.values import (
    GRAVITY_M_S2,
    Body,
    Demand,
    Estimate,
    Kind,
    Setpoint,
    lean_per_acceleration,
    maker_of,
    within,
    wrap_rad,
    zero_where_ignored,
)
from sitl_mock.vector import ZERO, Vector


@dataclass(frozen=True)
class ArduGains:
    """Parameters of the control law; the ArduCopter parameter is named where there is one."""

    accel_m_s2: float = 2.5  # WPNAV_ACCEL
    accel_z_m_s2: float = 1.0  # WPNAV_ACCEL_Z
    jerk_m_s3: float = 5.0  # PSC_JERK_XY
    jerk_z_m_s3: float = 5.0  # PSC_JERK_Z
    overspeed_gain: float = 2.0
    xy_p_1_s: float = 1.0  # PSC_POSXY_P
    z_p_1_s: float = 1.0  # PSC_POSZ_P
    xy_vel_p_1_s: float = 2.0  # PSC_VELXY_P
    xy_vel_i_1_s2: float = 1.0  # PSC_VELXY_I
    xy_vel_d: float = 0.5  # PSC_VELXY_D
    z_vel_p_1_s: float = 5.0  # PSC_VELZ_P
    z_acc_p: float = 1.4  # PSC_ACCZ_P 0.5, as lift per acceleration: 0.05 throttle per m/s2 over hover throttle 0.35
    z_acc_i_1_s: float = 2.8  # PSC_ACCZ_I 1.0, in the same unit
    lean_max_rad: float = math.radians(30.0)  # ANGLE_MAX
    thrust_min_m_s2: float = 1.0
    spool_s: float = 1.0
    yaw_p_1_s: float = 4.5  # ATC_ANG_YAW_P
    yaw_rate_max_rad_s: float = math.radians(60.0)  # ATC_SLEW_YAW
    look_ahead_m_s: float = 1.0  # the nose follows the direction of travel above this speed


class Limited(NamedTuple):
    """The demanded acceleration and the errors when the lean limit was exceeded; zeros while it is not."""

    accel_ne_m_s2: tuple[float, float] = (0.0, 0.0)
    position_error_ne_m: tuple[float, float] = (0.0, 0.0)
    velocity_error_ne_m_s: tuple[float, float] = (0.0, 0.0)


UNLIMITED: Final = Limited()


class ArduMemory(NamedTuple):
    """State of the control law between steps."""

    kind: Kind
    reference: Reference
    integral_ned_m_s2: Vector = ZERO
    spooled_s: float = 0.0
    heading_rad: float = math.nan
    limited: Limited = UNLIMITED


_memory = maker_of(ArduMemory)
_demand = maker_of(Demand)
_reference = maker_of(Reference)
_TRACK = Kind.TRACK
_STOPPED = Kind.STOPPED
_IDLING = Kind.IDLING
_STREAM = Kind.STREAM
_BRAKE = Kind.BRAKE


@dataclass(frozen=True)
class ArduControl:
    """The control law with its parameters and the maximum thrust that it assumes."""

    gains: ArduGains
    travel_limits: TravelLimits
    thrust_max_m_s2: float

    def fresh(self, estimate: Estimate, *, flying: bool) -> ArduMemory:
        """Initial state: motors off on the ground, or trimmed in hover."""
        kind = Kind.BRAKE if flying else Kind.STOPPED
        return ArduMemory(
            kind,
            Reference(estimate.position_ned_m, ZERO),
            ZERO,
            self.gains.spool_s if flying else 0.0,
        )

    def step(
        self, memory: ArduMemory, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[ArduMemory, Demand]:
        """Advance the law by one step; returns its new state and the demand on the airframe.

        Args:
            memory: State after the previous step.
            body: True motion.
            estimate: Estimated position and velocity.
            setpoint: Setpoint in force.
            dt_s: Length of the step.
        """
        gains = self.gains
        kind = setpoint.kind
        if kind is _STOPPED:
            return ArduMemory(Kind.STOPPED, Reference(estimate.position_ned_m, ZERO)), Demand(
                0.0, 0.0, 0.0, 0.0
            )
        spooled_s = min(memory.spooled_s + dt_s, gains.spool_s)
        if kind is _IDLING or (spooled_s < gains.spool_s and body.on_ground):
            idle = ArduMemory(kind, Reference(estimate.position_ned_m, ZERO), ZERO, spooled_s)
            return idle, Demand(0.0, 0.0, gains.thrust_min_m_s2, 0.0)

        was, started, integral, _, heading_rad, limited = memory
        if was is _STOPPED or was is _IDLING or (was is not kind and kind is _BRAKE):
            started = Reference(
                estimate.position_ned_m, estimate.velocity_ned_m_s, started.acceleration_ned_m_s2
            )
        if kind is _STREAM:
            reference = self._shaped(started, setpoint, dt_s)
        elif kind is _TRACK:
            reference = _reference(setpoint[1:4])
        elif kind is Kind.ATTITUDE:
            return self._leaning(memory, body, estimate, setpoint, dt_s)
        else:
            reference = travel(self.travel_limits, started, setpoint, dt_s)
        if limited is not UNLIMITED:
            reference = _held(started, reference, limited)
        heading_rad, yaw_rate_rad_s = self._yaw(heading_rad, body, setpoint, reference)
        limited, integral, lean, thrust = self._track(reference, integral, body, estimate, dt_s)
        fresh = (kind, reference, integral, spooled_s, heading_rad, limited)
        return _memory(fresh), _demand((*lean, thrust, yaw_rate_rad_s))

    def _shaped(self, reference: Reference, setpoint: Setpoint, dt_s: float) -> Reference:  # noqa: PLR0914
        """Advance the GUIDED reference; acceleration and jerk are limited, speed is not."""
        gains = self.gains
        (p_n, p_e, p_d), (v_n, v_e, v_d), (a_n, a_e, a_d) = reference
        _, (to_n, to_e, to_d), speed, wanted, *_ = setpoint
        if math.isnan(speed[0]) and math.isnan(to_n) and not math.isnan(wanted[0]):
            return self._accelerated(reference, wanted, dt_s)
        n, e, d = zero_where_ignored(speed)
        f_n, f_e, f_d = zero_where_ignored(wanted)
        limits = self.travel_limits
        if not math.isnan(to_n + to_e):
            gain_1_s = approach_gain_1_s(gains.accel_m_s2, gains.jerk_m_s3, limits.settle_1_s)
            near = approach_pair(
                (to_n - p_n, to_e - p_e), limits.speed_m_s, gains.accel_m_s2, gain_1_s
            )
            n = n + near[0]
            e = e + near[1]
        # Above the speeds of travel, acceleration and jerk grow with the speed.
        excess = v_d / limits.sink_m_s if v_d > 0.0 else -v_d / limits.climb_m_s
        gain = gains.overspeed_gain * excess if excess > 1.0 else 1.0
        accel_z = gains.accel_z_m_s2 * gain
        jerk_z = gains.jerk_z_m_s3 * gain
        if not math.isnan(to_d):
            gain_1_s = approach_gain_1_s(accel_z, jerk_z, limits.settle_1_s)
            d += approach_one(to_d - p_d, limits.climb_m_s, limits.sink_m_s, accel_z, gain_1_s)
        accel = gains.accel_m_s2
        jerk = gains.jerk_m_s3
        pair = shape_turn((n, e), (v_n, v_e), (a_n, a_e), (f_n, f_e), accel, jerk, dt_s)
        down = shape_one(d, v_d, a_d, f_d, accel_z, jerk_z, jerk_z / accel_z, dt_s)
        return advance(reference, Vector((*pair, down)), dt_s)

    def _accelerated(self, reference: Reference, wanted: Vector, dt_s: float) -> Reference:
        """Advance the reference by acceleration alone; the speed is their unlimited integral."""
        a_n, a_e, a_d = reference.acceleration_ned_m_s2
        d_n, d_e, d_d = wanted - reference.acceleration_ned_m_s2
        change = math.hypot(d_n, d_e)
        max_change = self.gains.jerk_m_s3 * dt_s
        keep = max_change / change if change > max_change else 1.0
        most_z = self.gains.jerk_z_m_s3 * dt_s
        down = a_d + within(d_d, -most_z, most_z)
        return advance(reference, Vector((a_n + d_n * keep, a_e + d_e * keep, down)), dt_s)

    def _leaning(
        self, memory: ArduMemory, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[ArduMemory, Demand]:
        """Follow an attitude target within ANGLE_MAX; the horizontal position is not controlled."""
        gains = self.gains
        # The reference climbs as asked, over the vehicle's present place.
        before = memory.reference
        position = estimate.position_ned_m
        velocity = estimate.velocity_ned_m_s
        if memory.kind > Kind.IDLING:
            position = position.level_with(before.position_ned_m[2])
            velocity = velocity.level_with(before.velocity_ned_m_s[2])
        down = shape_one(
            zero_where_ignored(setpoint.velocity_ned_m_s)[2],
            velocity[2],
            before.acceleration_ned_m_s2[2],
            0.0,
            gains.accel_z_m_s2,
            gains.jerk_z_m_s3,
            gains.jerk_z_m_s3 / gains.accel_z_m_s2,
            dt_s,
        )
        reference = advance(Reference(position, velocity), Vector((0.0, 0.0, down)), dt_s)
        heading_rad, yaw_rate_rad_s = self._yaw(memory.heading_rad, body, setpoint, reference)
        i_d = memory.integral_ned_m_s2[2]
        _, integral, _, thrust = self._track(
            reference, Vector((0.0, 0.0, i_d)), body, estimate, dt_s
        )
        if not math.isnan(setpoint.thrust):
            thrust = setpoint.thrust * self.thrust_max_m_s2
            reference = Reference(estimate.position_ned_m, estimate.velocity_ned_m_s)
        spooled_s = min(memory.spooled_s + dt_s, gains.spool_s)
        carried = ArduMemory(
            Kind.ATTITUDE, reference, Vector((0.0, 0.0, integral[2])), spooled_s, heading_rad
        )
        n, e = setpoint.lean_ne_rad
        keep = min(1.0, gains.lean_max_rad / max(math.hypot(n, e), 1e-9))
        return carried, Demand(n * keep, e * keep, thrust, yaw_rate_rad_s)

    def _track(  # noqa: PLR0914
        self, reference: Reference, integral: Vector, body: Body, estimate: Estimate, dt_s: float
    ) -> tuple[Limited, Vector, tuple[float, float], float]:
        """P on position, PID on velocity with the reference fed forward, lean limit with anti-windup."""
        gains = self.gains
        (r_n, r_e, r_d), (w_n, w_e, w_d), (f_n, f_e, f_d) = reference
        (p_n, p_e, p_d), (v_n, v_e, v_d) = estimate
        _, _, (b_n, b_e, b_d), lean_n, lean_e, *_ = body
        i_n, i_e, i_d = integral
        err_n = w_n + gains.xy_p_1_s * (r_n - p_n) - v_n
        err_e = w_e + gains.xy_p_1_s * (r_e - p_e) - v_e
        a_n = gains.xy_vel_p_1_s * err_n + i_n + gains.xy_vel_d * (f_n - b_n) + f_n
        a_e = gains.xy_vel_p_1_s * err_e + i_e + gains.xy_vel_d * (f_e - b_e) + f_e
        max_accel_m_s2 = GRAVITY_M_S2 * math.tan(gains.lean_max_rad)
        limited = UNLIMITED
        if a_n * a_n + a_e * a_e > max_accel_m_s2 * max_accel_m_s2:
            limited = Limited((a_n, a_e), (r_n - p_n, r_e - p_e), (err_n, err_e))
            a_n, a_e = turning_first((a_n, a_e), (w_n, w_e), max_accel_m_s2)
        i_n, i_e = _integrated((i_n, i_e), (err_n, err_e), gains.xy_vel_i_1_s2 * dt_s, limited)
        lean_tan = math.hypot(a_n, a_e) / GRAVITY_M_S2

        a_d = f_d + gains.z_vel_p_1_s * (w_d + gains.z_p_1_s * (r_d - p_d) - v_d)
        lift = GRAVITY_M_S2 - gains.z_acc_p * (a_d - b_d) - i_d
        least = gains.thrust_min_m_s2
        max_accel_m_s2 = self.thrust_max_m_s2
        if (lift > least or a_d < b_d) and (lift < max_accel_m_s2 or a_d > b_d):
            i_d += gains.z_acc_i_1_s * (a_d - b_d) * dt_s
        lift = within(lift, least, max_accel_m_s2)
        per = lean_per_acceleration(lean_tan)
        # Angle boost: thrust is increased by the actual lean so that the lift stays constant.
        up = math.cos(math.hypot(lean_n, lean_e))
        return limited, Vector((i_n, i_e, i_d)), (a_n * per, a_e * per), lift / max(up, 0.3)

    def _yaw(
        self, heading_rad: float, body: Body, setpoint: Setpoint, reference: Reference
    ) -> tuple[float, float]:
        """Desired heading and yaw rate; without a yaw setpoint the nose turns to the direction of travel."""
        gains = self.gains
        kind, _, _, _, yaw_rad, yaw_rate_rad_s, *_ = setpoint
        here_rad = body.yaw_rad
        most_rad_s = gains.yaw_rate_max_rad_s
        forward = 0.0 if math.isnan(yaw_rate_rad_s) else yaw_rate_rad_s
        if math.isnan(yaw_rad) and not math.isnan(yaw_rate_rad_s):
            return here_rad, within(forward, -most_rad_s, most_rad_s)
        if not math.isnan(yaw_rad):
            heading_rad = yaw_rad
        elif math.isnan(heading_rad):
            heading_rad = here_rad
        elif kind is not _BRAKE:
            n, e, _ = reference.velocity_ned_m_s
            if math.hypot(n, e) > gains.look_ahead_m_s:
                heading_rad = math.atan2(e, n)
        rate = gains.yaw_p_1_s * wrap_rad(heading_rad - here_rad) + forward
        return heading_rad, within(rate, -most_rad_s, most_rad_s)


def _held(before: Reference, after: Reference, limited: Limited) -> Reference:
    """Stop the reference from advancing in the direction in which the lean limit was reached."""
    limit_n, limit_e = limited.accel_ne_m_s2
    (p_n, p_e, _), (v_n, v_e, _), _ = before
    (q_n, q_e, q_d), (w_n, w_e, w_d), acceleration = after

    def further(step: tuple[float, float], error: tuple[float, float]) -> bool:
        return (
            step[0] * limit_n + step[1] * limit_e > 0.0
            and error[0] * limit_n + error[1] * limit_e > 0.0
        )

    if further((q_n - p_n, q_e - p_e), limited.position_error_ne_m):
        q_n = p_n
        q_e = p_e
    if (
        further((w_n - v_n, w_e - v_e), limited.velocity_error_ne_m_s)
        and v_n * limit_n + v_e * limit_e >= 0.0
    ):
        w_n = v_n
        w_e = v_e
    return Reference(Vector((q_n, q_e, q_d)), Vector((w_n, w_e, w_d)), acceleration)


def _integrated(
    integral: tuple[float, float], error: tuple[float, float], gain: float, limited: Limited
) -> tuple[float, float]:
    """Advance the integral; it does not grow in the direction in which the lean limit was reached."""
    (i_n, i_e) = integral
    (e_n, e_e) = error
    n = i_n + gain * e_n
    e = i_e + gain * e_e
    limit_n, limit_e = limited.accel_ne_m_s2
    if e_n * limit_n + e_e * limit_e > 0.0:
        size = math.hypot(n, e)
        max_length = math.hypot(i_n, i_e)
        if size > max_length:
            return n * max_length / size, e * max_length / size
    return n, e
