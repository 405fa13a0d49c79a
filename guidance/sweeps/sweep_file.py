"""The sweep file: a scenario, what is varied in it and how, the policies that play it, and the seeds."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from guidance.config import Section, find, load
from guidance.sim.scenario import EvaderPolicy, PursuerPolicy
from guidance.sweeps.axes import Axis, flat, grid_axis, random_axis

FOLDER = "sweeps"

Way = Literal["maths", "fast"]
"""How a row is played: by point masses, or flown by the mock in virtual time."""

PursuerNames = PursuerPolicy | tuple[PursuerPolicy, ...] | None
EvaderNames = EvaderPolicy | tuple[EvaderPolicy, ...] | None


class Pair(NamedTuple):
    """Policies of both players; None is the scenario's own."""

    pursuer: str | None
    evader: str | None


class Policies(Section):
    """Policies of both players, crossed where there are several of one."""

    pursuer: PursuerNames = Field(None, description="one or several; the scenario's own if not given")
    evader: EvaderNames = Field(None, description="likewise")

    def pairs(self) -> Iterator[Pair]:
        """Every pursuer's policy with every evader's."""
        one, other = ((names,) if not isinstance(names, tuple) else names for names in (self.pursuer, self.evader))
        return itertools.starmap(Pair, itertools.product(one, other))


class Seeds(Section):
    """Which seeds: `count` of them beginning with `from`, or a list."""

    model_config = ConfigDict(populate_by_name=True)

    begin: int = Field(0, alias="from", ge=0, description="the first")
    count: int = Field(1, ge=1, description="how many")
    values: tuple[Annotated[int, Field(ge=0)], ...] = Field((), alias="list", description="these, in place of both")


def _seeds(given: Any) -> Any:  # noqa: ANN401 - from a file
    if isinstance(given, int) and not isinstance(given, bool):
        return {"count": given}
    return {"list": given, "count": max(1, len(given))} if isinstance(given, list) else given


class Sweep(Section):
    """A whole sweep file.

    Rows are numbered with the seeds changing fastest, then the grid, then the policies. What is drawn at random depends
    on the seed and the key alone, so rows of one seed are comparable pairwise.
    """

    title: str = Field("", description="a few words")
    description: str = Field("", description="what it shows, and why it is as it is")
    scenario: str = Field(description="a scenario's name or path; beside the sweep's file, or with the package")
    way: Way = Field("maths", alias="as", description="played by point masses, or flown by the mock in virtual time")
    rows: int | None = Field(None, ge=1, description="how many in all, in place of seeds")
    seeds: Annotated[Seeds | None, BeforeValidator(_seeds, json_schema_input_type=int | list[int] | Seeds | None)] = (
        Field(None, description="how many, a list, or { from = 100, count = 50 }")
    )
    grid: dict[str, Any] = Field({}, description="a scenario's key and its values, crossed with those of the others")
    random: dict[str, Any] = Field({}, description="a scenario's key and its distribution, one draw for each seed")
    policies: tuple[Policies, ...] = Field((), description="who plays against whom; the scenario's own if not given")

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The grid's axes, then those drawn at random."""
        grid, random = flat(self.grid), flat(self.random, tables=True)
        return (
            *(grid_axis(key, spec) for key, spec in grid.items()),
            *(random_axis(key, spec) for key, spec in random.items()),
        )

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """The pairs of policies."""
        return tuple(pair for given in self.policies for pair in given.pairs()) or (Pair(None, None),)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.rows is not None and self.seeds is not None:
            raise ValueError("rows, seeds: only one of them; rows = seeds × points of the grid × pairs of policies")
        if len(set(self.pairs)) < len(self.pairs):
            twice = next(pair for pair in self.pairs if self.pairs.count(pair) > 1)
            raise ValueError(f"policies: {twice.pursuer} against {twice.evader} is given twice")
        if self.seeds is not None and len(set(self.seeds.values)) < len(self.seeds.values):
            raise ValueError(f"seeds = {list(self.seeds.values)}: a seed is given twice")
        return self


def load_sweep(name: str) -> tuple[Path, Sweep]:
    """Read a sweep by path or by the name of one that comes with the package.

    Raises:
        ConfigError: If there is none, or a key is wrong.
    """
    path = find(name, FOLDER)
    return path, load(Sweep, path)
