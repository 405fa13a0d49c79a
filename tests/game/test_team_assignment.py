"""The assignment of teams beside SciPy's, by the sum of what the pairs are worth."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from guidance.game.team.assignment import assigned_rows


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 4), (4, 1), (2, 5), (5, 2), (4, 4), (6, 7), (7, 6)])
@pytest.mark.parametrize("kind", ["any", "ties", "negative"])
def test_no_assignment_is_worth_more(n, m, kind):
    rng = np.random.default_rng(10 * n + m)
    worth = {
        "any": rng.uniform(0.0, 9.0, (30, n, m)),
        "ties": rng.integers(0, 3, (30, n, m)).astype(float),
        "negative": rng.normal(0.0, 5.0, (30, n, m)),
    }[kind]
    found = assigned_rows(worth)
    for table, rows in zip(worth, found, strict=True):
        columns = np.flatnonzero(rows >= 0)
        assert len(columns) == min(n, m) == len(set(rows[columns]))
        assert set(rows[rows < 0]) <= {-1}
        best = table[linear_sum_assignment(table, maximize=True)].sum()
        assert table[rows[columns], columns].sum() == pytest.approx(best, rel=1e-12, abs=1e-12)
        np.testing.assert_array_equal(assigned_rows(table), rows)
