"""What a sweep's rows come to, counted chunk by chunk: memory holds a chunk, and eight bytes a row for the regret."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from guidance.sweeps.bins import Bins, bins_of
from guidance.sweeps.folder import Folder
from guidance.sweeps.model import Pair
from guidance.sweeps.plan import ROW
from guidance.sweeps.statistics import NONE, Array, Moments

QUANTILES: Final = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 1.0)
_COLUMNS: Final = (
    ROW,
    "pursuer_policy",
    "evader_policy",
    "end",
    "predicted_winner",
    "predicted",
    "regret",
    "final_distance_m",
)


class Bad(NamedTuple):
    """A row that came out badly; in the order of how badly, the worst first.

    Attributes:
        kept: False if it was lost against the prediction.
        better: Minus its regret, or, if it was lost, minus its final distance.
        row: Number.
        end: How it ended.
        regret: NaN where there is none.
    """

    kept: bool
    better: float
    row: int
    end: str
    regret: float


@dataclass(slots=True)
class Tally:
    """Of one pair of policies.

    Attributes:
        pair: The policies.
        bins: What the rows are counted by, beside.
        worst: How many of the worst rows are kept.
        ends: How many rows ended how.
        regret: Moments.
        predicted: Moments of the game's value.
        regrets: All that are known.
        games: For every bin, rows that are games.
        captures: For every bin, those that ended in a capture.
        ranked: The worst rows, the worst first.
    """

    pair: Pair
    bins: Sequence[Bins]
    worst: int
    ends: Counter[str] = field(default_factory=Counter)
    regret: Moments = NONE
    predicted: Moments = NONE
    regrets: list[Array] = field(default_factory=list)
    games: list[NDArray[np.int64]] = field(default_factory=list)
    captures: list[NDArray[np.int64]] = field(default_factory=list)
    ranked: list[Bad] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.games = [np.zeros(len(bins.labels), dtype=np.int64) for bins in self.bins]
        self.captures = [np.zeros_like(games) for games in self.games]

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return self.ends.total()

    @property
    def valid(self) -> int:
        """How many of them are games."""
        return self.rows - self.ends["invalid"]

    def quantiles(self) -> list[float]:
        """The regret's `QUANTILES`; empty if there is none."""
        every = self.sorted_regrets()
        return np.quantile(every, QUANTILES).tolist() if every.size else []

    def sorted_regrets(self) -> Array:
        """Every regret, rising."""
        return np.sort(np.concatenate([*self.regrets, np.empty(0)]))

    def add(self, table: pa.Table) -> None:
        """Count some rows, all of this pair."""
        end = np.array(table["end"].to_pylist())
        regret = table["regret"].to_numpy()
        self.ends.update(end.tolist())
        self.regret = self.regret.joined(regret)
        self.predicted = self.predicted.joined(table["predicted"].to_numpy())
        self.regrets.append(regret[np.isfinite(regret)])
        game, captured = end != "invalid", end == "captured"
        for number, bins in enumerate(self.bins):
            places, count = bins.places(table[bins.column]), len(bins.labels)
            self.games[number] += np.bincount(places[game], minlength=count)
            self.captures[number] += np.bincount(places[captured], minlength=count)
        self._rank(table, lost=game & ~captured & (np.array(table["predicted_winner"].to_pylist()) == "pursuer"))

    def _rank(self, table: pa.Table, *, lost: NDArray[np.bool_]) -> None:
        """Keep the worst rows: first those lost against the prediction, the furthest off first, then by regret."""
        regret, row = table["regret"].to_numpy(), table[ROW].to_numpy()
        badness = np.where(lost, table["final_distance_m"].to_numpy(), regret)
        known = np.flatnonzero(lost | np.isfinite(regret))
        order = known[np.lexsort((row[known], -np.nan_to_num(badness[known]), ~lost[known]))][: self.worst]
        ends = table["end"].take(pa.array(order)).to_pylist()
        better = -np.nan_to_num(badness)
        self.ranked += [
            Bad(not lost[place], float(better[place]), int(row[place]), end, float(regret[place]))
            for place, end in zip(order.tolist(), ends, strict=True)
        ]
        self.ranked = sorted(self.ranked)[: self.worst]


def tallied(folder: Folder, *, worst: int) -> list[Tally]:
    """Count a sweep's rows, those that are there, for each pair of policies that has any."""
    bins = [one for axis in folder.plan.axes for one in bins_of(axis)]
    tallies = [Tally(pair, bins, worst) for pair in folder.plan.pairs]
    columns = [*_COLUMNS, *folder.plan.swept]
    for part in folder.parts:
        table = parquet.read_table(part, columns=columns)
        pairs = folder.plan.cases(table[ROW].to_numpy()).pair
        for number in np.unique(pairs).tolist():
            tallies[number].add(table.filter(pa.array(pairs == number)))
    return [tally for tally in tallies if tally.rows]
