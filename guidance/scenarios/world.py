"""The two worlds a mocked flight takes place in: this process and a moved clock, or a child process and real time."""

from typing import Protocol

from guidance.links.port import TargetSource, VehicleLink


class World(Protocol):
    """Both vehicles, as the flight reaches them. `advance` brings the world to the clock's present."""

    pursuer: VehicleLink
    evader: VehicleLink
    target: TargetSource

    def advance(self) -> None:
        """Bring the world up to now.

        Raises:
            LinkError: If the world has ended: the mock autopilot died, say.
        """
        ...

    def close(self) -> None:
        """End everything this world has started."""
        ...
