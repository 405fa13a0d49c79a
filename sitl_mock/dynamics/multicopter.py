"""A multicopter: a body with attitude and rotor lag, gravity, drag and the ground, under one control law."""

import math
from dataclasses import dataclass
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

from sitl_mock.dynamics.shaping import Reference
from sitl_mock.dynamics.values import (
    CALM,
    GRAVITY_M_S2,
    Body,
    Demand,
    Estimate,
    Kind,
    Motion,
    Setpoint,
    Surroundings,
    maker_of,
    within,
    wrap_rad,
)
from sitl_mock.vector import ZERO, Vector

_STREAM = Kind.STREAM
_DIRECT = Kind.DIRECT
_body = maker_of(Body)
_estimate = maker_of(Estimate)
_motion = maker_of(Motion)
_EXACT: Final = Vector((1.0, 1.0, 1.0))


@dataclass(frozen=True)
class Airframe:
    """Parameters of a multicopter's body, per unit of mass.

    Attributes:
        attitude_gain_1_s: Lean rate asked for per lean error (PX4's MC_ROLL_P).
        rate_gain_1_s: Inverse time constant of the rate loop under it.
        lean_rate_max_rad_s: Fastest lean.
        yaw_rate_gain_1_s: Inverse time constant of the yaw rate.
        thrust_max_m_s2: Specific thrust of all rotors at full throttle.
        rotor_lag_s: Time constant of the thrust.
        drag_1_s: Linear drag, horizontal and vertical (specific force per air speed).
        drag_1_m: Quadratic drag along each axis of the body (specific force per air speed along it, squared). With it,
            the horizontal linear drag is the rotors' momentum drag: this much in hover, growing with the root of the
            thrust.
        lean_accel_rad_s2: Angular acceleration at full thrust. Low thrust gives less, and the share used for turning
            reduces the lift. Infinite: not modelled.
    """

    attitude_gain_1_s: float
    rate_gain_1_s: float
    lean_rate_max_rad_s: float
    yaw_rate_gain_1_s: float
    thrust_max_m_s2: float
    rotor_lag_s: float
    drag_1_s: float
    drag_1_m: float
    lean_accel_rad_s2: float = math.inf


def body_at(position_ned_m: Vector, yaw_rad: float, *, on_ground: bool = True) -> Body:
    """A body at rest, motors stopped on the ground or hovering in the air."""
    thrust_m_s2 = 0.0 if on_ground else GRAVITY_M_S2
    return Body(
        position_ned_m,
        ZERO,
        ZERO,
        0.0,
        0.0,
        0.0,
        0.0,
        wrap_rad(yaw_rad),
        0.0,
        thrust_m_s2,
        on_ground,
    )


def step_body(
    airframe: Airframe, body: Body, demand: Demand, around: Surroundings, dt_s: float
) -> Body:
    """Advance the body by one step under a controller's demand, on the ground or in the air.

    Args:
        airframe: Mass, drag and lags.
        body: Present motion.
        demand: The controller's demand.
        around: Wind, height of the ground and thrust share.
        dt_s: At most about 0.02 s.
    """
    place, velocity, _, _, _, _, _, _, _, was_m_s2, on_ground = body
    if (
        on_ground
        and velocity is ZERO
        and not (was_m_s2 or demand.thrust_m_s2)
        and place[2] == around.ground_down_m
    ):
        return body  # at rest with the rotors stopped
    full_m_s2 = airframe.thrust_max_m_s2
    thrust_m_s2 = within(demand.thrust_m_s2, 0.0, full_m_s2)
    stands = on_ground and thrust_m_s2 <= GRAVITY_M_S2
    rate_n, rate_e, turning = (
        ZERO if stands else _turned(airframe, body, demand, thrust_m_s2 / full_m_s2, dt_s)
    )
    thrust_m_s2 = around.thrust_share * min(thrust_m_s2, full_m_s2 * (1.0 - turning))
    thrust_m_s2 += (was_m_s2 - thrust_m_s2) * math.exp(-dt_s / airframe.rotor_lag_s)
    if on_ground and thrust_m_s2 <= GRAVITY_M_S2:
        return _resting(body, thrust_m_s2, around.ground_down_m)
    moved = (rate_n, rate_e, thrust_m_s2)
    return _flying(airframe, body, demand, moved, around, dt_s)


def _turned(
    airframe: Airframe, body: Body, demand: Demand, throttle: float, dt_s: float
) -> tuple[float, float, float]:
    """Advance the lean rates towards north and east; returns them and the share of thrust used for turning."""
    ask_n = airframe.attitude_gain_1_s * (demand.lean_n_rad - body.lean_n_rad)
    ask_e = airframe.attitude_gain_1_s * (demand.lean_e_rad - body.lean_e_rad)
    ask = math.hypot(ask_n, ask_e)
    fastest = airframe.lean_rate_max_rad_s
    if ask > fastest:
        ask_n *= fastest / ask
        ask_e *= fastest / ask
    rate_n = body.lean_rate_n_rad_s
    rate_e = body.lean_rate_e_rad_s
    part = 1.0 - math.exp(-airframe.rate_gain_1_s * dt_s)
    full_change = airframe.lean_accel_rad_s2 * dt_s
    more_n = (ask_n - rate_n) * part
    more_e = (ask_e - rate_e) * part
    if full_change == math.inf:
        return rate_n + more_n, rate_e + more_e, 0.0
    share = math.hypot(more_n, more_e) / full_change
    max_throttle = min(throttle, 0.5)
    if share > max_throttle:
        more_n = more_n * max_throttle / share
        more_e = more_e * max_throttle / share
        share = max_throttle
    return rate_n + more_n, rate_e + more_e, share


def _resting(body: Body, thrust_m_s2: float, ground_down_m: float) -> Body:
    """Standing: thrust below the weight, body upright."""
    north, east, _ = body.position_ned_m
    return Body(
        Vector((north, east, ground_down_m)),
        ZERO,
        ZERO,
        0.0,
        0.0,
        0.0,
        0.0,
        body.yaw_rad,
        0.0,
        thrust_m_s2,
        on_ground=True,
    )


def _flying(  # noqa: PLR0914
    airframe: Airframe,
    body: Body,
    demand: Demand,
    moved: tuple[float, float, float],
    around: Surroundings,
    dt_s: float,
) -> Body:
    """Advance the body in the air with its new lean rates and thrust."""
    position, velocity, _, lean_n, lean_e, _, _, yaw, yaw_rate, _, _ = body
    (rate_n, rate_e, thrust_m_s2) = moved
    turn = demand.yaw_rate_rad_s
    ground_d = around.ground_down_m

    lean_n += rate_n * dt_s
    lean_e += rate_e * dt_s
    yaw_rate += (turn - yaw_rate) * (1.0 - math.exp(-airframe.yaw_rate_gain_1_s * dt_s))

    lean = math.hypot(lean_n, lean_e)
    side = thrust_m_s2 * (math.sin(lean) / lean if lean > 1e-9 else 1.0)
    (v_n, v_e, v_d) = velocity
    (wind_n, wind_e, wind_d) = around.wind_ned_m_s
    air_n = v_n - wind_n
    air_e = v_e - wind_e
    air_d = v_d - wind_d
    # Implicit in the drag: stable and free of bias at rest for any wind and step.
    lift = thrust_m_s2 * math.cos(lean)
    push = (side * lean_n, side * lean_e)
    a_n, a_e = _against_air(airframe, push, (air_n, air_e), (thrust_m_s2, lift), yaw, dt_s)
    drag = airframe.drag_1_s + airframe.drag_1_m * abs(air_d)
    a_d = (GRAVITY_M_S2 - lift - drag * air_d) / (1.0 + drag * dt_s)

    acceleration = Vector((a_n, a_e, a_d))
    reached = position.moved(velocity, acceleration, dt_s)
    reached_velocity = velocity.after(acceleration, dt_s)
    if reached[2] >= ground_d and reached_velocity[2] >= 0.0:
        # Touchdown without bouncing or sliding.
        return body_touching(body, thrust_m_s2, ground_d)
    return _body(
        (
            reached,
            reached_velocity,
            acceleration,
            lean_n,
            lean_e,
            rate_n,
            rate_e,
            math.remainder(yaw + yaw_rate * dt_s, math.tau),
            yaw_rate,
            thrust_m_s2,
            False,
        )
    )


def _against_air(
    airframe: Airframe,
    push: tuple[float, float],
    air: tuple[float, float],
    thrust: tuple[float, float],
    yaw_rad: float,
    dt_s: float,
) -> tuple[float, float]:
    """Horizontal acceleration (north, east) under a specific force and aerodynamic drag.

    Args:
        airframe: Drag coefficients.
        push: Horizontal part of the thrust, north and east.
        air: Speed through the air, north and east.
        thrust: Thrust and its vertical part.
        yaw_rad: Heading of the body.
        dt_s: Length of the step.
    """
    linear = airframe.drag_1_s
    quadratic = airframe.drag_1_m
    if not quadratic:
        damp = 1.0 / (1.0 + linear * dt_s)
        return (push[0] - linear * air[0]) * damp, (push[1] - linear * air[1]) * damp
    # More thrust has more momentum drag. A body that leans has less air speed along its axes.
    thrust_m_s2, lift = thrust
    if thrust_m_s2 > 0.0:
        linear *= math.sqrt(thrust_m_s2 / GRAVITY_M_S2)
        quadratic *= lift / thrust_m_s2
    cosine = math.cos(yaw_rad)
    sine = math.sin(yaw_rad)
    ahead = air[0] * cosine + air[1] * sine
    right = air[1] * cosine - air[0] * sine
    drag_x = linear + quadratic * abs(ahead)
    drag_y = linear + quadratic * abs(right)
    x = (push[0] * cosine + push[1] * sine - drag_x * ahead) / (1.0 + drag_x * dt_s)
    y = (push[1] * cosine - push[0] * sine - drag_y * right) / (1.0 + drag_y * dt_s)
    return x * cosine - y * sine, x * sine + y * cosine


def body_touching(body: Body, thrust_m_s2: float, ground_down_m: float) -> Body:
    """The body after touchdown at its present place."""
    return _resting(body, thrust_m_s2, ground_down_m)


MemoryT = TypeVar("MemoryT")


class Control(Protocol[MemoryT]):
    """A control law: estimate and setpoint in; lean, thrust and yaw rate out."""

    def fresh(self, estimate: Estimate, *, flying: bool) -> MemoryT:
        """Initial state of the law."""
        ...

    def step(
        self, memory: MemoryT, body: Body, estimate: Estimate, setpoint: Setpoint, dt_s: float
    ) -> tuple[MemoryT, Demand]:
        """Advance the law by one step.

        Args:
            memory: State after the previous step.
            body: True motion.
            estimate: Estimated position and velocity.
            setpoint: Setpoint in force.
            dt_s: Length of the step.
        """
        ...


class Pending(NamedTuple):
    """Delayed setpoints: the one in force, and those waiting with their times."""

    clock_s: float
    obeyed: Setpoint
    waiting: tuple[tuple[float, Setpoint], ...] = ()


_pending = maker_of(Pending)


def advance_pending(pending: Pending, setpoint: Setpoint, delay_s: float, dt_s: float) -> Pending:
    """Advance the delay line: streamed setpoints wait for `delay_s`, others take effect at once.

    Args:
        pending: The delay line.
        setpoint: The newest setpoint.
        delay_s: Delay of streamed setpoints.
        dt_s: Length of the step.
    """
    clock_s, obeyed, waiting = pending
    kind = setpoint.kind
    if kind is not _STREAM and kind is not _DIRECT:
        return _pending((clock_s + dt_s, setpoint, ()))
    if setpoint is not (waiting[-1][1] if waiting else obeyed):
        waiting = (*waiting, (clock_s + delay_s, setpoint))
    now_s = clock_s + 0.5 * dt_s
    while waiting and waiting[0][0] <= now_s:
        obeyed = waiting[0][1]
        waiting = waiting[1:]
    return _pending((clock_s + dt_s, obeyed, waiting))


@dataclass(frozen=True)
class Multicopter(Generic[MemoryT]):
    """A multicopter of one flavour.

    Attributes:
        control: The flavour's control law.
        memory_type: Type of the law's state; a state of another type is replaced by the initial one.
        airframe: The body.
        velocity_scale_ned: Estimated over true velocity, per axis (1 is perfect).
        setpoint_delay_s: Dead time of streamed setpoints.
        step_max_s: Longer steps are divided.
    """

    control: Control[MemoryT]
    memory_type: type[MemoryT]
    airframe: Airframe
    velocity_scale_ned: Vector = _EXACT
    setpoint_delay_s: float = 0.0
    step_max_s: float = 0.02

    def initial(self, position_ned_m: Vector, yaw_rad: float, *, flying: bool = False) -> Motion:
        """A vehicle at rest: motors stopped on the ground, or (`flying`) hovering in trim."""
        body = body_at(position_ned_m, yaw_rad, on_ground=not flying)
        return Motion(body, self._fresh(body, self.estimate(body, CALM)))

    def _fresh(self, body: Body, estimate: Estimate) -> tuple[Pending, MemoryT]:
        flying = not body.on_ground
        order = Setpoint(Kind.BRAKE if flying else Kind.STOPPED)
        return Pending(0.0, order), self.control.fresh(estimate, flying=flying)

    def estimate(self, body: Body, around: Surroundings) -> Estimate:
        """Estimated position and velocity: truth times the velocity scale, plus the errors in `around`."""
        velocity_m_s = body.velocity_ned_m_s
        if self.velocity_scale_ned is not _EXACT:
            velocity_m_s = velocity_m_s.scaled(self.velocity_scale_ned)
        position_m = body.position_ned_m + around.position_error_ned_m
        return _estimate((position_m, velocity_m_s + around.velocity_error_ned_m_s))

    def step(self, motion: Motion, setpoint: Setpoint, around: Surroundings, dt_s: float) -> Motion:
        """Advance the motion by `dt_s` under one setpoint, in equal steps of at most `step_max_s`.

        Args:
            motion: Present motion.
            setpoint: The newest setpoint; a streamed one takes effect after `setpoint_delay_s`.
            around: Wind, height of the ground, estimator errors, thrust share.
            dt_s: Time to advance.
        """
        body = motion.body
        estimate = self.estimate(body, around)
        carried = motion.memory
        if isinstance(carried, tuple) and isinstance(carried[1], self.memory_type):
            pending, memory = carried
        else:  # another flavour's
            pending, memory = self._fresh(body, estimate)
        count = 1 if dt_s <= self.step_max_s else math.ceil(dt_s / self.step_max_s - 1e-9)
        inner_s = dt_s / count
        for steps_left in range(count, 0, -1):
            pending = advance_pending(pending, setpoint, self.setpoint_delay_s, inner_s)
            memory, demand = self.control.step(memory, body, estimate, pending.obeyed, inner_s)
            body = step_body(self.airframe, body, demand, around, inner_s)
            if steps_left > 1:
                estimate = self.estimate(body, around)
        return _motion((body, (pending, memory)))

    def reference(self, motion: Motion) -> Reference | None:
        """The controller's reference motion; None if it has none."""
        carried = motion.memory
        known = isinstance(carried, tuple) and isinstance(carried[1], self.memory_type)
        return (
            getattr(carried[1], "reference", None) if known and isinstance(carried, tuple) else None
        )
