"""The mock stepped in this process, by the clock of the flight: whole MAVLink frames are handed to and fro."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from guidance.clock import Clock
from guidance.frames import Vector
from guidance.links import Wire
from guidance.links.carriers import GlobalPositionInt
from guidance.links.mavlink_evader import MavlinkEvader
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.wires import CapturedFrame, raw_keys
from guidance.sim.evader_pilot import EvaderPilot
from guidance.sim.mock_files import faulted_fleet, faults_after, system_ids
from guidance.sim.scenario import EVADER, Flown, Scenario, pursuits_of
from sitl_mock.faults import Faulted

if TYPE_CHECKING:
    from guidance.links.port import EvaderSource, VehicleLink


_REPORTS: Final = frozenset({"GLOBAL_POSITION_INT"})
"""An evader's own reports, which its pursuers read and its pilot does not."""


_captured: Final = partial(tuple.__new__, CapturedFrame)
"""Makes a captured frame from its values in half the time."""


class SteppedWire:
    """Our end of a wire to a stepped vehicle, without queues and locks: everything happens in one thread."""

    stream: Final = False

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send, self._arrived = send, list[tuple[float, bytes]]()
        self._sent, self._closed = 0, False

    def arrive(self, packets: Sequence[tuple[float, bytes]]) -> None:
        """Take frames of the vehicle, with their time."""
        if not self._closed:
            self._arrived += packets

    def receive(self) -> Sequence[tuple[float, bytes]]:
        """Return the frames since the last call."""
        arrived, self._arrived = self._arrived, []
        return arrived

    def impostors(self) -> Sequence[bytes]:
        """Return none: this wire has no addresses."""
        return ()

    def wait(self, timeout_s: float) -> None:
        """Return at once: nothing arrives before the vehicle is stepped."""

    def send(self, frame: bytes) -> None:
        """Send one frame."""
        if not self._closed:
            self._sent += 1
            self._send(frame)

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were sent."""
        return {"wire_sent": self._sent, "wire_unsent": 0, "wire_dropped": 0}

    def close(self) -> None:
        """Send and receive no more."""
        self._closed = True


class SteppedMock:
    """One vehicle. `wire` commands and hears it; who only listens may be given a wire of their own."""

    def __init__(self, name: str, vehicle: Faulted, clock: Clock) -> None:
        self._vehicle, self._clock, (self._to, self._from) = vehicle, clock, raw_keys(name)
        self._sent, self._captured = list[bytes](), list[CapturedFrame]()
        self._wires, self._ends = list[SteppedWire](), list[Wire]()
        self.wire = self.listener()

    def listener(self) -> SteppedWire:
        """Return one more wire that hears the vehicle."""
        wire = SteppedWire(self._send)
        self._wires.append(wire)
        return wire

    def join(self, end: Wire) -> None:
        """Connect the far end of any other wire to the vehicle; its frames are not captured."""
        self._ends.append(end)

    def advance(self, now_s: float) -> None:
        """Step the vehicle with the frames sent to it, and send its frames to all wires."""
        heard, self._sent = self._sent, []
        for end in self._ends:
            heard += [frame for _, frame in end.receive()]
        frames = self._vehicle.step(now_s, heard)
        if not frames:
            return
        packets = [(now_s, frame) for frame in frames]
        for wire in self._wires:
            wire.arrive(packets)
        for end in self._ends:
            for frame in frames:
                end.send(frame)
        self._captured += [_captured((now_s, self._from, frame)) for frame in frames]

    def drain(self) -> Sequence[CapturedFrame]:
        """Return the frames in both directions since the last call, for the record."""
        captured, self._captured = self._captured, []
        return captured

    def _send(self, frame: bytes) -> None:
        self._sent.append(frame)
        self._captured.append(_captured((self._clock.now_s(), self._to, frame)))


class SteppedWorld:
    """The world of virtual time: all players in one process. `advance` steps them to the clock's present.

    Attributes:
        faulted: The vehicles of all players with their faults, by name; more may be injected.
        vehicles: The same without.
        links: To the pursuing vehicles, by name.
        evaders: What each pursuing vehicle hears: by its name, the sources of all evaders by theirs.
        players: The evaders' pilots, by name.

    Raises:
        ConfigError: If a fault of the scenario is none that its vehicle can have.
    """

    real_time: Final = False

    def __init__(self, flown: Flown, clock: Clock) -> None:
        self._clock, self._pursuits, ids = clock, pursuits_of(flown), system_ids(flown)
        self.faulted = faulted_fleet(flown)
        self.vehicles = {name: faulted.vehicle for name, faulted in self.faulted.items()}
        self._mocks = {name: SteppedMock(name, faulted, clock) for name, faulted in self.faulted.items()}
        chased = {evader: scenario for scenario, _, evader in reversed(self._pursuits)}
        unread = {name: _REPORTS if name in chased else frozenset() for name in self._mocks}
        self._own = {
            name: PymavlinkLink(mock.wire, clock.now_s, system_id=ids[name], unread=unread[name])
            for name, mock in self._mocks.items()
        }
        self.links: dict[str, VehicleLink] = {one.vehicle: self._own[one.vehicle] for one in self._pursuits}
        self.players = {name: EvaderPilot(self._own[name], scenario) for name, scenario in chased.items()}
        self.evaders: dict[str, dict[str, EvaderSource]] = {
            vehicle: {
                name: MavlinkEvader(self._mocks[name].listener(), GlobalPositionInt(), system_id=ids[name])
                for name in self.players
            }
            for vehicle in self.links
        }

    def advance(self) -> None:
        """Step all vehicles."""
        now_s = self._clock.now_s()
        for mock in self._mocks.values():
            mock.advance(now_s)

    def engage(self, vehicle: str) -> None:
        """Put the faults of a vehicle's game in place that count from its engagement."""
        for name, keys in faults_after([one for one in self._pursuits if one.vehicle == vehicle], "engaged"):
            self.faulted[name].inject(keys)

    def drain(self) -> Sequence[CapturedFrame]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for mock in self._mocks.values() for passed in mock.drain()]

    def close(self) -> None:
        """Close the wires."""
        for link in self._own.values():
            link.close()
        for source in (source for heard in self.evaders.values() for source in heard.values()):
            source.close()


class EvaderHere(EvaderPilot):
    """The evader of a flight whose vehicle is not ours, stepped from the run's own loop.

    It is the rover of mocked flights, and reports over UDP as a real evader would: what the service hears are its
    MAVLink frames on a loopback port, where its TIMESYNC is answered too.

    Args:
        scenario: Its play and its place on Earth.
        clock: The run's.
        radio: For its reports and TIMESYNC; closed with it.
    """

    def __init__(self, scenario: Scenario, clock: Clock, radio: Wire) -> None:
        self._scenario, self._radio, self._faulted = scenario, radio, faulted_fleet(scenario)[EVADER]
        self._mock = SteppedMock(EVADER, self._faulted, clock)
        self._mock.join(radio)
        self._own = PymavlinkLink(self._mock.wire, clock.now_s, system_id=system_ids(scenario)[EVADER])
        super().__init__(self._own, scenario)

    def step(self, now_s: float, pursuers_game_m: Sequence[Vector], *, playing: bool) -> None:
        """Step the rover and its pilot."""
        self._mock.advance(now_s)
        self._mock.drain()  # the rover's own link is not recorded
        super().step(now_s, pursuers_game_m, playing=playing)

    def engage(self) -> None:
        """Put the evader's faults in place that count from engagement."""
        for name, keys in faults_after(self._scenario, "engaged"):
            if name == EVADER:
                self._faulted.inject(keys)

    def close(self) -> None:
        """Let go of the wires."""
        self._own.close()
        self._radio.close()
