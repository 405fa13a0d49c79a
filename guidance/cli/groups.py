"""Commands that hold others: alone, each shows its help and ends with 0, as a question that was answered."""

from typing import Any

from typer.core import TyperGroup


class CommandGroup(TyperGroup):
    """A command with sub-commands."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - click's context
        """Read the arguments; see the module."""
        return super().parse_args(ctx, args or ["--help"])
