"""Which row of one sweep belongs to which of another: the same values and the same seed, played otherwise."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from guidance.sweeps.folder import Folder
from guidance.sweeps.plan import ROW, Plan, Rows

_OTHERWISE = {"scenario", "policies", "title", "description", "as", "seeds", "rows"}
"""What may differ between sweeps whose rows pair."""


class Side(NamedTuple):
    """Rows of both sweeps that belong together, n each, and the pair of policies of the first."""

    a: pa.Table
    b: pa.Table
    pair: Rows


def pair_numbers(a: Plan, b: Plan) -> dict[int, int] | None:
    """Match the policies of two sweeps: by name where they share any, else by place; None if neither is possible."""
    shared = {a.pairs.index(pair): b.pairs.index(pair) for pair in a.pairs if pair in b.pairs}
    if shared:
        return shared
    return {number: number for number in range(len(a.pairs))} if len(a.pairs) == len(b.pairs) else None


def rows_pair(a: Plan, b: Plan) -> bool:
    """Whether rows of two sweeps have the same values in them for the same seed and point of the grid."""
    swept = [
        {name: value for name, value in plan.document["sweep"].items() if name not in _OTHERWISE} for plan in (a, b)
    ]
    return swept[0] == swept[1] and pair_numbers(a, b) is not None


def paired(a: Folder, b: Folder, columns: list[str]) -> Iterator[Side]:
    """Yield the rows that both folders have, chunk by chunk of the first."""
    matched = pair_numbers(a.plan, b.plan) or {}
    matches = np.array([matched.get(number, -1) for number in range(len(a.plan.pairs))])
    reader = _Reader(b, columns)
    for part in a.parts:
        table = parquet.read_table(part, columns=columns)
        cases = a.plan.cases(table[ROW].to_numpy())
        pair = matches[cases.pair]
        wanted = np.where(pair < 0, -1, b.plan.row_of(pair, cases.point, cases.seed))
        other = reader.rows(np.unique(wanted[wanted >= 0]))
        there = other[ROW].to_numpy()
        place = np.searchsorted(there, wanted)
        found = np.flatnonzero(np.isin(wanted, there))
        if found.size:
            yield Side(table.take(pa.array(found)), other.take(pa.array(place[found])), cases.pair[found])


class _Reader:
    """Reads rows of a sweep by number; keeps the part it read last."""

    def __init__(self, folder: Folder, columns: list[str]) -> None:
        self._folder = folder
        self._columns = columns
        self._last: tuple[int, pa.Table] | None = None

    def rows(self, wanted: Rows) -> pa.Table:
        """Return those of the rows, given rising, that are there."""
        found = [
            self._part(chunk, wanted[wanted // self._folder.chunk_rows == chunk])
            for chunk in np.unique(wanted // self._folder.chunk_rows).tolist()
            if self._folder.part(chunk).is_file()
        ]
        fields = [field for field in self._folder.plan.schema if field.name in self._columns]
        return pa.concat_tables([pa.schema(fields).empty_table().select(self._columns), *found])

    def _part(self, chunk: int, wanted: Rows) -> pa.Table:
        if self._last is None or self._last[0] != chunk:
            self._last = chunk, parquet.read_table(self._folder.part(chunk), columns=self._columns)
        return self._last[1].take(pa.array(wanted - self._folder.rows(chunk).start))
