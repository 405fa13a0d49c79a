"""A mock vehicle that is stepped in this process, and the wires that lead to it: whole MAVLink frames to and fro."""

from guidance.clock import Clock
from guidance.links import MemoryWire, Wire
from guidance.links.wires.shared import TappedWire
from sitl_mock.faults import Faulted


class SteppedMock:
    """One vehicle. `wire` commands and hears it; who only listens may be given a wire of their own."""

    def __init__(self, name: str, vehicle: Faulted, clock: Clock) -> None:
        self._vehicle = vehicle
        self._clock = clock
        ours, self._end = MemoryWire.pair(clock.now_s)
        self.wire = TappedWire(ours, clock.now_s, name)
        self._ends: list[Wire] = [self._end]

    def listener(self) -> MemoryWire:
        """Return one more wire that hears the vehicle."""
        ours, end = MemoryWire.pair(self._clock.now_s)
        self.join(end)
        return ours

    def join(self, end: Wire) -> None:
        """Let the vehicle send to this end too, and hear what comes by it."""
        self._ends.append(end)

    def advance(self, now_s: float) -> None:
        """Hand the vehicle what was sent to it, and everybody what it says."""
        heard = [frame for end in self._ends for _, frame in end.receive()]
        for frame in self._vehicle.step(now_s, heard):
            for end in self._ends:
                end.send(frame)
