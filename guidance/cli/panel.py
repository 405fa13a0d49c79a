"""`guidance panel`: the operator's page."""

from pathlib import Path
from typing import Annotated

import typer


def panel(
    endpoint: Annotated[
        list[str] | None,
        typer.Option(
            help="A daemon's control endpoint; may be given several times.", show_default="tcp/127.0.0.1:7448"
        ),
    ] = None,
    port: Annotated[int, typer.Option(help="TCP port of the page; 0 picks a free one.")] = 8088,
    host: Annotated[
        str, typer.Option(help="Where it is served. Anything else than loopback needs TLS and a password.")
    ] = "127.0.0.1",
    look: Annotated[bool, typer.Option("--look", help="Look on only: no order is taken.")] = False,
    records: Annotated[Path, typer.Option(help="Folder of the flights that are over, to look at again.")] = Path(
        "flights"
    ),
    token_file: Annotated[
        Path | None, typer.Option(help="The daemon's control.token_file; not needed for a daemon of your own.")
    ] = None,
    zenoh: Annotated[
        Path | None, typer.Option(help="With a router's endpoint (tls/…): our file of `guidance zenoh keys`.")
    ] = None,
    certificate: Annotated[Path | None, typer.Option(help="TLS certificate chain, PEM.")] = None,
    key: Annotated[Path | None, typer.Option(help="Its private key, PEM.")] = None,
    password_file: Annotated[
        Path | None, typer.Option(help="The password, in a file's first line that only you can read.")
    ] = None,
    tiles: Annotated[
        str, typer.Option(help="Map tiles under the plan view, as https://HOST/{z}/{x}/{y}.png: asked of that host.")
    ] = "",
    with_parent: Annotated[bool, typer.Option("--with-parent", hidden=True)] = False,
) -> None:
    """Serve the operator's page: where everything is, what guidance is about to do and why not, and the orders.

    Shows every daemon (`guidance run`, or a flight begun with --panel) at the endpoints, and waits for those that are
    not there yet. It is a process of its own: a flight flies on when it hangs or dies. Open the address that it prints;
    the token in it lets whoever has it order. Needs the extra `panel`.

    - `guidance panel`: the daemons on this computer
    - `guidance panel --look`: without orders
    - `guidance panel --host 192.168.1.7 --certificate cert.pem --key key.pem --password-file password`: for a tablet
    """
    from guidance.session.recorded import recorded_settings  # noqa: PLC0415 - with numpy, for this only
    from guidance.viz.panel import PanelOptions, serve_panel  # noqa: PLC0415 - zenoh takes a moment

    endpoints = endpoint or ["tcp/127.0.0.1:7448"]
    options = PanelOptions(
        endpoints, token_file, host, port, look, records, certificate, key, password_file, tiles, zenoh
    )
    serve_panel(options, recorded_settings, typer.echo, with_parent=with_parent)
