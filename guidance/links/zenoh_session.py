"""Opening a Zenoh session closed to everything but the endpoint that was named."""

import json
from collections.abc import Mapping
from typing import Any

import zenoh

from guidance.errors import LinkError


def closed_config(
    endpoint: str, *, timeout_s: float = 3.0, authentication: Mapping[str, Any] | None = None
) -> zenoh.Config:
    """A client that connects to one endpoint (`tcp/127.0.0.1:7447`), and neither listens nor looks around.

    `authentication` is Zenoh's `transport.auth`; without it only an endpoint that asks nobody lets us in.
    """
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "client",
                "listen": {"endpoints": []},
                "connect": {"endpoints": [endpoint], "timeout_ms": round(timeout_s * 1e3), "exit_on_failure": True},
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                # More room for bursts at real-time priority, and no longer wait: the loop never waits for a peer.
                "transport": {
                    "shared_memory": {"enabled": False},
                    **({} if authentication is None else {"auth": authentication}),
                    "link": {"tx": {"queue": {"size": {"real_time": 16}}}},
                },
            }
        )
    )


def open_session(
    endpoint: str, *, timeout_s: float = 3.0, authentication: Mapping[str, Any] | None = None
) -> "zenoh.Session":
    """Open a session, or say within `timeout_s` that nobody is there.

    Raises:
        LinkError: If nobody listens at the endpoint, or it refuses us.
    """
    try:
        return zenoh.open(closed_config(endpoint, timeout_s=timeout_s, authentication=authentication))
    except zenoh.ZError as error:
        reason = str(error).split(" at /")[0].strip()
        raise LinkError(
            f"zenoh {endpoint}: no session within {timeout_s:g} s ({reason}); is the vehicle (or the mock) running?"
        ) from error
