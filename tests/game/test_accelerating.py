"""PE against a pursuer with bounded acceleration, checked against a numerical minimax and the HJI equation."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from guidance.errors import ConfigError
from guidance.game.accelerating import solve_accelerating


def drawn(rng, largest=0.98):
    """A random state: pursuer at the origin, evader east of it."""
    u = rng.uniform(3.0, 10.0)
    speed = min(u, largest * u * math.sqrt(rng.random()))
    course = rng.uniform(0.0, 2.0 * math.pi)
    flown = (speed * math.cos(course), speed * math.sin(course))
    players = {
        "speed_m_s": u,
        "acceleration_m_s2": rng.uniform(1.0, 5.0),
        "evader_speed_m_s": u * rng.uniform(0.2, 0.8),
        "capture_radius_m": rng.uniform(0.0, 1.5),
    }
    return flown, (rng.uniform(2.0, 40.0), 0.0), players


def reach_m(flown, heading, time_s, u, a, steps=16):
    """Distance along a heading that the pursuer can fly by a time: accelerations by direct optimisation."""
    dt_s = time_s / steps
    ahead = np.array([math.cos(heading), math.sin(heading)])

    def velocities(given):
        return np.array(flown) + np.cumsum(given.reshape(steps, 2), axis=0) * dt_s

    def far_m(given):
        after = velocities(given)
        before = np.vstack([flown, after[:-1]])
        return float(np.sum(0.5 * (before + after) @ ahead) * dt_s)

    bounds = [
        {
            "type": "ineq",
            "fun": lambda given: 1.0 - np.sum(given.reshape(steps, 2) ** 2, axis=1) / a**2,
        },
        {"type": "ineq", "fun": lambda given: 1.0 - np.sum(velocities(given) ** 2, axis=1) / u**2},
    ]
    found = minimize(
        lambda given: -far_m(given), np.zeros(2 * steps), constraints=bounds, method="SLSQP"
    )
    assert found.success
    return -found.fun


@pytest.mark.parametrize("seed", range(3))
def test_the_value_is_that_of_a_numerical_minimax(seed):
    flown, evader, players = drawn(np.random.default_rng(seed), largest=2.0)  # often at top speed
    solution = solve_accelerating((0.0, 0.0), flown, evader, **players)
    u, a, v, radius_m = players.values()

    def short_m(heading):
        needed_m = evader[0] * math.cos(heading) + v * solution.time_s - radius_m
        return needed_m - reach_m(flown, heading, solution.time_s, u, a)

    assert short_m(solution.heading_rad) == pytest.approx(0.0, abs=5e-3 * u * solution.time_s)
    for heading in solution.heading_rad + np.array([-0.8, -0.2, 0.2, 0.8]):
        assert short_m(heading) <= 5e-3 * u * solution.time_s


def test_value_and_strategies_satisfy_the_hji_equation():
    rng = np.random.default_rng(7)
    h = 1e-5
    for _ in range(10):
        flown, evader, players = drawn(rng)
        solution = solve_accelerating((0.0, 0.0), flown, evader, **players)

        def slope(which, axis, flown=flown, evader=evader, players=players):
            state = [np.zeros(2), np.array(flown), np.array(evader)]
            shift = np.zeros(2)
            shift[axis] = h
            state[which] = state[which] + shift
            ahead = solve_accelerating(*state, **players).time_s
            state[which] = state[which] - 2.0 * shift
            return (ahead - solve_accelerating(*state, **players).time_s) / (2.0 * h)

        by_place, by_speed = ([slope(which, axis) for axis in (0, 1)] for which in (0, 1))
        optimal = np.dot(by_place, flown) - players["acceleration_m_s2"] * math.hypot(*by_speed)
        optimal += players["evader_speed_m_s"] * math.hypot(*by_place)  # dV/dE = -dV/dP
        assert optimal == pytest.approx(-1.0, abs=1e-6)
        heading = np.array([math.cos(solution.heading_rad), math.sin(solution.heading_rad)])
        played = np.dot(by_place, flown) + np.dot(by_speed, solution.acceleration_m_s2)
        played -= players["evader_speed_m_s"] * np.dot(by_place, heading)
        assert played == pytest.approx(-1.0, abs=1e-6)


def test_on_a_line_it_is_a_parabola_and_then_a_straight_line():
    u = 8.0
    a = 4.0
    v = 4.0
    d = 57.0
    for w in (0.0, 3.0, 8.0, -5.0):
        solution = solve_accelerating(
            (0.0, 0.0), (w, 0.0), (d, 0.0), speed_m_s=u, acceleration_m_s2=a, evader_speed_m_s=v
        )
        assert solution.time_s == pytest.approx(
            d / (u - v) + (u - w) ** 2 / (2.0 * a * (u - v)), rel=1e-9
        )
    near = solve_accelerating(
        (0.0, 0.0), (0.0, 0.0), (2.0, 0.0), speed_m_s=u, acceleration_m_s2=a, evader_speed_m_s=0.5
    )
    # V t + d = a t²/2, below top speed
    assert near.time_s == pytest.approx((0.5 + math.sqrt(0.25 + 16.0)) / a)


def test_an_evader_dodges_a_pursuer_that_flies_past():
    players = {
        "speed_m_s": 7.7,
        "acceleration_m_s2": 1.2,
        "evader_speed_m_s": 5.2,
        "capture_radius_m": 0.8,
    }
    dodged = solve_accelerating((0.0, 0.0), (3.1, -6.6), (3.6, 0.0), **players)
    assert math.sin(dodged.heading_rad) > 0.9  # against the pursuer's motion across
    assert (
        dodged.time_s
        > 2.0 * solve_accelerating((0.0, 0.0), (0.0, 0.0), (3.6, 0.0), **players).time_s
    )


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"evader_speed_m_s": 6.0}, "evader_speed_m_s = 6: allowed is 0 up to below 6"),
        ({"acceleration_m_s2": 0.0}, "acceleration_m_s2 = 0"),
        ({"capture_radius_m": math.nan}, "finite"),
    ],
)
def test_wrong_values_are_named(wrong, named):
    players = {"speed_m_s": 6.0, "acceleration_m_s2": 2.0, "evader_speed_m_s": 3.0} | wrong
    with pytest.raises(ConfigError, match=named):
        solve_accelerating((0.0, 0.0), (0.0, 0.0), (10.0, 0.0), **players)
