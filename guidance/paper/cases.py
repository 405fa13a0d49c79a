"""The eight published cells, each played with the paper's stepping and again with its end located exactly."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from guidance.game import Ball, Game, Rollout, rollout
from guidance.game.rollout import Paper, Sample

GAME = Game(Ball(2.0), evader_speed_m_s=1.0)
"""δ = 2. The paper gives no speeds; its times are those of v = 1 m/s."""

PE_PURSUER, PE_EVADER = (8.00, 1.42, 9.41), (7.92, 9.60, 0.0)
TAD_PURSUER, TAD_EVADER, TAD_TARGET = (6.97, 5.83, 9.15), (9.80, 0.33, 0.0), (0.0, 0.0, 0.0)

EXACT_DIGITS = 4

SYMBOLS = {"optimal": ("u*", "v*")}
"""The paper's symbols of the optimal strategies of pursuer and evader; the others keep their names."""


class TableRow(NamedTuple):
    """One row of a published table."""

    pursuer_policy: str
    evader_policy: str
    published: str


TABLE_1 = (
    TableRow("pure_pursuit", "optimal", "11.05"),
    TableRow("optimal", "pure_evade", "10.43"),
    TableRow("optimal", "optimal", "10.43"),
)
TABLE_2 = (
    TableRow("optimal", "task_oriented", "4.2341"),
    TableRow("optimal", "pure_evade", "19.4309"),
    TableRow("optimal", "optimal", "4.1481"),
    TableRow("pure_pursuit", "optimal", "3.2272"),
    TableRow("task_oriented", "optimal", "0.0046"),
)


@dataclass(frozen=True, slots=True)
class Case:
    """A published number beside ours.

    Attributes:
        pursuer_policy: name in `PURSUER_POLICIES`.
        evader_policy: name in `EVADER_POLICIES`.
        published: the number as printed.
        stepped: ours with the paper's stepping, rounded to the published digits.
        exact: ours with the end located exactly, to four digits.
        path: every sample of the exact play.
    """

    pursuer_policy: str
    evader_policy: str
    published: str
    stepped: str
    exact: str
    path: tuple[Sample, ...]

    @property
    def matches(self) -> bool:
        """True if every published digit is reproduced."""
        return self.stepped == self.published

    @property
    def is_optimal(self) -> bool:
        """True if both players play their optimum."""
        return self.pursuer_policy == self.evader_policy == "optimal"

    @property
    def strategies(self) -> tuple[str, str]:
        """Both strategies as the paper writes them."""
        names = (self.pursuer_policy, self.evader_policy)
        pursuer, evader = (SYMBOLS.get(name, (name, name))[side] for side, name in enumerate(names))
        return pursuer.replace("_", "-"), evader.replace("_", "-")


class Table(NamedTuple):
    """A published table."""

    title: str
    quantity: str
    cases: tuple[Case, ...]


def tables() -> tuple[Table, Table]:
    """Compute both tables of section V."""
    pe = Table(
        "Table 1: PE game, P = (8.00, 1.42, 9.41), E = (7.92, 9.60), δ = 2",
        "time cost, s",
        tuple(_case(cell, PE_PURSUER, PE_EVADER, None) for cell in TABLE_1),
    )
    tad = Table(
        "Table 2: TAD game, P = (6.97, 5.83, 9.15), E = (9.80, 0.33), T = (0, 0), δ = 2",
        "final distance to the target, m",
        tuple(_case(cell, TAD_PURSUER, TAD_EVADER, TAD_TARGET) for cell in TABLE_2),
    )
    return pe, tad


def _case(
    cell: TableRow, pursuer: tuple[float, ...], evader: tuple[float, ...], target: tuple[float, ...] | None
) -> Case:
    play = partial(
        rollout, GAME, pursuer, evader, target, pursuer_policy=cell.pursuer_policy, evader_policy=cell.evader_policy
    )
    stepped, exact = play(stepping=Paper()), play(keep_path=True)
    digits = len(cell.published.partition(".")[2])

    def printed(end: Rollout, places: int) -> str:
        return f"{float(end.time_s if target is None else end.distance_m):.{places}f}"

    return Case(*cell, stepped=printed(stepped, digits), exact=printed(exact, EXACT_DIGITS), path=exact.path)
