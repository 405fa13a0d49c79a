"""What every command does with its arguments: shows its help where it got none, refuses those of another way, and asks.

An option that means something with some commands or ways only is refused with another, never ignored. Before something
is armed or set it is asked for: whoever cannot be asked, and did not say `--yes`, has not agreed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from guidance.errors import ConfigError, FlightError

TokenFile = Annotated[
    Path | None, typer.Option(help="The daemon's control.token_file; not needed for a daemon of your own.")
]
ZenohFile = Annotated[
    Path | None, typer.Option(help="With a router's endpoint (tls/…): our file of `guidance zenoh keys`.")
]

_LONGEST = 200
"""So many letters of a command's first sentence at most."""


class CommandGroup(TyperGroup):
    """A command with sub-commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        """Read the arguments; see the module."""
        return super().parse_args(ctx, args or ["--help"])


class Program(CommandGroup):
    """The command itself. Its page is printed without Rich, which takes longer to import than all the rest of it."""

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - click's
        """Write the page as click does."""
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - click's
        """Write every command with the first sentence of its help, whole."""
        said = ((name, self.commands[name].get_short_help_str(_LONGEST)) for name in self.list_commands(ctx))
        with formatter.section("Commands"):
            formatter.write_dl(list(said))


def refuse_others(way: str, given: Mapping[str, Any], belonging: Mapping[str, str]) -> None:
    """Refuse an option that was given and belongs to something else.

    Args:
        way: What is done, as it was asked for: "--as maths".
        given: Values by option; what is None or False was not given.
        belonging: What an option belongs to, in words, for those that do not belong to `way`.

    Raises:
        ConfigError: With the option's name, and what it belongs to.
    """
    for option, where in belonging.items():
        value = given.get(option)
        if value is not None and value is not False:
            raise ConfigError(f"{option}: only {where}, not with {way}; leave it out")


def agree(question: str) -> None:
    """Ask, and go on only with a yes; the command ends as one that was refused with a no.

    Raises:
        ConfigError: Where nobody answers.
    """
    try:
        agreed = typer.confirm(question, err=True)
    except typer.Abort:
        typer.echo("", err=True)
        raise ConfigError("asked, and nobody answered: nothing was done; --yes answers beforehand") from None
    if not agreed:
        typer.echo("nothing was done", err=True)
        raise typer.Exit(FlightError.exit_code)
