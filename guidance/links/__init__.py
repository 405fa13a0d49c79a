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

from guidance.links.frames import SigningKey
from guidance.links.port import Clock, Endpoint, EvaderSource, VehicleLink, Wire, parse
from guidance.links.wires import MemoryWire

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
