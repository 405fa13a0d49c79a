"""Vehicles and evaders over wires: the ports, and adapters of MAVSDK and pymavlink.

`guidance.links.opening` opens links from URLs; it is imported apart, since it brings every wire library with it.

What it offers:
    VehicleLink: one vehicle, both directions. EvaderSource: where reports of the evader come from.
    Wire: MAVLink frames to and from somewhere. MemoryWire: two ends of one, for tests.
    Endpoint: a URL taken apart, by `parse`.
    SigningKey: the secret that MAVLink 2 signs with.
    Clock: tells monotonic seconds.
"""

from guidance.links.arrivals import Clock, MemoryWire
from guidance.links.endpoint import Endpoint, parse
from guidance.links.port import EvaderSource, VehicleLink, Wire
from guidance.links.signing import SigningKey

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
