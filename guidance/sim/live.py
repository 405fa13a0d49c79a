"""The real-time world: the mock autopilot as a child process, over Zenoh or UDP on loopback."""

import contextlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from guidance.clock import Clock
from guidance.links.evaders.mavlink import GlobalPositionInt, MavlinkEvader
from guidance.links.opening import link_over, open_wire
from guidance.links.port import EvaderSource, VehicleLink, Wire
from guidance.links.wires.shared import Passed, TappedWire, share
from guidance.links.wires.zenoh import ZenohWire
from guidance.sim.evader import EvaderPilot
from guidance.sim.faulting import check_faults, faults_after
from guidance.sim.fleet import EVADER, EVADER_ID, PURSUER, PURSUER_ID
from guidance.sim.mock_process import ZENOH, MockProcess
from guidance.sim.players import evader_settings
from guidance.sim.scenario import Scenario


class LiveWorld:
    """Both vehicles in a child process, reached over Zenoh or UDP.

    Raises:
        ConfigError: If the mock refuses its configuration.
        LinkError: If the mock cannot start (the port is in use, say), or cannot be heard.
    """

    real_time: Final = True

    def __init__(self, scenario: Scenario, clock: Clock, *, link: str, port: int, over: str = ZENOH) -> None:
        self._clock = clock
        self._scenario = scenario
        self._taps: list[TappedWire] = []
        self._closing = contextlib.ExitStack()
        try:
            folder = Path(self._closing.enter_context(tempfile.TemporaryDirectory(prefix="guidance-")))
            check_faults(scenario)
            self._mock = MockProcess(folder, scenario, over, port)
            self._closing.callback(self._mock.stop)
            commands, reports = self._wires(EVADER)
            self.link = self._open_link(link, self._wire(PURSUER), PURSUER, PURSUER_ID)
            rover = self._open_link("pymavlink", commands, EVADER, EVADER_ID)
            self.player = EvaderPilot(rover, evader_settings(scenario))
            self.evader_source: EvaderSource = MavlinkEvader(reports, GlobalPositionInt(), system_id=EVADER_ID)
            self._closing.callback(self.evader_source.close)
        except BaseException:
            self.close()
            raise

    def advance(self) -> None:
        """See that the mock lives: time moves by itself.

        Raises:
            LinkError: If it has ended.
        """
        self._mock.check()

    def engage(self) -> None:
        """Put the faults in place that count from engagement."""
        if faults := list(faults_after(self._scenario, "engaged")):
            self._mock.inject(faults)

    def drain(self) -> Sequence[Passed]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for tap in self._taps for passed in tap.drain()]

    def close(self) -> None:
        """Close the links, then end the child."""
        self._closing.close()

    def _wire(self, name: str) -> Wire:
        if name in self._mock.udp:
            return open_wire(f"udpin://127.0.0.1:{self._mock.udp[name]}", clock=self._clock.now_s)
        return ZenohWire(self._clock.now_s, namespace=name, endpoint=self._mock.endpoint)

    def _wires(self, name: str) -> tuple[Wire, Wire]:
        """Two for one vehicle; a UDP port can be had once only."""
        if name in self._mock.udp:
            one, other = share(self._wire(name), 2)
            return one, other
        return self._wire(name), self._wire(name)

    def _open_link(self, kind: str, bare: Wire, name: str, system_id: int) -> VehicleLink:
        now_s = self._clock.now_s
        wire = TappedWire(bare, now_s, name)
        self._taps.append(wire)
        link = link_over(wire, kind, system_id=system_id, clock=now_s, who=f"the mock's {name}", timeout_s=5.0)
        self._closing.callback(link.close)
        return link
