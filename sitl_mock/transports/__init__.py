"""Endpoints that carry a fleet's frames, and the loop that moves it in real time; the only place with sockets."""

from sitl_mock.transports.lockstep import run_lockstep
from sitl_mock.transports.loop import Arrival, Clock, Endpoint, run

__all__ = ["Arrival", "Clock", "Endpoint", "run", "run_lockstep"]
