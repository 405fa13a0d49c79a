"""Random numbers without a state: the k-th draw of a stream is a function of the seed and of k, for arrays of either.

So a game draws the same numbers alone and in a batch, on one worker or eight, in simulation and in flight. The
generator is SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number generators", 2014).
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_GOLDEN: Final = np.uint64(0x9E3779B97F4A7C15)
_FIRST: Final = np.uint64(0xBF58476D1CE4E5B9)
_SECOND: Final = np.uint64(0x94D049BB133111EB)


def uniform(seed: ArrayLike, stream: int, index: ArrayLike) -> Array:
    """Draw from [0, 1).

    Args:
        seed: Non-negative integers, (...).
        stream: Which of the independent sequences of a seed.
        index: Number of the draw, (...); broadcast against `seed`.
    """
    with np.errstate(over="ignore"):  # the arithmetic is modulo 2^64
        state = _mix(np.asarray(seed).astype(np.uint64) + _GOLDEN)
        state = _mix(state + np.uint64(stream) * _GOLDEN)
        state = _mix(state + np.asarray(index).astype(np.uint64) * _GOLDEN)
    return (state >> np.uint64(11)).astype(np.float64) * 2.0**-53


def normal(seed: ArrayLike, stream: int, index: ArrayLike) -> Array:
    """Draw from the standard normal distribution (Box & Muller); arguments as of `uniform`."""
    k = 2 * np.asarray(index, dtype=np.int64)
    radius = np.sqrt(-2.0 * np.log1p(-uniform(seed, stream, k)))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform(seed, stream, k + 1)))


def _mix(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return state ^ (state >> np.uint64(31))
