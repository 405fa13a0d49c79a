"""`guidance view`: a flight to look at, live or from its record."""

import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from guidance.log.broadcast import LiveFlight


def view(
    file: Annotated[
        Path | None, typer.Argument(help="A record.mcap that a flight wrote or is writing; none with --live.")
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Look at a daemon (`guidance run`) instead of a record.")
    ] = False,
    follow: Annotated[bool, typer.Option("--follow", help="The record is still being written: go on with it.")] = False,
    save: Annotated[Path | None, typer.Option(help="Write FILE.rrd for Rerun's viewer instead of serving.")] = None,
    endpoint: Annotated[str, typer.Option(help="With --live: the daemon's control.endpoint.")] = "tcp/127.0.0.1:7448",
    name: Annotated[str | None, typer.Option(help="With --live: the vehicle; not needed if there is one.")] = None,
    token_file: Annotated[Path | None, typer.Option(help="With --live: the daemon's control.token_file.")] = None,
    zenoh: Annotated[
        Path | None,
        typer.Option(help="With --live and a router's endpoint (tls/…): our file of `guidance zenoh keys`."),
    ] = None,
    port: Annotated[int, typer.Option(help="TCP port of the recording on loopback; 0 picks a free one.")] = 9876,
    web_port: Annotated[int, typer.Option(help="TCP port of the page on loopback; 0 picks a free one.")] = 9090,
    with_parent: Annotated[bool, typer.Option("--with-parent", hidden=True)] = False,
) -> None:
    """Show a flight in Rerun: both vehicles, stand-off disc, isochron, meeting point, fence, plots and events.

    Serves a page on 127.0.0.1 and nowhere else, until Ctrl-C. It is a process of its own: a flight that is looked at
    flies on when it hangs or dies. Needs the extra `viz`.

    - `guidance view flights/pe-001/record.mcap`: a flight that is over
    - `guidance view FILE --save flight.rrd`: for Rerun's own viewer, nothing is served
    - `guidance view --live`: the daemon on this computer
    """
    from guidance.cli.belonging import refuse_others  # noqa: PLC0415
    from guidance.errors import ConfigError  # noqa: PLC0415 - with numpy, for this only
    from guidance.session.recorded import recorded_settings  # noqa: PLC0415
    from guidance.viz.beside import end_with_parent  # noqa: PLC0415
    from guidance.viz.view import Destination, RecordFile  # noqa: PLC0415
    from guidance.viz.view import view as show  # noqa: PLC0415
    from guidance.viz.view.command import require_rerun  # noqa: PLC0415

    if live == (file is not None):
        raise ConfigError("give either the FILE of a record or --live")
    if live:
        refuse_others("--live", {"--follow": follow}, {"--follow": "with the FILE of a record"})
    else:
        given = {"--name": name, "--token-file": token_file, "--zenoh": zenoh}
        refuse_others("the FILE of a record", given, dict.fromkeys(given, "with --live"))
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    if with_parent:
        end_with_parent(ended.set)
    require_rerun()
    source = RecordFile(file, follow=follow) if file is not None else _live(endpoint, name, token_file, zenoh)
    count = show(source, Destination(save, port, web_port), recorded_settings, typer.echo, ended)
    typer.echo(f"{count} cycles shown" if save is None else f"{save}: {count} cycles")


def _live(endpoint: str, name: str | None, token_file: Path | None, zenoh: Path | None) -> "LiveFlight":
    from guidance.links.wires.zenoh_access import read_credentials  # noqa: PLC0415
    from guidance.log.broadcast import LiveFlight  # noqa: PLC0415 - Zenoh takes a second
    from guidance.session.control_bus import join_session  # noqa: PLC0415

    return LiveFlight(join_session(endpoint, token_file, read_credentials(zenoh)), name)
