"""What `guidance view` does: take a flight from where it comes, paint it, serve that on loopback until it is ended."""

import contextlib
import os
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from guidance.errors import ConfigError
from guidance.extras import require
from guidance.log import SettingsOf
from guidance.log.reader import Idle
from guidance.viz.view.source import Destination, FlightSource

if TYPE_CHECKING:
    from guidance.viz.view.painter import Painter

REDRAWN_EVERY_S: Final = 0.1
NICE: Final = 10
"""A live view gives way to the loop that it looks at."""


def view(
    source: FlightSource,
    destination: Destination,
    settings_of: SettingsOf,
    say: Callable[[str], None],
    ended: threading.Event,
) -> int:
    """Show a flight until `ended` is set; where it is saved, until all is written. Return how many cycles were shown.

    Args:
        source: Where the flight comes from; closed at the end.
        destination: Where its picture goes.
        settings_of: Makes the flight's settings of its metadata.
        say: Told where the picture can be seen.
        ended: Ends the view.

    Raises:
        ConfigError: If Rerun is not installed, or the record cannot be read.
        OutputError: If the file cannot be written.
        LinkError: If a port is in use.
    """
    with contextlib.ExitStack() as closing:
        closing.callback(source.close)
        require_rerun()
        from guidance.viz.view.painter import opened  # noqa: PLC0415 - Rerun takes a second

        if source.live:
            os.nice(NICE)
        metadata = source.metadata(_idle(ended))
        painter = opened(metadata, settings_of, source.name, destination, say, closing)
        for item in source.items(_idle(ended, painter)):
            with contextlib.suppress(*(() if source.trusted else (ConfigError, KeyError, TypeError))):
                painter.take(item)
            if ended.is_set() and not source.live:  # of a live one, what has come is shown to the end
                break
        painter.flush()
        if destination.save is None:
            ended.wait()
        return painter.cycles


def require_rerun() -> None:
    """See that the extra is installed.

    Raises:
        ConfigError: If it is not.
    """
    require("the view", "viz")


def _idle(ended: threading.Event, painter: "Painter | None" = None) -> Idle:
    """What to do while nothing comes: show what has come, wait a little, and say whether to end."""

    def idle() -> bool:
        if painter is not None:
            painter.flush()
        return ended.wait(REDRAWN_EVERY_S)

    return idle
