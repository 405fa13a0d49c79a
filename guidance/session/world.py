"""The three worlds a flight takes place in, as its one loop sees them.

The mock stepped in this process by a moved clock (`guidance.sim.stepped`), the mock as a child process in real time
(`guidance.sim.live`), and a vehicle that is not ours (`guidance.session.opening`).
"""

from collections.abc import Sequence
from typing import Protocol

from guidance.links.port import EvaderSource, VehicleLink
from guidance.links.wires.shared import Passed
from guidance.sim.evader import EvaderPlayer


class World(Protocol):
    """The vehicle and whom it pursues, as the flight reaches them."""

    @property
    def real_time(self) -> bool:
        """Whether time passes by itself."""
        ...

    @property
    def link(self) -> VehicleLink:
        """The vehicle."""
        ...

    @property
    def evader_source(self) -> EvaderSource:
        """What is heard of the evader."""
        ...

    @property
    def player(self) -> EvaderPlayer | None:
        """The evader, where this process plays it; None where it is somebody else's."""
        ...

    def advance(self) -> None:
        """Bring the world up to the clock's present.

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
