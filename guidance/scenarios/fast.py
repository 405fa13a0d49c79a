"""The virtual-time world: both mock vehicles stepped in this process, whole MAVLink frames handed to and fro."""

from collections.abc import Sequence

from guidance.links import MemoryWire
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.links.tap import Passed, TappedWire
from guidance.links.targets.global_position import GlobalPositionInt
from guidance.links.targets.mavlink_source import MavlinkTarget
from guidance.scenarios.fleet import EVADER_ID, PURSUER_ID, MockSpec, mock_specs
from guidance.scenarios.model import Scenario
from guidance.service.clock import Clock
from sitl_mock.vehicle import MockVehicle
from sitl_mock.world import Home

READY_AFTER_S = 3.0
"""The mocks' boot is cut short: nobody watches it."""


class FastWorld:
    """Both vehicles in one process. `advance` steps them to the clock's present."""

    def __init__(self, scenario: Scenario, clock: Clock) -> None:
        self._clock = clock
        pursuer_spec, evader_spec = mock_specs(scenario)
        self._pursuer = _Mock(scenario, pursuer_spec, clock)
        self._evader = _Mock(scenario, evader_spec, clock)
        self._wires = (self._pursuer.wire, self._evader.wire)
        self.pursuer = PymavlinkLink(self._pursuer.wire, clock.now_s, system_id=PURSUER_ID)
        self.evader = PymavlinkLink(self._evader.wire, clock.now_s, system_id=EVADER_ID)
        self.target = MavlinkTarget(self._evader.listener(), GlobalPositionInt(), system_id=EVADER_ID)

    def advance(self) -> None:
        """Step both vehicles."""
        now_s = self._clock.now_s()
        self._pursuer.advance(now_s)
        self._evader.advance(now_s)

    def drain(self) -> Sequence[Passed]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for wire in self._wires for passed in wire.drain()]

    def close(self) -> None:
        """Close the wires."""
        self.pursuer.close()
        self.evader.close()
        self.target.close()


class _Mock:
    """One vehicle and the wires that lead to it."""

    def __init__(self, scenario: Scenario, spec: MockSpec, clock: Clock) -> None:
        site = scenario.site
        self._vehicle = MockVehicle(
            spec.flavour,
            system_id=spec.system_id,
            home=Home(site.latitude_deg, site.longitude_deg, site.altitude_amsl_m),
            start_ned=spec.start_ned_m,
            yaw_deg=spec.yaw_deg,
            seed=scenario.seed,
            parameters=spec.parameters,
            ready_after_s=READY_AFTER_S,
        )
        self._clock = clock
        ours, self._end = MemoryWire.pair(clock.now_s)
        self.wire = TappedWire(ours, clock.now_s, spec.name)
        self._listeners: list[MemoryWire] = []

    def listener(self) -> MemoryWire:
        """Return one more wire that hears the vehicle."""
        ours, end = MemoryWire.pair(self._clock.now_s)
        self._listeners.append(end)
        return ours

    def advance(self, now_s: float) -> None:
        """Hand the vehicle what was sent to it, and everybody what it says."""
        heard = [frame for _, frame in self._end.receive()]
        for frame in self._vehicle.step(now_s, heard):
            for end in (self._end, *self._listeners):
                end.send(frame)
