"""The command `guidance panel`: finds the daemons and serves the page until it is stopped."""

import asyncio
import os
import signal
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from guidance.clock import MonotonicClock
from guidance.errors import ConfigError, LinkError
from guidance.extras import require
from guidance.links.wires.zenoh_access import read_credentials
from guidance.log import SettingsOf
from guidance.viz.panel.access import Access, origin_of, remote_access
from guidance.viz.panel.bus import DaemonBus
from guidance.viz.panel.hub import Hub
from guidance.viz.subprocesses import end_with_parent

NICE: Final = 5
"""Lower priority than the flight, but not the lowest: orders pass through the panel."""


class PanelOptions(NamedTuple):
    """Options of `guidance panel`; see its `--help`."""

    endpoints: Sequence[str]
    token_file: Path | None = None
    host: str = "127.0.0.1"
    port: int = 8088
    look: bool = False
    records: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    password_file: Path | None = None
    tiles: str = ""
    zenoh: Path | None = None


def serve_panel(
    options: PanelOptions, settings_of: SettingsOf, say: Callable[[str], None], *, with_parent: bool = False
) -> None:
    """Serve until SIGINT or SIGTERM; with a parent, also until standard input closes.

    Args:
        options: Options of the command line.
        settings_of: Makes settings from the metadata of a record.
        say: Prints a line.
        with_parent: Whether standard input belongs to a parent process.

    Raises:
        ConfigError: If aiohttp is not installed, or an option is not allowed.
        LinkError: If the port is in use.
    """
    require("guidance panel", "panel")
    if not 0 <= options.port <= 65535:
        raise ConfigError(f"--port {options.port}: allowed is 0 (pick a free one) to 65535")
    if options.tiles:
        origin_of(options.tiles)
    credentials = read_credentials(options.zenoh)
    security = remote_access(options.host, options.certificate, options.key, options.password_file)
    listening = _listen(options.host, options.port)
    access = Access(listening.getsockname()[1], security)
    os.nice(NICE)
    clock = MonotonicClock()
    hub = Hub([DaemonBus(one, options.token_file, clock, credentials) for one in options.endpoints], settings_of, clock)
    try:
        asyncio.run(_serve(hub, access, listening, options, say, with_parent=with_parent))
    finally:
        listening.close()
        hub.close()


async def _serve(
    hub: Hub,
    access: Access,
    listening: socket.socket,
    options: PanelOptions,
    say: Callable[[str], None],
    *,
    with_parent: bool,
) -> None:
    from guidance.viz.panel.records import RecordFolder  # noqa: PLC0415 - needs the extra
    from guidance.viz.panel.server import PanelServer  # noqa: PLC0415

    ended, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    if with_parent:
        end_with_parent(lambda: loop.call_soon_threadsafe(ended.set))
    records = None if options.records is None else RecordFolder(options.records)
    server = PanelServer(
        hub, access, MonotonicClock(), look=options.look, records=records, tiles=options.tiles, say=say
    )
    try:
        async with server.serving(listening, options.host):
            await ended.wait()
    finally:
        if records is not None:
            records.close()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise LinkError(
            f"--host {host} --port {port}: {error.strerror}; choose another, or port 0 for a free one"
        ) from error
