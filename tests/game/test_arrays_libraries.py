"""The same functions on the arrays of other libraries, where they are installed."""

from dataclasses import replace

import numpy as np
import pytest

from guidance.errors import ConfigError
from guidance.game import (
    EVADER_POLICIES,
    PURSUER_POLICIES,
    Ball,
    Cylinder,
    Exact,
    Extent,
    Game,
    StandOff,
    apollonius_circle,
    apollonius_sphere,
    rollout,
    solve,
)
from guidance.game.arrays import vectors
from tests.game.gradient import automatic_gradient, automatic_residual, value_gradient

pytestmark = pytest.mark.arrays
ROWS = 40
"""The same number wherever a test can choose: JAX compiles each operation anew for another shape."""

NAMES = ("paper", "ball_everything", "cylinder_everything", "space", "moving_target")


def only_long(value):
    """Return a parameter that is tried when there is time: compiling these games takes a library many seconds."""
    values = value if isinstance(value, tuple) else (value,)
    return pytest.param(*values, marks=pytest.mark.long)


class Torch:
    """PyTorch, on the CPU."""

    def __init__(self):
        self.torch = pytest.importorskip("torch")
        self.dtypes = {"single": self.torch.float32, "double": self.torch.float64}

    def array(self, values, precision="double"):
        return self.torch.asarray(np.array(values), dtype=self.dtypes[precision])

    def slopes(self, function, values):
        """Derivatives of the sum of a function's values by an array."""
        array = self.array(values).requires_grad_()
        function(array).sum().backward()
        return array.grad.numpy()


class Jax:
    """JAX, on the CPU, with double precision."""

    def __init__(self):
        jax = pytest.importorskip("jax")
        jax.config.update("jax_enable_x64", True)
        self.numpy = jax.numpy
        self.dtypes = {"single": jax.numpy.float32, "double": jax.numpy.float64}

    def array(self, values, precision="double"):
        return self.numpy.asarray(values, dtype=self.dtypes[precision])

    def slopes(self, function, values):
        """Derivatives of the sum of a function's values by an array."""
        import jax

        return np.asarray(jax.grad(lambda array: function(array).sum())(self.array(values)))


@pytest.fixture(scope="module", params=[Torch, Jax])
def library(request):
    return request.param()


@pytest.mark.parametrize(
    ("name", "precision", "tolerance"),
    [
        ("paper", "double", 1e-6),
        ("cylinder_everything", "double", 1e-6),
        ("cylinder_everything", "single", 2e-2),
        only_long(("ball_everything", "double", 1e-6)),
        only_long(("ball_everything", "single", 2e-2)),
        only_long(("space", "double", 1e-6)),
        only_long(("moving_target", "double", 1e-6)),
    ],
)
def test_another_library_solves_the_same_games(library, games, oracle, name, precision, tolerance):
    states = oracle.states(21, ROWS, games[name])
    velocity_m_s = np.full((ROWS, 3), 0.1)
    for with_target in (False, True):
        arrays = states[: 3 if with_target else 2]
        on_numpy = solve(games[name], *arrays, evader_velocity_m_s=velocity_m_s)
        on_library = solve(
            games[name],
            *(library.array(array, precision) for array in arrays),
            evader_velocity_m_s=library.array(velocity_m_s, precision),
        )
        clear = np.abs(on_numpy.margin_s) > 0.05
        assert on_library.value.dtype == library.dtypes[precision]
        np.testing.assert_array_equal(np.asarray(on_library.winner)[clear], on_numpy.winner[clear])
        np.testing.assert_array_equal(np.asarray(on_library.reason)[clear], on_numpy.reason[clear])
        for a, b in zip(on_library[1:-1], on_numpy[1:-1], strict=True):
            np.testing.assert_allclose(
                np.asarray(a)[clear], b[clear], rtol=tolerance, atol=tolerance
            )


ROUNDED = Extent(((0, 0), (15, 0), (4, 14)), 2.0)
"""It has edges, corners and a radius; a disc and a segment have less."""


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("moving_target", ROUNDED),
        only_long(("moving_target", Extent(radius_m=6.0))),
        only_long(("moving_target", Extent(((0.0, 0.0), (20.0, 5.0))))),
        only_long(("paper", ROUNDED)),
        only_long(("cylinder_everything", ROUNDED)),
    ],
)
def test_targets_with_an_extent_have_the_same_answers(library, games, oracle, name, shape):
    states = oracle.states(25, ROWS, games[name])[:3]
    game = replace(games[name], target_extent=shape)
    on_numpy = solve(game, *states)
    on_library = solve(game, *(library.array(array) for array in states))
    np.testing.assert_array_equal(np.asarray(on_library.winner), on_numpy.winner)
    for field in ("value", "margin_s", "pursuer_velocity_m_s"):
        np.testing.assert_allclose(
            np.asarray(getattr(on_library, field)), getattr(on_numpy, field), atol=1e-6
        )


def test_a_row_that_is_not_finite_is_lost_alone(library, games, oracle):
    P, E, T = oracle.states(22, ROWS)
    P[1, 1] = np.nan
    on_library = solve(games["cylinder_standoff"], *(library.array(array) for array in (P, E, T)))
    assert np.flatnonzero(np.isnan(np.asarray(on_library.value))).tolist() == [1]


def test_a_single_state_that_is_not_finite_is_refused_where_it_cannot_be_traced(library):
    P = library.array([np.nan, 0.0, 5.0])
    E = library.array([9.0, 0.0, 0.0])
    if isinstance(library, Torch):
        with pytest.raises(ConfigError, match=r"pursuer = .*must be finite"):
            solve(Game(Ball(2.0), 1.0), P, E)
    else:
        assert np.isnan(float(solve(Game(Ball(2.0), 1.0), P, E).value))


def test_a_single_state_works_too(library, games, oracle):
    P, E, T = oracle.states(23, 1)
    for name in NAMES:
        on_numpy = solve(games[name], P[0], E[0], T[0])
        on_library = solve(games[name], *(library.array(array[0]) for array in (P, E, T)))
        assert float(on_library.value) == pytest.approx(float(on_numpy.value), rel=1e-9)
        assert on_library.pursuer_velocity_m_s.shape == (3,)


def test_policies_circles_and_gradients_work_too(library, games, oracle):
    P, E, T = oracle.states(24, ROWS)
    arrays = [library.array(array) for array in (P, E, T)]
    run = T - E
    for policy in (*PURSUER_POLICIES.values(), *EVADER_POLICIES.values()):
        np.testing.assert_allclose(
            np.asarray(policy(games["wind"], *arrays, library.array(run))),
            policy(games["wind"], P, E, T, run),
            atol=1e-7,
        )
    for shape in (apollonius_circle, apollonius_sphere):
        for a, b in zip(shape(*arrays[:2], 2.0), shape(P, E, 2.0), strict=True):
            np.testing.assert_allclose(np.asarray(a), b)
    for a, b in zip(
        value_gradient(games["cylinder"], *arrays),
        value_gradient(games["cylinder"], P, E, T),
        strict=True,
    ):
        np.testing.assert_allclose(np.asarray(a), b, atol=1e-9)


def test_a_rollout_ends_as_in_numpy(library, games, oracle):
    states = oracle.states(24, ROWS)
    stepping = Exact(step_s=0.5, order=1)
    on_numpy = rollout(games["paper"], *states, stepping=stepping)
    arrays = [library.array(array) for array in states]
    on_library = rollout(games["paper"], *arrays, stepping=stepping)
    np.testing.assert_allclose(np.asarray(on_library.time_s), on_numpy.time_s, atol=1e-9)
    np.testing.assert_array_equal(np.asarray(on_library.end), on_numpy.end)


@pytest.mark.parametrize(
    "name", ["cylinder_everything", *map(only_long, ("ball_everything", "space"))]
)
def test_automatic_differentiation_leaves_no_residual(library, games, oracle, name):
    P, E, T = oracle.states(25, ROWS, games[name])
    arrays = [library.array(array) for array in (P, E, T)]
    chase = np.asarray(automatic_residual(games[name], *arrays[:2]))
    won = solve(games[name], P, E).value > 0.1
    assert np.abs(chase[won]).max() < 1e-9
    race = np.asarray(automatic_residual(games[name], *arrays))
    solution = solve(games[name], P, E, T)
    won = (
        (solution.value > 0.1)
        & (solution.meeting_time_s > 0.1)
        & (np.abs(solution.margin_s) > 0.01)
    )
    assert np.abs(race[won]).max() < 1e-6


@pytest.mark.parametrize("name", ["cylinder", *map(only_long, ("paper", "ball_everything"))])
def test_right_above_the_evader_the_derivatives_are_numbers(library, games, name):
    """The distance has no derivative there, and zero is used; the derivative by the height is continuous."""
    game = games[name]
    E = np.zeros((ROWS, 3))
    T = np.array([[30.0, 4.0, 0.0], [-9.0, 25.0, 0.0]] * (ROWS // 2))
    P = np.array([[0.0, 0.0, 12.0], [0.0, 0.0, 7.0]] * (ROWS // 2))

    def value(P, E, T):
        return solve(game, P, E, T).value

    chase = automatic_gradient(value, library.array(P), library.array(E), None)
    race = automatic_gradient(value, *(library.array(array) for array in (P, E, T)))
    for slopes in (chase, race):
        assert all(np.isfinite(np.asarray(part)).all() for part in slopes)
    nearly = P + np.array([1e-7, 0.0, 0.0])
    beside = value_gradient(game, nearly, E, T)
    np.testing.assert_allclose(np.asarray(race.target), beside.target, atol=1e-5)
    np.testing.assert_allclose(np.asarray(race.pursuer)[:, 2], beside.pursuer[:, 2], atol=1e-5)
    if name == "paper":
        np.testing.assert_allclose(np.asarray(chase.pursuer)[:, 2], 1.0 / np.sqrt(3.0), rtol=1e-12)


def test_a_cylinder_horizontally_inside_the_disc_gains_by_its_height_alone(library):
    game = Game(Cylinder(2.0, 0.7, 1.0), 1.0, standoff=StandOff(3.0, 2.0))
    P, E, T = (
        library.array([position_m] * ROWS)
        for position_m in ([0.5, 0.2, 9.0], [0.0, 0.0, 0.0], [9.0, 0.0, 0.0])
    )
    chase = automatic_gradient(lambda P, E, T: solve(game, P, E, T).value, P, E, None)
    assert np.asarray(chase.pursuer).tolist() == [[0.0, 0.0, 1.0]] * ROWS
    race = automatic_gradient(lambda P, E, T: solve(game, P, E, T).value, P, E, T)
    np.testing.assert_allclose(np.asarray(race.pursuer), [[0.0, 0.0, -1.0]] * ROWS, atol=1e-12)


def test_a_target_abeam_of_the_wind_has_its_derivative_too(library):
    """The absolute value of a zero coefficient has no derivative; the root that is used has one."""
    game = Game(Ball(2.0), 1.0, wind_m_s=(0.5, 0.0))
    arrays = [
        library.array([position_m] * ROWS)
        for position_m in ([0.0, -10.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    ]
    slopes = automatic_gradient(lambda P, E, T: solve(game, P, E, T).margin_s, *arrays)
    assert float(slopes.pursuer[0, 0]) == pytest.approx(-0.5 / (2.0**2 - 0.5**2), rel=1e-12)


def test_the_wind_may_differ_from_row_to_row(library, oracle):
    P, E, T = oracle.states(28, ROWS)
    blows = np.linspace(-0.4, 0.5, ROWS), np.linspace(0.3, -0.2, ROWS)
    for pursuer, disc in (
        (Ball(2.0), StandOff()),
        (Ball(2.0), StandOff(2.0, 1.0)),
        (Cylinder(2.0, 0.7, 0.5), StandOff(1.0)),
    ):
        on_numpy = Game(pursuer, 1.0, standoff=disc, wind_m_s=blows)
        on_library = Game(
            pursuer, 1.0, standoff=disc, wind_m_s=tuple(library.array(part) for part in blows)
        )
        for arrays in ((P, E), (P, E, T)):
            expected = solve(on_numpy, *arrays)
            answer = solve(on_library, *(library.array(array) for array in arrays))
            clear = np.abs(expected.margin_s) > 0.01
            np.testing.assert_array_equal(np.asarray(answer.winner), expected.winner)
            for a, b in zip(answer[1:-1], expected[1:-1], strict=True):
                np.testing.assert_allclose(np.asarray(a)[clear], b[clear], rtol=1e-6, atol=1e-6)
            single = solve(
                Game(pursuer, 1.0, standoff=disc, wind_m_s=(blows[0][7], blows[1][7])),
                *(a[7] for a in arrays),
            )
            assert float(expected.value[7]) == pytest.approx(float(single.value), rel=1e-12)


@pytest.mark.parametrize("name", ["paper", only_long("cylinder_everything")])
def test_jax_compiles_a_solution_whose_states_it_does_not_know_yet(games, oracle, name):
    jax = pytest.importorskip("jax")
    library = Jax()
    P, E, T = oracle.states(27, ROWS)
    compiled = jax.jit(lambda P, E, T: solve(games[name], P, E, T))
    on_library = compiled(*(library.array(array) for array in (P, E, T)))
    np.testing.assert_allclose(on_library.value, solve(games[name], P, E, T).value, atol=1e-6)


def test_what_is_made_on_the_way_is_made_where_the_states_are():
    """PyTorch's device without memory stands in for one that this machine may not have."""
    torch = pytest.importorskip("torch")
    like = torch.zeros(3, dtype=torch.float64, device="meta")
    xp, _ = vectors({"like": like})
    for made in (
        xp.constant(like, (1.0, 2.0)),
        xp.pack((3,), like, 1.0),
        xp.astype(xp.pack((3,), like, 1), xp.int8),
    ):
        assert made.device.type == "meta"


def test_arrays_of_different_libraries_are_refused_by_name(library):
    pursuer = np.array([3.0, 4.0, 10.0])
    evader = library.array([30.0, 1.0, 0.0])
    with pytest.raises(
        ConfigError, match=r"different libraries cannot be mixed: pursuer: ndarray, evader: "
    ):
        solve(Game(Ball(2.0), 1.0), pursuer, evader)


PAPER_TAD = ([[6.97, 5.83, 9.15]] * ROWS, [[9.8, 0.33, 0.0]] * ROWS, [[0.0, 0.0, 0.0]] * ROWS)


@pytest.mark.parametrize("parameter", ["radius", "capture", "age"])
def test_a_parameter_of_zero_has_the_derivative_of_its_neighbours(library, parameter):
    def game(array):
        return Game(
            Ball(2.0),
            1.0,
            array if parameter == "capture" else 0.0,
            StandOff(array if parameter == "radius" else (3.0 if parameter == "age" else 0.0), 0.0),
            array if parameter == "age" else 0.0,
        )

    states = [library.array(array) for array in PAPER_TAD]
    values = np.linspace(0.0, 0.2, ROWS)
    slopes = library.slopes(lambda array: solve(game(array), *states).value, values)
    h = 1e-6
    on_numpy = solve(game(values), *PAPER_TAD).value
    on_library = solve(game(values + h), *PAPER_TAD).value
    np.testing.assert_allclose(slopes, (on_library - on_numpy) / h, atol=1e-5)


def test_the_margin_has_its_derivative_on_the_barrier(library):
    E = library.array([[2.0, 0.0, 0.0]] * ROWS)
    T = library.array([[4.0, 0.0, 0.0]] * ROWS)
    slopes = library.slopes(
        lambda P: solve(Game(Ball(2.0), 1.0), P, E, T).margin_s, [[0.0, 0.0, 0.0]] * ROWS
    )
    np.testing.assert_allclose(slopes, [[0.5, 0.0, 0.0]] * ROWS, atol=1e-12)


@pytest.mark.parametrize("speeds", [Ball(2.0), only_long(Cylinder(3.0, 2.0, 1.0))])
def test_a_rollout_without_a_target_ends_in_a_capture(library, speeds):
    P = [[8.0, 1.42, 9.41]] * ROWS
    E = [[7.92, 9.6, 0.0]] * ROWS
    game = Game(speeds, 1.0)
    on_library = rollout(game, library.array(P), library.array(E), stepping=Exact(1.5))
    on_numpy = rollout(game, P, E, stepping=Exact(1.5))
    np.testing.assert_allclose(np.asarray(on_library.time_s), on_numpy.time_s, atol=1e-6)


def test_states_and_parameters_of_different_libraries_are_refused_by_name(library):
    P = np.array([[8.0, 1.42, 9.41]] * 2)
    E = np.array([[7.92, 9.6, 0.0]] * 2)
    foreign = Game(Ball(library.array([2.0, 3.0])), 1.0)
    own = Game(Ball(np.array([2.0, 3.0])), 1.0)
    for call in (
        lambda: solve(foreign, P, E),
        lambda: solve(own, library.array(P), library.array(E)),
        lambda: rollout(foreign, P, E),
        lambda: PURSUER_POLICIES["pure_pursuit"](foreign, P, E),
        lambda: Game(Ball(library.array([2.0, 3.0])), np.array([1.0, 1.0])),
    ):
        with pytest.raises(ConfigError, match="different libraries cannot be mixed"):
            call()
