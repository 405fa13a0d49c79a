import numpy as np
import pytest

from guidance.strategies import normal, uniform


def test_a_draw_is_the_same_alone_and_among_others():
    seeds = np.arange(50)
    index = np.arange(7)
    table = uniform(seeds[:, None], 3, index)
    for seed in (0, 17, 49):
        for k in (0, 6):
            assert uniform(seed, 3, k) == table[seed, k]
            assert normal(seed, 3, k) == normal(seeds[:, None], 3, index)[seed, k]


def test_draws_of_other_seeds_streams_and_numbers_differ():
    draws = uniform(np.arange(40)[:, None, None], 0, np.arange(30)[:, None]) + 0.0
    assert len(np.unique(draws)) == 40 * 30
    streams = np.array([uniform(5, stream, np.arange(100)) for stream in range(20)])
    assert len(np.unique(streams)) == 2000


@pytest.mark.parametrize("stream", [0, 1, 12])
def test_uniform_draws_are_even_and_uncorrelated(stream):
    draws = uniform(np.arange(200)[:, None], stream, np.arange(500))
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    counts, _ = np.histogram(draws, bins=20, range=(0.0, 1.0))
    expected = draws.size / 20
    # Chi squared, 19 degrees of freedom, p = 0.001
    assert np.sum((counts - expected) ** 2 / expected) < 44.0
    for one, other in ((draws[:, 1:], draws[:, :-1]), (draws[1:], draws[:-1])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4.0 / np.sqrt(one.size)


def test_normal_draws_have_the_moments_of_the_standard_normal_distribution():
    draws = normal(np.arange(400)[:, None], 2, np.arange(250)).ravel()
    near = 4.0 / np.sqrt(draws.size)
    assert abs(draws.mean()) < near
    assert abs(draws.var() - 1.0) < near * np.sqrt(2.0)
    assert abs(np.mean(draws**4) - 3.0) < near * np.sqrt(96.0)
