"""Several pursuers against one evader: from the definitions, against opponents, and against the game of one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.errors import ConfigError
from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, solve, solve_state
from guidance.game.team import solve_team
from guidance.game.team.regions import regions_of, survived
from tests.game.bits import same
from tests.harness.examples import drawn

PAPER = Game(Ball(2.0), 1.0)
HIGH = Game(Ball(3.0), 1.5, standoff=StandOff(0.0, 4.0))
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 5)


def states(seed, n, count=None):
    """Positions of n pursuers, an evader and a target, for one state or a batch."""
    rng = np.random.default_rng(seed)
    shape = () if count is None else (count,)
    P = rng.uniform(-20.0, 20.0, (*shape, n, 3))
    P[..., 2] = np.abs(P[..., 2])
    E, T = rng.uniform(-20.0, 20.0, (2, *shape, 3))
    E[..., 2] = T[..., 2] = 0.0
    return P, E, T


def unequal(seed, n):
    """A game whose pursuers have different speeds."""
    return Game(Ball(np.random.default_rng(seed).uniform(1.05, 4.0, n)), 1.0)


def pursuer_of(game, i):
    u = np.ravel(game.pursuer.speed_m_s)
    return Game(Ball(float(u[i % len(u)])), game.evader_speed_m_s, standoff=game.standoff)


def survival(oracle, game, P, E, n):
    """Times that an evader can run along each heading before the first capture, from the definition."""
    return np.min(
        [oracle.capture_times(pursuer_of(game, i), one, E, n) for i, one in enumerate(P)], axis=0
    )


def searched(oracle, game, P, E, cost):
    """The least cost of the end of a run, over all headings, ever finer about the best."""
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    spread = angle[1]
    for _ in range(13):
        n = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        t = survival(oracle, game, P, E, n)
        costs = cost(t, E + game.evader_speed_m_s * t[:, None] * n)
        best = angle[np.argmin(costs)]
        angle = np.linspace(best - spread, best + spread, 41)
        spread = spread / 10.0
    return costs.min()


@settings(max_examples=drawn(12), deadline=None)
@given(seed=seeds, n=counts, game=st.sampled_from([PAPER, HIGH, None]))
def test_the_value_is_that_of_its_definition(oracle, seed, n, game):
    """Catches a wrong value of a team, against a search over headings."""
    game = unequal(seed, n) if game is None else game
    P, E, T = states(seed, n)
    answer = solve_team(game, P, E, T)
    if answer.winner < 0:
        arrival = np.linalg.norm(E - T) / game.evader_speed_m_s
        short = [oracle.shortfall(pursuer_of(game, i), one, T, arrival) for i, one in enumerate(P)]
        assert answer.value == pytest.approx(min(short), rel=1e-12)
        return
    value = searched(oracle, game, P, E, lambda t, X: np.linalg.norm(X - T, axis=1))
    assert answer.value == pytest.approx(value, rel=1e-11, abs=1e-11)
    assert np.linalg.norm(answer.meeting_point_m - T) == pytest.approx(
        answer.value, rel=1e-12, abs=1e-12
    )


def pair_value(game, P, E, i, j):
    """The value of PE for two of the pursuers, by their speeds."""
    u = np.broadcast_to(game.pursuer.speed_m_s, len(P))[[i, j]]
    two = Game(Ball(u), game.evader_speed_m_s, standoff=game.standoff)
    return solve_team(two, P[[i, j]], E).value


@settings(max_examples=drawn(12), deadline=None)
@given(seed=seeds, n=counts, game=st.sampled_from([PAPER, HIGH, None]))
def test_the_lower_bound_of_pe_is_the_longest_run_that_no_pursuer_ends(oracle, seed, n, game):
    game = unequal(seed, n) if game is None else game
    P, E, _ = states(seed, n)
    answer = solve_team(game, P, E)
    assert answer.lower_bound == pytest.approx(
        -searched(oracle, game, P, E, lambda t, X: -t), rel=1e-11
    )
    alone = [solve(pursuer_of(game, i), one, E).value for i, one in enumerate(P)]
    assert answer.lower_bound <= answer.value <= min(alone)
    assert n > 2 or answer.lower_bound == answer.value
    best = min([*alone, *(pair_value(game, P, E, i, j) for i in range(n) for j in range(i))])
    assert answer.value == pytest.approx(best, rel=1e-12)
    assert answer.meeting_time_s == pytest.approx(answer.lower_bound, rel=1e-15)
    run = np.linalg.norm(answer.meeting_point_m - E)
    assert run == pytest.approx(game.evader_speed_m_s * answer.lower_bound, rel=1e-12)
    np.testing.assert_allclose(
        answer.evader_velocity_m_s * answer.lower_bound + E, answer.meeting_point_m, atol=1e-9
    )


@settings(max_examples=drawn(20), deadline=None)
@given(seed=seeds, kind=st.sampled_from([np.float64, np.float32]), tad=st.booleans())
def test_a_team_of_one_has_the_answer_of_solve_to_the_bit(seed, kind, tad):
    for game in (PAPER, HIGH):
        P, E, T = (part.astype(kind) for part in states(seed, 1, 30))
        E[0] = P[0, 0] * [1, 1, 0]
        P[1, 0] = E[1] + [0, 0, game.standoff.height_m]
        E[2] = T[2]
        P[3, 0] = [8, 0, game.standoff.height_m]
        E[3] = [0, 4, 0]
        T[3] = [0, 0, 0]
        seen = np.random.default_rng(seed).normal(size=(30, 3)).astype(kind)
        target = T if tad else None
        team = solve_team(game, P, E, target, evader_velocity_m_s=seen)
        one = solve(game, P[:, 0], E, target, evader_velocity_m_s=seen)
        assert same(team.pursuer_velocity_m_s[:, 0], one.pursuer_velocity_m_s)
        assert team.binds.all()
        for name in set(one._fields) - {"pursuer_velocity_m_s"}:
            assert same(getattr(team, name), getattr(one, name)), name
        assert same(team.lower_bound, one.value)


@settings(max_examples=drawn(15), deadline=None)
@given(seed=seeds, n=counts, tad=st.booleans())
def test_a_batch_is_its_singles(seed, n, tad):
    P, E, T = states(seed, n, 12)
    game = unequal(seed, n)
    T = T if tad else None
    whole = solve_team(game, P, E, T)
    folded = solve_team(
        game, P.reshape(3, 4, n, 3), E.reshape(3, 4, 3), None if T is None else T.reshape(3, 4, 3)
    )
    for i in range(12):
        one = solve_team(game, P[i], E[i], None if T is None else T[i])
        for part, other, single in zip(whole, folded, one, strict=True):
            assert same(part[i], single)
            assert same(other.reshape(part.shape), part)


def test_leading_axes_broadcast():
    P, E, T = states(1, 3, 20)
    crossed = solve_team(PAPER, P[:5, None], E[None, 5:12], T[0])
    assert crossed.value.shape == (5, 7)
    assert crossed.binds.shape == (5, 7, 3)
    assert crossed.pursuer_velocity_m_s.shape == (5, 7, 3, 3)
    assert crossed.value[3, 4] == solve_team(PAPER, P[3], E[9], T[0]).value
    speeds = Game(PAPER.pursuer, np.array([[0.5], [1.0]]))
    assert solve_team(speeds, P[0], E[0], T[0]).value.shape == (2,)
    assert (
        solve_team(speeds, P[0], E[0], T[0]).value[1] == solve_team(PAPER, P[0], E[0], T[0]).value
    )


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds, n=st.integers(2, 6), tad=st.booleans(), alike=st.booleans())
def test_the_order_of_the_pursuers_changes_nothing(seed, n, tad, alike):
    P, E, T = states(seed, n)
    order = np.random.default_rng(seed).permutation(n)
    game = PAPER if alike else unequal(seed, n)
    moved = game if alike else Game(Ball(game.pursuer.speed_m_s[order]), 1.0)
    answer = solve_team(game, P, E, T if tad else None)
    again = solve_team(moved, P[order], E, T if tad else None)
    for name in set(answer._fields) - {"binds", "multipliers", "pursuer_velocity_m_s"}:
        assert same(getattr(answer, name), getattr(again, name)), name
    assert same(answer.pursuer_velocity_m_s[order], again.pursuer_velocity_m_s)
    assert same(answer.binds[order], again.binds)
    assert same(answer.multipliers[order], again.multipliers)


def stepped(answer, P, E, dt, *, flown=None, run=None):
    return P + dt * (answer.pursuer_velocity_m_s if flown is None else flown), E + dt * (
        answer.evader_velocity_m_s if run is None else run
    )


@settings(max_examples=drawn(10), deadline=None)
@given(seed=seeds, n=counts)
def test_l_falls_for_none_of_fifty_evaders_and_rises_for_none_of_fifty_teams(seed, n):
    P, E, T = states(seed, n, 60)
    answer = solve_team(PAPER, P, E, T)
    won = (answer.winner > 0) & (answer.value > 1.0) & (answer.meeting_time_s > 0.5)
    P = P[won]
    E = E[won]
    T = T[won]
    answer = solve_team(PAPER, P, E, T)
    rng = np.random.default_rng(seed)
    dt = 1e-6
    evaders = rng.normal(size=(50, *E.shape)) * [1, 1, 0]
    evaders *= (rng.choice([1.0, 0.5], (50, 1, 1))) / np.linalg.norm(
        evaders, axis=-1, keepdims=True
    )
    later = solve_team(PAPER, *stepped(answer, P, E, dt, run=evaders), T)
    assert ((later.value - answer.value) / dt > -1e-4).all()
    teams = rng.normal(size=(50, *P.shape))
    teams *= 2.0 / np.linalg.norm(teams, axis=-1, keepdims=True)
    later = solve_team(PAPER, *stepped(answer, P, E, dt, flown=teams), T)
    assert ((later.value - answer.value) / dt < 1e-4).all()
    both = solve_team(PAPER, *stepped(answer, P, E, dt), T)
    np.testing.assert_allclose(both.value, answer.value, atol=1e-9)


@settings(max_examples=drawn(10), deadline=None)
@given(seed=seeds, n=st.integers(2, 5))
def test_the_bounds_of_pe_hold_against_fifty_opponents(seed, n):
    P, E, _ = states(seed, n, 40)
    answer = solve_team(PAPER, P, E)
    rng = np.random.default_rng(seed)
    dt = 1e-6 * np.minimum(1.0, answer.lower_bound)[:, None, None]
    evaders = rng.normal(size=(50, *E.shape)) * [1, 1, 0]
    evaders /= np.linalg.norm(evaders, axis=-1, keepdims=True)
    later = solve_team(
        PAPER, *stepped(answer, P, E, dt, run=evaders[..., None, :])[:1], E + dt[:, 0] * evaders
    )
    assert ((later.value + dt[:, 0, 0] - answer.value) / dt[:, 0, 0] < 1e-3).all()
    teams = rng.normal(size=(50, *P.shape))
    teams *= 2.0 / np.linalg.norm(teams, axis=-1, keepdims=True)
    later = solve_team(PAPER, P + dt * teams, E + dt[:, 0] * answer.evader_velocity_m_s)
    assert ((later.lower_bound + dt[:, 0, 0] - answer.lower_bound) / dt[:, 0, 0] > -1e-3).all()


def hunted(ratio, share, count, seed, n=2):
    """Play PE of n pursuers against an evader that tries 24 headings at every step and knows their velocities.

    Two pursuers bind at the start. Steps are a share of the value. Return the times to the capture over the value.
    """
    game = Game(Ball(ratio), 1.0)
    rng = np.random.default_rng(seed)
    P = rng.uniform(-12.0, 12.0, (8 * count, n, 3))
    E = rng.uniform(-6.0, 6.0, (8 * count, 3))
    P[..., 2] = np.abs(P[..., 2]) * rng.choice([0.0, 1.0], (8 * count, 1))
    E[:, 2] = 0.0
    first = solve_team(game, P, E)
    both = np.flatnonzero(first.binds.sum(axis=-1) == 2)[:count]
    P = P[both]
    E = E[both]
    value = first.value[both]
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    runs = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)[:, None]
    time = np.zeros(count)
    while (time < 1.5 * value).any():
        gap = np.linalg.norm(P - E[:, None], axis=-1).min(axis=-1)
        if (gap <= 0.01 * value).all():
            break
        h = np.minimum(share * value, gap / (ratio + 1.0))[:, None]
        P = P + h[..., None] * solve_team(game, P, E).pursuer_velocity_m_s
        tried = E + h * runs
        later = solve_team(game, P, tried).value
        E = tried[np.argmax(later, axis=0), np.arange(count)]
        time = time + np.where(gap > 0.01 * value, h[:, 0], 0.0)
    return time / value


@pytest.mark.parametrize(("ratio", "most"), [(1.3, 1.05), (2.0, 1.01)])
def test_two_pursuers_capture_an_evader_that_searches_in_the_value(ratio, most):
    """Catches two pursuers that an evader with a search at every step escapes for longer than the value."""
    late = hunted(ratio, 0.005, 3, 3)
    assert late.min() > 0.9
    assert late.max() < most


@pytest.mark.flight
@pytest.mark.parametrize("n", [3, pytest.param(4, marks=pytest.mark.long)])
def test_more_pursuers_are_never_later_than_the_upper_bound(n):
    assert hunted(1.3, 0.005, 10, 5, n).max() < 1.04
    assert hunted(2.0, 0.005, 10, 5, n).max() < 1.01


@pytest.mark.flight
def test_two_pursuers_are_the_less_late_the_shorter_the_steps():
    assert hunted(1.3, 0.0025, 10, 4).max() < 1.02


def test_an_evader_between_two_pursuers_runs_aside():
    answer = solve_team(Game(Ball(1.3), 1.0), [[-6, 0, 0], [6, 0, 0]], [0, 1e-3, 0])
    assert round(float(answer.value), 2) == 7.22
    assert answer.evader_velocity_m_s.tolist() == [0.0, 1.0, 0.0]
    even = solve_team(Game(Ball(1.3), 1.0), [[-6, 0, 0], [6, 0, 0]], [0, 0, 0])
    assert even.meeting_point_m[1] > 7.0


@settings(max_examples=drawn(20), deadline=None)
@given(seed=seeds, n=counts, tad=st.booleans())
def test_multipliers_are_what_a_second_of_delay_costs(seed, n, tad):
    P, E, T = states(seed, n)
    T = T if tad else None
    answer = solve_team(PAPER, P, E, T)
    if (
        answer.winner < 0
        or answer.value < 0.5
        or not answer.binds.any()
        or answer.lower_bound < answer.value
    ):
        return
    dt = 1e-6
    for i in range(n):
        late = P.copy()
        late[i] -= dt * answer.pursuer_velocity_m_s[i]
        slope = (solve_team(PAPER, late, E, T).value - answer.value) / dt
        if answer.binds[i]:
            assert (-slope if tad else slope) == pytest.approx(
                answer.multipliers[i], rel=1e-3, abs=1e-4
            )
        else:
            assert answer.multipliers[i] == 0.0
    assert answer.multipliers.sum() >= (0.0 if tad else 1.0)


@pytest.mark.parametrize(
    ("P", "target_m", "value", "later"),
    [
        ([[-9.58, 10.23, 3.66], [-8.49, -15.6, 7.59]], 20.835, 20.835 - 5.59 / 0.5, 1),
        ([[14.3, -18.66, 7.6], [-12.97, 14.53, 5.4]], None, 5.6 / 0.5, 0),
    ],
)
def test_where_a_height_decides_only_the_later_cylinders_delay_costs(P, target_m, value, later):
    game = Game(Cylinder(np.array([2.0, 2.2]), 1.0, 0.5), 1.0, standoff=StandOff(1.0, 2.0))
    E = np.zeros(3)
    T = None if target_m is None else [target_m, 0.0, 0.0]
    dt = 1e-6
    answer = solve_team(game, P, E, T)
    assert answer.binds.all()
    assert answer.value == pytest.approx(value)
    for i in (0, 1):
        late = np.array(P)
        late[i] -= dt * answer.pursuer_velocity_m_s[i]
        cost = abs(solve_team(game, late, E, T).value - answer.value) / dt
        assert cost == pytest.approx(float(i == later), abs=1e-6)
        assert answer.multipliers[i] == pytest.approx(cost, abs=1e-6)


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds)
def test_the_multipliers_of_two_pursuers_add_up_to_one_or_more(seed):
    """The condition for an exact value of two pursuers."""
    P, E, _ = states(seed, 2, 400)
    u = np.random.default_rng(seed).uniform(1.02, 4.0, (400, 2))
    answer = solve_team(Game(Ball(u), 1.0), P, E)
    assert (answer.multipliers.sum(axis=-1) >= 1.0 - 1e-9).all()


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds, n=st.integers(2, 5))
def test_a_pair_wins_only_if_one_of_it_wins_alone_and_one_more_never_hurts(seed, n):
    P, E, T = states(seed, n)
    answer = solve_team(PAPER, P, E, T)
    alone = solve(PAPER, P, E, T)
    assert answer.winner == alone.winner.max()
    fewer = solve_team(PAPER, P[1:], E, T)
    assert answer.winner >= fewer.winner
    if answer.winner > 0 and fewer.winner > 0:
        assert answer.value >= fewer.value
    elif answer.winner < 0:
        assert answer.value <= fewer.value
    pe = solve_team(PAPER, P, E)
    fewer = solve_team(PAPER, P[1:], E)
    assert pe.value <= fewer.value
    assert pe.lower_bound <= fewer.lower_bound * (1 + 1e-15)


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds, n=st.integers(3, 5))
def test_pursuers_that_do_not_bind_are_free(seed, n):
    P, E, T = states(seed, n)
    answer = solve_team(PAPER, P, E, T)
    assert 1 <= answer.binds.sum() <= 2
    again = solve_team(PAPER, P[answer.binds], E, T)
    assert (again.value, again.winner) == (answer.value, answer.winner)
    assert same(again.pursuer_velocity_m_s, answer.pursuer_velocity_m_s[answer.binds])
    if answer.winner > 0:
        towards = answer.meeting_point_m - P
        cosine = np.vecdot(towards, answer.pursuer_velocity_m_s) / np.linalg.norm(towards, axis=-1)
        np.testing.assert_allclose(cosine, 2.0, rtol=1e-9)


def test_two_pursuers_meet_the_evader_together_where_both_bind():
    P = np.array([[6.0, 4.0, 5.0], [6.0, -5.0, 3.0], [9.0, 9.0, 9.0]])
    answer = solve_team(PAPER, P, np.array([9.0, 0.0, 0.0]), np.zeros(3))
    assert answer.winner == Winner.PURSUER
    assert answer.reason == Reason.SOLVED
    assert answer.binds.tolist() == [True, True, False]
    way = np.linalg.norm(P - answer.meeting_point_m, axis=-1)
    np.testing.assert_allclose(way[:2] / 2.0, answer.meeting_time_s, rtol=1e-14)
    assert way[2] / 2.0 > answer.meeting_time_s
    np.testing.assert_allclose(
        [9, 0, 0] + answer.meeting_time_s * answer.evader_velocity_m_s,
        answer.meeting_point_m,
        atol=1e-14,
    )


def test_a_captured_evader_is_captured_by_whoever_is_there():
    P, E, T = states(3, 3)
    P[1] = E
    for target in (None, T):
        answer = solve_team(PAPER, P, E, target)
        assert answer.reason == Reason.CAPTURED
        assert answer.binds.tolist() == [False, True, False]
        assert answer.meeting_point_m.tolist() == E.tolist()
        assert answer.meeting_time_s == 0.0
        assert answer.value == (0.0 if target is None else pytest.approx(np.linalg.norm(E - T)))
        assert np.isfinite(answer.pursuer_velocity_m_s).all()
        both = solve_team(PAPER, np.stack([E, E]), E, target)
        assert both.pursuer_velocity_m_s.tolist() == [[0.0, 0.0, 0.0]] * 2


def test_a_pursuer_on_the_barrier_takes_nothing_from_one_that_wins():
    P = np.array([[8.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    E = np.array([0.0, 4.0, 0.0])
    T = np.zeros(3)
    assert solve(PAPER, P, E, T).reason.tolist() == [Reason.ON_BARRIER, Reason.SOLVED]
    answer = solve_team(PAPER, P, E, T)
    assert answer.winner == Winner.PURSUER
    assert answer.value == solve(PAPER, P[1], E, T).value
    late = solve_team(PAPER, np.array([[90.0, 0.0, 0.0], [8.0, 0.0, 0.0]]), E, T)
    assert (late.winner, late.value, late.reason) == (Winner.UNDECIDED, 0.0, Reason.ON_BARRIER)
    assert late.binds.tolist() == [False, True]


def test_right_above_the_evader_the_others_decide_where_it_runs():
    P = np.array([[0.0, 0.0, 10.0], [4.0, 0.0, 8.0]])
    answer = solve_team(PAPER, P, np.zeros(3))
    assert answer.reason == Reason.SOLVED
    assert answer.binds.all()
    run = answer.lower_bound * answer.evader_velocity_m_s
    assert np.linalg.norm(run - P[1]) >= 2.0 * answer.lower_bound - 1e-9
    assert answer.lower_bound == answer.value == pytest.approx(10.0 / np.sqrt(3.0))
    far = solve_team(PAPER, P + np.array([[0, 0, 0], [99, 0, 0]]), np.zeros(3))
    assert far.reason == Reason.OVERHEAD
    assert far.binds.tolist() == [True, False]


def test_rows_without_an_answer_are_nan_and_say_why():
    P, E, T = states(4, 2, 4)
    P[1, 0, 2] = np.nan
    E[2, 0] = np.inf
    answer = solve_team(Game(Ball(np.array([[2.0, 2.0]] * 3 + [[2.0, 1.0]])), 1.0), P, E, T)
    assert answer.reason.tolist()[1:] == [
        Reason.NOT_FINITE,
        Reason.NOT_FINITE,
        Reason.PURSUER_TOO_SLOW,
    ]
    assert answer.winner.tolist()[1:] == [Winner.UNDECIDED] * 3
    assert not answer.binds[1:].any()
    for name in ("value", "lower_bound", "margin_s", "meeting_point_m", "pursuer_velocity_m_s"):
        assert np.isnan(getattr(answer, name)[1:]).all()
        assert np.isfinite(getattr(answer, name)[0]).all()
    only = solve_team(PAPER, P[0], E[0], T[0])
    assert all(same(part[0], one) for part, one in zip(answer, only, strict=True))
    P[0] = E[0]
    assert solve_team(PAPER, P[:2], E[:2], T[:2]).reason.tolist() == [
        Reason.CAPTURED,
        Reason.NOT_FINITE,
    ]


@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize(("length", "speed"), [(2.0**-7, 1.0), (4.0, 8.0)])
def test_other_units_give_the_same_play_bit_for_bit(length, speed, tad):
    P, E, T = states(3, 3, 60)
    u = np.array([1.25, 2.0, 3.0])
    units = {"meeting_point_m": length, "pursuer_velocity_m_s": speed, "evader_velocity_m_s": speed}
    units |= dict.fromkeys(("margin_s", "meeting_time_s"), length / speed)
    units |= dict.fromkeys(("value", "lower_bound"), length if tad else length / speed)
    units["multipliers"] = speed if tad else 1.0
    here = solve_team(Game(Ball(u), 1.0), P, E, T if tad else None)
    there = solve_team(
        Game(Ball(speed * u), speed), length * P, length * E, length * T if tad else None
    )
    for name, value in here._asdict().items():
        unit = units.get(name, 1.0)
        np.testing.assert_array_equal(
            getattr(there, name), unit * value if unit != 1.0 else value, err_msg=name
        )


@pytest.mark.parametrize("tad", [True, False])
def test_another_place_and_height_is_the_same_game(tad):
    P, E, T = states(4, 3, 60)
    moved = np.array([30.0, -70.0, 0.0])
    here = solve_team(PAPER, P, E, T if tad else None)
    high = Game(Ball(2.0), 1.0, standoff=StandOff(0.0, 4.0))
    there = solve_team(high, P + moved + [0.0, 0.0, 4.0], E + moved, T + moved if tad else None)
    clear = np.abs(here.margin_s) > 1e-6
    np.testing.assert_allclose(there.value[clear], here.value[clear], atol=1e-9)
    np.testing.assert_allclose(
        there.meeting_point_m[clear], here.meeting_point_m[clear] + moved, atol=1e-6
    )
    np.testing.assert_allclose(
        there.pursuer_velocity_m_s[clear], here.pursuer_velocity_m_s[clear], atol=1e-6
    )
    assert np.count_nonzero(here.binds.sum(axis=-1) == 2) > (3 if tad else 0)


def test_integers_are_real_numbers():
    whole = solve_team(PAPER, np.array([[3, 4, 10], [30, 2, 3]]), [0, 0, 0], [30, 1, 0])
    real = solve_team(
        PAPER, np.array([[3.0, 4, 10], [30, 2, 3]]), np.zeros(3), np.array([30.0, 1, 0])
    )
    assert all(same(a, b) for a, b in zip(whole, real, strict=True))


@pytest.mark.parametrize(
    ("game", "said"),
    [
        (Game(Ball(2.0), 1.0, information_age_s=1.0), "information_age_s = 1.0"),
        (Game(Ball(2.0), 1.0, evader_space="space"), "evader_space = 'space'"),
        ([PAPER, Game(Cylinder(2.0, 1.0, 1.0), 1.0)], "the same speed set"),
        ([PAPER, Game(Ball(2.0), 1.0, target_velocity_m_s=(0.1, 0.0))], "target_velocity_m_s"),
        ([[PAPER, PAPER]], r"must be one Game, or lists \(n,\) of games"),
        ([PAPER, None], "game = .*must be one Game"),
    ],
)
def test_a_game_that_teams_do_not_play_is_refused_by_its_key(game, said):
    P, E, _ = states(0, 2)
    with pytest.raises(ConfigError, match=said):
        solve_team(game, P, E)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"pursuers": np.zeros(3)}, r"pursuers = .*\(..., n, 3\)"),
        ({"pursuers": np.zeros((0, 3))}, "pursuers"),
        ({"pursuers": np.zeros((2, 2))}, "pursuers"),
        ({"pursuers": "near"}, "pursuers = 'near'"),
        ({"evader": np.zeros(2)}, "evader"),
        ({"evader": 3.0}, "evader = 3.0"),
        ({"evader": np.zeros((4, 3)), "target": np.zeros((5, 3))}, "do not fit each other"),
        ({"evader": np.array([0.0, np.nan, 0.0])}, "evader = .*has no answer: not finite"),
        ({"game": Game(Ball(2.0), np.array([1.0, 1.5]))}, r"evader_speed_m_s = .*\(..., 1\)"),
        (
            {"game": Game(Ball(np.array([2.0, 0.5])), 1.0)},
            "the team: has no answer: pursuer too slow",
        ),
    ],
)
def test_bad_arguments_are_refused_by_their_names(changed, said):
    P, E, T = states(0, 2)
    given = {"game": PAPER, "pursuers": P, "evader": E, "target": T} | changed
    with pytest.raises(ConfigError, match=said):
        solve_team(**given)


@pytest.mark.parametrize(
    "game",
    [
        Game(Ball(1.3), 1.0),
        Game(Ball(2.0), 1.0, 0.3, StandOff(1.0, 2.0)),
        Game(Cylinder(2.0, 0.8, 0.6), 1.0, 0.2, StandOff(1.0, 2.0)),
        Game(Ball(2.0), 1.0, wind_m_s=(0.3, 0.2)),
    ],
)
def test_the_lower_bound_of_pe_is_the_longest_run_of_all_headings(game):
    rng = np.random.default_rng(7)
    angle = np.linspace(-np.pi, np.pi, 361)
    heading = np.cos(angle)[:, None], np.sin(angle)[:, None]
    for _ in range(12):
        P = rng.uniform(-10.0, 10.0, (rng.integers(3, 7), 3)) * [1.0, 1.0, 0.2] + [0.0, 0.0, 2.0]
        E = np.array([*rng.uniform(-3.0, 3.0, 2), 0.0])
        answer = solve_team(game, P, E)
        longest_s = survived(regions_of(game, P, E), heading).min(axis=1).max()
        assert answer.lower_bound >= longest_s * (1.0 - 1e-9)
        run = answer.meeting_point_m - E
        far = np.linalg.norm(run)
        if far > 0.0:
            along = (run[:1] / far, run[1:2] / far)
            assert survived(regions_of(game, P, E), along).min() == pytest.approx(far, rel=1e-9)


def test_a_crossing_that_lies_aside_of_both_own_ends_is_found():
    """A third pursuer cuts off the own ends of two, whose edges cross elsewhere; 4.808 s is the best of the others."""
    P = np.array([[4.0, 6.1, 2.9], [-3.6, -2.3, 2.8], [7.6, 1.3, -0.1], [-7.1, 6.3, 1.0]])
    E = np.array([-3.4, 0.2, 0.0])
    game = Game(Ball(1.3), 1.0)
    answer = solve_team(game, P, E)
    angle = np.linspace(-np.pi, np.pi, 20001)
    heading = np.cos(angle)[:, None], np.sin(angle)[:, None]
    longest_s = survived(regions_of(game, P, E), heading).min(axis=1).max()
    assert longest_s == pytest.approx(4.8302, abs=1e-3)
    assert answer.lower_bound == pytest.approx(longest_s, rel=1e-4)
    assert answer.lower_bound >= longest_s


def test_a_state_of_numpys_numbers_is_solved_as_one_of_floats():
    game = Game(Ball(2.0), 1.0)
    states = np.array([[8.0, 1.0, 9.0], [7.0, 9.0, 0.0], [0.0, 0.0, 0.0]])
    for count in (2, 3):
        assert solve_state(game, *map(tuple, states[:count])) == solve_state(
            game, *map(tuple, states[:count].tolist())
        )


def test_no_straight_run_before_cylinders_of_several_heights_ends_closer_than_the_lower_bound():
    """Catches a lower bound that a straight run falls below."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 1441)
    run = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    brackets = 0
    for _ in range(60):
        v = rng.uniform(1.0, 2.5)
        u = v * rng.uniform(1.2, 2.5)
        P = rng.uniform(-30.0, 30.0, (3, 3))
        P[:, 2] = rng.uniform(5.0, 20.0, 3)
        E, T = (np.array([*rng.uniform(-20.0, 20.0, 2), 0.0]) for _ in range(2))
        game = Game(Cylinder(u, 3.0, 1.5), v, capture_radius_m=0.5, standoff=StandOff(3.0, 5.0))
        team = solve_team(game, P, E, T)
        solved = int(team.reason) in {Reason.SOLVED, Reason.BRACKET}
        if not solved or team.winner != Winner.PURSUER:
            continue
        brackets += int(team.reason) == Reason.BRACKET
        low = np.zeros(angle.shape)
        high = np.full(angle.shape, 300.0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            place = E[:2] + v * middle[:, None] * run
            beside = np.linalg.norm(place[:, None] - P[:, :2], axis=-1) - 3.5
            level_s = (P[:, 2] - 5.5) / 1.5
            caught = ((beside <= u * middle[:, None]) & (level_s <= middle[:, None])).any(axis=1)
            low, high = np.where(caught, low, middle), np.where(caught, middle, high)
        left = np.linalg.norm(E[:2] + v * high[:, None] * run - T[:2], axis=1)
        assert team.lower_bound <= left.min() + 1e-6
    assert brackets > 0
