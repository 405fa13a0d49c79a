"""The linear assignment problem for a batch of tables: shortest augmenting paths (Crouse, IEEE TAES 52(4), 2016).

Every table of a batch is worked on by itself, so that its answer has the same bits in any batch.
"""

from typing import Any

import numpy as np

from guidance.game.team.discs import Array


def assigned_rows(worth: Array) -> Array:
    """Give each column of a table a row of its own so that the sum of what the pairs are worth is largest.

    Args:
        worth: finite numbers, (..., n, m).

    Returns:
        Number of the row of each column, (..., m); −1 for columns that are left over, where m is more than n.
    """
    *shape, n, m = worth.shape
    tables = worth.reshape(-1, n, m)
    if n <= m:
        return _shortest_paths(-tables).reshape(*shape, m)
    columns = _shortest_paths(-tables.swapaxes(1, 2))
    rows = np.full((len(tables), m), -1, dtype=np.intp)
    table, row = np.nonzero(columns >= 0)
    rows[table, columns[table, row]] = row
    return rows.reshape(*shape, m)


def _shortest_paths(cost: Array) -> Array:
    """Return the row of each column, (b, m), of the least sum of costs (b, n, m), n ≤ m: row by row, a path each."""
    b, n, m = cost.shape
    owner = np.full((b, m + 1), -1, dtype=np.intp)
    """Of each column; the last is where the new row stands until it has one."""
    row_price, column_price = np.zeros((b, n)), np.zeros((b, m + 1))
    for row in range(n):
        owner[:, m] = row
        tip, before = _path(cost, owner, row_price, column_price)
        while (moving := np.flatnonzero(tip != m)).size:
            column = tip[moving]
            owner[moving, column] = owner[moving, before[moving, column]]
            tip[moving] = before[moving, column]
    return owner[:, :m]


def _path(cost: Array, owner: Array, row_price: Array, column_price: Array) -> tuple[Any, Any]:
    """Find the cheapest way from the new row to a free column, and raise the prices along it.

    Returns:
        The free column, (b,), and for each column the one before it on its way, (b, m).
    """
    b, _, m = cost.shape
    tip = np.full(b, m)
    least, before = np.full((b, m), np.inf), np.full((b, m), m)
    reached = np.zeros((b, m + 1), dtype=bool)
    on = np.arange(b)
    while on.size:
        reached[on, tip[on]] = True
        row = owner[on, tip[on]]
        beyond = reached[on, :m]
        reduced = cost[on, row] - row_price[on, row][:, None] - column_price[on, :m]
        nearer = ~beyond & (reduced < least[on])
        before[on] = np.where(nearer, tip[on][:, None], before[on])
        least[on] = np.where(nearer, reduced, least[on])
        next_column = np.argmin(np.where(beyond, np.inf, least[on]), axis=1)
        step = least[on, next_column]
        table, column = np.nonzero(reached[on])
        row_price[on[table], owner[on[table], column]] += step[table]
        column_price[on[table], column] -= step[table]
        least[on] -= np.where(beyond, 0.0, step[:, None])
        tip[on] = next_column
        on = on[owner[on, next_column] >= 0]
    return tip, before
