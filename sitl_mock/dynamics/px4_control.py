"""PX4's multicopter position control: P on position, PID on velocity; setpoints are truncated, not shaped.

Parameters have PX4's names and defaults (mc_pos_control). The law reproduces the velocity error measured on PX4 1.17,
8 to 19 % eight seconds after a step: drag acts against a slow integrator (MPC_XY_VEL_I_ACC 0.4).
"""

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from sitl_mock.dynamics.px4_gains import Px4Gains
from sitl_mock.dynamics.shaping import Reference, TravelLimits, travel
from sitl_mock.dynamics.values import (
    GRAVITY_M_S2,
    IGNORED,
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

_STOPPED = Kind.STOPPED
_IDLING = Kind.IDLING
_STREAM = Kind.STREAM
_DIRECT = Kind.DIRECT
_TILT_OPENS_RAD_S: Final = 0.2
"""Rate at which the tilt limit opens after a take-off."""


class Px4Memory(NamedTuple):
    """State of the control law between steps."""

    kind: Kind
    reference: Reference
    integral_ned_m_s2: Vector = ZERO
    filtered_acceleration_ned_m_s2: Vector = ZERO
    spooled_s: float = 0.0
    ramped_s: float = 0.0
    tilt_max_rad: float = math.pi
    yaw_integral_rad_s2: float = 0.0
    hover_m_s2: float = GRAVITY_M_S2  # estimated hover thrust (MPC_USE_HTE)


_memory = maker_of(Px4Memory)
_demand = maker_of(Demand)
_reference = maker_of(Reference)
_NOTHING: Final = Demand(0.0, 0.0, 0.0, 0.0)
_UNMOVED: Final = (0.0, math.pi, 0.0, GRAVITY_M_S2)
"""Initial values of the `Px4Memory` fields after `spooled_s`."""


@dataclass(frozen=True)
class Px4Control:
    """The control law with its parameters and the maximum thrust that it assumes."""

    gains: Px4Gains
    travel_limits: TravelLimits
    thrust_max_m_s2: float

    def fresh(self, estimate: Estimate, *, flying: bool) -> Px4Memory:
        """Initial state: motors off on the ground, or trimmed in hover."""
        gains = self.gains
        if flying:
            done = (gains.spool_s, gains.ramp_s)
        else:
            done = (0.0, 0.0)
        kind = Kind.BRAKE if flying else Kind.STOPPED
        return Px4Memory(kind, Reference(estimate.position_ned_m, ZERO), ZERO, ZERO, *done)

    def step(
        self, memory: Px4Memory, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[Px4Memory, Demand]:
        """Advance the law by one step; returns its new state and the demand on the airframe.

        Args:
            memory: State after the previous step.
            body: True motion.
            estimate: Estimated position and velocity.
            setpoint: Setpoint in force.
            dt_s: Length of the step.
        """
        kind = setpoint.kind
        if kind is _STOPPED or kind is _IDLING:
            spooled_s = 0.0
            demand = _NOTHING
            if kind is _IDLING:
                spooled_s = min(memory.spooled_s + dt_s, self.gains.spool_s)
                demand = Demand(0.0, 0.0, self._thrust_least(), 0.0)
            reference = _reference((estimate.position_ned_m, ZERO, ZERO))
            return _memory((kind, reference, ZERO, ZERO, spooled_s, *_UNMOVED)), demand
        if kind is _DIRECT:
            # Open loop: lean and thrust for an acceleration in still air.
            n, e, d = zero_where_ignored(setpoint.acceleration_ned_m_s2)
            up = GRAVITY_M_S2 - d
            side = math.hypot(n, e)
            per = math.atan2(side, up) / side if side > 1e-9 else 0.0
            turn, yaw_integral = self._yaw_rate(memory, body, setpoint, dt_s)
            carried = Px4Memory(
                kind,
                Reference(estimate.position_ned_m, ZERO),
                spooled_s=self.gains.spool_s,
                ramped_s=self.gains.ramp_s,
                yaw_integral_rad_s2=yaw_integral,
            )
            return carried, Demand(n * per, e * per, math.hypot(side, up), turn)
        return self._controlled(memory, body, estimate, setpoint, dt_s)

    def _controlled(  # noqa: PLR0914
        self, memory: Px4Memory, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[Px4Memory, Demand]:
        gains = self.gains
        on_ground = body.on_ground
        _, _, was_integral, was, spooled_s, ramped_s, tilt_max_rad, _, hover_m_s2 = memory
        if spooled_s < gains.spool_s:
            spooled_s = min(spooled_s + dt_s, gains.spool_s)
        if spooled_s < gains.spool_s and on_ground:
            idle = Px4Memory(
                setpoint.kind, Reference(estimate.position_ned_m, ZERO), ZERO, ZERO, spooled_s
            )
            return idle, Demand(0.0, 0.0, 0.0, 0.0)

        position, speed = estimate
        now = body.acceleration_ned_m_s2
        if setpoint.kind is _STREAM:
            reference = _reference((position, speed, now))
            velocity, forward = self._stream_velocity(estimate, setpoint)
        else:
            reference = self._travelled(memory, body, estimate, setpoint, dt_s)
            velocity, forward = self._track(estimate, reference)
        climb = setpoint.climb_m_s
        up_max = gains.up_max_m_s if math.isnan(climb) else climb
        flying = ramped_s >= gains.ramp_s
        if not flying:
            if not on_ground or velocity[2] < -gains.take_off_wish_m_s:
                ramped_s += dt_s
            ramped_s = min(ramped_s, gains.ramp_s)
            # The climb limit rises from the speed that demands zero thrust, so that the thrust itself ramps.
            weightless_m_s = -GRAVITY_M_S2 / gains.z_vel_p_1_s
            up_max = weightless_m_s + (up_max - weightless_m_s) * ramped_s / gains.ramp_s
            flying = ramped_s >= gains.ramp_s
        if flying:
            tilt_max_rad = min(tilt_max_rad + _TILT_OPENS_RAD_S * dt_s, gains.tilt_max_rad)
        else:
            tilt_max_rad = gains.tilt_ground_rad
        if velocity[2] < -up_max:
            velocity = velocity.level_with(-up_max)

        lag = math.exp(-dt_s / gains.derivative_lag_s)
        slow = Vector((now[0] + (was[0] - now[0]) * lag, now[1] + (was[1] - now[1]) * lag, 0.0))
        integral, lean, thrust = self._velocity_loop(
            velocity,
            forward,
            speed,
            slow,
            was_integral,
            dt_s,
            (tilt_max_rad, hover_m_s2),
            flying=flying,
        )
        if on_ground:
            # During the take-off ramp the vertical integral runs, which slows the first seconds of the climb.
            integral = Vector((0.0, 0.0, integral[2] if ramped_s > 0.0 and not flying else 0.0))
        turn, yaw_integral = self._yaw_rate(memory, body, setpoint, dt_s)
        if not on_ground:
            # Drag makes the estimate of the hover thrust too low in descents and too high in climbs.
            lift = body.thrust_m_s2 * math.cos(math.hypot(body.lean_n_rad, body.lean_e_rad))
            hovers = lift * GRAVITY_M_S2 / max(GRAVITY_M_S2 - now[2], 1.0)
            hover_m_s2 += (hovers - hover_m_s2) * (1.0 - math.exp(-dt_s / gains.hover_lag_s))
        carried = (
            setpoint.kind,
            reference,
            integral,
            slow,
            spooled_s,
            ramped_s,
            tilt_max_rad,
            yaw_integral,
            hover_m_s2,
        )
        return _memory(carried), _demand((*lean, thrust, turn))

    def _travelled(
        self, memory: Px4Memory, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> Reference:
        """Advance the reference; it slows down while the vehicle lags behind it."""
        started = memory.reference
        if memory.kind is not setpoint.kind:
            # After OFFBOARD PX4's trajectory starts without acceleration, whatever the vehicle's is.
            streamed = memory.kind is _STREAM or memory.kind is _DIRECT
            started = Reference(
                estimate.position_ned_m,
                estimate.velocity_ned_m_s,
                ZERO if streamed else body.acceleration_ned_m_s2,
            )
        elif body.on_ground:
            started = Reference(
                estimate.position_ned_m.level_with(started.position_ned_m[2]),
                ZERO.level_with(started.velocity_ned_m_s[2]),
                ZERO.level_with(started.acceleration_ned_m_s2[2]),
            )
        limits = self.travel_limits
        climb_m_s = setpoint.climb_m_s
        if not math.isnan(climb_m_s):
            # Lifting off, the trajectory begins at the vehicle's height each time, and is never ahead of it.
            height_m = estimate.position_ned_m[2]
            started = started._replace(position_ned_m=started.position_ned_m.level_with(height_m))
            accel_m_s2 = min(limits.accel_z_m_s2, 2.0 * climb_m_s / self.gains.ramp_s)
            limits = replace(limits, accel_z_m_s2=accel_m_s2)
        ahead_n = started.position_ned_m[0] - estimate.position_ned_m[0]
        ahead_e = started.position_ned_m[1] - estimate.position_ned_m[1]
        if ahead_n * started.velocity_ned_m_s[0] + ahead_e * started.velocity_ned_m_s[1] > 0.0:
            dt_s *= 1.0 - min(math.hypot(ahead_n, ahead_e) / self.gains.xy_error_max_m, 0.99)
        return travel(limits, started, setpoint, dt_s)

    def _thrust_least(self) -> float:
        return self.gains.thrust_min * self.thrust_max_m_s2

    def _stream_velocity(self, estimate: Estimate, setpoint: Setpoint) -> tuple[Vector, Vector]:
        """Velocity after position control and truncation (NaN: not controlled), and the acceleration fed forward."""
        if setpoint.position_ned_m is IGNORED and setpoint.acceleration_ned_m_s2 is IGNORED:
            velocity = setpoint.velocity_ned_m_s
            if math.isnan(velocity[0] + velocity[1] + velocity[2]):
                return ZERO, ZERO
            return self._truncated(velocity), ZERO
        n, a_n = self._axis(setpoint, estimate, 0, self.gains.xy_p_1_s)
        e, a_e = self._axis(setpoint, estimate, 1, self.gains.xy_p_1_s)
        d, a_d = self._axis(setpoint, estimate, 2, self.gains.z_p_1_s)
        if math.isnan(a_n + a_e + a_d):
            # With an uncontrolled axis PX4 hovers and stays in OFFBOARD.
            return ZERO, ZERO
        return self._truncated(Vector((n, e, d))), Vector((a_n, a_e, a_d))

    @staticmethod
    def _axis(
        setpoint: Setpoint, estimate: Estimate, axis: int, gain: float
    ) -> tuple[float, float]:
        """Velocity and acceleration of one axis; both NaN if the setpoint leaves it uncontrolled."""
        to = setpoint.position_ned_m[axis]
        along = setpoint.velocity_ned_m_s[axis]
        push = setpoint.acceleration_ned_m_s2[axis]
        if math.isnan(to):
            return along, (0.0 if math.isnan(push) and not math.isnan(along) else push)
        velocity = (0.0 if math.isnan(along) else along) + gain * (
            to - estimate.position_ned_m[axis]
        )
        return velocity, (0.0 if math.isnan(push) else push)

    def _truncated(self, velocity: Vector) -> Vector:
        gains = self.gains
        n, e, d = velocity
        speed = math.hypot(n, e)
        max_speed_m_s = gains.xy_vel_max_m_s
        if speed <= max_speed_m_s and -gains.up_max_m_s <= d <= gains.down_max_m_s:
            return velocity
        if speed > max_speed_m_s:
            n *= max_speed_m_s / speed
            e *= max_speed_m_s / speed
        return Vector((n, e, within(d, -gains.up_max_m_s, gains.down_max_m_s)))

    def _track(self, estimate: Estimate, reference: Reference) -> tuple[Vector, Vector]:
        gains = self.gains
        (r_n, r_e, r_d), (v_n, v_e, v_d), acceleration = reference
        p_n, p_e, p_d = estimate.position_ned_m
        n = v_n + gains.xy_p_1_s * (r_n - p_n)
        e = v_e + gains.xy_p_1_s * (r_e - p_e)
        d = v_d + gains.z_p_1_s * (r_d - p_d)
        return self._truncated(Vector((n, e, d))), acceleration

    def _velocity_loop(  # noqa: PLR0914
        self,
        wanted: Vector,
        forward: Vector,
        velocity: Vector,
        acceleration: Vector,
        integral: Vector,
        dt_s: float,
        limits: tuple[float, float],
        *,
        flying: bool,
    ) -> tuple[Vector, tuple[float, float], float]:
        """PID on velocity with thrust and tilt limits (vertical first) and tracking anti-windup."""
        gains = self.gains
        (tilt_max_rad, hover_m_s2) = limits
        (w_n, w_e, w_d) = wanted
        (v_n, v_e, v_d) = velocity
        (f_n, f_e, f_d) = forward
        err_n = w_n - v_n
        err_e = w_e - v_e
        err_d = w_d - v_d
        if math.isnan(err_n + err_e + err_d):
            err_n, err_e, err_d = zero_where_ignored(Vector((err_n, err_e, err_d)))
        i_n, i_e, i_d = integral
        a_n = gains.xy_vel_p_1_s * err_n + i_n - gains.xy_vel_d * acceleration[0] + f_n
        a_e = gains.xy_vel_p_1_s * err_e + i_e - gains.xy_vel_d * acceleration[1] + f_e
        lift = GRAVITY_M_S2 - (gains.z_vel_p_1_s * err_d + i_d + f_d)

        most = self.thrust_max_m_s2
        least = self._thrust_least() if flying else 0.0
        if lift >= most or lift <= max(least, 1e-3):
            if (lift >= most and err_d <= 0.0) or (lift <= least and err_d >= 0.0):
                err_d = 0.0
            lift = min(max(lift, least, 1e-3), most)
        # The tilt follows from horizontal acceleration and gravity alone (MPC_ACC_DECOUPLE 1), independent of the lift.
        tilt_tan = math.hypot(a_n, a_e) / GRAVITY_M_S2
        tan_max = math.tan(tilt_max_rad)
        side = min(lift * min(tilt_tan, tan_max), gains.thrust_level_margin * most)
        lift = min(lift, math.sqrt(most * most - side * side))
        tan_max = min(tan_max, math.sqrt(most * most - lift * lift) / lift)
        shrink = tan_max / tilt_tan if tilt_tan > tan_max else 1.0
        throttle = shrink * lift / hover_m_s2
        if throttle < 1.0:
            # Tracking anti-windup with gain 2/P on the part of the acceleration that exceeds the limits.
            back = 2.0 / gains.xy_vel_p_1_s * (1.0 - throttle)
            err_n -= back * a_n
            err_e -= back * a_e
        a_n = a_n * shrink
        a_e = a_e * shrink
        tilt_tan = tilt_tan * shrink
        integral = Vector(
            (
                i_n + gains.xy_vel_i_1_s2 * err_n * dt_s,
                i_e + gains.xy_vel_i_1_s2 * err_e * dt_s,
                within(i_d + gains.z_vel_i_1_s2 * err_d * dt_s, -GRAVITY_M_S2, GRAVITY_M_S2),
            )
        )
        per = lean_per_acceleration(tilt_tan)
        thrust = lift * math.sqrt(1.0 + tilt_tan * tilt_tan)
        return integral, (a_n * per, a_e * per), thrust

    def _yaw_rate(
        self, memory: Px4Memory, body: Body, setpoint: Setpoint, dt_s: float
    ) -> tuple[float, float]:
        """Steady-state yaw rate of the PI rate loop against the damping, and its new integral."""
        gains = self.gains
        kind = setpoint.kind
        yaw_rate = setpoint.yaw_rate_rad_s
        if not math.isnan(setpoint.yaw_rad):
            wanted = gains.yaw_p_1_s * wrap_rad(setpoint.yaw_rad - body.yaw_rad)
            wanted += 0.0 if math.isnan(yaw_rate) else yaw_rate
            autopilots_own = kind is not _STREAM and kind is not _DIRECT
            most = gains.yaw_auto_rate_max_rad_s if autopilots_own else gains.yaw_rate_max_rad_s
            wanted = within(wanted, -most, most)
        elif not math.isnan(yaw_rate):
            wanted = within(yaw_rate, -gains.yaw_rate_max_rad_s, gains.yaw_rate_max_rad_s)
        else:
            wanted = gains.yaw_drift_rad_s if kind is _STREAM else 0.0
        rate = body.yaw_rate_rad_s
        error = wanted - rate
        integral = (
            0.0
            if body.on_ground
            else memory.yaw_integral_rad_s2 + gains.yaw_rate_i_1_s2 * error * dt_s
        )
        push = gains.yaw_rate_p_1_s * (error + rate) + integral
        return push / (gains.yaw_rate_p_1_s + gains.yaw_damping_1_s), integral
