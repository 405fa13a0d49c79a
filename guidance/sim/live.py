"""The real-time world: the mock autopilot as a child process, over Zenoh or UDP on loopback."""

import contextlib
import json
import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.links.evaders import GlobalPositionInt, MavlinkEvader
from guidance.links.opening import open_link, open_wire
from guidance.links.port import EvaderSource, VehicleLink, Wire
from guidance.links.wires.shared import CapturedFrame, TappedWire, share
from guidance.links.wires.zenoh import ZenohWire, open_session
from guidance.sim.mock_files import check_faults, faults_after, fleet, script
from guidance.sim.players import EvaderPilot, evader_settings
from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, PURSUER_ID, Scenario
from sitl_mock.child import RunningFleet, running
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.errors import TransportError

ZENOH: Final = "zenoh"
UDP: Final = "udp"
OVER: Final = (ZENOH, UDP)
"""Transports to the vehicles."""

_ANSWER_LIMIT_S: Final = 2.0


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
            check_faults(scenario)
            self._mock = _mock(self._closing, scenario, over, port)
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
        try:
            self._mock.check()
        except TransportError as error:
            raise LinkError(f"{error}; the record holds everything until then") from error

    def engage(self) -> None:
        """Put the faults in place that count from engagement."""
        if faults := list(faults_after(self._scenario, "engaged")):
            # on its own thread: the loop must not wait
            threading.Thread(target=_inject, args=(self._mock[PURSUER].zenoh, faults)).start()

    def drain(self) -> Sequence[CapturedFrame]:
        """All frames that passed since the last call, of one vehicle after the other."""
        return [passed for tap in self._taps for passed in tap.drain()]

    def close(self) -> None:
        """Close the links, then end the child."""
        self._closing.close()

    def _wire(self, name: str) -> Wire:
        vehicle = self._mock[name]
        if vehicle.udp_port is not None:
            return open_wire(vehicle.udp, clock=self._clock.now_s)
        return ZenohWire(self._clock.now_s, namespace=name, endpoint=vehicle.zenoh or "")

    def _wires(self, name: str) -> tuple[Wire, Wire]:
        """Return two wires to one vehicle; a UDP port can be opened only once."""
        if self._mock[name].udp_port is not None:
            one, other = share(self._wire(name), 2)
            return one, other
        return self._wire(name), self._wire(name)

    def _open_link(self, kind: str, bare: Wire, name: str, system_id: int) -> VehicleLink:
        now_s = self._clock.now_s
        wire = TappedWire(bare, now_s, name)
        self._taps.append(wire)
        link = open_link(wire, kind, system_id=system_id, clock=now_s, who=f"the mock's {name}", timeout_s=5.0)
        self._closing.callback(link.close)
        return link


def _mock(closing: contextlib.ExitStack, scenario: Scenario, over: str, port: int) -> RunningFleet:
    """Start the mock; the stack ends it. Its Zenoh session is there over UDP too: faults are injected by it."""
    tables = fleet(scenario)
    started = running(
        tables.pop("vehicle"),
        over=(UDP, ZENOH) if over == UDP else (ZENOH,),
        faults=script(scenario),
        port=port,
        **tables,
    )
    try:
        return closing.enter_context(started)
    except MockConfigError as error:
        raise ConfigError(f"the mock autopilot did not start: {error}") from error
    except TransportError as error:
        hint = "; choose another with --port, or --port 0 for a free one" if port else ""
        raise LinkError(f"the mock autopilot did not start: {error}{hint}") from error


def _inject(endpoint: str, faults: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    session = open_session(endpoint)
    try:
        for name, keys in faults:
            for _ in session.get(
                f"{name}/faults", payload=json.dumps({"do": "inject", **keys}), timeout=_ANSWER_LIMIT_S
            ):
                pass  # they were checked before the start
    finally:
        session.close()  # type: ignore[no-untyped-call]
