"""Orders of captures against all orders, the play that breaks no promise, and rules against their definitions."""

import itertools

import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import EVADER_POLICIES, Ball, Cylinder, End, Extent, Game, StandOff
from guidance.game.team import TEAM_RULES, TeamView, match_teams, rollout_teams
from guidance.game.team.capture_sequences import (
    MOST,
    CaptureProblem,
    Foreseen,
    lead_and_place,
    sequence_captures,
)
from guidance.game.team.in_turn import way_by_a_capture

POINTS = Game(Ball(1.2), 1.0, capture_radius_m=1.0)
T = np.zeros(3)


def states(seed, n, m, count, size_m=25.0):
    rng = np.random.default_rng(seed)
    P = rng.uniform(-size_m, size_m, (count, n, 3))
    P[..., 2] = rng.uniform(0.0, 5.0, (count, n))
    E = rng.uniform(-20.0, 20.0, (count, m, 3))
    E[..., 2] = 0.0
    return P, E


def straight(E, v=1.0):
    far = np.linalg.norm(E, axis=-1)
    return Foreseen(-v * E / far[..., None], far / v)


def scene_of(game, P, E, foreseen, holds=None):
    plays = np.ones((*P.shape[:-1], E.shape[-2]), dtype=bool)
    nobody = np.full(P.shape[:-1], -1)
    holds = nobody if holds is None else holds
    return CaptureProblem(game, P, E, np.zeros(E.shape), foreseen, plays, holds, nobody > 0, 0.0)


def captured_in_order(P, E, run, until, order, u=1.2, radius=1.0):
    """Fly an order by the definition: bisection for the time at which a straight flight captures. True if in time."""
    now_s = 0.0
    for j in order:
        low = now_s
        high = now_s + 1e4
        for _ in range(60):
            middle = 0.5 * (low + high)
            away = np.linalg.norm(E[j] + middle * run[j] - P)
            low, high = (low, middle) if away <= u * (middle - now_s) + radius else (middle, high)
        there = E[j] + high * run[j]
        way = there - P
        P = P + way / max(np.linalg.norm(way), 1e-12) * u * (high - now_s)
        now_s = high
        if now_s >= until[j]:
            return False
    return True


def most_by_all_orders(P, E, run, until):
    """Try every assignment of evaders to pursuers and every order."""
    n = len(P)
    m = len(E)
    best = 0
    for owner in itertools.product(range(-1, n), repeat=m):
        count = sum(who >= 0 for who in owner)
        if count <= best:
            continue
        sets = [[j for j in range(m) if owner[j] == i] for i in range(n)]
        if all(
            any(
                captured_in_order(P[i], E, run, until, order)
                for order in itertools.permutations(sets[i])
            )
            for i in range(n)
        ):
            best = count
    return best


def test_orders_capture_as_many_as_any_assignment_in_any_order():
    P, E = states(3, 2, 4, 8)
    foreseen = straight(E)
    orders = sequence_captures(scene_of(POINTS, P, E, foreseen))
    known = [
        most_by_all_orders(P[b], E[b], foreseen.run_m_s[b], foreseen.until_s[b]) for b in range(8)
    ]
    assert orders.captured.tolist() == known
    assert max(known) > 2  # a pursuer takes several


def test_a_pursuer_in_an_order_is_where_its_straight_flight_ends():
    games = (
        Game(Ball(2.0), 1.0, capture_radius_m=0.5, standoff=StandOff(3.0, 4.0)),
        Game(Cylinder(2.0, 1.0, 0.7), 1.0, capture_radius_m=0.2, standoff=StandOff(3.0, 4.0)),
    )
    P, E = states(4, 1, 1, 50)
    run = straight(E).run_m_s
    for game in games:
        time_s, there = lead_and_place(game, P[:, 0], E[:, 0], run[:, 0])
        evader = E[:, 0] + time_s[:, None] * run[:, 0]
        beside = np.maximum(np.linalg.norm((there - evader)[:, :2], axis=1) - 3.0, 0.0)
        if isinstance(game.pursuer, Ball):
            away = np.hypot(beside, there[:, 2] - 4.0)
            assert np.linalg.norm(there - P[:, 0], axis=1) == pytest.approx(2.0 * time_s)
        else:
            away = np.maximum(beside, abs(there[:, 2] - 4.0))
            level_m = np.linalg.norm((there - P[:, 0])[:, :2], axis=1)
            assert (level_m <= 2.0 * time_s + 1e-9).all()
        assert (away <= game.capture_radius_m + 1e-9).all()


def test_of_many_evaders_no_order_holds_one_twice_and_promised_ones_stay_with_their_pursuers():
    P, E = states(5, 3, MOST + 3, 20)
    holds = np.argmin(np.linalg.norm(E[:, None] - P[:, :, None], axis=-1), axis=-1)
    holds[:, 1:] = -1
    orders = sequence_captures(scene_of(POINTS, P, E, straight(E), holds))
    alone = sequence_captures(scene_of(POINTS, P[:, :1], E, straight(E), holds[:, :1]))
    assert (orders.captured >= alone.captured).all()
    begun = [row[row >= 0].tolist() for row in orders.first]
    assert all(len(set(row)) == len(row) for row in begun)
    assert max(map(len, begun)) == 3


def weaving(game, pursuer, evader, target=None, evader_velocity_m_s=None):
    """Run to the target in bends of 57 degrees, 6 m long."""
    to = target - evader
    far = np.linalg.norm(to[..., :2], axis=-1)
    to = to / np.maximum(far, 1e-9)[..., None]
    turn = np.where(far > 1.0, np.sin(2.0 * np.pi * far / 6.0), 0.0)
    x = np.cos(turn) * to[..., 0] - np.sin(turn) * to[..., 1]
    y = np.sin(turn) * to[..., 0] + np.cos(turn) * to[..., 1]
    return np.asarray(game.evader_speed_m_s)[..., None] * np.stack([x, y, 0.0 * x], axis=-1)


def shared_out(*policies):
    """Evaders of a batch: as many games for each policy. A step costs the same for a batch as for one game."""

    def policy(*players):
        runs = np.stack([each(*players) for each in policies])
        whose = np.arange(runs.shape[1]) * len(policies) // runs.shape[1]
        return runs[whose, np.arange(runs.shape[1])]

    return policy


def captured(result):
    return (result.end == End.CAPTURED).sum(axis=-1)


STRAIGHT = EVADER_POLICIES["task_oriented"]


def test_captures_are_never_fewer_than_guaranteed_nor_than_by_any_rule():
    """Catches a play that gives up a promised capture, or takes fewer than a simple rule."""
    P, E = states(11, 3, 3, 16)
    both = {"evader_policy": shared_out(STRAIGHT, weaving), "step_s": 0.25}
    played = {
        policy: rollout_teams(
            POINTS, np.tile(P, (2, 1, 1)), np.tile(E, (2, 1, 1)), T, pursuer_policy=policy, **both
        )
        for policy in ("captures", *TEAM_RULES)
    }
    team = played.pop("captures")
    assert (captured(team) >= team.first.captures).all()
    assert (team.end[team.first.first >= 0] == End.CAPTURED).all()
    for result in played.values():
        for half in (slice(16), slice(16, 32)):
            assert captured(team)[half].sum() >= captured(result)[half].sum()
    most = sequence_captures(scene_of(POINTS, P, E, straight(E))).captured
    assert captured(team)[:16].sum() >= 0.98 * most.sum()


@pytest.mark.parametrize(
    ("evaders", "step_s"),
    [
        (["task_oriented", weaving, "optimal"], 0.5),
        pytest.param("optimal", 0.25, marks=pytest.mark.long),
    ],
    ids=["mixed", "optimal"],
)
def test_no_promised_capture_is_missed_against_optimal_evaders(evaders, step_s):
    """Catches a play that gives up a promised capture of an evader which knows the matching."""
    P, E = states(11, 3, 3, 16)
    team = rollout_teams(
        POINTS, P, E, T, pursuer_policy="captures", evader_policy=evaders, step_s=step_s
    )
    assert (captured(team) >= team.first.captures).all()
    assert (team.end[team.first.first >= 0] == End.CAPTURED).all()


def test_vehicles_with_stand_off_keep_every_promised_capture_and_take_more():
    """Catches orders of captures that forget the stand-off or the slower climb."""
    game = Game(Cylinder(4.0, 2.0, 1.5), 2.0, capture_radius_m=0.2, standoff=StandOff(3.0, 4.0))
    P, E = states(12, 2, 4, 12)
    P[..., 2] += 4.0
    played = {
        policy: rollout_teams(
            game, P, E, T, pursuer_policy=policy, evader_policy="task_oriented", step_s=0.1
        )
        for policy in ("captures", "optimal")
    }
    for result in played.values():
        assert (result.end[result.first.first >= 0] == End.CAPTURED).all()
    assert captured(played["captures"]).sum() >= captured(played["optimal"]).sum()


def test_a_target_with_an_extent_keeps_its_promises_too():
    """Catches a promise of captures that measures to the middle of the target."""
    game = Game(Ball(1.5), 1.0, capture_radius_m=0.5, target_extent=Extent(radius_m=3.0))
    P, E = states(13, 2, 3, 10)
    result = rollout_teams(
        game, P, E, T, pursuer_policy="captures", evader_policy="task_oriented", step_s=0.2
    )
    assert (result.end[result.first.first >= 0] == End.CAPTURED).all()


def test_captures_of_one_game_are_those_of_its_batch():
    """Catches an order of captures that another game of the batch has changed."""
    P, E = states(14, 2, 3, 4)
    policies = {"pursuer_policy": "captures", "evader_policy": weaving, "step_s": 0.3}
    batch = rollout_teams(POINTS, P, E, T, **policies)
    for row in (0, 3):
        single = rollout_teams(POINTS, P[row], E[row], T, **policies)
        np.testing.assert_array_equal(batch.end[row], single.end)
        np.testing.assert_array_equal(batch.time_s[row], single.time_s)


def view_of(P, E, run):
    in_play = np.ones(E.shape[:-1], dtype=bool)
    in_play[..., -1] = False
    return TeamView(POINTS, P, E, np.zeros(E.shape), run, np.zeros(P.shape), in_play)


def test_rules_chase_whom_they_say():
    P, E = states(15, 3, 4, 30)
    E[:, -1] = P[:, 0] * [1.0, 1.0, 0.0]  # out of play, and nearer than all
    run = straight(E).run_m_s
    view = view_of(P, E, run)
    flown = {name: rule.play(view) for name, rule in TEAM_RULES.items()}
    for b, i in np.ndindex(30, 3):
        near = int(np.argmin(np.linalg.norm(E[b, :3] - P[b, i], axis=1)))
        to = E[b, near] - P[b, i]
        np.testing.assert_allclose(flown["nearest"][b, i], 1.2 * to / np.linalg.norm(to))
        time_s, there = lead_and_place(POINTS, P[b, i], E[b, near], run[b, near])
        np.testing.assert_allclose(flown["lead"][b, i], (there - P[b, i]) / time_s)
    times_s, there = lead_and_place(POINTS, P[:, :, None], E[:, None], run[:, None])
    for b in range(30):
        best = min(
            itertools.permutations(range(3)),
            key=lambda order: sum(times_s[b, i, j] for i, j in enumerate(order)),
        )
        for i, j in enumerate(best):
            expected = (there[b, i, j] - P[b, i]) / times_s[b, i, j]
            np.testing.assert_allclose(flown["hungarian"][b, i], expected, atol=1e-9)


def test_captures_need_a_target():
    P, E = states(1, 2, 2, 1)
    with pytest.raises(ConfigError, match="pursuer_policy = 'captures': needs a target"):
        rollout_teams(POINTS, P, E, pursuer_policy="captures")


def test_hopeless_evaders_are_left_and_nothing_is_promised():
    P = np.array([[50.0, 0.0, 0.0]])
    E = np.array([[-2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    assert match_teams(POINTS, P, E, T).guaranteed == 0
    result = rollout_teams(POINTS, P, E, T, pursuer_policy="captures", step_s=0.2)
    assert result.end.tolist() == [End.ARRIVED] * 2


def way_by_runs(P, E, T, ratio, radius):
    """Return the longest way of a parallel pursuit and back, over straight runs, by bisection of the capture."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3601)
    run = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    r = (P - E) / np.linalg.norm(P - E)
    # Of a straight run the pursuer's place is P + (E + t w - E) less what it has closed along r
    along = run @ r
    closing = along + np.sqrt(ratio**2 - (1.0 - along**2))
    time = (np.linalg.norm(P - E) - radius) / closing
    place = E + time[:, None] * run + radius * r
    np.testing.assert_allclose(np.linalg.norm(place - P, axis=1), ratio * time, rtol=1e-6)
    return (ratio * time + np.linalg.norm(place - T, axis=1)).max()


def test_the_way_by_a_capture_is_the_longest_over_all_straight_runs():
    P, E = states(21, 1, 1, 60)
    ways = way_by_a_capture(POINTS, P[:, 0], E[:, 0], T, T)
    known = [way_by_runs(P[b, 0], E[b, 0], T, 1.2, 1.0) for b in range(60)]
    sure = np.isfinite(ways)
    assert 5 < sure.sum() < 60
    assert ways[sure] == pytest.approx(np.array(known)[sure], rel=1e-5)


def test_no_zigzag_makes_that_way_longer():
    """Random velocities, slower ones too, each held for a while and known to the pursuer."""
    rng = np.random.default_rng(22)
    P, E = states(22, 1, 1, 200)
    P, E = P[:, 0], E[:, 0]
    known = way_by_a_capture(POINTS, P, E, T, T)
    flown = np.zeros(200)
    r = (P - E) / np.linalg.norm(P - E, axis=1, keepdims=True)
    left = np.linalg.norm(P - E, axis=1) - 1.0
    place = P.copy()
    while (left > 1e-9).any():
        heading = rng.uniform(0.0, 2.0 * np.pi, 200)
        speed = rng.choice([1.0, 1.0, 0.4], 200)
        run = np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=-1) * speed[:, None]
        along = (run * r).sum(axis=1)
        closing = along + np.sqrt(1.44 - (speed**2 - along**2))
        h = np.minimum(rng.uniform(0.1, 8.0, 200), left / closing) * (left > 1e-9)
        place += h[:, None] * (run - closing[:, None] * r)
        left -= h * closing
        flown += 1.2 * h
    assert (flown + np.linalg.norm(place, axis=1) <= known + 1e-6).all()


class Delaying:
    """Evaders of whom the first ones run so that their capture and the way back take longest; others run straight."""

    def __init__(self):
        self.headings = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)

    def __call__(self, game, pursuer, evader, target=None, evader_velocity_m_s=None):
        runs = np.stack(
            [np.cos(self.headings), np.sin(self.headings), 0.0 * self.headings], axis=-1
        )
        after = evader + 0.1 * runs.reshape(-1, *(1,) * (evader.ndim - 1), 3)
        ways = way_by_a_capture(game, pursuer, after, target, target)
        ways = np.where(np.isfinite(ways), ways, 1e9)
        return runs[np.argmax(ways, axis=0)]


@pytest.mark.parametrize(
    "play",
    [
        shared_out(Delaying(), weaving, STRAIGHT),
        pytest.param("optimal", marks=pytest.mark.long),
    ],
    ids=["delaying, weaving or straight", "optimal"],
)
def test_two_pursuers_make_every_capture_in_turn_that_is_promised_against_three_evaders(play):
    """Catches a second capture in turn that is promised and comes too late."""
    game = Game(Ball(2.5), 1.0, capture_radius_m=0.5)
    P, E = states(23, 2, 3, 60, size_m=12.0)
    sure = match_teams(game, P, E, T, spare_m=0.035)
    three = np.flatnonzero((sure.captures == 3) & (sure.guaranteed == 2))[:8]
    assert len(three) >= 5
    three = np.tile(three, 3)
    result = rollout_teams(
        game,
        P[three],
        E[three],
        T,
        pursuer_policy="captures",
        evader_policy=play,
        step_s=0.1,
        duration_s=120.0,
    )
    assert (result.first.captures == 3).all()
    assert (captured(result) == 3).all()
