"""Options that several commands share, refused combinations of options, help without arguments, and questions.

An option that does not apply is refused, not ignored. Arming and setting need an answer to a question, or `--yes`.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from guidance.errors import ConfigError, FlightError


def completed(*values: str) -> Callable[[str], list[str]]:
    """Return what completes an argument or option in the shell: the values that begin with the word so far."""

    def complete(incomplete: str) -> list[str]:
        return [value for value in values if value.startswith(incomplete)]

    return complete


def completed_scenario(incomplete: str) -> list[str]:
    """Return the bundled scenarios whose names begin with the word so far."""
    from guidance.config import config_folder  # noqa: PLC0415 - only for the shell

    names = sorted(path.stem for path in (config_folder() / "scenarios").glob("*.toml"))
    return [name for name in names if name.startswith(incomplete)]


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before arming or setting.")]
AllRows = Annotated[bool, typer.Option("--all", help="Show the passed rows, too.")]
ScenarioName = Annotated[
    str,
    typer.Argument(
        help="A scenario file, or a name of `guidance scenario list`.",
        autocompletion=completed_scenario,
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed; default: the scenario's.")]
Expected = Annotated[
    str | None,
    typer.Option(
        help="px4 or arducopter; default: from HEARTBEAT.",
        autocompletion=completed("px4", "arducopter"),
    ),
]
Link = Annotated[
    str,
    typer.Option(
        help="Client in real time: mavsdk or pymavlink.",
        autocompletion=completed("mavsdk", "pymavlink"),
    ),
]
Parameters = Annotated[
    list[str] | None,
    typer.Option(
        help="MAVLink URL for the parameters of a --vehicle zenoh+tcp://; one for each.",
        metavar="URL",
    ),
]
Port = Annotated[
    int,
    typer.Option(min=0, max=65535, help="Zenoh port of the mock, or its first UDP port; 0 is any."),
]
FlightFolder = Annotated[
    Path | None, typer.Option(help="Its new folder.", show_default="flights/SCENARIO-NUMBER")
]
TokenFile = Annotated[
    Path | None, typer.Option(help="The control.token_file; not needed for your own daemon.")
]
ZenohFile = Annotated[
    Path | None, typer.Option(help="For a router (tls/…): our file from `guidance zenoh keys`.")
]
Panel = Annotated[
    bool,
    typer.Option("--panel", help="Serve the operator's page (extra panel; map: GUIDANCE_TILES)."),
]


class CommandGroup(TyperGroup):
    """A command with sub-commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        """Show the help if there are no arguments."""
        return super().parse_args(ctx, args or ["--help"])


def refuse(ctx: typer.Context, way: str, where: str, *options: str) -> None:
    """Refuse options that were given and do not apply.

    Args:
        ctx: Of the command.
        way: The chosen way, as in "--as maths".
        where: Where the options apply.
        options: Their names, as in "--link".

    Raises:
        ConfigError: With the option's name and where it applies.
    """
    for parameter in ctx.command.params:
        source = ctx.get_parameter_source(str(parameter.name))
        if parameter.opts[0] in options and source is not None and source.name == "COMMANDLINE":
            raise ConfigError(f"{parameter.opts[0]}: only {where}, not with {way}; remove it")


def may_fly(vehicles: Sequence[str], *, yes: bool) -> None:
    """Ask before vehicles are armed that are not on loopback."""
    from guidance.links.port import parse  # noqa: PLC0415

    for url in vehicles:
        if not (parse(url).on_loopback or yes):
            agree(f"{url} may be a real vehicle. Arm and fly it? Propellers will turn")


def agree(question: str) -> None:
    """Ask for consent. A no ends the command with the exit code of a refusal.

    Raises:
        ConfigError: If there is no answer.
    """
    try:
        agreed = typer.confirm(question, err=True)
    except typer.Abort:
        typer.echo("", err=True)
        raise ConfigError(
            "no answer to the question: nothing was done; --yes answers it in advance"
        ) from None
    if not agreed:
        typer.echo("nothing was done", err=True)
        raise typer.Exit(FlightError.exit_code)
