"""`guidance view`: reads a flight from a source, draws it in Rerun, and serves it on loopback. Needs the extra `viz`.

view: shows a `RecordFile` or a `guidance.log.broadcast.LiveFlight` at a `Destination`.
"""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import rerun as rr

from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, writing
from guidance.log import Item, SettingsOf, metadata_of, scan, title_of
from guidance.log.reader import Idle
from guidance.viz.painter import Painter, layout
from guidance.viz.serving import RecordingServer, WebPage

if TYPE_CHECKING:
    from guidance.log.broadcast import LiveFlight

APPLICATION: Final = "guidance"
REDRAWN_EVERY_S: Final = 0.1
NICE: Final = 10
"""Niceness of a live viewer, so that the flight's loop has priority."""


class Destination(NamedTuple):
    """A file, or a page on two loopback ports (0 picks a free one)."""

    save: Path | None = None
    port: int = 9876
    web_port: int = 9090


class RecordFile:
    """A record; `follow` reads one that is still being written."""

    trusted = True

    def __init__(self, path: Path, *, follow: bool = False) -> None:
        self.name = str(path)
        self.live = follow
        self._path = path

    def metadata(self, idle: Idle) -> Mapping[str, str]:
        """Return the record's metadata."""
        return metadata_of(self._path, idle if self.live else None)

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield the record's messages."""
        return scan(self._path, idle=idle if self.live else None)

    def close(self) -> None:
        """Do nothing; `scan` closes the file."""


def view(
    source: "RecordFile | LiveFlight",
    destination: Destination,
    settings_of: SettingsOf,
    say: Callable[[str], None],
    ended: threading.Event,
) -> int:
    """Show a flight until `ended` is set, or save it. Return the number of cycles.

    Args:
        source: The flight; closed at the end. Unreadable items are errors in a record; on a bus, where anyone can
            publish, they are ignored.
        destination: A file or a page.
        settings_of: Returns the flight's settings for its metadata.
        say: Receives the page's address.
        ended: Ends the viewer.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the file cannot be written.
        LinkError: If a port is in use.
    """
    with contextlib.ExitStack() as closing:
        closing.callback(source.close)
        if source.live:
            os.nice(NICE)
        metadata = source.metadata(lambda: ended.wait(REDRAWN_EVERY_S))
        recording = rr.RecordingStream(APPLICATION)
        closing.callback(recording.disconnect)
        sink = _served(destination, say, closing) if destination.save is None else _file(destination.save)
        with_target = settings_of(metadata).cycle.target_game_m is not None
        recording.set_sinks(sink, default_blueprint=layout(with_target=with_target))
        recording.send_recording_name(title_of(metadata))
        painter = Painter(recording, settings_of, metadata, source.name)

        def idle() -> bool:
            painter.flush()
            return ended.wait(REDRAWN_EVERY_S)

        for item in source.items(idle):
            with contextlib.suppress(*(() if source.trusted else (ConfigError, KeyError, TypeError))):
                painter.take(item)
            if ended.is_set() and not source.live:  # a live flight is shown to its end
                break
        painter.flush()
        if destination.save is None:
            ended.wait()
        return painter.cycles


def _file(path: Path) -> rr.FileSink:
    with writing(path):
        private_folder(path.parent)
        private_file(path)  # Rerun only logs a failure
    return rr.FileSink(path)


def _served(place: Destination, say: Callable[[str], None], closing: contextlib.ExitStack) -> rr.GrpcServerSink:
    for option, given in (("--port", place.port), ("--web-port", place.web_port)):
        if not 0 <= given <= 65535:
            raise ConfigError(f"{option} {given}: allowed is 0 (pick a free one) to 65535")
    recording = RecordingServer(place.port)
    closing.callback(recording.close)
    page = WebPage(place.web_port, recording)
    closing.callback(page.close)
    say(f"look at  {page.url}")
    say(f"or with  rerun --connect {recording.uri}")
    return recording.sink
