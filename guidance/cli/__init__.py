"""The `guidance` command: one module a sub-command, registered here by name."""

import typer

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="markdown")


def main() -> None:
    """Run the command line."""
    app()
