"""Zenoh's sessions, and a router for computers without zenohd. Imports nothing heavy: orders by a router use it."""

import contextlib
import json
import os
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import zenoh

from guidance.errors import ConfigError, LinkError
from guidance.links.zenoh.credentials import AUTHORITY, NO_CREDENTIALS, ROUTER, Credentials

_UNHEARD: Final = "does a Zenoh router (zenohd, guidance zenoh router) or the mock listen there, and no other program?"
_REFUSED: Final = (
    "is the router running, is its certificate for this host and signed by zenoh.tls_ca_file, and does it accept our "
    "certificate or user? With RUST_LOG=warn the router logs whom it refuses"
)

MOST_QUERY_BYTES: Final = 65536
"""A larger query is dropped unread."""

_RUNTIME: Final = "(rx: (worker_threads: 1))"
"""ZENOH_RUNTIME: one thread reads. By default there are two, and every packet wakes both."""

_MOST_MESSAGE_BYTES: Final = 1_048_576
"""A router of ours ends the link of a party that sends a larger message, before it holds the whole in memory."""

Session = zenoh.Session


def is_over(stop: threading.Event, wait_s: float = 0.0) -> bool:
    """Return whether a thread that calls Zenoh should end: `stop` is set, or the interpreter is ending.

    Such threads must not be daemon threads: one that returns from Zenoh while the interpreter ends aborts the process
    ("FATAL: exception not rethrown").

    Args:
        stop: Set to end the thread.
        wait_s: How long to wait for it.
    """
    return stop.wait(wait_s) or not threading.main_thread().is_alive()


def direct_session(
    mode: str,
    endpoints: Mapping[str, Mapping[str, Any]],
    **transport: Any,  # noqa: ANN401 - JSON
) -> Session:
    """Open a session that neither searches the network nor shares memory.

    Args:
        mode: "client" or "router".
        endpoints: Zenoh's keys of "listen" or "connect"; without endpoints there, it does not.
        transport: More keys of Zenoh's "transport".

    Raises:
        ZError: If there is no session.
    """
    if mode == "router":
        sizes = {"max_message_size": _MOST_MESSAGE_BYTES}
        transport["link"] = {"rx": sizes, **transport.get("link", {})}
    document = {
        "mode": mode,
        **{key: endpoints.get(key, {"endpoints": []}) for key in ("listen", "connect")},
        # A router waits for this delay when it opens, also if it searches for nobody
        "scouting": {
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
            "delay": 0,
        },
        "transport": {"shared_memory": {"enabled": False}, **transport},
    }
    # Zenoh reads it when the first session of a process opens
    os.environ.setdefault("ZENOH_RUNTIME", _RUNTIME)
    return zenoh.open(zenoh.Config.from_json5(json.dumps(document)))


def open_session(
    endpoint: str, *, timeout_s: float = 3.0, credentials: Credentials = NO_CREDENTIALS
) -> Session:
    """Open a client session to one endpoint (`tcp/127.0.0.1:7447`). It neither listens nor searches the network.

    Raises:
        LinkError: If the endpoint does not answer within `timeout_s`, or refuses us.
    """
    sending = {"queue": {"size": {"real_time": 16}}}  # room for bursts; sending never waits
    there = {"endpoints": [endpoint], "timeout_ms": round(timeout_s * 1e3), "exit_on_failure": True}
    tls = {} if credentials.tls is None else credentials.tls
    auth = {} if credentials.auth is None else credentials.auth
    link = {"tx": sending, "tls": tls}
    try:
        return direct_session("client", {"connect": there}, link=link, auth=auth)
    except zenoh.ZError as error:
        ask = _UNHEARD if credentials == NO_CREDENTIALS else _REFUSED
        raise LinkError(
            f"zenoh {endpoint}: no session within {timeout_s:g} s ({_short(error)}); {ask}"
        ) from error


def close_all(*closes: Callable[[], object]) -> None:
    """End subscriptions, tokens and sessions. A session left open would keep the interpreter from ending."""
    for close in closes:
        with contextlib.suppress(zenoh.ZError):
            close()


def is_small(query: "zenoh.Query") -> bool:
    """Return whether a query may be read; judged before its bytes are copied."""
    parts = (query.payload, query.attachment)
    sizes = [0 if part is None else len(part) for part in parts]
    return sum(sizes) + len(str(query.parameters)) <= MOST_QUERY_BYTES


def open_router(path: Path, keys: Path | None = None, listen: str | None = None) -> Session:
    """Open a router, which routes until it is closed. It is the same code as zenohd, without plugins (REST, storage).

    Args:
        path: zenohd's configuration, JSON5.
        keys: A folder made by `guidance zenoh keys`; replaces the certificates that the file names.
        listen: Replaces the file's endpoint: tls/0.0.0.0:7447.

    Raises:
        ConfigError: If the file or a certificate is wrong or cannot be read.
        LinkError: If it cannot listen at the endpoint.
    """
    if not path.is_file():
        raise ConfigError(
            f"{path}: no such file; config/zenoh/router.json5 is included in the installation"
        )
    try:
        config = zenoh.Config.from_file(str(path))
        if listen is not None:
            config.insert_json5("listen/endpoints", json.dumps([listen]))
        if keys is not None:
            keys = keys.absolute()
            for key, name in (
                ("root_ca_certificate", f"{AUTHORITY}.pem"),
                ("listen_certificate", f"{ROUTER}.pem"),
                ("listen_private_key", f"{ROUTER}.key"),
            ):
                if not (keys / name).is_file():
                    raise ConfigError(
                        f"--keys {keys}: {name} is missing; create it with guidance zenoh keys"
                    )
                config.insert_json5(f"transport/link/tls/{key}", json.dumps(str(keys / name)))
    except zenoh.ZError as error:
        raise ConfigError(f"{path}: not a Zenoh configuration ({_short(error)})") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        ask = "is its port in use, and do its certificates exist? Name their folder with --keys"
        raise LinkError(f"{path}: the router cannot listen ({_short(error)}); {ask}") from error


def _short(error: Exception) -> str:
    return str(error).split(" at /")[0].strip()
