"""A recording of Rerun, into a file or behind two servers on loopback, and the painter for it."""

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path

import rerun as rr

from guidance.errors import ConfigError, OutputError
from guidance.files import private_file, private_folder
from guidance.log import SettingsOf, title_of
from guidance.viz.view.layout import layout
from guidance.viz.view.painter import Painter
from guidance.viz.view.places import Destination
from guidance.viz.view.serving import WebPage, free_port, recording_server

APPLICATION = "guidance"


def opened(
    metadata: Mapping[str, str],
    settings_of: SettingsOf,
    source: str,
    place: Destination,
    say: Callable[[str], None],
    closing: contextlib.ExitStack,
) -> Painter:
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
    recording = rr.RecordingStream(APPLICATION)
    closing.callback(recording.disconnect)
    sink = _file(place.save) if place.save is not None else _served(place, say, closing)
    with_target = settings_of(metadata).cycle.target_game_m is not None
    recording.set_sinks(sink, default_blueprint=layout(with_target=with_target))
    recording.send_recording_name(title_of(metadata))
    return Painter(recording, settings_of, metadata, source)


def _file(path: Path) -> rr.FileSink:
    try:
        private_folder(path.parent)
        private_file(path)  # Rerun would only say in its log that it cannot
    except OSError as error:
        raise OutputError(f"--save {path}: cannot be written ({error.strerror}); choose another file") from error
    return rr.FileSink(path)


def _served(place: Destination, say: Callable[[str], None], closing: contextlib.ExitStack) -> rr.GrpcServerSink:
    port, web_port = _port("--port", place.port), _port("--web-port", place.web_port)
    sink = recording_server(port)
    page = WebPage(web_port, sink.uri, port)
    closing.callback(page.close)
    say(f"look at  {page.url}")
    say(f"or with  rerun --connect {sink.uri}")
    return sink


def _port(option: str, port: int) -> int:
    if not 0 <= port <= 65535:
        raise ConfigError(f"{option} {port}: allowed is 0 (pick a free one) to 65535")
    return port or free_port()
