"""Opening a Zenoh session closed to everything but the endpoint that was named."""

import json

import zenoh

from guidance.errors import LinkError


def closed_config(endpoint: str, *, timeout_s: float = 3.0) -> zenoh.Config:
    """A client that connects to one endpoint (`tcp/127.0.0.1:7447`), and neither listens nor looks around."""
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
                    "link": {"tx": {"queue": {"size": {"real_time": 16}}}},
                },
            }
        )
    )


def open_session(endpoint: str, *, timeout_s: float = 3.0) -> "zenoh.Session":
    """Open a session, or say within `timeout_s` that nobody is there.

    Raises:
        LinkError: If nobody listens at the endpoint, or it refuses us.
    """
    try:
        return zenoh.open(closed_config(endpoint, timeout_s=timeout_s))
    except zenoh.ZError as error:
        reason = str(error).split(" at /")[0].strip()
        raise LinkError(
            f"zenoh {endpoint}: no session within {timeout_s:g} s ({reason}); is the vehicle (or the mock) running?"
        ) from error
