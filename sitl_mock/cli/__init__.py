"""The `sitl-mock` command: one module a sub-command, registered here by name."""

import sys

import typer

from sitl_mock.cli.calibrate import calibrate
from sitl_mock.cli.run import run
from sitl_mock.errors import MockError

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="A mock autopilot that real clients fly as PX4 or ArduCopter.",
)
app.command()(run)
app.command()(calibrate)


@app.callback()
def _root() -> None:
    """A mock autopilot that real clients fly as PX4 or ArduCopter."""


def main() -> None:
    """Run the command line. What the user can mend ends with one message and an exit code, not with a traceback."""
    try:
        app()
    except MockError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201 - the last word of a command
        sys.exit(error.exit_code)
