"""The `guidance` command: its sub-commands, each imported only when it is used."""

from collections import UserDict
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer.core import TyperGroup

from guidance.cli.arguments import CommandGroup

COMMANDS: Final[Mapping[str, tuple[str, str]]] = {
    "fly": ("fly", "Fly a pursuit, with the mock or a running autopilot, and show the outcome."),
    "paper": ("solve", "Recompute the paper's tables and figures."),
    "solve": ("solve", "Solve one state of a game, or every row of a file."),
    "scenario": ("scenario", "Run, list and explain scenario files."),
    "sweep": ("sweep", "Play a scenario with many values of its keys, and report the results."),
    "league": ("league", "Play a policy against the optimum and the built-in policies."),
    "compare": ("sweep", "Compare two outcomes or two sweeps."),
    "init": ("vehicle_setup", "Write a vehicle file for the autopilot at a URL."),
    "doctor": (
        "vehicle_setup",
        "Check this computer: clocks, timing, ports, folders, disk, extras.",
    ),
    "check": ("vehicle_setup", "Check the autopilot's parameters, frames and stream rates."),
    "schema": ("vehicle_setup", "Print the JSON Schema of a file, for editors."),
    "run": ("daemon", "Run the guidance daemon of one vehicle."),
    "ctl": ("daemon", "Give a running daemon an order, or show its state."),
    "panel": ("viewers", "Serve the operator's page: map, state, checks and orders."),
    "view": ("viewers", "Show a flight in Rerun."),
    "log": ("records", "Inspect a flight record, and export it for other tools."),
    "replay": ("records", "Run the present code on a record's inputs and compare the setpoints."),
    "report": ("records", "Draw a record: an HTML page and pictures."),
    "zenoh": ("vehicle_setup", "Certificates and a router for Zenoh between machines."),
}
"""Every command: its module, and its line in the help. The function or `typer.Typer` has the command's name."""


class _LazyCommands(UserDict[str, Any]):
    """The commands by name, imported when they are taken."""

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - click's own classes
        module_name, _ = self.data[name]
        module = import_module(f"guidance.cli.{module_name}")
        command = getattr(module, name)
        if isinstance(command, typer.Typer):
            return typer.main.get_group(command)
        alone = typer.Typer(add_completion=False, rich_markup_mode="markdown")
        alone.command(name)(command)
        return typer.main.get_command(alone)


class Program(CommandGroup):
    """The root command. Its help is printed without Rich, whose import is slow."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - click's
        super().__init__(**settings | {"commands": _LazyCommands(COMMANDS)})

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401, ARG002 - click's context
        """Return the names, without importing the commands."""
        return list(COMMANDS)

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - click's
        """Write the help as click does."""
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401, ARG002 - click's
        """Write every command with its line."""
        with formatter.section("Commands"):
            lines = [(name, line) for name, (_, line) in COMMANDS.items()]
            formatter.write_dl(lines)


app = typer.Typer(cls=Program, pretty_exceptions_enable=False, rich_markup_mode="markdown")


def _version(wanted_version: bool) -> None:
    if wanted_version:
        from importlib.metadata import version  # noqa: PLC0415 - for this only

        from guidance.log.writer import PACKAGE, commit  # noqa: PLC0415 - for this only

        text = f"{PACKAGE} {version(PACKAGE)}"
        head = commit()
        if head:
            text += f", commit {head[:12]}"
        typer.echo(text)
        raise typer.Exit


@app.callback()
def _root(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Version and commit."),
    ] = False,
) -> None:
    """Closed-form pursuit guidance: fly it, solve it, check it against the paper."""
