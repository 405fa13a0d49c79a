"""`guidance paper`: recomputes the published tables and figures."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from guidance.paper import Table


def paper(
    out: Annotated[Path, typer.Option(help="Folder for the figures (PNG and PDF).")] = Path("paper"),
    figures: Annotated[bool, typer.Option(help="Draw the figures.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the tables as JSON.")] = False,
) -> None:
    """Recompute the paper's tables and figures; the exit code is 1 if a published digit differs."""
    from guidance.extras import require  # noqa: PLC0415
    from guidance.files import writing  # noqa: PLC0415
    from guidance.paper import draw_figures, tables  # noqa: PLC0415 - numpy takes a moment
    from guidance.screen import console, sheet  # noqa: PLC0415

    if figures:
        require("the figures (--no-figures leaves them out)", "plot")
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    computed = tables()
    cases = [case for table in computed for case in table.cases]
    wrong = sum(not case.matches for case in cases)
    there = console(stderr=as_json)
    if as_json:
        typer.echo(json.dumps(_plain(computed), indent=2))
    else:
        headings = ("pursuer", "evader", "published", "paper's stepping", "exact", "match")
        for table in computed:
            rows = [
                (*case.strategies, case.published, case.stepped, case.exact, "✓" if case.matches else "✗")
                for case in table.cases
            ]
            there.print(sheet(headings, rows, left=(0, 1), title=f"{table.title}; {table.quantity}"))
        there.print(f"{len(cases) - wrong} of {len(cases)} published cells match in every digit.")
    if figures:
        for path in draw_figures(*computed, out):
            there.print(f"drawn: {path}", soft_wrap=True)
    if wrong:
        raise typer.Exit(1)


def _plain(computed: "Sequence[Table]") -> list[dict[str, Any]]:
    return [
        {
            "title": table.title,
            "quantity": table.quantity,
            "pursuer": case.pursuer_policy,
            "evader": case.evader_policy,
            "published": float(case.published),
            "stepped": float(case.stepped),
            "exact": float(case.exact),
            "matches": case.matches,
        }
        for table in computed
        for case in table.cases
    ]
