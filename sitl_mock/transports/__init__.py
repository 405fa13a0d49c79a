"""Endpoints that carry a fleet's frames, and the loop that moves it in real time. Nothing else here touches a socket."""

from sitl_mock.transports.endpoint import Arrival, Endpoint
from sitl_mock.transports.loop import Clock, run

__all__ = ["Arrival", "Clock", "Endpoint", "run"]
