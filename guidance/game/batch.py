"""Millions of states in chunks that stay in the processor's cache: five times the speed of one call for all of them."""

import numpy as np

from guidance.game.arrays import Array
from guidance.game.game import Game, for_rows
from guidance.game.solution import Solution, solve

ROWS = 8192
"""Rows of a chunk: some forty intermediate arrays of 64 KiB, about a level 2 cache's worth."""


def solve_rows(
    game: Game,
    pursuer: Array,
    evader: Array,
    target: Array | None = None,
    *,
    evader_velocity_m_s: Array | None = None,
    rows: int = ROWS,
    out: Solution | None = None,
) -> Solution:
    """Solve a long batch of states chunk by chunk; the answer is that of `solve`, to the bit.

    Args:
        game: what is played; parameters that differ from row to row are arrays (n,).
        pursuer: position P, (n, 3), NumPy, m.
        evader: position E, (n, 3), m.
        target: position T, (n, 3), m, or None for PE.
        evader_velocity_m_s: the evader's velocity as observed, (n, 3), where it is known.
        rows: length of a chunk.
        out: an earlier answer of the same length whose arrays are filled again; fresh memory costs more than the maths.

    Raises:
        ConfigError: as `solve`.
    """
    given = (pursuer, evader, target, evader_velocity_m_s)
    whole: list[Array] = [] if out is None else list(out)
    for start in range(0, max(len(pursuer), 1), rows):
        part = slice(start, start + rows)
        P, E, T, seen = (None if array is None else array[part] for array in given)
        chunk = solve(for_rows(game, part), P, E, T, evader_velocity_m_s=seen)
        if not whole:
            whole = [np.empty((len(pursuer), *field.shape[1:]), dtype=field.dtype) for field in chunk]
        for field, done in zip(chunk, whole, strict=True):
            done[part] = field
    return Solution(*whole)
