"""Estimate: its filters against filterpy, an independent library, and its motion against its own definition."""

import functools
import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guidance.estimation import filters
from guidance.estimation.filters import Estimate, Height, Normal, steady_after, turning_after
from guidance.estimation.measurement import TrackSettings

SETTINGS = TrackSettings(declared_speed_m_s=3.0, turning_noise_m2_s3=0.7, turn_rate_sd_rad_s=0.5)
STEPS_S = [0.02, 0.3, 1.0]
states = st.tuples(
    *[st.floats(-200.0, 200.0)] * 2, *[st.floats(-10.0, 10.0)] * 2, st.floats(-1.5, 1.5)
)


@functools.cache
def filterpy():
    """Imported when needed: it loads SciPy's statistics and matplotlib, and every worker collects this file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # filterpy's, on import
        from filterpy import common, kalman
    return SimpleNamespace(
        noise=common.Q_continuous_white_noise,
        filter=kalman.KalmanFilter,
        mixture=kalman.IMMEstimator,
    )


NOTHING = np.zeros((5, 5))
MODELS = (steady_after, turning_after)
FLYING = Height(4.0, 0.5, 2.0, 0.3, 1.0)


def moved(model, state, dt_s, covariance=NOTHING):
    """Mean and covariance after a step of a model."""
    size = 4 + model
    lower = covariance[:size, :size][np.tril_indices(size)].tolist()
    after = MODELS[model](Normal(list(state[:size]), lower), dt_s, SETTINGS)
    return np.array(after.mean), covariance_of(after)


def covariance_of(state):
    size = len(state.mean)
    covariance = np.zeros((size, size))
    covariance[np.tril_indices(size)] = state.covariance
    return covariance + np.tril(covariance, -1).T


def mean_after(model, state, dt_s):
    return moved(model, state, dt_s)[0]


def noise_after(model, dt_s):
    return moved(model, [0.0] * 5, dt_s)[1]


def filterpy_noise(dt_s, density, turn_rate_variance):
    noise = np.zeros((5, 5))
    block = filterpy().noise(2, dt=dt_s, spectral_density=density)
    for axis in (0, 1):
        noise[np.ix_([axis, axis + 2], [axis, axis + 2])] = block
    noise[4, 4] = turn_rate_variance
    return noise


def turned(state, dt_s, pieces=20000):
    """A coordinated turn by small steps of its definition: position' = velocity, velocity' = ω × velocity."""
    north, east, north_rate, east_rate, turn_rate = state
    piece = dt_s / pieces
    velocity = complex(north_rate, east_rate)
    place = complex(north, east)
    half = complex(math.cos(turn_rate * piece / 2), math.sin(turn_rate * piece / 2))
    for _ in range(pieces):
        velocity *= half
        place += velocity * piece
        velocity *= half
    return [place.real, place.imag, velocity.real, velocity.imag]


@pytest.mark.parametrize("turn_rate", [0.0, 1e-6, 1e-3, 0.4, -1.2])
def test_the_turn_is_the_one_that_its_definition_gives(turn_rate):
    state = [10.0, -20.0, 3.0, 1.5, turn_rate]
    assert mean_after(1, state, 0.7)[:4] == pytest.approx(turned(state, 0.7), abs=1e-6)


@settings(deadline=None)
@given(states, st.sampled_from(STEPS_S))
def test_the_steady_model_goes_straight(state, dt_s):
    north, east, north_rate, east_rate, _ = state
    straight = [north + dt_s * north_rate, east + dt_s * east_rate, north_rate, east_rate]
    assert mean_after(0, state, dt_s)[:4] == pytest.approx(straight)


@settings(deadline=None)
@given(states, st.sampled_from(STEPS_S))
@pytest.mark.parametrize("model", [0, 1])
def test_a_covariance_moves_by_the_jacobian_of_the_step(model, state, dt_s):
    spread = np.random.default_rng(5).normal(size=(5, 5))
    size = 4 + model
    covariance = spread @ spread.T
    jacobian = np.array([
        (mean_after(model, state + by, dt_s) - mean_after(model, state - by, dt_s)) / 2e-4
        for by in 1e-4 * np.eye(5)[:size]
    ]).T  # fmt: skip
    _, after = moved(model, state, dt_s, covariance)
    covariance = covariance[:size, :size]
    assert after == pytest.approx(
        jacobian @ covariance @ jacobian.T + noise_after(model, dt_s), abs=1e-2, rel=1e-4
    )


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_the_noise_is_filterpy_s_continuous_white_noise(dt_s):
    fading = SETTINGS.turn_rate_sd_rad_s**2 * (1.0 - math.exp(-2.0 * dt_s / SETTINGS.turn_time_s))
    assert noise_after(0, dt_s) == pytest.approx(
        filterpy_noise(dt_s, SETTINGS.steady_noise_m2_s3, fading)[:4, :4]
    )
    assert noise_after(1, dt_s) == pytest.approx(
        filterpy_noise(dt_s, SETTINGS.turning_noise_m2_s3, fading)
    )


def test_two_half_steps_spread_as_much_as_one_whole_one():
    _, twice = moved(0, [1.0, 2.0, 3.0, 4.0], 0.5, noise_after(0, 0.5))
    assert twice == pytest.approx(noise_after(0, 1.0))


def moving_filter(model, dt_s, known):
    """filterpy's filter, with the state moved by our motion and everything else its own."""

    class Moving(filterpy().filter):
        def predict(self, *_args, **_kwargs):
            mean, covariance = moved(model, self.x[:, 0], dt_s, self.P)
            size = 4 + model
            self.x[:size, 0] = mean
            self.P[:size, :size] = covariance

    return Moving(dim_x=5, dim_z=known)


def filterpy_imm(measured, noise, dt_s):
    """filterpy's IMM with our two motions and its own mixing, gains, likelihoods and combination."""
    known = len(measured)
    begun = filters.begin(measured, np.diag(noise), SETTINGS)
    models = []
    for model in (0, 1):
        one = moving_filter(model, dt_s, known)
        one.x = np.array(begun.turning.mean)[:, None]
        one.P = covariance_of(begun.turning)
        one.H = np.eye(5)[:known]
        one.R = noise
        models.append(one)
    begins = 1.0 / SETTINGS.steady_time_s
    ends = 1.0 / SETTINGS.turning_time_s
    # The generator of a chain with two states, exponentiated by its series: independent of the closed form.
    generator = np.array([[-begins, begins], [ends, -ends]]) * dt_s
    chain = np.eye(2)
    term = np.eye(2)
    for order in range(1, 30):
        term = term @ generator / order
        chain += term
    return filterpy().mixture(
        models, [1.0 - begun.turning_share, begun.turning_share], chain
    ), begun


def advanced(modes, dt_s):
    return filters.advance(Estimate(0.0, 0.0, modes, FLYING), dt_s, SETTINGS).modes


@pytest.mark.parametrize("dt_s", STEPS_S)
@pytest.mark.parametrize("known", [2, 4])
def test_fifty_steps_are_those_of_filterpy_s_interacting_models(dt_s, known):
    rng = np.random.default_rng(3)
    noise = np.diag([0.4, 0.4, 0.09, 0.09][:known])
    reference, modes = filterpy_imm(np.array([5.0, -3.0, 2.0, 1.0])[:known], noise, dt_s)
    for count in range(1, 51):
        angle = 0.3 * count * dt_s
        truth = np.array(
            [
                5.0 + 8.0 * math.sin(angle),
                -3.0 + 8.0 * math.cos(angle),
                2.4 * math.cos(angle),
                -2.4 * math.sin(angle),
            ]
        )
        measured = truth[:known] + rng.normal(0.0, 0.3, known)
        # The steady model borrows the turn rate before it is mixed
        steady, turning = reference.filters
        steady.x[4] = turning.x[4]
        steady.P[4, :] = steady.P[:, 4] = 0.0
        steady.P[4, 4] = turning.P[4, 4]
        reference.predict()
        modes = advanced(modes, dt_s)
        for model in (0, 1):
            size = 4 + model
            assert modes[model].mean == pytest.approx(
                reference.filters[model].x[:size, 0], abs=1e-7
            )
            assert covariance_of(modes[model]) == pytest.approx(
                reference.filters[model].P[:size, :size], abs=1e-7
            )
        reference.update(measured[:, None])
        modes = filters.correct(modes, measured, np.diag(noise))
        mixture = filters.blended(*modes)
        assert mixture.mean == pytest.approx(reference.x[:4, 0], abs=1e-7)
        assert covariance_of(mixture) == pytest.approx(reference.P[:4, :4], abs=1e-7)
        assert modes.turning_share == pytest.approx(reference.mu[1], abs=1e-7)


def test_no_time_changes_nothing():
    estimate = Estimate(0.0, 0.0, filters.begin([1.0, 2.0], [0.5, 0.5], SETTINGS), FLYING)
    assert filters.advance(estimate, 0.0, SETTINGS) is estimate


def test_the_innovation_is_that_of_the_mixture():
    modes = advanced(filters.begin([1.0, 2.0], [0.5, 0.5], SETTINGS), 0.5)
    measured = np.array([3.0, -1.0])
    variances = [0.3, 0.3]
    mixture = filters.blended(*modes)
    off = measured - mixture.mean[:2]
    inverse = np.linalg.inv(covariance_of(mixture)[:2, :2] + np.diag(variances))
    assert filters.distance(modes, measured, variances) == pytest.approx(off @ inverse @ off)


def test_no_model_is_ever_ruled_out_for_good():
    modes = filters.begin([0.0, 0.0, 3.0, 0.0], [0.5, 0.5, 0.1, 0.1], SETTINGS)
    for _ in range(20):
        modes = filters.correct(modes, [1e4, 0.0, 0.0, 300.0], [1e-3, 1e-3, 1e-4, 1e-4])
        assert 0.0 < modes.turning_share < 1.0
        modes = advanced(modes, 0.02)
        for state in modes[:2]:
            assert np.isfinite(state.mean).all()
            assert np.linalg.eigvalsh(covariance_of(state)).min() > 0.0


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_the_height_is_filterpy_s_filter_of_two_numbers(dt_s):
    reference = filterpy().filter(dim_x=2, dim_z=1)
    reference.x = np.array([[4.0], [0.5]])
    reference.P = np.array([[2.0, 0.3], [0.3, 1.0]])
    reference.F = np.array([[1.0, dt_s], [0.0, 1.0]])
    reference.Q = filterpy().noise(2, dt=dt_s, spectral_density=0.05)
    ours = FLYING
    modes = filters.begin([0.0, 0.0], [0.5, 0.5], SETTINGS)
    for count in range(20):
        reference.predict()
        reference.update(4.0 + count, R=0.4, H=np.array([[1.0, 0.0]]))
        reference.update(1.0 / dt_s, R=0.1, H=np.array([[0.0, 1.0]]))
        ours = filters.advance(Estimate(0.0, 0.0, modes, ours), dt_s, SETTINGS).height
        ours = filters.correct_rate(filters.correct_down(ours, 4.0 + count, 0.4), 1.0 / dt_s, 0.1)
        assert ours[:2] == pytest.approx(reference.x[:, 0])
        assert ours[2:] == pytest.approx([reference.P[0, 0], reference.P[0, 1], reference.P[1, 1]])
