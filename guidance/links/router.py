"""A Zenoh router of our own, from a zenohd configuration file, for where zenohd itself is not installed.

It routes and judges as zenohd does, which is the same code; it has no plugins (REST, storage).
"""

import json
from pathlib import Path

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.wires.zenoh_access import AUTHORITY, ROUTER


def open_router(path: Path, keys: Path | None = None, listen: str | None = None) -> "zenoh.Session":
    """Open a router; it routes until it is closed.

    Args:
        path: zenohd's configuration, JSON5.
        keys: A folder of `guidance zenoh keys`, in place of the certificates that the file names.
        listen: The endpoint to listen at, in place of the file's: tls/0.0.0.0:7447.

    Raises:
        ConfigError: If the file or a certificate cannot be read, or is wrong.
        LinkError: If it cannot listen there.
    """
    if not path.is_file():
        raise ConfigError(f"{path}: there is no such file; config/zenoh/router.json5 comes along")
    try:
        config = zenoh.Config.from_file(str(path))
        if listen is not None:
            config.insert_json5("listen/endpoints", json.dumps([listen]))
        if keys is not None:
            _take(config, keys.absolute())
    except zenoh.ZError as error:
        raise ConfigError(f"{path}: is no Zenoh configuration ({_short(error)})") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise LinkError(
            f"{path}: the router cannot listen ({_short(error)}); is its port in use, and are its certificates there? "
            "--keys says where"
        ) from error


def _take(config: zenoh.Config, keys: Path) -> None:
    for key, name in (
        ("root_ca_certificate", f"{AUTHORITY}.pem"),
        ("listen_certificate", f"{ROUTER}.pem"),
        ("listen_private_key", f"{ROUTER}.key"),
    ):
        if not (keys / name).is_file():
            raise ConfigError(f"--keys {keys}: has no {name}; guidance zenoh keys makes it")
        config.insert_json5(f"transport/link/tls/{key}", json.dumps(str(keys / name)))


def _short(error: Exception) -> str:
    return str(error).split(" at /")[0].strip()
