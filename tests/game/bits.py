"""What tests of batches share: random players, and equality to the bit."""

import numpy as np


def same(a, b):
    """Equal to the bit, NaN and the sign of zero included."""
    a = np.asarray(a)
    b = np.asarray(b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def teams(seed, n, m, count=None):
    """Positions of pursuers and evaders such that some pursuers beat some evaders of a target at zero."""
    rng = np.random.default_rng(seed)
    shape = () if count is None else (count,)
    P = rng.uniform(-25.0, 25.0, (*shape, n, 3))
    E = rng.uniform(-18.0, 18.0, (*shape, m, 3))
    P[..., 2] = np.abs(P[..., 2])
    E[..., 2] = 0.0
    return P, E
