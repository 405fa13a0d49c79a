"""Where a view takes a flight from, and where its picture goes."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

from guidance.log import Item, metadata_of, scan
from guidance.log.reader import Idle


class Destination(NamedTuple):
    """Where the picture goes: into a file, or to a page, on two ports of loopback (0 picks a free one)."""

    save: Path | None = None
    port: int = 9876
    web_port: int = 9090


class FlightSource(Protocol):
    """Where a flight's items come from: `RecordFile`, or `guidance.log.broadcast.LiveFlight`."""

    @property
    def name(self) -> str:
        """Named where an item cannot be read."""

    @property
    def live(self) -> bool:
        """Whether it lasts: the view then gives way to the loop that it looks at."""

    @property
    def trusted(self) -> bool:
        """Whether an item that cannot be read ends the view; anybody on a bus may say anything."""

    def metadata(self, idle: Idle) -> Mapping[str, str]:
        """As the record's; waited for with `idle`."""

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield what there is, and what comes, until `idle` ends it."""

    def close(self) -> None:
        """Take no more from it. May be called twice."""


class RecordFile:
    """A record, or one that is still being written (`follow`)."""

    trusted = True

    def __init__(self, path: Path, *, follow: bool = False) -> None:
        self.name = str(path)
        self.live = follow
        self._path = path

    def metadata(self, idle: Idle) -> Mapping[str, str]:
        """What was written at the start."""
        return metadata_of(self._path, idle if self.live else None)

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield the record's messages."""
        return scan(self._path, idle=idle if self.live else None)

    def close(self) -> None:
        """Nothing: the file is closed where its reading ends."""
