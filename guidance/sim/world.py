"""The two worlds a mocked flight takes place in: this process and a moved clock, or a child process and real time."""

from collections.abc import Sequence
from typing import Protocol

from guidance.links.port import EvaderSource, VehicleLink
from guidance.links.wires.shared import Passed


class World(Protocol):
    """Both vehicles, as the flight reaches them. `advance` brings the world to the clock's present."""

    pursuer: VehicleLink
    evader: VehicleLink
    evader_source: EvaderSource

    def advance(self) -> None:
        """Bring the world up to now.

        Raises:
            LinkError: If the world has ended: the mock autopilot died, say.
        """
        ...

    def engage(self) -> None:
        """The game has begun: faults that count from engagement do from now on."""
        ...

    def drain(self) -> Sequence[Passed]:
        """Return the raw frames that passed since the last call, for the record."""
        ...

    def close(self) -> None:
        """End everything this world has started."""
        ...
