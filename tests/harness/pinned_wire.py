"""A wire in memory that pins addresses like a UDP port; every MAVLink component has its own address."""

from collections.abc import Callable, Mapping, Sequence

from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.port import Wire
from guidance.links.wires.udp import AddressPins
from guidance.sim.stepped import SteppedWorld

Packet = tuple[float, bytes]
COMPONENT = 6
"""Byte of a MAVLink 2 frame with the sender's component id."""


class PinnedWire:
    """`Wire` around another that accepts each of these systems from one address at a time.

    Args:
        wire: Source of the frames.
        systems: MAVLink system ids that are accepted.
        is_lost: Whether the frames of a component are lost now.
    """

    def __init__(
        self,
        wire: Wire,
        systems: Sequence[int],
        is_lost: Callable[[int], bool] = lambda _component: False,
    ) -> None:
        self._wire = wire
        self._is_lost = is_lost
        self._pins = AddressPins(systems)

    def receive(self) -> Sequence[Packet]:
        """Return the frames from pinned addresses."""
        accepted = []
        for at_s, data in self._wire.receive():
            component = data[COMPONENT] if len(data) > COMPONENT else 0
            if not self._is_lost(component):
                accepted.append((at_s, self._pins.admit(at_s, ("evader", component), data)))
        return [(at_s, data) for at_s, data in accepted if data]

    def impostors(self) -> Sequence[bytes]:
        """Return the frames from other addresses."""
        kept = self._pins.impostors
        return [kept.popleft() for _ in range(len(kept))]

    def impostors_of(self, system_id: int) -> int:
        """Return how many frames with a system's id came from another address."""
        return self._pins.impostors_of[system_id]

    def send(self, frame: bytes) -> None:
        """Send on the wire."""
        self._wire.send(frame)

    def counters(self) -> Mapping[str, int]:
        """Return the wire's counts, and how many frames were refused, by reason."""
        return {
            **self._wire.counters(),
            **{f"wire_{reason}": count for reason, count in self._pins.refused.items()},
        }

    def close(self) -> None:
        """Close the wire."""
        self._wire.close()


def evader_wire(world: SteppedWorld) -> Wire:
    """Return the wire of a world's evader reports."""
    assert isinstance(world.evaders["pursuer"]["evader"], MavlinkEvader)
    return world.evaders["pursuer"]["evader"].wire
