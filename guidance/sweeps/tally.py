"""What a sweep's rows come to, counted chunk by chunk, and the worst of them as scenario files to fly again.

Memory holds a chunk, and eight bytes a row for the regret. Captures are counted by the values of every swept column: a
grid's own, or even bins over what is drawn at random.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import tomli_w
from numpy.typing import NDArray
from pyarrow import parquet

from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamScenario
from guidance.sweeps.axes import Axis
from guidance.sweeps.distributions import Choice, Number
from guidance.sweeps.folder import Folder, write_whole
from guidance.sweeps.plan import ROW, Plan
from guidance.sweeps.row_scenarios import Scenarios
from guidance.sweeps.statistics import NONE, Array, Moments
from guidance.sweeps.sweep_file import Pair

_BINS = 10
_MOST_VALUES = 25

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


class Worst(NamedTuple):
    """A row that came out badly, its scenario's file, how it ended and its regret, NaN if there is none."""

    path: Path
    row: int
    tally: Tally
    end: str
    regret: float


def scenario_of(plan: Plan, row: int) -> Scenario | TeamScenario | str:
    """Return what a row plays, or why it is no game."""
    return next(iter(Scenarios(plan).of(plan.cases(np.array([row], dtype=np.int64)))))


def write_worst(folder: Folder, tallies: Sequence[Tally], out: Path) -> Iterator[Worst]:
    """Write the worst rows of every tally as `worst-001.toml` and so on, the worst of all first.

    Raises:
        OSError: If a file cannot be written.
    """
    ranked = sorted(((bad, number) for number, tally in enumerate(tallies) for bad in tally.ranked))
    for number, (bad, whose) in enumerate(ranked, 1):
        scenario = scenario_of(folder.plan, bad.row)
        if isinstance(scenario, str):  # a row without a game is never ranked
            continue
        path, pair = out / f"worst-{number:03d}.toml", tallies[whose].pair
        about = (
            f"Row {bad.row} of the sweep {folder.plan.digest[:12]}, {pair.pursuer} against {pair.evader}: {bad.end}."
        )
        document = {**scenario.model_dump(mode="json", exclude={"expect"}, exclude_none=True), "description": about}
        write_whole(path, tomli_w.dumps(document).encode())
        yield Worst(path, bad.row, tallies[whose], bad.end, bad.regret)
