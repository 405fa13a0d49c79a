"""`guidance compare`: two outcomes, or two sweeps, side by side."""

from pathlib import Path
from typing import Annotated

import typer

from guidance.extras import require


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="An outcome (JSON), or a sweep's folder.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The same, to hold against it.")],
    column: Annotated[
        str, typer.Option("--by", help="Column whose largest differences are listed (sweeps only).")
    ] = "achieved",
    rows: Annotated[int, typer.Option(min=0, help="How many of the largest differences are listed.")] = 10,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Hold two outcomes, or two sweeps, against each other; differences are B minus A.

    Two outcomes, as `guidance scenario run FILE --json` prints them: column by column. Two sweeps: the means of all
    columns and the probability of capture, with 95 % intervals of their differences, and the rows that differ most.
    Rows pair where both sweeps have the same values and seeds in them, and the intervals are then those of the paired
    differences; else the two are taken as independent.

    - `guidance compare maths.json flown.json`: the same scenario, in mathematics and flown
    - `guidance compare sweeps/flown-maths sweeps/flown-fast`: the same for a sweep
    - `guidance compare old new --by regret --rows 20`: two versions of a policy
    """
    require("guidance compare", "sim")
    from guidance.sweeps.compare import compare_paths  # noqa: PLC0415 - pyarrow takes a moment

    compare_paths(a, b, column=column, rows=rows, as_json=as_json)
