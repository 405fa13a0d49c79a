"""The parties on a router between machines: their keys, which last a century, and what an evader of theirs says."""

import datetime
from collections.abc import Sequence
from pathlib import Path

import pytest

from guidance.config import config_folder
from guidance.frames import Amsl, LocalFrame
from guidance.links.zenoh.access import read_credentials
from guidance.links.zenoh.credentials import Credentials
from guidance.links.zenoh.keys import make_keys

PARTIES = ("uav1", "uav1-guidance", "evader1", "operator", "viewer")
ROUTERS = config_folder() / "zenoh"
ROUTER = ROUTERS / "router.json5"
_NOON = datetime.datetime(2026, 1, 1, 12, tzinfo=datetime.UTC)
CENTURY = _NOON, _NOON + datetime.timedelta(days=36_500)
FRAME = LocalFrame(47.3977418, 8.5455939, Amsl(488.0))
SAID = (
    b'{"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 600.0, "altitude_datum": "amsl"}'
)


def folder_of_keys(factory: pytest.TempPathFactory, parties: Sequence[str] = PARTIES) -> Path:
    """Make the keys of some parties for this host, by an authority of their own."""
    folder = factory.mktemp("keys")
    make_keys(folder, parties, ["127.0.0.1"], CENTURY)
    return folder


def of(keys: Path, name: str) -> Credentials:
    """Return the credentials of a party."""
    return read_credentials(keys / f"{name}.toml")
