"""The `guidance` command: one module a sub-command, registered here by name."""

import sys

import typer

from guidance.cli.check import check
from guidance.cli.compare import compare
from guidance.cli.ctl import ctl
from guidance.cli.fly import fly
from guidance.cli.log import log
from guidance.cli.paper import paper
from guidance.cli.replay import replay
from guidance.cli.report import report
from guidance.cli.run import run
from guidance.cli.scenario import scenario
from guidance.cli.solve import solve
from guidance.cli.sweep import sweep
from guidance.cli.view import view
from guidance.errors import GuidanceError

app = typer.Typer(
    no_args_is_help=True,
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
app.command()(run)
app.command()(check)
app.command()(ctl)


@app.callback()
def _root() -> None:
    """Closed-form pursuit guidance: fly it, solve it, check it against the paper."""


def main() -> None:
    """Run the command line. What the user can mend ends with one message and an exit code, not with a traceback."""
    try:
        app()
    except GuidanceError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201 - the last word of a command
        sys.exit(error.exit_code)
