"""`guidance view` and `panel`: the viewer and the operator's page, and their processes beside a flight."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from guidance.cli.arguments import TokenFile, ZenohFile, refuse
from guidance.clock import MonotonicClock
from guidance.errors import ConfigError
from guidance.extras import require_extras
from guidance.session.orders.words import ENDPOINT

_Port = partial(typer.Option, min=0, max=65535)
_STOP_LIMIT_S: Final = 5.0
TILES: Final = "GUIDANCE_TILES"
"""Environment variable with the default of --tiles, also for the pages beside a flight."""


def view(
    ctx: typer.Context,
    file: Annotated[
        Path | None, typer.Argument(help="A record.mcap, or the folder of a flight.")
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show a daemon (`guidance run`) instead of a record.")
    ] = False,
    follow: Annotated[
        bool, typer.Option("--follow", help="Follow a record that is still being written.")
    ] = False,
    save: Annotated[
        Path | None, typer.Option(help="Write an .rrd file for Rerun's viewer instead of serving.")
    ] = None,
    endpoint: Annotated[
        str, typer.Option(help="With --live: the daemon's control.endpoint.")
    ] = ENDPOINT,
    name: Annotated[
        str | None, typer.Option(help="The vehicle's name; not needed if there is only one.")
    ] = None,
    token_file: TokenFile = None,
    zenoh: ZenohFile = None,
    port: Annotated[
        int, _Port(help="TCP port of the recording on loopback; 0 picks a free one.")
    ] = 9876,
    web_port: Annotated[
        int, _Port(help="TCP port of the page on loopback; 0 picks a free one.")
    ] = 9090,
) -> None:
    """Show a flight in Rerun: both vehicles, stand-off disc, isochron, meeting point, fence, plots and events.

    Serves a page on 127.0.0.1 until Ctrl-C. The viewer is a separate process: the flight continues if it hangs or dies.
    Needs the extra `viz`.

    - `guidance view flights/pe-001/record.mcap`: a finished flight
    - `guidance view flights/teams_guard-001`: all vehicles of a team flight
    - `guidance view FILE --save flight.rrd`: a file for Rerun's viewer
    - `guidance view --live`: the daemon on this computer
    """
    from guidance.links.zenoh.access import read_credentials  # noqa: PLC0415 - slow imports
    from guidance.log.broadcast import LiveFlight  # noqa: PLC0415
    from guidance.session.flight_files import RECORD  # noqa: PLC0415
    from guidance.session.orders.control_client import join_session  # noqa: PLC0415

    if live == (file is not None):
        raise ConfigError("give either the FILE of a record or --live")
    if live:
        refuse(ctx, "--live", "with the FILE of a record", "--follow")
    else:
        refuse(ctx, "the FILE of a record", "with --live", "--name", "--token-file", "--zenoh")
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    require_extras("the view", "viz")
    from guidance.viz import view as viewer  # noqa: PLC0415

    with contextlib.ExitStack() as closing:
        if file is None:
            session = closing.enter_context(
                join_session(endpoint, token_file, read_credentials(zenoh))
            )
            sources: dict[str, viewer.Source] = {"": LiveFlight(session, name)}
        else:
            folder_record = file / RECORD
            records = sorted(file.glob(f"*/{RECORD}"))
            if not records:
                records = [folder_record if folder_record.exists() else file]
            sources = {path.parent.name: viewer.RecordFile(path, live=follow) for path in records}
        count = viewer.view(sources, save, (port, web_port), typer.echo, ended)
    typer.echo(f"{count} cycles shown" if save is None else f"{save}: {count} cycles")


def panel(
    endpoint: Annotated[
        list[str] | None, typer.Option(help="Of daemons; repeatable.", show_default=ENDPOINT)
    ] = None,
    port: Annotated[int, _Port(help="TCP port of the page; 0 picks a free one.")] = 8088,
    host: Annotated[
        str, typer.Option(help="Its address; others than loopback need TLS and a password.")
    ] = "127.0.0.1",
    look: Annotated[bool, typer.Option("--look", help="Show only; no orders.")] = False,
    records: Annotated[Path, typer.Option(help="Folder of finished flights, for replay.")] = Path(
        "flights"
    ),
    token_file: TokenFile = None,
    zenoh: ZenohFile = None,
    certificate: Annotated[Path | None, typer.Option(help="TLS certificate chain, PEM.")] = None,
    key: Annotated[Path | None, typer.Option(help="Its private key, PEM.")] = None,
    password_file: Annotated[
        Path | None, typer.Option(help="The password in one line, readable only by you.")
    ] = None,
    tiles: Annotated[
        str, typer.Option(envvar=TILES, help="Map: a folder with Z/X/Y.png, or a URL.")
    ] = "tiles",
) -> None:
    """Serve the operator's page: map, state, checks, reasons and orders.

    Shows every daemon (`guidance run`, or a flight with --panel) at the endpoints, also those that start later. It is a
    separate process: the flight continues if it hangs or dies. Open the printed address. Its token allows orders, so
    keep it secret. The map under the plan is a folder with Z/X/Y.png, or https://HOST/{z}/{x}/{y}.png on another host.
    Needs the extra `panel`.

    - `guidance panel`: the daemons on this computer
    - `guidance panel --look`: without orders
    - `guidance panel --host 192.168.1.7 --certificate cert.pem --key key.pem --password-file password`: for a tablet
    """
    require_extras("guidance panel", "panel")
    from guidance.links.zenoh.access import read_credentials  # noqa: PLC0415 - slow imports
    from guidance.viz.panel.access import Access, listening_socket, map_of, remote_access  # noqa: PLC0415
    from guidance.viz.panel.hub import DaemonBus, Hub  # noqa: PLC0415
    from guidance.viz.panel.server import PANEL_NICE, PanelServer  # noqa: PLC0415

    map_of(tiles)
    credentials = read_credentials(zenoh)
    security = remote_access(host, certificate, key, password_file)
    with listening_socket(host, port) as listening:
        os.nice(PANEL_NICE)
        clock = MonotonicClock()
        access = Access(host, listening.getsockname()[1], security, clock, typer.echo)
        if not endpoint:
            endpoint = [ENDPOINT]
        buses = [DaemonBus(address, token_file, clock, credentials) for address in endpoint]
        with contextlib.closing(Hub(buses, clock)) as hub:
            asyncio.run(
                PanelServer(hub, access, look=look, records=records, tiles=tiles).serve(listening)
            )


class CommandBeside:
    """Runs `guidance ARGUMENTS` as a child process of a flight, which does not depend on it.

    The child ends when its standard input closes, so it ends with its parent.

    Args:
        arguments: Command name, then its arguments.
        say: Receives every line of its output, on a separate thread.
    """

    def __init__(self, *arguments: str, say: Callable[[str], None] = typer.echo) -> None:
        # A separate session, so that Ctrl-C reaches only the parent.
        piped: dict[str, Any] = {
            "stdin": subprocess.PIPE,
            "stdout": subprocess.PIPE,
            "text": True,
            "errors": "replace",
        }
        self.child: Final = subprocess.Popen(command(arguments), start_new_session=True, **piped)
        self._relaying = threading.Thread(
            target=self._relay, args=(say,), name=arguments[0], daemon=True
        )
        self._relaying.start()

    def _relay(self, say: Callable[[str], None]) -> None:
        assert self.child.stdout is not None
        with self.child.stdout as lines:
            for line in lines:
                say(line.rstrip())

    def close(self) -> None:
        """End it, by force after `_STOP_LIMIT_S`. May be called twice."""
        assert self.child.stdin is not None
        self.child.stdin.close()
        try:
            self.child.wait(_STOP_LIMIT_S)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
        self._relaying.join()


def command(arguments: Sequence[str]) -> list[str]:
    """Return the command line of a child command. `-P` keeps the current folder off the import path."""
    code = "from guidance.cli import main, viewers; viewers.end_with_parent(); main()"
    return [sys.executable, "-P", "-c", code, *arguments]


def panel_beside(
    endpoint: str, records: Path | None, token_file: Path | None = None
) -> CommandBeside:
    """Start the page of the daemon at an endpoint on a free port; it prints its address."""
    options = {
        "--endpoint": endpoint,
        "--port": "0",
        "--token-file": token_file,
        "--records": records,
    }
    words = list[str]()
    for name, value in options.items():
        if value is not None:
            words += [name, str(value)]
    return CommandBeside("panel", *words)


def end_with_parent() -> None:
    """End this process as SIGTERM does when its standard input closes."""
    threading.Thread(target=_read_to_the_end, name="parent", daemon=True).start()


def _read_to_the_end() -> None:
    # os.read, because a thread that waits in a buffered reader would keep the interpreter from ending.
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
