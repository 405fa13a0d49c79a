"""Moving a fleet in real time: wake on the 10 ms grid and whenever something comes."""

import math
import select
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from sitl_mock.autopilot import TICK_S


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


Clock = Callable[[], float]

_LATE_S: Final = 1e-5
"""Woken a little too early, a tick would be 10 ms late."""
STALL_S: Final = 1.0
"""After a stall longer than this (a suspended process) the time in between is left out."""


class Stepped(Protocol):
    """What the loop moves: a `MockVehicle`, or a wrapper around one that spoils its frames."""

    def step_links(self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]) -> dict[str, list[bytes]]:
        """Move on to now_s, take the frames of each link, return what each link sends."""
        ...


@dataclass(slots=True)
class Loop:
    """The state of the loop: vehicles, endpoints, and how far the clock of the vehicles is behind the caller's."""

    vehicles: Mapping[str, Stepped]
    endpoints: Sequence[Endpoint]
    clock: Clock
    left_out_s: float = 0.0
    first_s: float = math.nan
    last_s: float = math.nan
    tick: int = -1

    def cycle(self, ready: Collection[int] | None = None) -> None:
        """Take what has come, move the vehicles to now (between ticks those spoken to), send what they say.

        Args:
            ready: What there is to be read; endpoints without any of it are not asked. None asks all.
        """
        inbox: dict[str, dict[str, list[bytes]]] = defaultdict(lambda: defaultdict(list))
        for arrival in self._arrivals(ready):
            inbox[arrival.vehicle][arrival.link].append(arrival.data)
        now_s = self._now()
        tick = math.floor((now_s - self.first_s) / TICK_S)
        ticked, self.tick = tick != self.tick, tick
        for name, vehicle in self.vehicles.items():
            if not ticked and name not in inbox:
                continue
            for link, frames in vehicle.step_links(now_s, inbox.get(name, {})).items():
                if frames:
                    for endpoint in self.endpoints:
                        endpoint.send(name, link, frames)

    def _arrivals(self, ready: Collection[int] | None) -> Iterator[Arrival]:
        for endpoint in self.endpoints:
            if ready is None or any(fileno in ready for fileno in endpoint.filenos()):
                yield from endpoint.receive()

    def _now(self) -> float:
        now_s = self.clock() - self.left_out_s
        if math.isnan(self.first_s):
            self.first_s = now_s
        if now_s - self.last_s > STALL_S:
            self.left_out_s += now_s - self.last_s - TICK_S
            now_s = self.last_s + TICK_S
        self.last_s = now_s
        return now_s

    def wait_s(self) -> float:
        """Time until the vehicles' next tick."""
        since_s = self.clock() - self.left_out_s - self.first_s
        return TICK_S - since_s % TICK_S + _LATE_S


def run(
    vehicles: Mapping[str, Stepped],
    endpoints: Sequence[Endpoint],
    clock: Clock,
    stop: Callable[[Collection[int]], bool],
    watched: Sequence[int] = (),
) -> None:
    """Run until `stop` is true.

    Args:
        vehicles: By name.
        endpoints: What carries their frames.
        clock: Monotonic seconds.
        stop: Asked after every wake, with the file descriptors that are readable.
        watched: More file descriptors to wake for; `stop` reads them.
    """
    loop = Loop(vehicles, endpoints, clock)
    ready: Collection[int] = ()
    while not stop(ready):
        loop.cycle(ready)
        sources = [*watched, *(fileno for endpoint in endpoints for fileno in endpoint.filenos())]
        ready, _, _ = select.select(sources, [], [], loop.wait_s())  # not poll: too coarse for 100 Hz
