"""The `sitl-mock` command: one module a sub-command, registered here by name."""

import sys

import typer

from sitl_mock.cli.compare import calibrate, compare
from sitl_mock.cli.list import list_, modes
from sitl_mock.cli.run import run
from sitl_mock.errors import MockError

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command()(run)
app.command("list")(list_)
app.command()(modes)
app.command()(calibrate)
app.command()(compare)


@app.callback()
def _root() -> None:
    """A mock autopilot that real clients fly as PX4, ArduCopter or Rover: nothing to build, ready in under a second.

    `sitl-mock run --vehicles 2 --udp 14540` starts two PX4 copters for MAVSDK (udpin://127.0.0.1:14540 and 14541);
    `sitl-mock run --vehicles arducopter:uav1 --gcs 14550` one ArduCopter for a ground station;
    `sitl-mock list` tells what there is.
    """


def main() -> None:
    """Run the command line. What the user can mend ends with one message and an exit code, not with a traceback."""
    try:
        app()
    except MockError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201 - the last word of a command
        sys.exit(error.exit_code)
