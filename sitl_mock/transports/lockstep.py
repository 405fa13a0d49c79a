"""A fleet whose time belongs to its clients: a vehicle advances only when a client asks for the next step.

The protocol is on the page about the mock (docs/mock.md, Lockstep). A step is COMMAND_LONG 31010 (MAV_CMD_USER_1):
param1 seconds, param2 the step's number. The vehicle advances, sends everything that is due, and last the COMMAND_ACK
with the number in result_param2.
"""

from __future__ import annotations

import math
import select
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple

from sitl_mock.mavlink import Decoder
from sitl_mock.protocols import Result

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from sitl_mock.faults import Faulted
    from sitl_mock.mavlink import Message
    from sitl_mock.transports.loop import Endpoint

STEP: Final = 31010
"""MAV_CMD_USER_1."""
LONGEST_S: Final = 1.0
"""What a step of this length sends fits into the buffer of a socket, so nothing of it is lost."""
HELLO_S: Final = 0.2
"""The first frames are repeated this often (real time) until a client is heard."""
_GRID_US: Final = 10_000
_COMMAND_LONG: Final = 76
_V1 = 0xFE
_V2 = 0xFD
_MARKS: Final = (bytes((_V1,)), bytes((_V2,)))


class _Step(NamedTuple):
    """A step that a client asks for: its length, its number, and the client's ids."""

    length_us: int | None
    number: int
    client: tuple[int, int]


@dataclass(slots=True)
class _Vehicle:
    """One vehicle's own time (µs) and its last step."""

    faulted: Faulted
    now_us: int = 0
    number: int | None = None
    hello: dict[str, list[bytes]] = field(default_factory=dict)
    heard: bool = False


class Lockstep:
    """The vehicles of a fleet, each with its own time, which begins at 0.

    Args:
        vehicles: Vehicles by name.
        endpoints: Their endpoints.
    """

    def __init__(self, vehicles: Mapping[str, Faulted], endpoints: Sequence[Endpoint]) -> None:
        self._endpoints = endpoints
        self._vehicles = {name: _Vehicle(faulted) for name, faulted in vehicles.items()}
        for vehicle in self._vehicles.values():
            vehicle.hello = vehicle.faulted.step_links(0.0, {})

    def say_hello(self) -> None:
        """Repeat the first frames of vehicles that have not heard a client yet."""
        for name, vehicle in self._vehicles.items():
            if not vehicle.heard:
                self._send(name, vehicle.hello)

    def cycle(self, ready: Collection[int] | None = None) -> None:
        """Take everything that has arrived, frame by frame, and advance where a frame asks for a step.

        Args:
            ready: Readable file descriptors; other endpoints are skipped. None reads all.
        """
        for endpoint in self._endpoints:
            if ready is not None and not any(fileno in ready for fileno in endpoint.filenos()):
                continue
            for arrival in endpoint.receive():
                vehicle = self._vehicles[arrival.vehicle]
                # A program over PX4's topics is no client that could ask for a step.
                vehicle.heard |= arrival.data[:1] in _MARKS
                faulted = vehicle.faulted
                for frame in frames_of(arrival.data):
                    step = _step(frame, faulted.vehicle.system_id)
                    if step is None:
                        now_s = vehicle.now_us * 1e-6
                        answers = faulted.step_links(now_s, {arrival.link: [frame]})
                        self._send(arrival.vehicle, answers)
                        continue
                    result = Result.DENIED
                    if step.length_us is not None:
                        result = Result.ACCEPTED
                        # A repeated request is answered, and not flown again.
                        if step.number != vehicle.number:
                            self._advance(arrival.vehicle, vehicle, step.length_us)
                            vehicle.number = step.number
                    answer = ("COMMAND_ACK", STEP, int(result), 0, step.number, *step.client)
                    frames = faulted.vehicle.links[arrival.link].pack([answer])
                    self._send(arrival.vehicle, {arrival.link: frames})

    def _advance(self, name: str, vehicle: _Vehicle, length_us: int) -> None:
        """Advance on the vehicle's grid, so that a step of many ticks sends what small steps would send."""
        end_us = vehicle.now_us + length_us
        due: dict[str, list[bytes]] = {}
        while vehicle.now_us < end_us:
            vehicle.now_us += _GRID_US
            for link, frames in vehicle.faulted.step_links(vehicle.now_us * 1e-6, {}).items():
                due.setdefault(link, []).extend(frames)
        self._send(name, due)

    def _send(self, name: str, frames: Mapping[str, Sequence[bytes]]) -> None:
        for link, each in frames.items():
            if each:
                for endpoint in self._endpoints:
                    endpoint.send(name, link, each)


def frames_of(data: bytes) -> Iterator[bytes]:
    """Yield the frames of a datagram; bytes that begin none are yielded together, for the decoder to count."""
    at = 0
    while at < len(data):
        size = len(data) - at
        if data[at] == _V2 and size > 2:
            size = data[at + 1] + (25 if data[at + 2] & 1 else 12)
        elif data[at] == _V1 and size > 1:
            size = data[at + 1] + 8
        yield data[at : at + size]
        at += size


def _step(frame: bytes, system_id: int) -> _Step | None:
    """Return the step that a frame asks this vehicle for; None for every other frame."""
    # Only COMMAND_LONG asks for a step; other frames are not worth decoding.
    number = -1
    if frame[0] == _V2 and len(frame) > 9:
        number = int.from_bytes(frame[7:10], "little")
    elif frame[0] == _V1 and len(frame) > 5:
        number = frame[5]
    if number != _COMMAND_LONG:
        return None
    messages: list[Message] = Decoder().feed(frame, whole=True)
    if not messages or messages[0].command != STEP:
        return None
    (message,) = messages
    if message.target_system not in {0, system_id}:
        return None
    length_s = message.param1
    number = int(message.param2) if math.isfinite(message.param2) else 0
    client = (message.get_srcSystem(), message.get_srcComponent())
    if not 0.0 < length_s <= LONGEST_S or not abs(message.param2) < 2**24:
        return _Step(None, 0, client)
    return _Step(max(round(length_s * 1e6 / _GRID_US), 1) * _GRID_US, number, client)


def run_lockstep(
    vehicles: Mapping[str, Faulted],
    endpoints: Sequence[Endpoint],
    stop: Callable[[Collection[int]], bool],
    watched: Sequence[int] = (),
) -> None:
    """Run until `stop` is true; without a client's steps, time stands still.

    Args:
        vehicles: Vehicles by name.
        endpoints: Their endpoints.
        stop: Called after every wake with the readable file descriptors.
        watched: More file descriptors that wake the loop; `stop` reads them.
    """
    lockstep = Lockstep(vehicles, endpoints)
    ready: Collection[int] = ()
    while not stop(ready):
        lockstep.cycle(ready)
        filenos = (endpoint.filenos() for endpoint in endpoints)
        sources = [*watched, *chain.from_iterable(filenos)]
        ready, _, _ = select.select(sources, [], [], HELLO_S)
        if not ready:
            lockstep.say_hello()
