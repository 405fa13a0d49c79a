"""The `guidance` command: its sub-commands, registered here by name."""

from typing import Annotated

import typer

from guidance.cli.arguments import Program
from guidance.cli.check import check, doctor
from guidance.cli.configuration import init, schema
from guidance.cli.daemon import ctl, run
from guidance.cli.fly import fly
from guidance.cli.paper import paper
from guidance.cli.records import log, replay, report
from guidance.cli.scenario import scenario
from guidance.cli.solve import solve
from guidance.cli.sweep import compare, sweep
from guidance.cli.viewers import panel, view
from guidance.cli.zenoh import zenoh

app = typer.Typer(
    cls=Program,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="Closed-form pursuit guidance: fly it, solve it, check it against the paper.",
)
app.command()(fly)
app.command()(paper)
app.command()(replay)
app.command()(report)
app.command()(view)
app.add_typer(log, name="log")
app.add_typer(scenario, name="scenario")
app.add_typer(sweep, name="sweep")
app.command()(compare)
app.command()(solve)
app.command()(init)
app.command()(doctor)
app.command()(schema)
app.command()(run)
app.command()(check)
app.command()(ctl)
app.command()(panel)
app.add_typer(zenoh, name="zenoh")


def _version(asked: bool) -> None:
    if not asked:
        return
    from importlib.metadata import version  # noqa: PLC0415 - for this only

    from guidance.log.provenance import PACKAGE, commit  # noqa: PLC0415 - for this only

    known = commit()
    typer.echo(f"{PACKAGE} {version(PACKAGE)}" + (f", commit {known[:12]}" if known else ""))
    raise typer.Exit


@app.callback()
def _root(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and its commit.")
    ] = False,
) -> None:
    """Closed-form pursuit guidance: fly it, solve it, check it against the paper."""
