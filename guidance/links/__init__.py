"""Vehicles and evaders over wires: the contracts, and adapters of MAVSDK and pymavlink.

`guidance.links.opening` opens links from URLs. It is imported separately because it loads every wire library.

Contents:
    VehicleLink: one vehicle, both directions.
    EvaderSource: reports of the evader.
    Wire: MAVLink bytes to and from a vehicle. MemoryWire: two connected ends, for tests.
    Endpoint: a parsed URL, see `parse`.
    SigningKey: the secret of MAVLink 2 signing.
    Clock: a function that returns monotonic seconds.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from guidance.links.mavlink.frames import SigningKey
    from guidance.links.port import Clock, Endpoint, EvaderSource, VehicleLink, Wire, parse
    from guidance.links.wires.base import MemoryWire

__all__ = [
    "Clock",
    "Endpoint",
    "EvaderSource",
    "MemoryWire",
    "SigningKey",
    "VehicleLink",
    "Wire",
    "parse",
]

_MODULES: Final = {
    "Clock": "port",
    "Endpoint": "port",
    "EvaderSource": "port",
    "MemoryWire": "wires.base",
    "SigningKey": "mavlink.frames",
    "VehicleLink": "port",
    "Wire": "port",
    "parse": "port",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - each name has its own type
    """Import a name when it is used: an order by a router needs a Zenoh session, but not MAVLink."""
    if name not in _MODULES:
        raise AttributeError(f"module 'guidance.links' has no attribute {name!r}")
    return getattr(import_module(f"guidance.links.{_MODULES[name]}"), name)
