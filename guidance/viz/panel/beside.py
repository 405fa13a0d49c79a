"""A panel beside a flight, as a process of its own."""

from collections.abc import Sequence
from pathlib import Path

from guidance.extras import require
from guidance.viz.beside import CommandBeside


class PanelBeside(CommandBeside):
    """Starts `guidance panel` for the daemon at an endpoint; it says itself where it can be opened.

    Args:
        endpoint: The daemon's.
        options: More of the panel's options.

    Raises:
        ConfigError: If aiohttp is not installed.
    """

    def __init__(self, endpoint: str, *options: str) -> None:
        require("--panel", "panel")
        self.endpoint = endpoint
        super().__init__("panel", "--endpoint", endpoint, *options)


def options_of(token_file: Path | None, records: Path | None) -> Sequence[str]:
    """Return the panel's options for a daemon whose token and records lie there, on a free port."""
    token = () if token_file is None else ("--token-file", str(token_file))
    return ("--port", "0", *token, *(() if records is None else ("--records", str(records))))
