"""Commands that hold others: alone, each shows its help and ends with 0, as a question that was answered."""

from typing import Any

from typer.core import TyperGroup

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
