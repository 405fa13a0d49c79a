"""A speed set that is registered from outside the package: one module (`spheroid`) and its test."""

from collections import Counter

import numpy as np
import pytest

from guidance.clock import VirtualClock
from guidance.config import parse_document
from guidance.errors import ConfigError
from guidance.game import Ball, Cylinder, Exact, Game, StandOff, Winner, rollout, solve, solve_state
from guidance.game.speed_sets import SPEED_SETS, SpeedSet, register, speed_set_named
from guidance.game.team import between, match_teams
from guidance.game.verification import hji_residual
from guidance.session.fly.mission import Mission
from guidance.session.fly.result import outcome_of_flight
from guidance.session.plan import plan_of
from guidance.session.vehicle_file import Config
from guidance.sim.maths import play_scenarios
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedWorld
from tests.game.spheroid import Spheroid

SPEEDS = Spheroid(6.0, 3.0, 2.0)
GAME = Game(SPEEDS, 3.0, standoff=StandOff(3.0, 5.0), wind_m_s=(0.5, -1.0))

CHASE: dict = {
    "title": "spheroid",
    "game": "pe",
    "pursuer": {
        "position_m": [0.0, 0.0, 15.0],
        "speed_m_s": 6.0,
        "climb_m_s": 3.0,
        "descent_m_s": 2.0,
        "speed_set": "spheroid",
    },
    "evader": {"position_m": [0.0, 25.0], "speed_m_s": 3.0},
}
DEFENCE = CHASE | {"game": "tad", "target": {"position_m": [4.0, 3.0]}}

SWEEP = """
scenario = "chase.toml"
seeds = 4
policies = [{ pursuer = ["optimal", "proportional_navigation"], evader = "optimal" }]
[grid]
"pursuer.speed_set" = ["ball", "spheroid"]
"""


@pytest.fixture
def spheroid():
    register(Spheroid)
    yield Spheroid
    del SPEED_SETS["spheroid"]


def states(count=300):
    rng = np.random.default_rng(8)
    P, E, T = rng.uniform(-30.0, 30.0, (3, count, 3))
    E[:, 2] = 0.0
    T[:, 2] = 0.0
    return P, E, T


def tall(P):
    """The ball's positions: heights above the disc times u over the vertical speed towards it."""
    above = P[:, 2] - GAME.standoff.height_m
    stretch = np.where(above > 0.0, 6.0 / 2.0, 6.0 / 3.0)
    return np.column_stack([P[:, :2], GAME.standoff.height_m + stretch * above])


@pytest.mark.parametrize("with_target", [False, True])
def test_its_game_is_solved_alone_and_in_a_batch_and_is_that_of_a_ball_in_its_heights(with_target):
    P, E, T = states()
    goal = (T,) if with_target else ()
    answer = solve(GAME, P, E, *goal)
    ball = Game(Ball(6.0), 3.0, standoff=GAME.standoff, wind_m_s=GAME.wind_m_s)
    expected = solve(ball, tall(P), E, *goal)
    assert np.array_equal(answer.winner, expected.winner)
    assert answer.value == pytest.approx(expected.value, nan_ok=True)
    assert set(answer.winner) == ({1, -1} if with_target else {1})
    for row in range(0, 300, 10):
        alone = solve_state(GAME, *(places[row] for places in (P, E, *goal)))
        for name, value in alone._asdict().items():
            assert np.array_equal(getattr(answer, name)[row], value), name
    # The pursuer flies at the edge of its set, and no other pair of velocities is better than this one
    air_m_s = answer.pursuer_velocity_m_s - [*GAME.wind_m_s, 0.0]
    paces = [SPEEDS.pace(velocity) for velocity in air_m_s[answer.meeting_time_s > 0]]
    assert paces == pytest.approx(np.full(len(paces), 6.0))
    won = (answer.winner > 0) & (answer.value > 1.0) & (np.abs(P[:, 2] - 5.0) > 1.0)
    residual = hji_residual(GAME, P[won], E[won], *(places[won] for places in goal))
    assert np.abs(residual).max() < 1e-4


def test_its_play_ends_when_its_value_says():
    """Catches a user's speed set whose play does not take its value."""
    P, E, _ = (places[:40] for places in states())
    answer = solve(GAME, P, E)
    end = rollout(GAME, P, E, stepping=Exact(step_s=0.1), duration_s=60.0)
    assert end.time_s == pytest.approx(answer.value, abs=1e-6)


def test_vehicles_with_their_own_speeds_are_matched():
    P, E, T = states(6)
    pursuers = [Spheroid(5.0 + number, 3.0, 2.0) for number in range(6)]
    still = Game(SPEEDS, 3.0, standoff=GAME.standoff)
    game = between(still, pursuers, [3.0, 2.0, 1.0])
    matching = match_teams(game, P, E[:3], T[:3])
    assert sorted(set(matching.first)) == sorted(matching.first)
    assert (matching.first >= 0).all()


def test_files_know_it_by_name(spheroid):
    scenario = parse_document(Scenario, CHASE, source="a.toml")
    assert plan_of(scenario=scenario).flight.cycle.game.pursuer == SPEEDS
    assert "spheroid" in str(Config.model_json_schema())
    assert speed_set_named("spheroid") is Spheroid
    outcome, defended = play_scenarios(
        [scenario, parse_document(Scenario, DEFENCE, source="b.toml")]
    )
    assert (outcome.end, defended.winner) == ("captured", defended.predicted_winner)
    assert abs(outcome.regret) < 1e-6
    slow = CHASE | {"pursuer": CHASE["pursuer"] | {"speed_set": "cube"}}
    with pytest.raises(ConfigError, match="must be one of ball, cylinder, spheroid"):
        parse_document(Scenario, slow, source="a.toml")


@pytest.mark.flight
@pytest.mark.parametrize("document", [CHASE, DEFENCE], ids=["pe", "tad"])
def test_it_is_flown(spheroid, document):
    scenario = parse_document(Scenario, document, source="a.toml")
    clock = VirtualClock()
    world = SteppedWorld(scenario, clock)
    try:
        result = Mission(scenario, world, clock, equipment={}).fly()
    finally:
        world.close()
    (flight,) = result.vehicles.values()
    outcome = outcome_of_flight(flight, "virtual")
    assert (outcome.end, outcome.winner) == ("captured", "pursuer")
    # Captured farther from its target than the value, the evader has played worse than it could
    assert outcome.ratio > 0.75
    assert scenario.target is not None or outcome.ratio < 1.25


def test_it_is_swept_beside_another(spheroid, tmp_path):
    from pyarrow import parquet

    from guidance.sweeps.folder import begin_or_continue
    from guidance.sweeps.rows import planned
    from guidance.sweeps.running import finish

    lines = ['title = "spheroid"\ngame = "pe"']
    for name in ("pursuer", "evader"):
        keys = CHASE[name].items()
        lines += [f"[{name}]", *(f"{key} = {value!r}" for key, value in keys)]
    (tmp_path / "chase.toml").write_text("\n".join(lines))
    (tmp_path / "sweep.toml").write_text(SWEEP)
    finish(
        begin_or_continue(tmp_path / "out", planned(str(tmp_path / "sweep.toml"), None), 64),
        lambda _: None,
    )
    rows = parquet.read_table(tmp_path / "out" / "rows").to_pylist()
    counts = Counter((row["pursuer.speed_set"], row["end"]) for row in rows)
    assert counts == {("ball", "captured"): 8, ("spheroid", "captured"): 8}


class Unmapped(Spheroid):
    """A set without a closed form of the evader's region."""

    name = "unmapped"
    planar = SpeedSet.planar


def test_a_game_that_needs_what_a_set_does_not_have_is_refused_by_name():
    register(Unmapped)
    try:
        game = Game(Unmapped(6.0, 3.0, 2.0), 3.0)
        P, E, T = states(5)
        assert np.array_equal(solve(game, P, E).winner, [Winner.PURSUER] * 5)
        with pytest.raises(ConfigError, match="the speed set 'unmapped' has no closed form of the"):
            solve(game, P, E, T)
        pursuer = DEFENCE["pursuer"] | {"speed_set": "unmapped"}
        scenario = parse_document(Scenario, DEFENCE | {"pursuer": pursuer}, source="a.toml")
        with pytest.raises(ConfigError, match="'unmapped' has no closed form"):
            plan_of(scenario=scenario)
    finally:
        del SPEED_SETS["unmapped"]
    with pytest.raises(ConfigError, match="an evader that flies is defined for the speed set Ball"):
        Game(SPEEDS, 3.0, evader_space="space")


def test_a_second_set_of_the_same_name_is_refused(spheroid):
    class Other(Spheroid):
        name = "spheroid"

    with pytest.raises(ConfigError, match="'spheroid': another one has this name"):
        register(Other)


def test_every_set_shortens_a_velocity_onto_its_edge_and_takes_as_long_as_its_support_says():
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(200, 3))
    for speeds in (Ball(3.0), Cylinder(3.0, 2.0, 1.0), Spheroid(3.0, 2.0, 1.0)):
        fastest = speeds.flyable(1e3 * directions)
        level = np.hypot(fastest[:, 0], fastest[:, 1])
        assert speeds.duration_s(level, fastest[:, 2]) == pytest.approx(np.ones(200))
        products = directions @ fastest.T
        assert (products <= speeds.support(directions)[:, None] + 1e-9).all()
