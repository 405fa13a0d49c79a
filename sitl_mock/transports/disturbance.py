"""Faults of the transports themselves: a router that goes down and comes back, a vehicle that changes its port."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from sitl_mock.errors import TransportError
from sitl_mock.faults.faulted import Faulted
from sitl_mock.transports.loop import Endpoint

RETRY_S = 0.5


@runtime_checkable
class Restartable(Protocol):
    """An endpoint that can go down and come back."""

    def go_down(self) -> None:
        """Close what others are connected to."""
        ...

    def come_up(self) -> None:
        """Open it again, at the same place."""
        ...


@runtime_checkable
class Rebindable(Protocol):
    """An endpoint whose vehicles have a port each."""

    def change_port(self, vehicle: str) -> None:
        """Take another free port."""
        ...


class Disturbances:
    """Carries out what the faults of some vehicles ask of their endpoints.

    Args:
        vehicles: By name.
        endpoints: What carries their frames.
    """

    def __init__(self, vehicles: Mapping[str, Faulted], endpoints: Sequence[Endpoint]) -> None:
        self._vehicles = vehicles
        self._endpoints = endpoints
        self._down: dict[int, tuple[float, Restartable]] = {}

    def carry_out(self, now_s: float) -> None:
        """Do what is asked for by now, and bring up what has been down for long enough."""
        for name, vehicle in self._vehicles.items():
            while vehicle.transport:
                self._strike(name, *vehicle.transport.popleft(), now_s)
        for number, (until_s, endpoint) in list(self._down.items()):
            if now_s >= until_s:
                try:
                    endpoint.come_up()
                except TransportError:
                    self._down[number] = (now_s + RETRY_S, endpoint)  # its port is not free yet
                else:
                    del self._down[number]

    def _strike(self, vehicle: str, what: str, for_s: float, now_s: float) -> None:
        for endpoint in self._endpoints:
            if what == "router_restart" and isinstance(endpoint, Restartable):
                endpoint.go_down()
                self._down[id(endpoint)] = (now_s + for_s, endpoint)
            elif what == "udp_port_change" and isinstance(endpoint, Rebindable):
                endpoint.change_port(vehicle)
