"""The mock stepped in this process, by the clock of the flight: whole MAVLink frames are handed to and fro."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from guidance.clock import Clock
from guidance.frames import Vector
from guidance.links import MemoryWire, Wire
from guidance.links.evaders import GlobalPositionInt, MavlinkEvader
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.wires.shared import CapturedFrame, TappedWire
from guidance.sim.mock_files import faulted_fleet, faults_after
from guidance.sim.players import EvaderPilot, evader_settings
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, PURSUER_ID, Scenario
from sitl_mock.faults import Faulted

if TYPE_CHECKING:
    from guidance.links.port import EvaderSource, VehicleLink


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
        """Connect another wire to the vehicle."""
        self._ends.append(end)

    def advance(self, now_s: float) -> None:
        """Step the vehicle with the frames sent to it, and send its frames to all wires."""
        heard = [frame for end in self._ends for _, frame in end.receive()]
        for frame in self._vehicle.step(now_s, heard):
            for end in self._ends:
                end.send(frame)


class SteppedWorld:
    """The world of virtual time: both vehicles in one process. `advance` steps them to the clock's present.

    Attributes:
        faulted: The vehicles with their faults, by name; more may be injected.
        vehicles: The same without.

    Raises:
        ConfigError: If a fault of the scenario is none that its vehicle can have.
    """

    real_time: Final = False

    def __init__(self, scenario: Scenario, clock: Clock) -> None:
        self._clock = clock
        self._scenario = scenario
        self.faulted = faulted_fleet(scenario)
        self.vehicles = {name: faulted.vehicle for name, faulted in self.faulted.items()}
        self._mocks = {name: SteppedMock(name, faulted, clock) for name, faulted in self.faulted.items()}
        pursuer, evader = self._mocks[PURSUER], self._mocks[EVADER]
        self.link: VehicleLink = PymavlinkLink(pursuer.wire, clock.now_s, system_id=PURSUER_ID)
        self.evader_link: VehicleLink = PymavlinkLink(evader.wire, clock.now_s, system_id=EVADER_ID)
        self.player = EvaderPilot(self.evader_link, evader_settings(scenario))
        self.evader_source: EvaderSource = MavlinkEvader(evader.listener(), GlobalPositionInt(), system_id=EVADER_ID)

    def advance(self) -> None:
        """Step both vehicles."""
        now_s = self._clock.now_s()
        for mock in self._mocks.values():
            mock.advance(now_s)

    def engage(self) -> None:
        """Put the faults in place that count from engagement."""
        for name, keys in faults_after(self._scenario, "engaged"):
            self.faulted[name].inject(keys)

    def drain(self) -> Sequence[CapturedFrame]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for mock in self._mocks.values() for passed in mock.wire.drain()]

    def close(self) -> None:
        """Close the wires."""
        self.link.close()
        self.evader_link.close()
        self.evader_source.close()


class EvaderHere:
    """The evader of a flight whose vehicle is not ours, stepped from the run's own loop.

    It is the rover of mocked flights, and reports over UDP as a real evader would: what the service hears are its
    MAVLink frames on a loopback port, where its TIMESYNC is answered too.

    Args:
        scenario: Its play and its place on Earth.
        clock: The run's.
        radio: For its reports and TIMESYNC; closed with it.
    """

    def __init__(self, scenario: Scenario, clock: Clock, radio: Wire) -> None:
        self._scenario = scenario
        self._faulted = faulted_fleet(scenario)[EVADER]
        self._mock = SteppedMock(EVADER, self._faulted, clock)
        self._mock.join(radio)
        self._radio = radio
        self._link = PymavlinkLink(self._mock.wire, clock.now_s, system_id=EVADER_ID)
        self._pilot = EvaderPilot(self._link, evader_settings(scenario))

    @property
    def ready(self) -> bool:
        """Armed, guided, and its place on Earth known."""
        return self._pilot.ready

    def position_game_m(self) -> Vector | None:
        """Its own telemetry's position."""
        return self._pilot.position_game_m()

    def step(self, now_s: float, pursuer_game_m: Vector | None, *, playing: bool) -> None:
        """Step the rover and its pilot."""
        self._mock.advance(now_s)
        self._mock.wire.drain()  # the rover's own link is not recorded
        self._pilot.step(now_s, pursuer_game_m, playing=playing)

    def stop(self) -> None:
        """Disarm the rover."""
        self._pilot.stop()

    def engage(self) -> None:
        """Put the evader's faults in place that count from engagement."""
        for name, keys in faults_after(self._scenario, "engaged"):
            if name == EVADER:
                self._faulted.inject(keys)

    def close(self) -> None:
        """Let go of the wires."""
        self._link.close()
        self._radio.close()
