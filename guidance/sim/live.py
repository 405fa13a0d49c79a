"""The real-time world: the mock autopilot as a child process, over Zenoh or UDP on loopback."""

import contextlib
import json
import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from guidance.clock import Clock
from guidance.errors import ConfigError, LinkError
from guidance.links import opening, world
from guidance.links.evaders import carriers
from guidance.links.evaders import mavlink as mavlink_evader
from guidance.links.port import EvaderSource, VehicleLink, Wire
from guidance.links.wires import base as wires
from guidance.links.zenoh import session as zenoh_session
from guidance.links.zenoh import wire as zenoh_wire
from guidance.sim.evader_pilot import EvaderPilot
from guidance.sim.mock_files import faults_after, fleet, script
from guidance.sim.scenario import Flown, pursuits_of
from sitl_mock.child import RunningFleet, running
from sitl_mock.errors import ConfigError as MockConfigError
from sitl_mock.errors import TransportError

OVER: Final = ("zenoh", "udp")
"""Transports to the vehicles."""


class LiveWorld(world.World):
    """All players in a child process, reached over Zenoh or UDP.

    Raises:
        ConfigError: If the mock refuses its configuration.
        LinkError: If the mock cannot start (the port is in use, say), or cannot be heard.
    """

    def __init__(
        self, flight_scenario: Flown, clock: Clock, *, link: str, port: int, over: str
    ) -> None:
        super().__init__()
        self._clock = clock
        self._pursuits = pursuits_of(flight_scenario)
        self._sources: dict[str, dict[str, EvaderSource]] = {
            pursuit.vehicle: {} for pursuit in self._pursuits
        }
        self.evaders |= self._sources
        with self.closing:
            self._mock = _mock(self.closing, flight_scenario, over, port)
            for scenario, vehicle, evader in self._pursuits:
                self.links[vehicle] = self._open_link(link, self._wires(vehicle, 1)[0], vehicle)
                if evader not in self.players:
                    # The pilot has a link to the evader, and each vehicle its reports.
                    commands, *reports = self._wires(evader, 1 + len(self.evaders))
                    self.players[evader] = EvaderPilot(
                        self._open_link("pymavlink", commands, evader), scenario
                    )
                    for sources, wire in zip(self._sources.values(), reports, strict=True):
                        system_id = self._mock[evader].system_id
                        sources[evader] = mavlink_evader.MavlinkEvader(
                            wire, carriers.GLOBAL_POSITION, system_id=system_id
                        )
                        self.closing.callback(sources[evader].close)
            self.closing = self.closing.pop_all()

    def advance(self) -> None:
        """See that the mock lives: time moves by itself.

        Raises:
            LinkError: If it has ended.
        """
        try:
            self._mock.check()
        except TransportError as error:
            raise LinkError(f"{error}; the record holds everything until then") from error

    def engage(self, vehicle: str) -> None:
        """Put the faults of a vehicle's game in place that count from its engagement."""
        if faults := list(
            faults_after(
                [pursuit for pursuit in self._pursuits if pursuit.vehicle == vehicle], "engaged"
            )
        ):
            # on its own thread: the loop must not wait
            threading.Thread(target=_inject, args=(self._mock[vehicle].zenoh, faults)).start()

    def _wires(self, name: str, readers: int) -> Sequence[Wire]:
        """Return wires to one vehicle; a UDP port can be opened only once."""
        vehicle = self._mock[name]
        now_s = self._clock.now_s
        if vehicle.udp_port is not None:
            return wires.share(opening.open_wire(vehicle.udp, clock=now_s), readers)
        return [
            zenoh_wire.ZenohWire(
                now_s,
                zenoh_session.open_session("" if vehicle.zenoh is None else vehicle.zenoh),
                name,
            )
            for _ in range(readers)
        ]

    def _open_link(self, kind: str, bare: Wire, name: str) -> VehicleLink:
        now_s = self._clock.now_s
        vehicle_words = f"the mock's {name}"
        system_id = self._mock[name].system_id
        self.taps.append(wires.TappedWire(bare, now_s, name))
        link = opening.open_link(
            self.taps[-1], kind, system_id=system_id, clock=now_s, who=vehicle_words, timeout_s=5.0
        )
        self.closing.callback(link.close)
        return link


def _mock(closing: contextlib.ExitStack, scenario: Flown, over: str, port: int) -> RunningFleet:
    """Start the mock; the stack ends it. Its Zenoh session is there over UDP too: faults are injected by it."""
    tables = fleet(scenario)
    faults = script(scenario)
    vehicles = tables.pop("vehicle")
    mock = running(
        vehicles,
        over=("udp", "zenoh") if over == "udp" else ("zenoh",),
        faults=faults,
        port=port,
        **tables,
    )
    try:
        return closing.enter_context(mock)
    except MockConfigError as error:
        raise ConfigError(f"the mock autopilot did not start: {error}") from error
    except TransportError as error:
        hint = "; choose another with --port, or --port 0 for a free one" if port else ""
        raise LinkError(f"the mock autopilot did not start: {error}{hint}") from error


def _inject(endpoint: str, faults: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    with zenoh_session.open_session(endpoint) as session:
        for name, keys in faults:  # they were checked before the start
            order = json.dumps({"do": "inject", **keys})
            list(session.get(f"{name}/faults", payload=order, timeout=2.0))
