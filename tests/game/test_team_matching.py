"""Many against many: the matching against all possible matchings, and its guarantees."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.errors import ConfigError
from guidance.game import Ball, Cylinder, Game, Reason, StandOff, Winner, solve
from guidance.game.team import match_teams, solve_team
from tests.game.bits import same, teams
from tests.harness.examples import drawn

PAPER = Game(Ball(2.0), 1.0)
T = np.zeros(3)
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 4)


def all_matchings(n, m):
    """Every way to give evaders pursuers of their own, −1 for none."""
    for first in itertools.product(range(-1, n), repeat=m):
        taken = [i for i in first if i >= 0]
        if len(set(taken)) == len(taken):
            yield first


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds, n=counts, m=st.integers(1, 3))
def test_no_matching_guarantees_more_captures_or_as_many_with_a_larger_sum(seed, n, m):
    P, E = teams(seed, n, m)
    matching = match_teams(PAPER, P, E, T)
    value = solve(PAPER, P[:, None], E[None], T)
    beats = value.winner > 0
    np.testing.assert_array_equal(matching.beats, beats)
    assert same(matching.alone, value.value)
    best = (0, 0.0)
    for first in all_matchings(n, m):
        pairs = [(i, j) for j, i in enumerate(first) if i >= 0]
        if all(beats[pair] for pair in pairs):
            best = max(best, (len(pairs), sum(value.value[pair] for pair in pairs)))
    guarded = matching.first >= 0
    assert matching.guaranteed == guarded.sum() == best[0]
    sum_of_firsts = sum(value.value[i, j] for j, i in enumerate(matching.first) if i >= 0)
    assert sum_of_firsts == pytest.approx(best[1], rel=1e-12)
    np.testing.assert_array_equal(matching.winner, np.where(guarded, Winner.PURSUER, Winner.EVADER))


@settings(max_examples=drawn(40), deadline=None)
@given(seed=seeds, n=st.integers(2, 5), m=st.integers(1, 3))
def test_no_other_second_pursuers_add_more(seed, n, m):
    P, E = teams(seed, n, m)
    matching = match_teams(PAPER, P, E, T)
    spare = sorted(set(range(n)) - set(matching.first.tolist()))
    matched = np.flatnonzero(matching.first >= 0)

    def total(second):
        parts = []
        for j in matched:
            team = [matching.first[j]] + ([second[j]] if second[j] >= 0 else [])
            parts.append(float(solve_team(PAPER, P[team], E[j], T).value))
        return sum(parts)

    best = 0.0
    for pick in all_matchings(len(spare), len(matched)):
        second = np.full(m, -1)
        second[matched] = [spare[i] if i >= 0 else -1 for i in pick]
        best = max(best, total(second))
    assert matching.total == pytest.approx(best, rel=1e-12)
    assert matching.total == pytest.approx(total(matching.second), rel=1e-12)
    assert set(matching.second[matching.second >= 0].tolist()) <= set(spare)


@settings(max_examples=drawn(25), deadline=None)
@given(seed=seeds, n=st.integers(1, 4), m=counts)
def test_everybody_plays_the_game_of_its_team(seed, n, m):
    P, E = teams(seed, n, m)
    matching = match_teams(PAPER, P, E, T)
    for j in range(m):
        if matching.first[j] < 0:
            assert matching.value[j] == 0.0
            np.testing.assert_allclose(
                matching.evader_velocity_m_s[j], -E[j] / np.linalg.norm(E[j]), rtol=1e-14
            )
            assert matching.meeting_point_m[j].tolist() == T.tolist()
            continue
        team = [i for i in (matching.first[j], matching.second[j]) if i >= 0]
        answer = solve_team(PAPER, P[team], E[j], T)
        assert same(matching.value[j], answer.value)
        assert same(matching.meeting_point_m[j], answer.meeting_point_m)
        assert same(matching.evader_velocity_m_s[j], answer.evader_velocity_m_s)
        assert same(matching.pursuer_velocity_m_s[team], answer.pursuer_velocity_m_s)
        assert (matching.evader_of[team] == j).all()
    unmatched = np.flatnonzero(matching.first < 0)
    for i in set(range(n)) - set(matching.first.tolist()) - set(matching.second.tolist()):
        among = unmatched if len(unmatched) else np.arange(m)
        alone = solve(PAPER, P[i], E[among], T)
        assert matching.evader_of[i] == among[np.argmax(alone.margin_s)]
        assert same(
            matching.pursuer_velocity_m_s[i], alone.pursuer_velocity_m_s[np.argmax(alone.margin_s)]
        )


def test_one_against_one_is_the_game_of_one_to_the_bit():
    P, E = teams(1, 1, 1, 200)
    for target in (T, None):
        matching = match_teams(PAPER, P, E, target)
        single = solve(PAPER, P[:, 0], E[:, 0], target)
        won = single.winner > 0
        assert same(matching.guaranteed.astype(bool), won)
        for name in ("value", "meeting_point_m", "evader_velocity_m_s"):
            assert same(getattr(matching, name)[won, 0], getattr(single, name)[won])
        assert same(matching.pursuer_velocity_m_s[:, 0], single.pursuer_velocity_m_s)
        assert same(matching.reason[:, 0], single.reason)
        assert same(matching.total[won], single.value[won])


@settings(max_examples=drawn(25), deadline=None)
@given(seed=seeds, n=counts, m=counts)
def test_pe_assigns_as_many_as_can_be_with_the_least_sum_of_times(seed, n, m):
    P, E = teams(seed, n, m)
    matching = match_teams(PAPER, P, E)
    time = solve(PAPER, P[:, None], E[None]).value
    best = min(
        sum(time[i, j] for j, i in enumerate(first) if i >= 0)
        for first in all_matchings(n, m)
        if sum(i >= 0 for i in first) == min(n, m)
    )
    assert matching.guaranteed == min(n, m)
    assert matching.total == pytest.approx(best, rel=1e-12)
    assert (matching.second == -1).all()
    for j, i in enumerate(matching.first):
        full = solve_team(PAPER, P, E[j])
        assert same(matching.lower_bound[j], full.lower_bound)
        assert same(matching.evader_velocity_m_s[j], full.evader_velocity_m_s)
        assert matching.value[j] == (time[i, j] if i >= 0 else np.inf)
        assert matching.lower_bound[j] <= matching.value[j]
        assert matching.winner[j] == (Winner.PURSUER if i >= 0 else Winner.UNDECIDED)
    for i in range(n):
        j = matching.evader_of[i]
        assert same(matching.pursuer_velocity_m_s[i], solve(PAPER, P[i], E[j]).pursuer_velocity_m_s)
        if i not in matching.first.tolist():
            among = np.flatnonzero(matching.first < 0)
            among = among if len(among) else np.arange(m)
            assert j == among[np.argmin(time[i, among])]


@settings(max_examples=drawn(25), deadline=None)
@given(seed=seeds, n=counts, m=counts, tad=st.booleans())
def test_the_order_of_the_players_changes_nothing(seed, n, m, tad):
    P, E = teams(seed, n, m)
    rng = np.random.default_rng(seed)
    p = rng.permutation(n)
    e = rng.permutation(m)
    u = rng.uniform(1.5, 4.0, n)
    v = rng.uniform(0.5, 1.4, m)
    goal = T if tad else None
    matching = match_teams(Game(Ball(u[:, None]), v), P, E, goal)
    moved = match_teams(Game(Ball(u[p, None]), v[e]), P[p], E[e], goal)
    assert moved.guaranteed == matching.guaranteed
    assert same(moved.total, matching.total)
    for name in (
        "value",
        "lower_bound",
        "winner",
        "meeting_point_m",
        "evader_velocity_m_s",
        "reason",
    ):
        assert same(getattr(moved, name), getattr(matching, name)[e]), name
    assert same(moved.pursuer_velocity_m_s, matching.pursuer_velocity_m_s[p])
    assert same(moved.beats, matching.beats[p][:, e])
    back = np.append(p, -1)
    assert back[moved.first].tolist() == matching.first[e].tolist()
    assert back[moved.second].tolist() == matching.second[e].tolist()
    assert e[moved.evader_of].tolist() == matching.evader_of[p].tolist()


@settings(max_examples=drawn(10), deadline=None)
@given(seed=seeds, n=counts, m=counts, tad=st.booleans())
def test_a_batch_is_its_singles(seed, n, m, tad):
    P, E = teams(seed, n, m, 6)
    rng = np.random.default_rng(seed)
    game = Game(
        Ball(rng.uniform(1.5, 4.0, (n, 1))),
        rng.uniform(0.5, 1.4, (6, 1, m)),
        standoff=StandOff(0.0, 2.0),
    )
    in_play = rng.random((6, m)) < 0.8
    goal = T if tad else None
    full = match_teams(game, P, E, goal, in_play=in_play)
    folded = match_teams(
        Game(game.pursuer, game.evader_speed_m_s.reshape(2, 3, 1, m), standoff=game.standoff),
        P.reshape(2, 3, n, 3),
        E.reshape(2, 3, m, 3),
        goal,
        in_play=in_play.reshape(2, 3, m),
    )
    for i in range(6):
        pair_game = Game(game.pursuer, game.evader_speed_m_s[i], standoff=game.standoff)
        single = match_teams(pair_game, P[i], E[i], goal, in_play=in_play[i])
        for part, part_of_folded, alone in zip(full, folded, single, strict=True):
            assert same(part[i], alone)
            assert same(part_of_folded.reshape(part.shape), part)


def test_leading_axes_broadcast():
    P, E = teams(2, 3, 2, 4)
    crossed = match_teams(PAPER, P[:, None], E[None, :3], T)
    assert crossed.first.shape == (4, 3, 2)
    assert crossed.beats.shape == (4, 3, 3, 2)
    assert same(crossed.value[2, 1], match_teams(PAPER, P[2], E[1], T).value)
    targets = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 0.0]])
    apart = match_teams(PAPER, P[0], E[0], targets)
    assert apart.alone[1, 1] == solve(PAPER, P[0, 1], E[0, 1], targets[1]).value


def test_who_is_out_of_play_is_left_alone():
    P, E = teams(3, 2, 3)
    for target in (T, None):
        matching = match_teams(PAPER, P, E, target, in_play=[True, False, True])
        without = match_teams(PAPER, P, E[[0, 2]], target)
        assert matching.first[1] == -1
        assert matching.winner[1] == Winner.UNDECIDED
        assert np.isnan(matching.value[1])
        assert np.isnan(matching.alone[:, 1]).all()
        assert not matching.beats[:, 1].any()
        assert matching.evader_velocity_m_s[1].tolist() == [0.0, 0.0, 0.0]
        assert same(matching.value[[0, 2]], without.value)
        assert same(matching.pursuer_velocity_m_s, without.pursuer_velocity_m_s)
        without_evaders = match_teams(PAPER, P, E, target, in_play=np.zeros(3, dtype=bool))
        assert (without_evaders.guaranteed, without_evaders.total) == (0, 0.0)
        assert (without_evaders.evader_of == -1).all()
        assert (without_evaders.pursuer_velocity_m_s == 0).all()


@given(st.integers(0, 10_000), st.booleans())
@settings(max_examples=drawn(80), deadline=None)
def test_of_equal_promises_the_ways_do_not_cross(seed, noisy):
    """High above their discs all pursuers capture by their descent, so every pairing promises the same."""
    random = np.random.default_rng(seed)
    P = np.column_stack([random.uniform(-20.0, 20.0, (2, 2)), np.full(2, 40.0)])
    E = np.column_stack(
        [random.uniform(-20.0, 20.0, 2), random.uniform(80.0, 100.0, 2), np.zeros(2)]
    )
    game = Game(Cylinder(9.0, 3.0, 1.5), 1.0, standoff=StandOff(5.0, 8.0))
    hysteresis = 0.5 if noisy else 0.0
    if noisy:  # as of positions in flight
        P[:, 2] += random.uniform(-1e-3, 1e-3, 2)
    matching = match_teams(game, P, E, [0.0, 0.0, 0.0], hysteresis=hysteresis)
    assert matching.guaranteed == 2
    assert np.ptp(matching.alone, axis=0).max() < 2e-3
    ends = matching.meeting_point_m[:, :2]
    starts = P[matching.first, :2]
    assert not crossing(*starts[0], *ends[0], *starts[1], *ends[1])


def crossing(ax, ay, bx, by, cx, cy, dx, dy):
    """Return whether the segments AB and CD cross."""

    def side(px, py, qx, qy, rx, ry):
        return (qx - px) * (ry - py) - (qy - py) * (rx - px)

    return (
        side(ax, ay, bx, by, cx, cy) * side(ax, ay, bx, by, dx, dy) < 0.0
        and side(cx, cy, dx, dy, ax, ay) * side(cx, cy, dx, dy, bx, by) < 0.0
    )


def test_hysteresis_keeps_a_pair_that_is_nearly_as_good():
    P = np.array([[5.0, 5.0, 5.0], [5.0, -5.0, 5.0]])
    evaders_before = np.array([[12.0, 0.01, 0.0], [12.0, -0.01, 0.0]])
    evaders_after = evaders_before * [1, -1, 1]
    before = match_teams(PAPER, P, evaders_before, T)
    assert before.first.tolist() == [0, 1]
    assert match_teams(PAPER, P, evaders_after, T).first.tolist() == [1, 0]
    gain = (
        match_teams(PAPER, P, evaders_after, T).total
        - match_teams(PAPER, P, evaders_after, T, previous=before, hysteresis=9.0).total
    )
    assert gain > 0
    repeated = match_teams(
        PAPER, P, evaders_after, T, previous=before, hysteresis=0.5 * gain + 1e-9
    )
    assert repeated.first.tolist() == [0, 1]
    assert repeated.guaranteed == 2
    assert match_teams(
        PAPER, P, evaders_after, T, previous=before, hysteresis=0.5 * gain - 1e-9
    ).first.tolist() == [1, 0]
    pe = match_teams(
        PAPER, P, evaders_after, previous=match_teams(PAPER, P, evaders_before), hysteresis=1.0
    )
    assert pe.first.tolist() == [0, 1]
    assert match_teams(
        PAPER, P, evaders_after, previous=match_teams(PAPER, P, evaders_before)
    ).first.tolist() == [
        1,
        0,
    ]


@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize("hysteresis", [0.0, 1e6])
def test_every_team_that_still_wins_is_kept_or_improved(tad, hysteresis):
    rng = np.random.default_rng(4)
    P, E = teams(4, 4, 3, 100)
    goal = T if tad else None
    before = match_teams(PAPER, P, E + rng.normal(0.0, 4.0, E.shape) * [1, 1, 0], goal)
    repeated = match_teams(PAPER, P, E, goal, previous=before, hysteresis=hysteresis)
    promised = 0
    for row, j in np.ndindex(before.first.shape):
        team = [i for i in (before.first[row, j], before.second[row, j]) if i >= 0]
        if not team or not repeated.beats[row, team, j].any():
            continue
        promised += 1
        value = solve_team(PAPER, P[row, team], E[row, j], goal).value
        assert repeated.winner[row, j] == Winner.PURSUER
        if tad:
            assert repeated.value[row, j] >= value - 1e-9
        else:
            assert repeated.value[row, j] <= value + 1e-9
        if hysteresis:
            assert repeated.first[row, j] == before.first[row, j]
    assert promised > 100


def test_a_second_pursuer_that_is_kept_stays():
    P = np.array([[7.0, 0.0, 2.0], [8.0, 5.0, 3.0], [8.0, 5.1, 3.0]])
    evader_before = np.array([[11.0, 3.0, 0.0]])
    evader_after = np.array([[11.0, 3.3, 0.0]])
    before = match_teams(PAPER, P, evader_before, T)
    fresh = match_teams(PAPER, P, evader_after, T)
    before = before._replace(second=3 - before.second)
    assert (fresh.first.tolist(), fresh.second.tolist()) == ([0], [1])
    assert match_teams(PAPER, P, evader_after, T, previous=before).second.tolist() == [1]
    assert match_teams(
        PAPER, P, evader_after, T, previous=before, hysteresis=1.0
    ).second.tolist() == [2]


def test_number_zero_joins_like_any_other():
    P = np.array([[6.0, 4.0, 5.0], [6.0, -5.0, 3.0]])
    E = np.array([[9.0, 0.0, 0.0]])
    matching = match_teams(PAPER, P, E, T)
    assert (matching.first.tolist(), matching.second.tolist()) == ([1], [0])
    assert (
        matching.value[0] == solve_team(PAPER, P, E[0], T).value > solve(PAPER, P[1], E[0], T).value
    )


def test_on_the_barrier_nobody_is_beaten():
    P = np.array([[90.0, 0.0, 0.0], [8.0, 0.0, 0.0]])
    matching = match_teams(PAPER, P, np.array([[0.0, 4.0, 0.0]]), T)
    assert (matching.guaranteed, matching.beats.any(), matching.reason[0]) == (
        0,
        False,
        Reason.ON_BARRIER,
    )


def test_no_rows_are_matched_in_no_rows_and_no_players_are_no_game():
    for target in (T, None):
        none = match_teams(PAPER, np.zeros((0, 3, 3)), np.zeros((0, 2, 3)), target)
        assert (none.guaranteed.shape, none.first.shape, none.beats.shape) == (
            (0,),
            (0, 2),
            (0, 3, 2),
        )
        assert solve_team(PAPER, np.zeros((0, 3, 3)), np.zeros((0, 3)), target).binds.shape == (
            0,
            3,
        )
    for P, E in (
        (np.zeros((5, 0, 3)), np.zeros((5, 2, 3))),
        (np.zeros((5, 2, 3)), np.zeros((5, 0, 3))),
    ):
        with pytest.raises(
            ConfigError, match=r"must be an array of numbers of shape \(..., ., 3\)"
        ):
            match_teams(PAPER, P, E, T)


def test_a_pair_that_does_not_play_needs_no_numbers_where_evaders_differ_in_speed():
    slow = Game(Ball(4.0), 1.0)
    fast = Game(Ball(4.0), 2.0)
    P = np.array([[6.0, 4.0, 5.0], [6.0, -5.0, 3.0]])
    E = np.array([[9.0, 0.0, 0.0], [-20.0, 3.0, 0.0]])
    every, one = (match_teams([[slow, fast], [slow, other]], P, E) for other in (fast, None))
    assert every.first.tolist() == one.first.tolist() == [1, 0]
    assert match_teams([[None, fast], [slow, None]], P, E).first.tolist() == [1, 0]
    np.testing.assert_array_equal(every.value, one.value)


def test_who_is_not_stopped_runs_to_its_target_and_stays_there():
    E = np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [3.0, -4.0, 0.0]])
    matching = match_teams(PAPER, np.array([[90.0, 0.0, 0.0]]), E, T)
    np.testing.assert_allclose(
        matching.evader_velocity_m_s, [[0, -1, 0], [0, 0, 0], [-0.6, 0.8, 0]], atol=1e-15
    )


def test_pursuers_in_the_evaders_plane_stand_still_once_nobody_is_left():
    P = np.array([[9.0, 0.0, 0.0], [0.0, 7.0, 0.0]])
    E = np.array([[3.0, 4.0, 0.0]])
    without_evaders = match_teams(PAPER, P, E, T, in_play=[False])
    assert without_evaders.pursuer_velocity_m_s.tolist() == [[0.0, 0.0, 0.0]] * 2


def test_every_game_of_a_batch_may_have_speeds_of_its_own():
    P, E = teams(9, 3, 2, 4)
    u = np.linspace(1.5, 3.0, 12).reshape(4, 3, 1)
    v = np.linspace(0.6, 1.0, 8).reshape(4, 1, 2)
    matching = match_teams(Game(Ball(u), v), P, E, T)
    for row in range(4):
        single = match_teams(Game(Ball(u[row]), v[row, 0]), P[row], E[row], T)
        assert all(same(part[row], alone) for part, alone in zip(matching, single, strict=True))
    assert match_teams(Game(Ball(u), 1.0), P[0], E[0], T).guaranteed.shape == (4,)


@pytest.mark.parametrize("size", [1e-20, 1.0, 1e20])
def test_as_many_are_sure_in_games_of_any_size(size):
    goals = np.array([[10.0, 0.0, 0.0], [-10.0, 0.0, 0.0]])
    runs = np.array([[13.0, 0.0, 0.0], [-13.0, 0.0, 0.0]])
    for guards, first in ((goals, [0, 1]), (goals[::-1], [1, 0])):
        matching = match_teams(
            PAPER, size * (guards + np.array([0.0, 1.0, 0.0])), size * runs, size * goals
        )
        assert matching.first.tolist() == first
        assert matching.guaranteed == 2


def test_rows_without_an_answer_are_nan_and_say_why():
    P, E = teams(5, 2, 2, 3)
    P[1, 0, 0] = np.nan
    for target in (T, None):
        matching = match_teams(PAPER, P, E, target)
        assert (matching.reason[1] == Reason.NOT_FINITE).all()
        assert (matching.first[1] == -1).all()
        assert (matching.evader_of[1] == -1).all()
        assert matching.guaranteed[1] == 0
        assert np.isnan(matching.total[1])
        assert np.isnan(matching.value[1]).all()
        assert np.isnan(matching.pursuer_velocity_m_s[1]).all()
        only = match_teams(PAPER, P[2], E[2], target)
        assert all(same(part[2], field) for part, field in zip(matching, only, strict=True))
        with pytest.raises(ConfigError, match="have no answer: not finite"):
            match_teams(PAPER, P[1], E[1], target)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"evaders": np.zeros(3)}, r"evaders = .*\(..., m, 3\)"),
        ({"target": np.zeros(2)}, "target"),
        ({"target": np.zeros((5, 3))}, "do not fit each other"),
        (
            {"pursuers": np.zeros((4, 2, 3)), "evaders": np.zeros((3, 2, 3))},
            "do not fit each other",
        ),
        ({"in_play": [True]}, "in_play = .*: must say for each of 2 evaders"),
        ({"in_play": [np.nan, 1.0]}, r"in_play = \[nan, 1.0\]: must say for each of 2 evaders"),
        ({"in_play": [[True], [True, False]]}, "in_play"),
        ({"in_play": np.ma.array([True, True], mask=[0, 1])}, "in_play"),
        ({"hysteresis": -1.0}, r"hysteresis = -1.0"),
        ({"hysteresis": np.inf}, "hysteresis"),
        ({"hysteresis": "much"}, "hysteresis = 'much': must be a finite number, zero or more"),
        ({"hysteresis": None}, "hysteresis = None"),
        (
            {"pursuers": [[1.0, 2.0, 3.0], [4.0, 5.0]]},
            r"pursuers = .*must be an array of numbers of shape \(..., n, 3\)",
        ),
        (
            {"evaders": np.ma.masked_array(np.zeros((2, 3)), mask=np.eye(2, 3))},
            r"(?s)evaders = .*masked array",
        ),
        ({"game": [[PAPER, PAPER]]}, "game: its numbers have the shape"),
        ({"game": [[PAPER], [PAPER, PAPER]]}, r"lists \(n, m\) of games"),
        (
            {"game": Game(Ball(2.0), np.array([[1.0], [1.5]]))},
            r"(?s)evader_speed_m_s = .*\(..., 1, m\)",
        ),
    ],
)
def test_bad_arguments_are_refused_by_their_names(changed, said):
    P, E = teams(0, 2, 2)
    given = {"game": PAPER, "pursuers": P, "evaders": E, "target": T} | changed
    with pytest.raises(ConfigError, match=said):
        match_teams(**given)
