"""The mock stepped in this process, by the clock of the flight: whole MAVLink frames are handed to and fro."""

from collections.abc import Sequence
from typing import Final

from guidance.clock import Clock
from guidance.frames import Enu
from guidance.links import Wire
from guidance.links.evaders.carriers import GLOBAL_POSITION
from guidance.links.evaders.mavlink import MavlinkEvader
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.wires.base import MemoryWire, TappedWire
from guidance.links.world import World
from guidance.sim.evader_pilot import EvaderPilot
from guidance.sim.mock_files import faulted_fleet, faults_after
from guidance.sim.scenario import EVADER, EVADER_ID, Flown, Scenario, pursuits_of
from sitl_mock.faults import Faulted

_ON_THE_WAY_S: Final = 0.02
"""Time from sending a frame until the vehicle takes it: a cycle of the loop."""


class SteppedMock:
    """One vehicle, which hears and is heard over any number of wires; `ends` are their far ends."""

    def __init__(self, vehicle: Faulted, clock: Clock) -> None:
        self._vehicle = vehicle
        self._clock = clock
        self.ends = list[Wire]()

    def wire(self) -> Wire:
        """Return one more wire to the vehicle."""
        ours, end = MemoryWire.pair(self._clock.now_s)
        self.ends.append(end)
        return ours

    def advance(self, now_s: float) -> None:
        """Step the vehicle with the frames sent to it, and send its frames to all wires."""
        packets = [packet for end in self.ends for packet in end.receive()]
        received = [frame for _, frame in packets]
        frames: list[bytes] = []
        arrived_s = max((sent_s for sent_s, _ in packets), default=now_s) + _ON_THE_WAY_S
        if arrived_s < now_s - 0.5 * _ON_THE_WAY_S:
            # The loop stood still. Frames that it sent before have arrived then, not only now.
            frames += self._vehicle.step(arrived_s, received)
            received = []
        frames += self._vehicle.step(now_s, received)
        for end in self.ends:
            for frame in frames:
                end.send(frame)


class SteppedWorld(World):
    """The world of virtual time: all players in one process. `advance` steps them to the clock's present.

    Attributes:
        faulted: The vehicles of all players with their faults, by name; more may be injected.
        vehicles: The same without.

    Raises:
        ConfigError: If a fault of the scenario is none that its vehicle can have.
    """

    real_time = False

    def __init__(self, scenario: Flown, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._pursuits = pursuits_of(scenario)
        self.faulted = faulted_fleet(scenario)
        self.vehicles = {name: faulted.vehicle for name, faulted in self.faulted.items()}
        self._mocks = {name: SteppedMock(faulted, clock) for name, faulted in self.faulted.items()}
        chased = {evader: scenario for scenario, _, evader in reversed(self._pursuits)}
        for name, vehicle in self.vehicles.items():
            # an evader's own reports: its pursuers read them, its pilot does not
            unread = frozenset({"GLOBAL_POSITION_INT"} if name in chased else ())
            self.taps.append(TappedWire(self._mocks[name].wire(), clock.now_s, name))
            self.links[name] = PymavlinkLink(
                self.taps[-1], clock.now_s, system_id=vehicle.system_id, unread=unread
            )
        self.players |= {
            name: EvaderPilot(self.links.pop(name), scenario) for name, scenario in chased.items()
        }
        for pursuer in self.links:
            self.evaders[pursuer] = {
                name: MavlinkEvader(
                    self._mocks[name].wire(),
                    GLOBAL_POSITION,
                    system_id=self.vehicles[name].system_id,
                )
                for name in self.players
            }

    def wire(self, player: str) -> Wire:
        """Return one more wire to a player, for another program."""
        return self._mocks[player].wire()

    def advance(self) -> None:
        """Step all vehicles."""
        for mock in self._mocks.values():
            mock.advance(self._clock.now_s())

    def engage(self, vehicle: str) -> None:
        """Put the faults of a vehicle's game in place that count from its engagement."""
        for name, keys in faults_after(
            [pursuit for pursuit in self._pursuits if pursuit.vehicle == vehicle], "engaged"
        ):
            self.faulted[name].inject(keys)


class EvaderHere(EvaderPilot):
    """The evader of a flight whose vehicle is not ours, stepped from the run's own loop.

    It is the rover of mocked flights, and reports as a real evader would: the service receives its MAVLink frames, and
    its TIMESYNC is answered too.

    Args:
        scenario: Its play and its place on Earth, and faults of its own only.
        clock: The run's.
        radio: For its reports and TIMESYNC.
    """

    def __init__(self, scenario: Scenario, clock: Clock, radio: Wire) -> None:
        self._faulted = faulted_fleet(scenario)[EVADER]
        self._later = [keys for _, keys in faults_after(scenario, "engaged")]
        self._mock = SteppedMock(self._faulted, clock)
        super().__init__(
            PymavlinkLink(self._mock.wire(), clock.now_s, system_id=EVADER_ID), scenario
        )
        self._mock.ends.append(radio)

    def step(self, now_s: float, pursuers_game_m: Sequence[Enu], *, playing: bool) -> None:
        """Step the rover and its pilot; when the game begins, put the faults in place that count from then."""
        while playing and self._later:
            self._faulted.inject(self._later.pop(0))
        self._mock.advance(now_s)
        super().step(now_s, pursuers_game_m, playing=playing)
