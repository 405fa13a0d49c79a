"""Run a fleet in real time: wake on a 10 ms grid and whenever data arrive."""

import math
import select
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final, NamedTuple, Protocol

from sitl_mock.vehicle.autopilot import TICK_S


class Arrival(NamedTuple):
    """Bytes received for a vehicle on one of its links."""

    vehicle: str
    link: str
    data: bytes


class Endpoint(Protocol):
    """Carries frames of several vehicles; used from the loop's thread only.

    * `filenos` are readable when data have arrived.
    * `receive` never blocks and returns all data, oldest first; overflow is dropped and counted.
    * `send` never blocks; frames that cannot be sent are dropped and counted.
    * `close` releases everything and may be called twice.
    """

    @property
    def dropped(self) -> int:
        """Return the number of dropped frames."""
        ...

    def filenos(self) -> Sequence[int]:
        """Return the file descriptors to wait on."""
        ...

    def receive(self) -> Sequence[Arrival]:
        """Return all received data."""
        ...

    def send(self, vehicle: str, link: str, frames: Sequence[bytes]) -> None:
        """Send frames of a vehicle on a link."""
        ...

    def describe(self) -> dict[str, str]:
        """Return the address of each vehicle by name."""
        ...

    def close(self) -> None:
        """Release everything."""
        ...


Clock = Callable[[], float]

_LATE_S: Final = 1e-5
"""Waking slightly early would delay a tick by 10 ms, so wait this much longer."""
STALL_S: Final = 1.0
"""A longer stall (suspended process) is removed from the vehicles' time."""


class Stepped(Protocol):
    """A `MockVehicle`, or a wrapper that applies faults."""

    def step_links(
        self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]
    ) -> dict[str, list[bytes]]:
        """Advance to now_s, take the frames of each link, return the frames to send on each."""
        ...


@dataclass(slots=True)
class Loop:
    """State of the loop: vehicles, endpoints, and the lag of the vehicles' clock.

    `clock` runs `speed` times as fast as real time.
    """

    vehicles: Mapping[str, Stepped]
    endpoints: Sequence[Endpoint]
    clock: Clock
    speed: float = 1.0
    left_out_s: float = 0.0
    first_s: float = math.nan
    last_s: float = math.nan
    tick: int = -1

    def cycle(self, ready: Collection[int] | None = None) -> None:
        """Receive, advance the vehicles (between ticks only those with data), and send.

        Args:
            ready: Readable file descriptors; other endpoints are skipped. None reads all.
        """
        inbox: dict[str, dict[str, list[bytes]]] = defaultdict(lambda: defaultdict(list))
        for endpoint in self.endpoints:
            if ready is None or any(fileno in ready for fileno in endpoint.filenos()):
                for arrival in endpoint.receive():
                    inbox[arrival.vehicle][arrival.link].append(arrival.data)
        # A pause longer than STALL_S is left out.
        now_s = self.clock() - self.left_out_s
        if math.isnan(self.first_s):
            self.first_s = now_s
        if now_s - self.last_s > STALL_S * self.speed:
            self.left_out_s += now_s - self.last_s - TICK_S
            now_s = self.last_s + TICK_S
        self.last_s = now_s
        tick = math.floor((now_s - self.first_s) / TICK_S)
        ticked = tick != self.tick
        self.tick = tick
        for name, vehicle in self.vehicles.items():
            if not ticked and name not in inbox:
                continue
            for link, frames in vehicle.step_links(now_s, inbox.get(name, {})).items():
                if frames:
                    for endpoint in self.endpoints:
                        endpoint.send(name, link, frames)

    def wait_s(self) -> float:
        """Real time until the vehicles' next tick."""
        since_s = self.clock() - self.left_out_s - self.first_s
        return (TICK_S - since_s % TICK_S) / self.speed + _LATE_S


def run(
    vehicles: Mapping[str, Stepped],
    endpoints: Sequence[Endpoint],
    clock: Clock,
    stop: Callable[[Collection[int]], bool],
    watched: Sequence[int] = (),
    speed: float = 1.0,
) -> None:
    """Run until `stop` is true.

    Args:
        vehicles: Vehicles by name.
        endpoints: Their endpoints.
        clock: Monotonic seconds, which run `speed` times as fast as real time.
        stop: Called after every wake with the readable file descriptors.
        watched: More file descriptors that wake the loop; `stop` reads them.
        speed: Speed of the clock.
    """
    loop = Loop(vehicles, endpoints, clock, speed)
    ready: Collection[int] = ()
    while not stop(ready):
        loop.cycle(ready)
        filenos = (endpoint.filenos() for endpoint in endpoints)
        sources = [*watched, *chain.from_iterable(filenos)]
        # Not poll: too coarse for 100 Hz
        ready, _, _ = select.select(sources, [], [], loop.wait_s())
