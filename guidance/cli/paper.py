"""`guidance paper`: the published tables and figures, computed again."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table as Grid


def paper(
    out: Annotated[Path, typer.Option(help="Folder for the figures (PNG and PDF).")] = Path("paper"),
    figures: Annotated[bool, typer.Option(help="Draw the figures.")] = True,
) -> None:
    """Compute the paper's tables and figures again; exit with 1 if a published digit differs."""
    from guidance.paper import draw_figures, tables  # noqa: PLC0415 - matplotlib takes a second that others need not pay

    console = Console()
    computed = tables()
    for table in computed:
        grid = Grid(title=table.title, title_justify="left", caption=table.quantity, caption_justify="left")
        grid.add_column("pursuer")
        grid.add_column("evader")
        for column in ("published", "paper's stepping", "exact"):
            grid.add_column(column, justify="right")
        grid.add_column("match", justify="center")
        for case in table.cases:
            grid.add_row(*case.strategies, case.published, case.stepped, case.exact, "✓" if case.matches else "✗")
        console.print(grid)
    cases = [case for table in computed for case in table.cases]
    wrong = sum(not case.matches for case in cases)
    console.print(f"{len(cases) - wrong} of {len(cases)} published cells match in every digit.")
    if figures:
        for path in draw_figures(*computed, out):
            console.print(f"drawn: {path}", soft_wrap=True)
    if wrong:
        raise typer.Exit(1)
