"""Faults of transports: a router that restarts, a vehicle that changes its port."""

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
        """Close the connections."""
        ...

    def come_up(self) -> None:
        """Open them again at the same address."""
        ...


@runtime_checkable
class Rebindable(Protocol):
    """An endpoint with one port per vehicle."""

    def change_port(self, vehicle: str) -> None:
        """Take another free port."""
        ...


class Disturbances:
    """Applies the transport faults of vehicles to their endpoints.

    Args:
        vehicles: Vehicles by name.
        endpoints: Their endpoints.
    """

    def __init__(self, vehicles: Mapping[str, Faulted], endpoints: Sequence[Endpoint]) -> None:
        self._vehicles = vehicles
        self._endpoints = endpoints
        self._down: dict[int, tuple[float, Restartable]] = {}

    def carry_out(self, now_s: float) -> None:
        """Apply new transport faults, and end those whose time is over."""
        for name, vehicle in self._vehicles.items():
            while vehicle.transport:
                what, for_s = vehicle.transport.popleft()
                for endpoint in self._endpoints:
                    if what == "router_restart" and isinstance(endpoint, Restartable):
                        endpoint.go_down()
                        self._down[id(endpoint)] = (now_s + for_s, endpoint)
                    elif what == "udp_port_change" and isinstance(endpoint, Rebindable):
                        endpoint.change_port(name)
        for number, (until_s, closed) in list(self._down.items()):
            if now_s >= until_s:
                try:
                    closed.come_up()
                except TransportError:
                    self._down[number] = (now_s + RETRY_S, closed)  # its port is not free yet
                else:
                    del self._down[number]
