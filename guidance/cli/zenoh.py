"""`guidance zenoh`: certificates and a router for Zenoh between machines."""

import datetime
import signal
import threading
import time
from pathlib import Path
from typing import Annotated, Final

import typer

from guidance.cli.arguments import CommandGroup

_VALID: Final = datetime.timedelta(days=365)

zenoh = typer.Typer(cls=CommandGroup, help="Certificates and a router for Zenoh between machines.")


@zenoh.command()
def keys(
    names: Annotated[list[str], typer.Argument(help="Names of the parties: uav1, uav1-guidance, evader1, operator.")],
    out: Annotated[Path, typer.Option(help="Folder of the certificates.")] = Path("keys"),
    host: Annotated[list[str] | None, typer.Option(help="A name or address of the router.")] = None,
) -> None:
    """Create a test authority, a certificate for the router and one for each name, for mutual TLS.

    They are valid for a year. Run it again to add names to the same authority. NAME.toml holds the settings of a
    party: pass it as `--zenoh keys/NAME.toml` to `guidance ctl`, `guidance view` and `sitl-mock run`, or copy it to the
    section `[zenoh]` of a vehicle file. Only you can read the keys. Keep ca.key off the computers that fly: it can sign
    any certificate.

    - `guidance zenoh keys uav1 uav1-guidance evader1 operator viewer --host 192.168.1.10`
    """
    from guidance.extras import require  # noqa: PLC0415 - only where it is used

    require("guidance zenoh keys", "keys")
    from guidance.files import writing  # noqa: PLC0415
    from guidance.links.keys import Validity, make_keys  # noqa: PLC0415 - cryptography takes a moment

    begin = datetime.datetime.fromtimestamp(time.time_ns() / 1e9, datetime.UTC)
    validity = Validity(begin - datetime.timedelta(hours=1), begin + _VALID)
    with writing(out):
        written = make_keys(out, names, ["localhost", "127.0.0.1", *(host or ())], validity)
    for path in written:
        typer.echo(path)


@zenoh.command()
def router(
    config: Annotated[str, typer.Argument(help="zenohd's configuration.")] = "zenoh/router.json5",
    keys: Annotated[Path | None, typer.Option(help="Folder of `guidance zenoh keys`.")] = None,
    listen: Annotated[str | None, typer.Option(help="Endpoint that replaces the file's: tls/0.0.0.0:7447.")] = None,
) -> None:
    """Run a Zenoh router until Ctrl-C, for computers without zenohd.

    The default configuration (`config/zenoh/router.json5`) admits parties with a certificate of our authority and
    restricts each to its own keys. zenohd reads the same file.

    - `guidance zenoh router --keys keys --listen tls/0.0.0.0:7447`
    """
    from guidance.config import config_folder  # noqa: PLC0415
    from guidance.links.zenoh_wire import open_router  # noqa: PLC0415 - zenoh takes a moment

    path = Path(config)
    path = path if path.is_file() else config_folder() / path
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with open_router(path, keys, listen):
        typer.echo(f"routing by {path}{'' if listen is None else f' at {listen}'}; Ctrl-C ends it")
        ended.wait()
