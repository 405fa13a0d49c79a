"""The port between a fleet and the outside."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol


class Arrival(NamedTuple):
    """Bytes that came for a vehicle by one of its links."""

    vehicle: str
    link: str
    data: bytes


class Endpoint(Protocol):
    """Carries frames of several vehicles. It is used from one thread, the loop's.

    * `filenos` are readable when `receive` has something to give.
    * `receive` never blocks and gives everything that has come, oldest first; what does not fit is dropped and counted.
    * `send` never blocks; what cannot be sent is dropped and counted.
    * `close` releases everything and may be called twice.
    """

    dropped: int

    def filenos(self) -> Sequence[int]:
        """What to wait for."""
        ...

    def receive(self) -> Sequence[Arrival]:
        """Everything that has come."""
        ...

    def send(self, vehicle: str, link: str, frames: Sequence[bytes]) -> None:
        """Send what a vehicle says on a link."""
        ...

    def describe(self) -> dict[str, str]:
        """Vehicle name to where it can be reached."""
        ...

    def close(self) -> None:
        """Release everything."""
        ...
