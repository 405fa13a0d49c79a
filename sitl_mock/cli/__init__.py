"""The `sitl-mock` command: one module per sub-command, registered here by name."""

import sys
from typing import Annotated

import typer

from sitl_mock.cli.compare import calibrate, compare
from sitl_mock.cli.list import list_, modes
from sitl_mock.cli.run import run
from sitl_mock.cli.versions import versions
from sitl_mock.errors import MockError

app = typer.Typer(
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command()(run)
app.command("list")(list_)
app.command()(modes)
app.command()(calibrate)
app.command()(compare)
app.command()(versions)


def _version(asked: bool) -> None:
    if not asked:
        return
    from sitl_mock.installation import installed_versions  # noqa: PLC0415 - for this only

    distributions = [f"{name} {version}" for name, version in installed_versions().items()]
    typer.echo(f"sitl-mock of {', '.join(distributions) or 'a checkout that is not installed'}")
    raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Mock autopilot for real MAVLink clients: PX4, ArduCopter or Rover, without a build, ready in under a second.

    `sitl-mock run --vehicles 2 --udp 14540` starts two PX4 copters for MAVSDK (udpin://127.0.0.1:14540 and 14541);
    `sitl-mock run --vehicles arducopter:uav1 --gcs 14550` starts one ArduCopter for a ground station;
    `sitl-mock list` lists flavours and faults.
    """
    if context.invoked_subcommand is None:  # without a sub-command: show the help
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line; user errors end with one message and an exit code, without a traceback."""
    try:
        app()
    except MockError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201 - the error message of a command
        sys.exit(error.exit_code)
