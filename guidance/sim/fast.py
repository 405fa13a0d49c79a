"""The virtual-time world: both mock vehicles stepped in this process, whole MAVLink frames handed to and fro."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from guidance.clock import Clock
from guidance.links.evaders.mavlink import GlobalPositionInt, MavlinkEvader
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.wires.shared import Passed
from guidance.sim.faulting import faulted_fleet, faults_after
from guidance.sim.fleet import EVADER, EVADER_ID, PURSUER, PURSUER_ID
from guidance.sim.scenario import Scenario
from guidance.sim.stepped import SteppedMock

if TYPE_CHECKING:
    from guidance.links.port import EvaderSource, VehicleLink


class FastWorld:
    """Both vehicles in one process. `advance` steps them to the clock's present.

    Raises:
        ConfigError: If a fault of the scenario is none that its vehicle can have.
    """

    def __init__(self, scenario: Scenario, clock: Clock) -> None:
        self._clock = clock
        self._scenario = scenario
        self._faulted = faulted_fleet(scenario)
        self.vehicles = {name: faulted.vehicle for name, faulted in self._faulted.items()}
        self._mocks = {name: SteppedMock(name, faulted, clock) for name, faulted in self._faulted.items()}
        pursuer, evader = self._mocks[PURSUER], self._mocks[EVADER]
        self.pursuer: VehicleLink = PymavlinkLink(pursuer.wire, clock.now_s, system_id=PURSUER_ID)
        self.evader: VehicleLink = PymavlinkLink(evader.wire, clock.now_s, system_id=EVADER_ID)
        self.evader_source: EvaderSource = MavlinkEvader(evader.listener(), GlobalPositionInt(), system_id=EVADER_ID)

    def advance(self) -> None:
        """Step both vehicles."""
        now_s = self._clock.now_s()
        for mock in self._mocks.values():
            mock.advance(now_s)

    def engage(self) -> None:
        """Put the faults in place that count from engagement."""
        for name, keys in faults_after(self._scenario, "engaged"):
            self._faulted[name].inject(keys)

    def drain(self) -> Sequence[Passed]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for mock in self._mocks.values() for passed in mock.wire.drain()]

    def close(self) -> None:
        """Close the wires."""
        self.pursuer.close()
        self.evader.close()
        self.evader_source.close()
