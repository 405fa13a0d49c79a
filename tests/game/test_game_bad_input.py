"""Bad input: refused by name at the edge, NaN in its own row inside a batch."""

import math
import re
from itertools import product

import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import (
    EVADER_POLICIES,
    PURSUER_POLICIES,
    Ball,
    Cylinder,
    End,
    Exact,
    Game,
    Paper,
    Reason,
    StandOff,
    Winner,
    apollonius_circle,
    rollout,
    solve,
)

PAPER = Game(Ball(2.0), 1.0)
P = np.array([8.0, 1.42, 9.41])
E = np.array([7.92, 9.6, 0.0])
T = np.zeros(3)
NAN = math.nan
INF = math.inf


@pytest.mark.parametrize(
    ("name", "build"),
    [
        ("speed_m_s", Ball),
        ("horizontal_m_s", lambda value: Cylinder(value, 1.0, 1.0)),
        ("climb_m_s", lambda value: Cylinder(2.0, value, 1.0)),
        ("descent_m_s", lambda value: Cylinder(2.0, 1.0, value)),
        ("evader_speed_m_s", lambda value: Game(Ball(2.0), value)),
        ("step_s", lambda value: Exact(step_s=value)),
        ("step_s", lambda value: Paper(step_s=value)),
        ("capture_m", lambda value: Paper(capture_m=value)),
        ("duration_s", lambda value: rollout(PAPER, P, E, duration_s=value)),
    ],
)
def test_what_must_be_more_than_zero_says_so(name, build):
    for value in (0.0, -1.0, NAN, INF, -INF, "fast", None, 1j):
        words = rf"{name} = {re.escape(repr(value))}.*must be a finite number, more than zero"
        with pytest.raises(ConfigError, match=words):
            build(value)


@pytest.mark.parametrize(
    ("name", "build"),
    [
        ("radius_m", lambda value: StandOff(radius_m=value)),
        ("height_m", lambda value: StandOff(height_m=value)),
        ("capture_radius_m", lambda value: Game(Ball(2.0), 1.0, capture_radius_m=value)),
        ("information_age_s", lambda value: Game(Ball(2.0), 1.0, information_age_s=value)),
    ],
)
def test_what_may_be_zero_says_so(name, build):
    for value in (-1e-9, NAN, INF, "near"):
        with pytest.raises(ConfigError, match=rf"{name} = .*must be a finite number, zero or more"):
            build(value)
    build(0.0)


@pytest.mark.parametrize("name", ["wind_m_s", "target_velocity_m_s"])
def test_a_velocity_in_the_plane_is_two_finite_numbers(name):
    for pair in ((NAN, 0.0), (0.0, INF), (1.0,), (0.0, 0.0, 0.0), 0.0, [0.0], ("a", "b"), None):
        with pytest.raises(ConfigError, match=rf"{name} = .*must be two finite numbers"):
            Game(Ball(2.0), 1.0, **{name: pair})


def test_a_velocity_in_the_plane_may_be_a_list_or_an_array():
    games = [
        Game(Ball(2.0), 1.0, wind_m_s=pair)
        for pair in ((0.3, -0.4), [0.3, -0.4], np.array([0.3, -0.4]))
    ]
    assert games[0] == games[1] == games[2]
    assert games[2].wind_m_s == (0.3, -0.4)
    rows = Game(Ball(2.0), 1.0, wind_m_s=[np.array([0.1, 0.2]), 0.3])
    assert rows == Game(Ball(2.0), 1.0, wind_m_s=(np.array([0.1, 0.2]), 0.3))
    for refused in (
        {"target_velocity_m_s": (np.array([0.1, 0.2]), 0.3)},
        {"wind_m_s": (np.array([0.1, 0.2]), NAN)},
    ):
        with pytest.raises(ConfigError, match="must be two finite numbers"):
            Game(Ball(2.0), 1.0, **refused)


@pytest.mark.parametrize("pursuer", [2.0, "ball", None, (2.0,)])
def test_a_pursuer_is_one_of_the_speed_sets(pursuer):
    with pytest.raises(
        ConfigError, match=r"pursuer = .*Ball\(speed_m_s\) or Cylinder\(horizontal_m_s, climb_m_s"
    ):
        Game(pursuer, 1.0)


@pytest.mark.parametrize("standoff", [(3, 5), 3.0, None])
def test_a_stand_off_is_a_disc(standoff):
    with pytest.raises(
        ConfigError, match=r"standoff = .*: must be a disc, StandOff\(radius_m, height_m\)"
    ):
        Game(Ball(2.0), 1.0, standoff=standoff)


@pytest.mark.parametrize(
    "slow",
    [
        {"pursuer": Ball(1.0), "evader_speed_m_s": 1.0},
        {"pursuer": Ball(0.9), "evader_speed_m_s": 1.0},
        {"pursuer": Cylinder(1.0, 9.0, 9.0), "evader_speed_m_s": 1.0},
        {"pursuer": Ball(2.0), "evader_speed_m_s": 1.0, "wind_m_s": (0.6, 0.8)},
    ],
)
def test_a_pursuer_without_speed_in_hand_is_refused(slow):
    with pytest.raises(ConfigError, match=r"evader_speed_m_s = .*δ > 1"):
        Game(**slow)


def test_a_game_against_another_evader_is_the_same_game_built_anew():
    whole = {"standoff": StandOff(3.0, 5.0), "target_velocity_m_s": (0.1, -0.2)}
    game = Game(Cylinder(6.0, 3.0, 1.5), 2.0, **whole)
    assert game.against(4, 0.25) == Game(
        Cylinder(6.0, 3.0, 1.5), 4.0, information_age_s=0.25, **whole
    )
    assert game == Game(Cylinder(6.0, 3.0, 1.5), 2.0, **whole)


@pytest.mark.parametrize(
    ("speed_m_s", "age_s", "named"),
    [
        (0.0, 0.0, "evader_speed_m_s"),
        (NAN, 0.0, "evader_speed_m_s"),
        (2.0, 0.0, r"evader_speed_m_s = 2.0 .*δ > 1"),
        (0.2, 0.0, "target_velocity_m_s"),
        (1.5, -0.1, "information_age_s"),
        (1.5, INF, "information_age_s"),
    ],
)
def test_another_evader_is_refused_where_it_makes_no_game(speed_m_s, age_s, named):
    game = Game(Ball(2.0), 1.0, target_velocity_m_s=(0.3, 0.0))
    with pytest.raises(ConfigError, match=named):
        game.against(speed_m_s, age_s)


def test_a_target_that_outruns_the_evader_is_refused():
    with pytest.raises(
        ConfigError, match=r"target_velocity_m_s = \(0.6, 0.8\): must be slower than the evader"
    ):
        Game(Ball(2.0), 1.0, target_velocity_m_s=(0.6, 0.8))


@pytest.mark.parametrize(
    "extension",
    [
        {"pursuer": Cylinder(2.0, 1.0, 1.0)},
        {"standoff": StandOff(1.0, 0.0)},
        {"standoff": StandOff(0.0, 1.0)},
        {"wind_m_s": (0.1, 0.0)},
        {"target_velocity_m_s": (0.0, 0.1)},
    ],
)
def test_an_evader_in_space_takes_no_extension_of_the_plane(extension):
    with pytest.raises(
        ConfigError, match="evader_space = 'space': an evader that flies is defined for"
    ):
        Game(
            **({"pursuer": Ball(2.0), "evader_speed_m_s": 1.0, "evader_space": "space"} | extension)
        )
    assert (
        Game(Ball(2.0), 1.0, evader_space="space", standoff=StandOff(0.0, 0.0)).evader_space
        == "space"
    )


def test_an_unknown_space_is_refused():
    with pytest.raises(ConfigError, match="evader_space = 'time': must be 'plane' or 'space'"):
        Game(Ball(2.0), 1.0, evader_space="time")


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros(2),
        np.zeros((3, 2)),
        np.float64(1.0),
        [1.0, 2.0],
        "abc",
        [1.0, "a", 2.0],
        np.zeros(3) + 1j,
        np.zeros(()),
    ],
)
def test_what_is_no_array_of_vectors_is_refused_by_name(bad):
    with pytest.raises(
        ConfigError, match=r"(?s)pursuer = .*must be an array of shape \(\.\.\., 3\)"
    ):
        solve(PAPER, bad, E)
    with pytest.raises(
        ConfigError, match=r"(?s)target = .*must be an array of shape \(\.\.\., 3\)"
    ):
        solve(PAPER, P, E, bad)
    with pytest.raises(ConfigError, match=r"(?s)evader_velocity_m_s = .*must be an array"):
        solve(PAPER, P, E, evader_velocity_m_s=bad)


def test_lists_of_different_lengths_and_masked_arrays_are_refused_by_name():
    masked = np.ma.masked_array(np.zeros(3), mask=[0, 1, 0])
    for bad, said in (
        ([[1.0, 2.0, 3.0], [4.0]], "evader = .*must be an array of shape"),
        (masked, "(?s)evader = .*masked"),
    ):
        with pytest.raises(ConfigError, match=said):
            solve(PAPER, np.zeros(3), bad)


def test_shapes_that_do_not_fit_are_refused_with_their_names():
    with pytest.raises(
        ConfigError, match=r"leading shapes do not fit.*'pursuer': \(4,\).*'evader': \(5,\)"
    ):
        solve(PAPER, np.zeros((4, 3)), np.zeros((5, 3)))
    rows = Game(Ball(np.full(4, 2.0)), 1.0)
    with pytest.raises(ConfigError, match=r"leading shapes do not fit.*'speed_m_s': \(4,\)"):
        solve(rows, np.zeros((5, 3)), np.zeros((5, 3)))
    assert solve(rows, P, E).value.shape == (4,)


@pytest.mark.parametrize("name", ["pursuer", "evader", "target", "evader_velocity_m_s"])
def test_a_single_state_that_is_not_finite_is_refused_by_name(name):
    for axis, value in product(range(3), (NAN, INF, -INF)):
        given = {"pursuer": P, "evader": E, "target": T, "evader_velocity_m_s": T}
        given[name] = given[name].copy()
        given[name][axis] = value
        with pytest.raises(ConfigError, match=rf"^{name} = .*must be finite numbers"):
            solve(PAPER, **given)


@pytest.mark.parametrize("value", [NAN, INF, -INF])
def test_in_a_batch_only_the_row_itself_is_lost(games, value):
    for name, game in games.items():
        for place in range(4):
            given = [np.tile(array, (5, 1)) for array in (P, E, T, T)]
            clean = solve(game, *given[:3], evader_velocity_m_s=given[3])
            given[place][2, place % 3] = value
            for target in (None, given[2]):
                if target is None and place == 2:
                    continue
                solution = solve(game, *given[:2], target, evader_velocity_m_s=given[3])
                assert (
                    solution.reason.tolist()
                    == [solution.reason[0]] * 2 + [Reason.NOT_FINITE] + [solution.reason[0]] * 2
                )
                assert solution.winner[2] == Winner.UNDECIDED
                for field in solution[1:-1]:
                    assert np.isnan(field[2]).all(), name
                    assert not np.isnan(np.delete(field, 2, axis=0)).any(), name
                if target is not None:
                    np.testing.assert_array_equal(
                        np.delete(solution.value, 2), np.delete(clean.value, 2)
                    )


def test_parameters_out_of_range_cost_their_own_rows_with_the_reason():
    u = np.array([2.0, 1.0, 0.5, -2.0, 0.0, NAN, INF, 2.0, 2.0, 2.0, 2.0, 2.0])
    v = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 0.0, NAN, 1.0, 1.0])
    radius = np.array([0.0] * 10 + [-1.0, NAN])
    slow = Reason.PURSUER_TOO_SLOW
    wrong = Reason.OUT_OF_RANGE
    expected = [Reason.SOLVED, slow, slow] + [wrong] * 9
    solution = solve(
        Game(Ball(u), v, capture_radius_m=radius), np.tile(P, (12, 1)), np.tile(E, (12, 1))
    )
    assert solution.reason.tolist() == expected
    assert np.isnan(solution.value).tolist() == [False] + [True] * 11
    assert solution.winner.tolist() == [Winner.PURSUER] + [Winner.UNDECIDED] * 11


@pytest.mark.parametrize(
    "large",
    [
        {"standoff": StandOff(1e100, 1e100)},
        {"standoff": StandOff(1e100, 1e100), "capture_radius_m": 2e100},
        {"standoff": StandOff(1e100, 0.0), "information_age_s": 1e46},
    ],
)
def test_lengths_that_overflow_together_are_no_answer(large):
    assert solve(Game(Ball(1e54), 1.0, **large), P, E).reason == Reason.OVERFLOW


@pytest.mark.parametrize(
    ("place", "radius_m"),
    [((1e100, 1e100, 0.0), 0.0), ((1e100, 0.0, 1e100), 0.0), ((1e100, 0.0, 0.0), 1e100)],
)
def test_no_large_length_makes_up_for_another(place, radius_m):
    game = Game(Ball(1e54), 1.0, standoff=StandOff(radius_m, 0.0))
    assert solve(game, np.array(place), np.zeros(3)).reason == Reason.OVERFLOW


@pytest.mark.parametrize(
    "place", [(1e100, 0.0, 0.0), (0.0, 1e100, 0.0), (0.0, 0.0, 1e100), (0.0, 1e100, 1e100)]
)
def test_places_that_overflow_are_no_answer_however_close_they_are(place):
    assert solve(Game(Ball(1e54), 1.0), np.array(place), np.array(place)).reason == Reason.OVERFLOW


def test_a_single_state_in_single_precision_that_is_not_finite_is_refused():
    with pytest.raises(ConfigError, match=r"pursuer = .*must be finite"):
        solve(Game(Ball(2.0), 1.0), np.full(3, NAN, np.float32), np.zeros(3, np.float32))


def test_far_on_the_negative_side_overflows_as_on_the_positive():
    for x in (1e100, -1e100):
        solution = solve(Game(Ball(1e54), 1.0), np.full((3, 3), [x, 0.0, 0.0]), np.zeros((3, 3)))
        assert solution.reason.tolist() == [Reason.OVERFLOW] * 3


@pytest.mark.parametrize("axis", [0, 1])
def test_a_wind_that_is_no_number_costs_its_own_row(axis):
    wind = [np.array([0.1, 0.1]), np.array([0.2, 0.2])]
    wind[axis][1] = NAN
    solution = solve(Game(Ball(2.0), 1.0, wind_m_s=wind), np.tile(P, (2, 1)), np.tile(E, (2, 1)))
    assert solution.reason.tolist() == [Reason.SOLVED, Reason.OUT_OF_RANGE]


def test_speeds_whose_fourth_powers_overflow_are_no_answer():
    assert solve(Game(Ball(1e80), 1.0), P, E).reason == Reason.OVERFLOW
    assert solve(Game(Ball(1e70), 1.0), P, E).reason == Reason.SOLVED


def test_the_wind_counts_in_the_rows_speed_in_hand():
    game = Game(Ball(np.array([1.4, 1.6])), 1.0, wind_m_s=(0.3, 0.4))
    solution = solve(game, np.tile(P, (2, 1)), np.tile(E, (2, 1)))
    assert solution.reason.tolist() == [Reason.PURSUER_TOO_SLOW, Reason.SOLVED]


@pytest.mark.parametrize("ratio", [1.0, 0.5, -2.0, NAN, INF, "2"])
def test_a_circle_needs_a_ratio_above_one(ratio):
    with pytest.raises(ConfigError, match=r"speed_ratio = .*must be a finite number above 1"):
        apollonius_circle(P, E, ratio)


def test_policies_that_need_a_target_say_so():
    for catalogue in (PURSUER_POLICIES, EVADER_POLICIES):
        with pytest.raises(
            ConfigError, match="target = None: the policy 'task_oriented' needs a target"
        ):
            catalogue["task_oriented"](PAPER, P, E)


def test_lead_pursuit_without_the_evaders_velocity_is_refused_and_plays_nothing_else():
    words = "evader_velocity_m_s = None: the policy 'lead_pursuit' needs it"
    with pytest.raises(ConfigError, match=words):
        PURSUER_POLICIES["lead_pursuit"](PAPER, P, E, E)


def test_rollouts_refuse_what_they_do_not_know():
    with pytest.raises(ConfigError, match="pursuer_policy = 'fly': must be one of optimal"):
        rollout(PAPER, P, E, pursuer_policy="fly")
    with pytest.raises(ConfigError, match="evader_policy = 'run': must be one of optimal"):
        rollout(PAPER, P, E, evader_policy="run")
    with pytest.raises(
        ConfigError, match=r"information_age_s = 0.5: must be 0, because a rollout keeps no past"
    ):
        rollout(Game(Ball(2.0), 1.0, information_age_s=0.5), P, E)
    with pytest.raises(ConfigError, match=r"order = 2: must be 1 or 4"):
        Exact(order=2)


def test_a_row_without_an_answer_ends_its_rollout_at_once():
    states = np.tile(P, (3, 1))
    states[1, 0] = NAN
    end = rollout(PAPER, states, np.tile(E, (3, 1)), stepping=Exact(step_s=0.5))
    assert end.end.tolist() == [End.CAPTURED, End.NO_ANSWER, End.CAPTURED]
    assert end.time_s[1] == 0.0
