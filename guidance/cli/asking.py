"""Questions before something is armed or set. Whoever cannot be asked, and did not say `--yes`, has not agreed."""

import typer

from guidance.errors import ConfigError, FlightError


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
