"""The evader of a flight whose vehicle is not ours: simulated here, and reporting over UDP as a real one would.

It is the rover of mocked flights, stepped to the present of the clock. What the service hears of it are its MAVLink
frames on a loopback port, where its TIMESYNC is answered too.
"""

from collections.abc import Sequence
from typing import Protocol

from guidance.clock import Clock
from guidance.frames import Amsl, LocalFrame, Vector, ned_from_game
from guidance.links.port import Wire
from guidance.links.pymavlink_link import PymavlinkLink
from guidance.messages import Home
from guidance.sim.evader import EvaderPilot
from guidance.sim.faulting import faulted_fleet, faults_after
from guidance.sim.fleet import EVADER, EVADER_ID
from guidance.sim.players import evader_settings
from guidance.sim.scenario import Scenario, Site, Wind
from guidance.sim.stepped import SteppedMock


class EvaderPlayer(Protocol):
    """What a run needs of an evader that it plays itself."""

    @property
    def ready(self) -> bool:
        """Whether it can begin to play."""
        ...

    def position_game_m(self) -> Vector | None:
        """Where it is in the game frame, None until it knows."""
        ...

    def step(self, now_s: float, pursuer_game_m: Vector | None, *, playing: bool) -> None:
        """Move on to the present, playing or standing still."""
        ...

    def engage(self) -> None:
        """The game begins: faults that count from engagement do from now on."""
        ...


class EvaderHere:
    """`EvaderPlayer` in this process, stepped from the run's own loop.

    Args:
        scenario: What it plays, and where on Earth.
        clock: The run's.
        radio: Where it reports to, and hears TIMESYNC; closed with it.
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
        """Where its own telemetry has it."""
        return self._pilot.position_game_m()

    def step(self, now_s: float, pursuer_game_m: Vector | None, *, playing: bool) -> None:
        """Step the rover, and let it be told what to do next."""
        self._mock.advance(now_s)
        self._mock.wire.drain()  # nobody records what passes between the rover and who drives it
        self._pilot.step(now_s, pursuer_game_m, playing=playing)

    def engage(self) -> None:
        """Put the evader's faults in place that count from engagement."""
        for name, keys in faults_after(self._scenario, "engaged"):
            if name == EVADER:
                self._faulted.inject(keys)

    def close(self) -> None:
        """Let go of the wires."""
        self._link.close()
        self._radio.close()


def laid_about(scenario: Scenario, home: Home, frame: LocalFrame, autopilot: str) -> Scenario:
    """Return the scenario where the vehicle stands: its home is the scenario's, and the autopilot is its own.

    Faults and wind of the vehicle are a mock's and fall away; those of the evader stay, since it is a mock.
    """
    x, y = scenario.home_m
    home_ned_m = frame.ned_from_wgs84(home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m))
    north_m, east_m, down_m = (at + by for at, by in zip(home_ned_m, ned_from_game((-x, -y, 0.0)), strict=True))
    latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned((north_m, east_m, down_m))
    return scenario.model_copy(
        update={
            "site": Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres),
            "pursuer": scenario.pursuer.model_copy(update={"autopilot": autopilot}),
            "fault": tuple(fault for fault in scenario.fault if fault.vehicle == EVADER),
            "wind": Wind(),
        }
    )


def left_out(scenario: Scenario) -> Sequence[str]:
    """Name what of a scenario a vehicle that is not ours flies without."""
    words = []
    if any(fault.vehicle != EVADER for fault in scenario.fault):
        words.append("faults of the pursuer")
    if any(scenario.wind.velocity_m_s):
        words.append("wind")
    return words
