"""What `guidance view` does: take a flight from where it comes, paint it, serve that on loopback until it is ended."""

import contextlib
import os
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from guidance.errors import ConfigError
from guidance.records import metadata_of, scan
from guidance.records.reading import Idle

if TYPE_CHECKING:
    from guidance.view.painter import Painter

REDRAWN_EVERY_S: Final = 0.1
NICE: Final = 10
"""A live view gives way to the loop that it looks at."""


class Destination(NamedTuple):
    """Where the picture goes: into a file, or to a page, on two ports of loopback (0 picks a free one)."""

    save: Path | None = None
    port: int = 9876
    web_port: int = 9090


class Seen(NamedTuple):
    """What is looked at: a record, one that is still being written (`follow`), or, without a file, a daemon."""

    file: Path | None = None
    follow: bool = False
    endpoint: str = ""
    name: str | None = None
    token_file: Path | None = None


def view(seen: Seen, place: Destination, say: Callable[[str], None], ended: threading.Event) -> int:
    """Show a flight until `ended` is set; where it is saved, until all is written. Return how many cycles were shown.

    Raises:
        ConfigError: If Rerun is not installed, the record cannot be read, or the file cannot be written.
        LinkError: If a port is in use, or no daemon answers.
    """
    require_rerun()
    with contextlib.ExitStack() as closing:
        painter = (_daemon if seen.file is None else _record)(seen, place, say, ended, closing)
        painter.flush()
        if place.save is None:
            ended.wait()
        return painter.cycles


def require_rerun() -> None:
    """See that the extra is installed.

    Raises:
        ConfigError: If it is not.
    """
    if find_spec("rerun") is None:
        raise ConfigError("the view needs Rerun, which is not installed: pip install 'pursuit-guidance[viz]'")


def _record(
    seen: Seen, place: Destination, say: Callable[[str], None], ended: threading.Event, closing: contextlib.ExitStack
) -> "Painter":
    from guidance.view.opening import opened  # noqa: PLC0415 - Rerun takes a second

    if seen.file is None:
        raise ConfigError("no record is given")
    if seen.follow:
        os.nice(NICE)
    metadata = metadata_of(seen.file, _idle(ended) if seen.follow else None)
    painter = opened(metadata, str(seen.file), place, say, closing)
    for item in scan(seen.file, idle=_idle(ended, painter) if seen.follow else None):
        painter.take(item)
        if ended.is_set():
            break
    return painter


def _daemon(
    seen: Seen, place: Destination, say: Callable[[str], None], ended: threading.Event, closing: contextlib.ExitStack
) -> "Painter":
    from guidance.view.live import LiveFlight  # noqa: PLC0415 - Zenoh and Rerun take a second
    from guidance.view.opening import opened  # noqa: PLC0415

    os.nice(NICE)
    flight = LiveFlight(seen.endpoint, seen.name, seen.token_file)
    closing.callback(flight.close)
    painter = opened(flight.metadata, flight.name, place, say, closing)
    for item in flight.items(_idle(ended, painter)):
        with contextlib.suppress(ConfigError, KeyError, TypeError):  # whoever is on the bus may say anything
            painter.take(item)
    return painter


def _idle(ended: threading.Event, painter: "Painter | None" = None) -> Idle:
    """What to do while nothing comes: show what has come, wait a little, and say whether to end."""

    def idle() -> bool:
        if painter is not None:
            painter.flush()
        return ended.wait(REDRAWN_EVERY_S)

    return idle
