"""Where the values of a swept column are counted: a grid's own values, or even bins over what is drawn at random."""

import itertools
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from guidance.sweeps.axes import Axis
from guidance.sweeps.distributions import Choice, Number

_BINS = 10
_MOST_VALUES = 25


class Bins(NamedTuple):
    """Bins of one column.

    Attributes:
        column: Name.
        labels: Of each bin, for a table.
        centres: Where each is drawn; its number where the column holds no numbers.
        edges: Between the bins, one fewer than there are; None where each bin is one value.
        values: What each bin is, where it is one value.
    """

    column: str
    labels: tuple[str, ...]
    centres: tuple[float, ...]
    edges: NDArray[np.float64] | None
    values: tuple[float | str, ...]

    def places(self, column: pa.ChunkedArray) -> NDArray[np.intp]:
        """Return the bin of every row; what lies beyond the last one is counted there."""
        if self.edges is not None:
            return np.asarray(np.searchsorted(self.edges, column.to_numpy(), side="right"))
        order = {value: place for place, value in enumerate(self.values)}
        return np.array([order[value] for value in column.to_pylist()], dtype=np.intp)


def bins_of(axis: Axis) -> list[Bins]:
    """Return bins for each column of an axis."""
    columns = list(axis.columns())
    extremes = axis.extremes()
    if isinstance(axis.distribution, Number):
        extremes = list(axis.distribution.shown)
    if axis.distribution is not None and not isinstance(axis.distribution, Choice):
        across = [[value[place] for value in extremes] for place in range(axis.width)] or [extremes]
        return [_even(column, values) for column, values in zip(columns, across, strict=True)]
    found = []
    for cells, column in zip(axis.cells(extremes), columns, strict=True):
        distinct = list(dict.fromkeys(cells.to_pylist()))
        numbers = not any(isinstance(value, str) for value in distinct)
        found.append(_even(column, distinct) if numbers and len(distinct) > _MOST_VALUES else _each(column, distinct))
    return found


def _even(column: str, values: list[float]) -> Bins:
    ends = np.linspace(min(values), max(values), _BINS + 1)
    centres = 0.5 * (ends[1:] + ends[:-1])
    labels = tuple(f"{low:.4g} to {high:.4g}" for low, high in itertools.pairwise(ends.tolist()))
    return Bins(column, labels, tuple(centres.tolist()), ends[1:-1], ())


def _each(column: str, values: list[float | str]) -> Bins:
    texts = any(isinstance(value, str) for value in values)
    labels = tuple(value if isinstance(value, str) else f"{value:.4g}" for value in values)
    centres = tuple(float(place if texts else value) for place, value in enumerate(values))
    return Bins(column, labels, centres, None, tuple(values))
