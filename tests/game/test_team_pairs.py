"""Targets with an extent that only two pursuers together defend, and the margin of teams over the whole set."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, End, Extent, Game, Reason, StandOff, Winner, solve
from guidance.game.team import match_teams, rollout_teams, solve_team
from guidance.game.team.packing import packed
from guidance.game.team.several import pairs_of

LINE = Extent(((-50.0, 0.0), (50.0, 0.0)))
GUARD = Game(Ball(1.5), 1.0, 0.1, target_extent=LINE)
P = np.array([[0.0, 11.25, 0.0], [26.0, 11.25, 0.0]])
E = np.array([15.0, 11.25, 0.0])
T = np.zeros(3)
SHAPES = {
    "line": LINE,
    "disc": Extent(radius_m=15.0),
    "polygon": Extent(((-20.0, -10.0), (25.0, -12.0), (18.0, 16.0), (-15.0, 12.0))),
    "rounded": Extent(((-20.0, -10.0), (25.0, -12.0), (18.0, 16.0)), 4.0),
}
GAMES = {
    "points": Game(Ball(1.5), 1.0, 0.1),
    "stand-off": Game(Ball(1.6), 1.0, standoff=StandOff(2.0, 3.0)),
    "vehicles": Game(Cylinder(2.0, 1.0, 0.7), 1.0, 0.2, standoff=StandOff(2.0, 3.0)),
    "drift": Game(Ball(1.7), 1.0, target_velocity_m_s=(0.2, -0.1)),
    "wind": Game(Ball(2.0), 1.0, wind_m_s=(0.2, 0.1)),
}


def to(x_m):
    """A policy of an evader that runs straight to a point of the line, in each game of a batch to another."""

    def run(game, pursuer, evader, target=None, evader_velocity_m_s=None):
        way = np.multiply.outer(x_m, [1.0, 0.0, 0.0])[..., None, :] - np.asarray(evader)
        return way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)

    return run


def edge_of(shape, count=2001):
    """Points of a set's edge, and how far two of them are apart at most."""
    corners = np.array(shape.corners_m)
    angle = np.linspace(-np.pi, np.pi, count)
    circle = shape.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if len(corners) == 1:
        return corners[0] + circle, shape.radius_m * (angle[1] - angle[0])
    points = []
    longest = 0.0
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way = end - begin
        length = np.linalg.norm(way)
        out = shape.radius_m * np.array([way[1], -way[0]]) / length
        points.append(begin + out + np.linspace(0.0, 1.0, count)[:, None] * way)
        points.append(begin + circle)
        longest = max(longest, length / (count - 1), shape.radius_m * (angle[1] - angle[0]))
    return np.concatenate(points), longest


def margin_by_trial(game, pursuers, evader):
    """The least margin of the best pursuer at points of the set's edge, and how far it may be from the least of all."""
    points, spacing_m = edge_of(game.target_extent)
    targets = np.column_stack([points, np.zeros(len(points))])
    point = replace(game, target_extent=Extent())
    margins = [solve(point, pursuer, evader, targets).margin_s for pursuer in pursuers]
    return np.max(margins, axis=0).min(), 2.0 * spacing_m / game.evader_speed_m_s


def test_two_pursuers_that_lose_alone_are_matched_and_promised():
    alone = solve(GUARD, P, E, T)
    assert (alone.winner == Winner.EVADER).all()
    team = solve_team(GUARD, P, E, T)
    assert (team.winner, team.reason, team.binds.tolist()) == (
        Winner.PURSUER,
        Reason.SOLVED,
        [True, True],
    )
    found = match_teams(GUARD, P, E[None], T)
    assert (found.guaranteed, found.first.tolist(), found.second.tolist()) == (1, [0], [1])
    assert found.value[0] == pytest.approx(team.value, rel=1e-12)
    assert found.value[0] == pytest.approx(0.0579, abs=1e-4)
    assert found.evader_of.tolist() == [0, 0]
    np.testing.assert_allclose(found.pursuer_velocity_m_s, team.pursuer_velocity_m_s, rtol=1e-12)
    with_others = match_teams(GUARD, np.vstack([P, [[90.0, 60.0, 0.0]]]), E[None], T)
    assert (with_others.first.tolist(), with_others.second.tolist()) == ([0], [1])


def test_a_pair_keeps_its_promise_wherever_the_evader_runs():
    """Catches a pair whose members each leave the gap to the other."""
    x_m = np.array([12.25, 12.5, 13.0])
    games = np.broadcast_to(P, (3, 2, 3)), np.broadcast_to(E, (3, 1, 3))
    played = rollout_teams(GUARD, *games, T, evader_policy=to(x_m), step_s=0.02)
    assert (played.end == End.CAPTURED).all()
    assert (played.distance_m >= played.first.value - 0.01).all()


def test_a_promise_of_a_pair_is_kept_when_a_new_evader_comes():
    both = np.array([E, [26.0, 14.0, 0.0]])
    first = match_teams(GUARD, P, both, T, in_play=[True, False])
    assert (first.first.tolist(), first.second.tolist()) == ([0, -1], [1, -1])
    kept = match_teams(GUARD, P, both, T, previous=first)
    assert (kept.first[0], kept.second[0]) == (0, 1)
    fresh = match_teams(GUARD, P, both, T)
    assert fresh.guaranteed == kept.guaranteed == 1


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", GAMES)
def test_a_team_wins_if_and_only_if_some_pursuer_is_first_at_every_point_of_the_set(name, shape):
    game = replace(GAMES[name], target_extent=SHAPES[shape])
    rng = np.random.default_rng(len(name) + 7 * len(shape))
    for _ in range(4):
        pursuers = rng.uniform(-40.0, 40.0, (3, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 5.0]
        evader = np.array([*rng.uniform(-50.0, 50.0, 2), 0.0])
        if game.target_extent.distance_m((0.0, 0.0), evader) < 1.0:
            continue
        answer = solve_team(game, pursuers, evader, T)
        least, off = margin_by_trial(game, pursuers, evader)
        assert least - off <= answer.margin_s <= least + 1e-9
        assert answer.winner == np.sign(answer.margin_s)
        if answer.winner > 0:
            assert answer.value > 0.0


def test_states_that_need_two_pursuers_are_won_by_two():
    """Catches a win that only two pursuers have and the matching misses, or gives to none."""
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(60):
        pursuers = np.array([[-13.0, 11.0, 0.0], [13.0, 11.0, 0.0]]) + rng.uniform(
            -2.0, 2.0, (2, 3)
        ) * [1, 1, 0]
        evader = np.array([rng.uniform(-3.0, 3.0), rng.uniform(10.0, 12.0), 0.0])
        answer = solve_team(GUARD, pursuers, evader, T)
        least, off = margin_by_trial(GUARD, pursuers, evader)
        if abs(least) < off:
            continue
        assert (answer.winner > 0) == (least > 0)
        alone = solve(GUARD, pursuers, evader, T).winner.max()
        needed = answer.winner > 0 > alone
        found += needed
        assert (match_teams(GUARD, pursuers, evader[None], T).guaranteed == 1) == (
            answer.winner > 0
        )
    assert found >= 10


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["points", "vehicles", "drift"])
def test_a_team_of_one_has_the_answer_of_solve_to_the_bit_with_an_extent(name, shape):
    game = replace(GAMES[name], target_extent=SHAPES[shape])
    rng = np.random.default_rng(3)
    pursuers = rng.uniform(-40.0, 40.0, (20, 3)) * [1.0, 1.0, 0.1] + [0.0, 0.0, 5.0]
    evaders = rng.uniform(-60.0, 60.0, (20, 3)) * [1.0, 1.0, 0.0]
    team = solve_team(game, pursuers[:, None], evaders, T)
    one = solve(game, pursuers, evaders, T)
    for field in set(one._fields) - {"pursuer_velocity_m_s"}:
        assert np.asarray(getattr(team, field)).tobytes() == getattr(one, field).tobytes(), field
    assert team.pursuer_velocity_m_s[:, 0].tobytes() == one.pursuer_velocity_m_s.tobytes()


def test_the_packing_is_the_best_of_all():
    rng = np.random.default_rng(2)
    for _ in range(20):
        n = 4
        m = 3
        numbers = pairs_of(n)
        singles = np.where(rng.random((m, n)) < 0.3, rng.random((m, n)), -np.inf)
        pairs = np.where(
            rng.random((m, len(numbers))) < 0.4, rng.random((m, len(numbers))), -np.inf
        )
        promised = rng.random(m) < 0.3
        options = [[(-1, -1, None)] for _ in range(m)]
        for j in range(m):
            options[j] += [(i, -1, singles[j, i]) for i in range(n) if singles[j, i] > -np.inf]
            options[j] += [
                (*numbers[k].tolist(), pairs[j, k])
                for k in range(len(numbers))
                if pairs[j, k] > -np.inf
            ]
        best = max(worth_of(choice, promised) for choice in itertools.product(*options))
        first, second = packed(singles, pairs, numbers, promised)
        chosen = []
        for j in range(m):
            profit = [one[2] for one in options[j] if one[:2] == (first[j], second[j])]
            chosen.append((first[j], second[j], profit[0]))
        assert worth_of(chosen, promised) == pytest.approx(best, rel=1e-9)


def worth_of(choice, promised):
    """How good a choice is: promised evaders, evaders, and profit; nothing if a pursuer is used twice."""
    used = [player for one in choice for player in one[:2] if player >= 0]
    if len(set(used)) < len(used):
        return (-1.0, -1.0, 0.0)
    matched = [one[2] is not None for one in choice]
    profit = sum(one[2] for one in choice if one[2] is not None)
    return (float(np.sum(promised & matched)), float(sum(matched)), profit)
