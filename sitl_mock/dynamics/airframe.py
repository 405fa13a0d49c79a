"""A multicopter's body: attitude and rotor lag, gravity, drag through the air, and the ground."""

import math
from dataclasses import dataclass

from sitl_mock.dynamics.values import GRAVITY_M_S2, ZERO, Body, Demand, Ned, Surroundings, wrap_rad


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
        drag_1_m: Quadratic drag along each axis of the body (specific force per air speed along it, squared).
    """

    attitude_gain_1_s: float
    rate_gain_1_s: float
    lean_rate_max_rad_s: float
    yaw_rate_gain_1_s: float
    thrust_max_m_s2: float
    rotor_lag_s: float
    drag_1_s: float
    drag_1_m: float


def body_at(position_ned_m: Ned, yaw_rad: float, *, on_ground: bool = True) -> Body:
    """A body at rest, motors stopped on the ground or hovering in the air."""
    thrust_m_s2 = 0.0 if on_ground else GRAVITY_M_S2
    return Body(position_ned_m, ZERO, ZERO, 0.0, 0.0, 0.0, 0.0, wrap_rad(yaw_rad), 0.0, thrust_m_s2, on_ground)


def step_body(airframe: Airframe, body: Body, demand: Demand, around: Surroundings, dt_s: float) -> Body:
    """One step of `dt_s` (at most about 0.02 s) under a controller's demand, on the ground or in the air."""
    thrust_m_s2 = min(max(demand.thrust_m_s2, 0.0), airframe.thrust_max_m_s2)
    thrust_m_s2 += (body.thrust_m_s2 - thrust_m_s2) * math.exp(-dt_s / airframe.rotor_lag_s)
    if body.on_ground and thrust_m_s2 <= GRAVITY_M_S2:
        return _resting(body, thrust_m_s2, around.ground_down_m)
    return _flying(airframe, body, demand, thrust_m_s2, around, dt_s)


def _resting(body: Body, thrust_m_s2: float, ground_down_m: float) -> Body:
    """Thrust below the weight: the legs stay where they are, upright."""
    north, east, _ = body.position_ned_m
    return Body(
        (north, east, ground_down_m), ZERO, ZERO, 0.0, 0.0, 0.0, 0.0, body.yaw_rad, 0.0, thrust_m_s2, on_ground=True
    )


def _flying(
    airframe: Airframe, body: Body, demand: Demand, thrust_m_s2: float, around: Surroundings, dt_s: float
) -> Body:
    (p_n, p_e, p_d), (v_n, v_e, v_d), _, lean_n, lean_e, rate_n, rate_e, yaw, yaw_rate, _, _ = body

    ask_n = airframe.attitude_gain_1_s * (demand.lean_n_rad - lean_n)
    ask_e = airframe.attitude_gain_1_s * (demand.lean_e_rad - lean_e)
    ask = math.hypot(ask_n, ask_e)
    if ask > airframe.lean_rate_max_rad_s:
        ask_n *= airframe.lean_rate_max_rad_s / ask
        ask_e *= airframe.lean_rate_max_rad_s / ask
    keep = math.exp(-airframe.rate_gain_1_s * dt_s)
    rate_n = ask_n + (rate_n - ask_n) * keep
    rate_e = ask_e + (rate_e - ask_e) * keep
    lean_n += rate_n * dt_s
    lean_e += rate_e * dt_s
    yaw_rate += (demand.yaw_rate_rad_s - yaw_rate) * (1.0 - math.exp(-airframe.yaw_rate_gain_1_s * dt_s))

    lean = math.hypot(lean_n, lean_e)
    side = thrust_m_s2 * (math.sin(lean) / lean if lean > 1e-9 else 1.0)
    w_n, w_e, w_d = around.wind_ned_m_s
    air_n, air_e, air_d = v_n - w_n, v_e - w_e, v_d - w_d
    # Implicit in the drag: stable and free of bias at rest for any wind and step.
    a_n, a_e = _against_air(airframe, (side * lean_n, side * lean_e), (air_n, air_e), yaw, dt_s)
    drag = airframe.drag_1_s + airframe.drag_1_m * abs(air_d)
    a_d = (GRAVITY_M_S2 - thrust_m_s2 * math.cos(lean) - drag * air_d) / (1.0 + drag * dt_s)

    half = 0.5 * dt_s
    p_d += (v_d + a_d * half) * dt_s
    if p_d >= around.ground_down_m and v_d + a_d * dt_s >= 0.0:
        # The legs take the impact: nothing bounces, nothing slides.
        return body_touching(body, thrust_m_s2, around.ground_down_m)
    return Body(
        (p_n + (v_n + a_n * half) * dt_s, p_e + (v_e + a_e * half) * dt_s, p_d),
        (v_n + a_n * dt_s, v_e + a_e * dt_s, v_d + a_d * dt_s),
        (a_n, a_e, a_d),
        lean_n,
        lean_e,
        rate_n,
        rate_e,
        math.remainder(yaw + yaw_rate * dt_s, math.tau),
        yaw_rate,
        thrust_m_s2,
        on_ground=False,
    )


def _against_air(
    airframe: Airframe, push: tuple[float, float], air: tuple[float, float], yaw_rad: float, dt_s: float
) -> tuple[float, float]:
    """Horizontal acceleration under a specific force and the drag of the air, along north and east."""
    linear, quadratic = airframe.drag_1_s, airframe.drag_1_m
    if not quadratic:
        damp = 1.0 / (1.0 + linear * dt_s)
        return (push[0] - linear * air[0]) * damp, (push[1] - linear * air[1]) * damp
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    ahead, right = air[0] * cosine + air[1] * sine, air[1] * cosine - air[0] * sine
    drag_x, drag_y = linear + quadratic * abs(ahead), linear + quadratic * abs(right)
    x = (push[0] * cosine + push[1] * sine - drag_x * ahead) / (1.0 + drag_x * dt_s)
    y = (push[1] * cosine - push[0] * sine - drag_y * right) / (1.0 + drag_y * dt_s)
    return x * cosine - y * sine, x * sine + y * cosine


def body_touching(body: Body, thrust_m_s2: float, ground_down_m: float) -> Body:
    """The body after touching the ground at this place."""
    return _resting(body, thrust_m_s2, ground_down_m)
