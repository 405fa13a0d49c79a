"""The promises of a matching at the start hold at the end, for each evader and any play."""

import itertools

import numpy as np
import pytest

from guidance.game import Ball, Cylinder, End, Game, StandOff
from guidance.game.rows import for_rows
from guidance.game.team import match_teams, rollout, rollout_teams, solve_team

STEP_S = 0.2
T = np.zeros(3)
HEADINGS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
SIZES = list(itertools.product(range(1, 5), range(2, 5)))


class Searching:
    """Evaders that try 24 headings at every step and know the pursuers' velocities.

    Each takes the heading that gives its team the worst value after the step. One that has no team runs to the target.
    """

    def __init__(self, monkeypatch, game, target):
        self.game = game
        self.target = target
        monkeypatch.setattr(rollout, "match_teams", self.watching)

    def watching(self, game, P, E, target=None, **rest):
        self.seen = match_teams(game, P, E, target, **rest)
        self.places = np.asarray(P, dtype=float)
        return self.seen

    def __call__(self, game, pursuer, evader, target=None, evader_velocity_m_s=None):
        first = np.maximum(self.seen.first, 0)
        second = self.seen.second
        who = np.stack([first, np.where(second < 0, first, second)], axis=-1)
        row = np.arange(len(who))[:, None, None]
        later = (self.places + STEP_S * self.seen.pursuer_velocity_m_s)[row, who]
        everybody = range(self.places.shape[-2]), range(evader.shape[-2])
        numbers = [len(side) for side in everybody]
        j = np.arange(len(everybody[1]))[:, None]
        team = for_rows(self.game, lambda value: np.broadcast_to(value, numbers)[who, j])
        v = np.broadcast_to(self.game.evader_speed_m_s, evader.shape[-2])[:, None]
        runs = np.stack([np.cos(HEADINGS), np.sin(HEADINGS), 0.0 * HEADINGS], axis=-1)
        tried = evader + STEP_S * v * runs[:, None, None]
        if self.target is None:
            cost = -solve_team(team, later, tried).value
        else:
            after = solve_team(team, later, tried, self.target)
            cost = np.where(after.winner > 0, after.value, -after.value)
        best = v * runs[np.argmin(cost, axis=0)]
        return np.where((self.seen.first >= 0)[..., None], best, self.seen.evader_velocity_m_s)


def states(seed, n, m, count):
    rng = np.random.default_rng(seed)
    P = rng.uniform(-18.0, 18.0, (count, n, 3))
    E = rng.uniform(-18.0, 18.0, (count, m, 3))
    P[..., 2] = np.abs(P[..., 2]) * rng.choice([0.0, 0.5, 1.0], (count, 1))
    E[..., 2] = 0.0
    return P, E


def broken(monkeypatch, game, n, m, count, *, tad, seed, evaders="mixed"):
    """Play random states; return how many promises were made, and by how much the worst was missed, m or s."""
    P, E = states(seed, n, m, count)
    target = T if tad else None
    searching = Searching(monkeypatch, game, target)
    kinds = [
        searching,
        "optimal",
        "pure_evade",
        searching,
        *(["task_oriented"] if tad else []),
        "hold",
    ]
    policy = [kinds[(seed + j) % len(kinds)] for j in range(m)] if evaders == "mixed" else evaders
    soonest = match_teams(game, P, E)
    longest = (
        150.0 if tad else 1.1 * float(np.max(soonest.value, where=soonest.first >= 0, initial=1.0))
    )
    played = rollout_teams(
        game, P, E, target, evader_policy=policy, step_s=STEP_S, capture_m=0.02, duration_s=longest
    )
    promised = played.first.first >= 0
    value = np.where(played.first.first >= 0, played.first.value, 0.0)
    if tad:
        missed = np.where(played.end == End.TIME_UP, 0.0, value - played.distance_m)
    else:
        missed = np.where(played.end == End.CAPTURED, played.time_s - value, np.inf)
    return np.count_nonzero(promised), np.max(missed, where=promised, initial=0.0)


def allowed(game):
    fastest = np.max(game.pursuer.horizontal_m_s) + np.max(game.evader_speed_m_s)
    return 2.0 * fastest * STEP_S


def vehicles(n, m):
    """The game of vehicles, each pursuer and each evader with a speed of its own."""
    u = np.array([[4.0], [3.5], [5.0], [4.4]])[:n]
    v = np.array([2.0, 1.6, 2.4, 1.8])[:m]
    return Game(Cylinder(u, 2.0, 1.5), v, capture_radius_m=0.2, standoff=StandOff(3.0, 4.0))


@pytest.mark.parametrize("tad", [True, False])
def test_every_promise_made_at_the_start_is_kept(monkeypatch, tad):
    """Catches a promise of a matching that an evader which searches at every step breaks."""
    game = Game(Ball(2.0), 1.0)
    promises, worst = broken(monkeypatch, game, 4, 3, 6, tad=tad, seed=43)
    assert promises >= 4
    assert worst <= allowed(game)


@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize(("n", "m"), [(1, 2), (3, 2)])
def test_vehicles_with_stand_off_and_speeds_of_their_own_keep_their_promises(
    monkeypatch, n, m, tad
):
    """Catches a promise that holds for equal points and breaks for unequal vehicles with a disc."""
    game = vehicles(n, m)
    promises, worst = broken(monkeypatch, game, n, m, 5, tad=tad, seed=10 * n + m)
    assert promises >= 3
    assert worst <= allowed(game)


@pytest.mark.long
@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_thousands_of_states_of_vehicles_keep_every_promise(monkeypatch, n, m, tad):
    game = vehicles(n, m)
    _, worst = broken(monkeypatch, game, n, m, 40, tad=tad, seed=100 * n + m)
    assert worst <= allowed(game)


@pytest.mark.long
@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_two_thousand_states_keep_every_promise(monkeypatch, n, m, tad):
    """1,920 states, and 96 with slower pursuers below."""
    game = Game(Ball(2.0), 1.0)
    _, worst = broken(monkeypatch, game, n, m, 80, tad=tad, seed=100 * n + m)
    assert worst <= allowed(game)


@pytest.mark.flight
@pytest.mark.parametrize("tad", [True, False])
@pytest.mark.parametrize(
    ("n", "m", "count"),
    [(3, 3, 10), *(pytest.param(n, 3, 24, marks=pytest.mark.long) for n in (2, 3))],
)
def test_slower_pursuers_keep_their_promises(monkeypatch, n, m, count, tad):
    game = Game(Ball(1.3), 1.0)
    _, worst = broken(monkeypatch, game, n, m, count, tad=tad, seed=n)
    assert worst <= allowed(game)


def test_an_evader_that_was_promised_is_not_left_for_one_that_runs_away():
    """Catches a matching that trades a promised capture for a possible one."""
    P = [[-12.43, -7.9, 2.71]]
    E = [[17.38, -5.95, 0.0], [12.0, -12.3, 0.0]]
    played = rollout_teams(Game(Ball(2.0), 1.0), P, E, T, evader_policy=["optimal", "pure_evade"])
    assert played.first.winner.tolist() == [1, -1]
    assert played.end[0] == End.CAPTURED
    assert played.distance_m[0] == pytest.approx(played.first.value[0], abs=1e-6)
