"""Matchings of pursuers and evaders: as many evaders as can be, and of those matchings the largest profit.

Single pursuers are a linear assignment. Where an evader may need two pursuers, it is a set packing, which is solved as
an integer programme: first for the number of evaders, then for the profit at that number.
"""

import numpy as np

from guidance.errors import ConfigError
from guidance.extras import how_to_add
from guidance.game.arrays import Array
from guidance.game.team.table import taken


def assigned(profit: Array, first: Array | None = None) -> Array:
    """Return the pursuer of each evader, (b, m), −1 for none: as many as can be, and of those the largest profit.

    Args:
        profit: of each pair, (b, m, n), zero or more; −∞ where there is none.
        first: which evaders come first, (b, m), where not all can be matched.
    """
    try:
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - only teams need it, and it loads slowly
    except ImportError:
        raise ConfigError(f"match_teams: {how_to_add('sim')}") from None
    b, m, n = profit.shape
    edges = profit > -np.inf
    # One pair more is worth more than all profits together.
    profit = np.where(edges, profit, 0.0)
    largest_profit = profit.max(axis=(1, 2), keepdims=True)
    bonus = 1.0 + min(n, m) * largest_profit
    if first is not None:
        bonus = bonus * (1.0 + first[..., None])
    worth = np.where(edges, bonus + profit, 0.0)
    chosen = np.full((b, m), -1)
    finite_rows = np.isfinite(worth.sum(axis=(1, 2)))
    for row in np.flatnonzero(finite_rows):
        evader, pursuer = linear_sum_assignment(worth[row], maximize=True)
        chosen[row, evader] = pursuer
    is_edge = (chosen >= 0) & taken(edges, chosen)
    return np.where(is_edge, chosen, -1)


def packed(singles: Array, pairs: Array, numbers: Array, promised: Array) -> tuple[Array, Array]:  # noqa: PLR0914
    """Return the pursuers of each evader, (m,) and (m,), −1 for none: as many evaders as can be, promised ones first.

    Args:
        singles: profit of each pursuer alone, (m, n), zero or more; −∞ where it guarantees nothing.
        pairs: the same of each pair of pursuers, (m, k).
        numbers: of both pursuers of each pair, (k, 2).
        promised: evaders that come first where not all can be matched, (m,).
    """
    from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - as above

    m, n = singles.shape
    evader, pursuer = np.nonzero(singles > -np.inf)
    paired_evader, pair = np.nonzero(pairs > -np.inf)
    evaders = np.concatenate([evader, paired_evader])
    first = np.concatenate([pursuer, numbers[pair, 0]])
    second = np.concatenate([np.full_like(pursuer, -1), numbers[pair, 1]])
    profit = np.concatenate([singles[evader, pursuer], pairs[paired_evader, pair]])
    everybody = np.arange(n)[:, None]
    uses = np.vstack(
        [np.arange(m)[:, None] == evaders, (everybody == first) | (everybody == second)]
    ).astype(float)
    matched = np.where(promised[evaders], m + 1.0, 1.0)
    one_each = LinearConstraint(uses, 0.0, 1.0)
    binary = {"integrality": np.ones(len(evaders)), "bounds": Bounds(0.0, 1.0)}
    exact = {"mip_rel_gap": 0.0}
    optimum = milp(-matched, constraints=one_each, options=exact, **binary)
    as_many = LinearConstraint(matched, round(-optimum.fun) - 0.5, np.inf)
    best = milp(-profit, constraints=[one_each, as_many], options=exact, **binary)
    rows = np.flatnonzero(best.x > 0.5)
    team = np.full((2, m), -1)
    team[0, evaders[rows]] = first[rows]
    team[1, evaders[rows]] = second[rows]
    return team[0], team[1]
