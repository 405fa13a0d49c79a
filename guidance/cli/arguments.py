"""Shared handling of arguments: help without arguments, refused combinations of options, and questions.

An option that does not apply is refused, not ignored. Arming and setting need an answer to a question, or `--yes`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from guidance.errors import ConfigError, FlightError

TokenFile = Annotated[
    Path | None, typer.Option(help="The daemon's control.token_file; not needed for your own daemon.")
]
ZenohFile = Annotated[
    Path | None, typer.Option(help="For a router's endpoint (tls/…): our file from `guidance zenoh keys`.")
]


class CommandGroup(TyperGroup):
    """A command with sub-commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        """Show the help if there are no arguments."""
        return super().parse_args(ctx, args or ["--help"])


def refuse_others(way: str, given: Mapping[str, Any], belonging: Mapping[str, str]) -> None:
    """Refuse options that do not apply.

    Args:
        way: The chosen way, as in "--as maths".
        given: Values by option; None and False mean not given.
        belonging: For each option that does not apply to `way`: where it applies.

    Raises:
        ConfigError: With the option's name and where it applies.
    """
    for option, where in belonging.items():
        value = given.get(option)
        if value is not None and value is not False:
            raise ConfigError(f"{option}: only {where}, not with {way}; remove it")


def agree(question: str) -> None:
    """Ask for consent. A no ends the command with the exit code of a refusal.

    Raises:
        ConfigError: If there is no answer.
    """
    try:
        agreed = typer.confirm(question, err=True)
    except typer.Abort:
        typer.echo("", err=True)
        raise ConfigError("no answer to the question: nothing was done; --yes answers it in advance") from None
    if not agreed:
        typer.echo("nothing was done", err=True)
        raise typer.Exit(FlightError.exit_code)
