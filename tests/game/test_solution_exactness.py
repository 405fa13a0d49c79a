"""To the last digits: against the definitions in sixty digits, where formulas written carelessly lose theirs."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, solve
from guidance.game.arrays import less_length
from tests.harness.examples import drawn

DIGITS = 60
some = settings(max_examples=drawn(60), deadline=None)
places = st.tuples(*[st.floats(-50.0, 50.0)] * 2)
heights = st.floats(0.0, 50.0)
spare = st.sampled_from([1e-12, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 20.0])


def at(*place):
    return np.array([*place, 0.0][:3])


def length(*parts):
    return sum(part * part for part in parts).sqrt()


def exact(*arrays):
    return [[Decimal(float(part)) for part in array] for array in arrays]


def final_distance(P, E, T, u, v):
    """‖c − T‖ − r of eq. (41), and the barrier, as the paper writes them."""
    (px, py, pz), (ex, ey, _), (tx, ty, _) = exact(P, E, T)
    square = (Decimal(u) / Decimal(v)) ** 2
    hand = square - 1
    c = ((square * ex - px) / hand, (square * ey - py) / hand)
    r = (pz * pz / hand + square * ((px - ex) ** 2 + (py - ey) ** 2) / hand**2).sqrt()
    b = square * ((ex - tx) ** 2 + (ey - ty) ** 2) - ((px - tx) ** 2 + (py - ty) ** 2 + pz * pz)
    return length(c[0] - tx, c[1] - ty) - r, b, r, c


@some
@given(P=places, z=heights, E=places, T=places, over=spare)
def test_the_final_distance_keeps_its_digits_however_close_the_speeds(P, z, E, T, over):
    P = at(*P, z)
    E = at(*E)
    T = at(*T)
    u = 1.0 + over
    solution = solve(Game(Ball(u), 1.0), P, E, T)
    with localcontext() as context:
        context.prec = DIGITS
        value, b, _, _ = final_distance(P, E, T, u, 1.0)
        size = sum(part * part for vector in exact(P, E, T) for part in vector) + Decimal("1e-300")
    clear = abs(float(b / size)) > 1e-3
    if solution.winner > 0 and clear:
        assert float(solution.value) == pytest.approx(float(value), rel=1e-12)
    if clear:
        assert int(solution.winner) == (1 if b > 0 else -1)


def test_at_a_speed_ratio_of_one_plus_1e_12_fourteen_digits_are_right():
    rng = np.random.default_rng(3)
    u = 1.0 + 1e-12
    worst = 0.0
    for _ in range(300):
        P, E, T = (at(*rng.uniform(-20.0, 20.0, 3)) for _ in range(3))
        E[2] = T[2] = 0.0
        solution = solve(Game(Ball(u), 1.0), P, E, T)
        with localcontext() as context:
            context.prec = DIGITS
            value = float(final_distance(P, E, T, u, 1.0)[0])
        if value > 0.5:
            worst = max(worst, abs(float(solution.value) / value - 1.0))
            assert np.linalg.norm(solution.meeting_point_m - T) == pytest.approx(value, rel=1e-12)
    assert worst < 1e-14


@pytest.mark.parametrize(
    ("u", "P", "E"),
    [
        (2.0, (8.0, 0.0, 0.0), (0.0, 4.0)),
        (3.0, (3.0, 3.0, 0.0), (1.0, 1.0)),
        (3.0, (1.0, 4.0, 8.0), (3.0, 0.0)),
    ],
)
def test_on_the_barrier_everything_is_exactly_zero(u, P, E):
    solution = solve(Game(Ball(u), 1.0), np.array(P), at(*E), np.zeros(3))
    assert (solution.winner, solution.value, solution.margin_s) == (Winner.UNDECIDED, 0.0, 0.0)
    assert solution.reason == Reason.ON_BARRIER


def capture_time(P, E, u, v, wind):
    """Root of √((ut)² − z²) = ‖E − P − w t‖ + v t, by bisection."""
    (px, py, pz), (ex, ey, _) = exact(P, E)
    u, v, x, y = (Decimal(part) for part in (u, v, *wind))
    low = abs(pz) / u
    high = Decimal(10) ** 30

    def short(t):
        return length(ex - px - x * t, ey - py - y * t) + v * t - ((u * t) ** 2 - pz * pz).sqrt()

    for _ in range(400):
        middle = (low * high).sqrt() if low > 0 else high / 2
        low, high = (middle, high) if short(middle) > 0 else (low, middle)
    return high


@settings(max_examples=drawn(30), deadline=None)
@given(P=places, z=st.floats(0.1, 50.0), E=places, over=st.sampled_from([1e-9, 1e-6, 1e-3, 0.5]))
def test_pe_keeps_its_digits_however_little_the_wind_leaves(P, z, E, over):
    wind = (0.3, -0.4)
    u = 1.5 + over
    P = at(*P, z)
    E = at(*E)
    with localcontext() as context:
        context.prec = DIGITS
        value = float(capture_time(P, E, u, 1.0, wind))
    assert float(solve(Game(Ball(u), 1.0, wind_m_s=wind), P, E).value) == pytest.approx(
        value, rel=1e-12
    )


@some
@given(
    wind=st.tuples(*[st.floats(-3.0, 3.0)] * 2),
    v=st.floats(0.1, 5.0),
    over=st.sampled_from([1e-12, 1e-9, 1e-3, 1.0]),
)
def test_what_the_pursuer_has_in_hand_keeps_its_digits_in_any_wind(wind, v, over):
    u = v + float(np.hypot(*wind)) + over
    with localcontext() as context:
        context.prec = DIGITS
        x, y = (Decimal(part) for part in wind)
        hand = float(Decimal(u) - Decimal(v) - length(x, y))
    assert less_length(u, v, wind) == pytest.approx(hand, rel=1e-14, abs=1e-30)


def stand_off_time(d, z, radius, capture, u, v):
    """Root of √((u t + l)² − z²) = d − R + v t, from the quadratic as it is."""
    d, z, radius, capture, u, v = (Decimal(part) for part in (d, z, radius, capture, u, v))
    half = v * (d - radius) - u * capture
    hand = u * u - v * v
    beyond = (d - radius) ** 2 + z * z - capture * capture
    return (half + (half * half + hand * beyond).sqrt()) / hand


@pytest.mark.parametrize("d", [0.75, 3.0, 9.0])
@pytest.mark.parametrize("over", [1e-12, 1e-6, 1e-3])
def test_pe_keeps_its_digits_inside_and_outside_of_the_disc(d, over):
    game = Game(Ball(1.0 + over), 1.0, capture_radius_m=2.0, standoff=StandOff(2.5, 0.0))
    with localcontext() as context:
        context.prec = DIGITS
        time = float(stand_off_time(d, 4.0, 2.5, 2.0, 1.0 + over, 1.0))
    assert float(solve(game, at(d, 0, 4.0), at(0, 0)).value) == pytest.approx(time, rel=1e-12)


def test_a_race_won_beside_the_pursuer_is_exact_however_far_the_target():
    for far in (1e3, 1e6, 1e9):
        solution = solve(Game(Ball(2.0), 1.0), at(-1, 0), at(0, 0), at(far, 0))
        np.testing.assert_allclose(solution.meeting_point_m, (1.0, 0.0, 0.0), rtol=1e-15)
        assert float(solution.value) == pytest.approx(far - 1.0, rel=1e-15)


@pytest.mark.parametrize(
    "name", ["capture_radius", "ball_standoff", "cylinder_standoff", "age", "wind", "moving_target"]
)
def test_a_symmetric_state_has_no_spurious_side(games, name):
    game = games[name]
    if name in ("wind", "moving_target"):
        game = Game(game.pursuer, 1.0, wind_m_s=(0.3, 0.0), target_velocity_m_s=(0.2, 0.0))
    solution = solve(
        game, np.array([-15.0, 0.0, 9.0]), np.array([-2.0, 0.0, 0.0]), np.array([14.0, 0.0, 0.0])
    )
    far = solve(
        game, np.array([15.0, 0.0, 9.0]), np.array([2.0, 0.0, 0.0]), np.array([30.0, 0.0, 0.0])
    )
    for one in (solution, far):
        for vector in (one.meeting_point_m, one.pursuer_velocity_m_s, one.evader_velocity_m_s):
            assert vector[1] == 0.0


NEWTON = {
    "radius": Game(Ball(2.0), 1.0, capture_radius_m=1.5),
    "standoff": Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 2.0)),
    "slow": Game(Ball(1.02), 1.0, standoff=StandOff(3.0, 2.0)),
    "wind": Game(Ball(2.0), 1.0, wind_m_s=(0.3, -0.4)),
    "young": Game(Ball(2.0), 1.0, standoff=StandOff(3.0, 2.0), information_age_s=0.5),
    "moving": Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.2)),
    "all": Game(
        Ball(2.0),
        1.0,
        0.2,
        StandOff(3.0, 2.0),
        information_age_s=0.5,
        wind_m_s=(0.3, -0.4),
        target_velocity_m_s=(0.1, 0.2),
    ),
    "cylinder": Game(Cylinder(2.0, 9.0, 9.0), 1.0, 0.2, StandOff(3.0, 2.0), wind_m_s=(0.3, -0.4)),
}


@pytest.mark.parametrize("name", NEWTON)
def test_the_meeting_point_is_on_the_edge_and_its_normal_leads_to_the_target(name, oracle):
    """Without the kernel's own formulas: the definition says who is where, finite differences where the edge leads."""
    game = NEWTON[name]
    P, E, T = oracle.states(17, 400)
    solution = solve(game, P, E, T)
    won = (solution.winner > 0) & (solution.value > 0.5) & (solution.meeting_time_s > 0.3)
    assert won.sum() > 60
    P = P[won]
    E = E[won]
    T = T[won]
    t = solution.meeting_time_s[won]
    X = solution.meeting_point_m[won]
    np.testing.assert_allclose(oracle.shortfall(game, P, X, t), 0.0, atol=1e-10)
    run = game.evader_speed_m_s * (t + game.information_age_s)
    np.testing.assert_allclose(np.linalg.norm(X - E, axis=1), run, rtol=1e-12)
    drift = np.array([*game.target_velocity_m_s, 0.0])
    goal = T + t[:, None] * drift
    np.testing.assert_allclose(np.linalg.norm(X - goal, axis=1), solution.value[won], rtol=1e-12)
    n = (X - E) / run[:, None]
    p = np.stack([-n[:, 1], n[:, 0], 0.0 * t], axis=1)
    step = 1e-3
    sides = []
    for side in (-step, step):
        heading = n + side * p
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        then = oracle.capture_times(game, P, E, heading)
        end = E + (game.evader_speed_m_s * (then + game.information_age_s))[:, None] * heading
        sides.append(np.linalg.norm(end - T - then[:, None] * drift, axis=1))
    slope = (sides[1] - sides[0]) / (2.0 * step)
    curved = np.abs(sides[1] + sides[0] - 2.0 * solution.value[won]) / step**2
    assert (np.abs(slope) <= 1e-6 + 10.0 * step * step * (1.0 + curved)).all()
