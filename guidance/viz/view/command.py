"""What `guidance view` does: take a flight from where it comes, paint it, serve that on loopback until it is ended."""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from guidance.errors import ConfigError, OutputError
from guidance.extras import require
from guidance.files import private_file, private_folder
from guidance.log import Item, SettingsOf, metadata_of, scan, title_of
from guidance.log.reader import Idle

if TYPE_CHECKING:
    import rerun as rr

    from guidance.viz.view.painter import Painter

APPLICATION: Final = "guidance"
REDRAWN_EVERY_S: Final = 0.1
NICE: Final = 10
"""A live view gives way to the loop that it looks at."""


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
        if source.live:
            os.nice(NICE)
        metadata = source.metadata(_idle(ended))
        painter = _opened(metadata, settings_of, source.name, destination, say, closing)
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


def _opened(
    metadata: Mapping[str, str],
    settings_of: SettingsOf,
    source: str,
    place: Destination,
    say: Callable[[str], None],
    closing: contextlib.ExitStack,
) -> "Painter":
    """Open a recording and say where it can be seen.

    Args:
        metadata: Of the record or of the flight that lasts.
        settings_of: Makes a flight's settings of it.
        source: Named in errors.
        place: A file, or where it is served.
        say: Is told where it can be seen.
        closing: Closes the recording in the end.

    Raises:
        ConfigError: If the metadata has no settings, or a port is none.
        OutputError: If the file cannot be written.
        LinkError: If a port is in use.
    """
    import rerun as rr  # noqa: PLC0415 - takes a second

    from guidance.viz.view.layout import layout  # noqa: PLC0415
    from guidance.viz.view.painter import Painter  # noqa: PLC0415

    recording = rr.RecordingStream(APPLICATION)
    closing.callback(recording.disconnect)
    sink = _file(place.save) if place.save is not None else _served(place, say, closing)
    with_target = settings_of(metadata).cycle.target_game_m is not None
    recording.set_sinks(sink, default_blueprint=layout(with_target=with_target))
    recording.send_recording_name(title_of(metadata))
    return Painter(recording, settings_of, metadata, source)


def _file(path: Path) -> "rr.FileSink":
    import rerun as rr  # noqa: PLC0415

    try:
        private_folder(path.parent)
        private_file(path)  # Rerun would only say in its log that it cannot
    except OSError as error:
        raise OutputError(f"--save {path}: cannot be written ({error.strerror}); choose another file") from error
    return rr.FileSink(path)


def _served(place: Destination, say: Callable[[str], None], closing: contextlib.ExitStack) -> "rr.GrpcServerSink":
    for option, given in (("--port", place.port), ("--web-port", place.web_port)):
        if not 0 <= given <= 65535:
            raise ConfigError(f"{option} {given}: allowed is 0 (pick a free one) to 65535")
    from guidance.viz.view.serving import WebPage, free_port, recording_server  # noqa: PLC0415

    port, web_port = place.port or free_port(), place.web_port or free_port()
    sink = recording_server(port)
    page = WebPage(web_port, sink.uri, port)
    closing.callback(page.close)
    say(f"look at  {page.url}")
    say(f"or with  rerun --connect {sink.uri}")
    return sink
