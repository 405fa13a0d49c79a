"""One chase in virtual time: the daemon's own cycle, a mock autopilot, and an evader that has full speed at once.

The evader is a point mass, and its reports need no wire; this saves processor time.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from random import Random
from typing import Any

from guidance.clock import VirtualClock
from guidance.cycle import Alarm, Certificate
from guidance.flight import Event, Flight, FlightSettings, Outputs, State
from guidance.flight.settings import AfterCapture
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.links import MemoryWire
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.messages import EvaderReport, Setpoint
from guidance.session.fly.loop import PERIOD_S
from guidance.session.plan import plan_of
from guidance.sim.scenario import Scenario, Target
from guidance.sim.scenario_file import load_scenario
from sitl_mock.vehicle.mock_vehicle import MockVehicle
from sitl_mock.world import Home
from tests.harness.linked import FlownByHand
from tests.harness.sortie import Sortie

REPORT_S = 0.1
POSITION_SD_M = 0.05
VELOCITY_SD_M_S = 0.03
SETTLED_S = 2.0
LONGEST_S = 90.0

_FAR_S = 60.0
"""`Runner.run` sets a goal so far ahead that it is not reached before the next call."""

HOVER_S = 6.0
"""Time between the climb and the chase, as with an operator; PX4 overestimates the hover thrust after a climb."""
ORDERS = {State.READY: (Event.START,), State.STANDING_BY: (Event.ENGAGE,)}


def hover_chase(
    autopilot: str,
    *,
    seed: int,
    speeds_m_s: tuple[float, float] = (6.0, 3.0),
    target_m: tuple[float, float] | None = None,
) -> Scenario:
    """Return the measured scenario for an autopilot, the speeds of pursuer and evader, and the target in TAD."""
    scenario = load_scenario("hover_chase")[1]
    pursuer = scenario.pursuer.model_copy(
        update={"autopilot": autopilot, "speed_m_s": speeds_m_s[0]}
    )
    evader = scenario.evader.model_copy(update={"speed_m_s": speeds_m_s[1]})
    game = {} if target_m is None else {"game": "tad", "target": Target(position_m=target_m)}
    return scenario.model_copy(update={"pursuer": pursuer, "evader": evader, "seed": seed, **game})


class Runner:
    """The evader, an `EvaderSource`: stands still until it runs, then has full speed at once.

    It runs away from the pursuer, or to `goal_m` once that is set.

    Args:
        scenario: Gives the evader's place, speed and noise.
        settings: Settings of the pursuer's flight, with the stand-off disc.
        turn_at_m: Distance of the pursuer from the disc at which the evader changes its motion to `turned`.
        turned: Speed away from the pursuer after that, as a share of the full speed: 0 stops, -1 approaches.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: FlightSettings,
        *,
        turn_at_m: float = -math.inf,
        turned: float = 1.0,
    ) -> None:
        self.goal_m: tuple[float, float] | None = None
        self.silent = False
        self.share = 1.0
        self._turn_at_m = turn_at_m + settings.cycle.game.standoff.radius_m
        self._turned = turned
        self._has_turned = False
        site = scenario.site
        amsl = Amsl(site.altitude_amsl_m)
        projection = settings.autopilot.projection
        self._frame = LocalFrame(
            site.latitude_deg, site.longitude_deg, amsl, amsl, projection=projection
        )
        east, north = scenario.evader.position_m
        self.place_m = (north, east)
        self.velocity_m_s = (0.0, 0.0)
        self.speed_m_s = scenario.evader.speed_m_s
        self._random = Random(scenario.seed)
        self._now_s = 0.0
        self._next_s = 0.0
        self._due: list[EvaderReport] = []

    def begin(self, place_m: tuple[float, float], *, seed: int) -> None:
        """Report from another place, x and y of the game frame, with other noise."""
        east, north = place_m
        self.place_m = (north, east)
        self.silent = False
        self._random.seed(seed)

    def run(self, velocity_m_s: tuple[float, float]) -> None:
        """Run with a velocity, north and east, from now on; at its largest speed at most."""
        north, east = velocity_m_s
        self.share = min(1.0, math.hypot(north, east) / self.speed_m_s)
        if self.share > 0.0:
            self.goal_m = (self.place_m[0] + _FAR_S * north, self.place_m[1] + _FAR_S * east)

    def advance(self, now_s: float, pursuer_m: tuple[float, float], *, running: bool) -> None:
        """Move to the present time and report."""
        away = [mine - his for mine, his in zip(self.place_m, pursuer_m, strict=True)]
        self._has_turned |= running and math.hypot(*away) < self._turn_at_m
        if self.goal_m is not None:
            away = [goal - mine for goal, mine in zip(self.goal_m, self.place_m, strict=True)]
        pace = self.share * self.speed_m_s / math.hypot(*away) if running else 0.0
        pace *= self._turned if self._has_turned else 1.0
        self.velocity_m_s = (away[0] * pace, away[1] * pace)
        dt_s = now_s - self._now_s
        self._now_s = now_s
        self.place_m = (
            self.place_m[0] + self.velocity_m_s[0] * dt_s,
            self.place_m[1] + self.velocity_m_s[1] * dt_s,
        )
        if now_s >= self._next_s - 1e-9:
            self._next_s = now_s + REPORT_S
            self._due.extend(() if self.silent else (self._report(),))

    def _report(self) -> EvaderReport:
        gauss = self._random.gauss
        north, east = (metres + gauss(0.0, POSITION_SD_M) for metres in self.place_m)
        speed_north, speed_east = (
            speed + gauss(0.0, VELOCITY_SD_M_S) for speed in self.velocity_m_s
        )
        latitude_deg, longitude_deg, altitude = self._frame.wgs84_from_ned(Ned((north, east, 0.0)))
        return EvaderReport(
            received_s=self._now_s,
            sent_s=self._now_s,
            source="runner",
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            altitude_amsl_m=altitude.metres,
            velocity_ned_m_s=Ned((speed_north, speed_east, 0.0)),
            position_sd_m=POSITION_SD_M,
            velocity_sd_m_s=VELOCITY_SD_M_S,
        )

    def receive(self) -> list[EvaderReport]:
        """See `EvaderSource`."""
        due = self._due
        self._due = []
        return due

    def counters(self) -> Mapping[str, int]:
        """See `EvaderSource`."""
        return {}

    def close(self) -> None:
        """See `EvaderSource`."""


class Altering:
    """A link that alters setpoints before it sends them."""

    def __init__(self, link: PymavlinkLink, send: Callable[[Setpoint], Setpoint]) -> None:
        self._link = link
        self._send = send
        self.receive = link.receive
        self.request = link.request
        self.send_heartbeat = link.send_heartbeat
        self.counters = link.counters
        self.close = link.close

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """See `VehicleLink`."""
        self._link.send_setpoint(self._send(setpoint))


@dataclass(slots=True)
class Chased:
    """Results of a chase. Lengths and speeds are of the true motion; `flown_s` is from the certificate.

    Attributes:
        value_s: The game's value at engagement.
        flown_s: Time from engagement until within the tolerance of the disc; NaN if never.
        nearest_m: Least horizontal distance to the rim of the disc: negative is inside.
        lowest_m: Least height above the disc: negative is below.
        nearest_below_m: Least horizontal distance to the rim while more than half a metre below the disc: negative is
            inside the forbidden space.
        fastest_m_s: Largest speed over the ground.
        station_m: All distances to the rim of the disc, from two seconds after the capture.
        slip_m_s: All ground speeds relative to the evader, from the same time.
        reported_m: All distances to the rim as the vehicle reports them, from the same time.
        height_m: All reported heights above the disc, from the same time.
        commands: Every setpoint's velocity and acceleration, NED.
        needed_s: `time_needed_s` of the first certificate.
        assured_m: `assured_distance_m` of the last one.
        alarms: Every alarm and its time since engagement.
    """

    value_s: float = math.nan
    flown_s: float = math.nan
    nearest_m: float = math.inf
    lowest_m: float = math.inf
    nearest_below_m: float = math.inf
    fastest_m_s: float = 0.0
    station_m: list[float] = field(default_factory=list)
    slip_m_s: list[float] = field(default_factory=list)
    reported_m: list[float] = field(default_factory=list)
    height_m: list[float] = field(default_factory=list)
    commands: list[tuple[float, ...]] = field(default_factory=list)
    needed_s: float = math.nan
    assured_m: float = math.nan
    alarms: list[tuple[float, Alarm]] = field(default_factory=list)

    @property
    def ratio(self) -> float:
        """Flown over value."""
        return self.flown_s / self.value_s

    @property
    def worst_station_m(self) -> float:
        """Farthest from the rim after the capture."""
        return max(map(abs, self.station_m), default=math.nan)

    @property
    def worst_height_m(self) -> float:
        """Farthest from the disc's height after the capture, as the vehicle reports it."""
        return max(map(abs, self.height_m), default=math.nan)

    @property
    def worst_reported_m(self) -> float:
        """Farthest from the rim after the capture, as the vehicle reports it."""
        return max(map(abs, self.reported_m), default=math.nan)

    @property
    def largest_command_m_s(self) -> float:
        """Largest commanded ground speed."""
        return max(math.hypot(*command[:2]) for command in self.commands)

    @property
    def slip_rms_m_s(self) -> float:
        """Root of the mean square of the slip."""
        return math.sqrt(sum(slip * slip for slip in self.slip_m_s) / max(1, len(self.slip_m_s)))

    def note(
        self,
        since_s: float,
        certificate: Certificate,
        gap_m: float,
        height_m: float,
        slip_m_s: float,
    ) -> None:
        """Record one cycle of the game."""
        self.assured_m = certificate.assured_distance_m
        if math.isnan(self.value_s):
            self.value_s = certificate.value
            self.needed_s = certificate.time_needed_s
        if math.isnan(self.flown_s) and certificate.captured:
            self.flown_s = since_s
        if height_m < -0.5:
            self.nearest_below_m = min(self.nearest_below_m, gap_m)
        self.nearest_m = min(self.nearest_m, gap_m)
        self.lowest_m = min(self.lowest_m, height_m)
        if since_s > self.flown_s + SETTLED_S:
            self.station_m.append(gap_m)
            self.slip_m_s.append(slip_m_s)
            self.reported_m.append(certificate.gap_m)
            self.height_m.append(certificate.height_gap_m)


class Chase(Sortie):
    """A running chase. After the capture the pursuer keeps station while the evader runs on.

    In TAD the evader runs to the current meeting point of the game.

    Args:
        scenario: The scenario to fly; its evader policy is ignored.
        change: Changes the flight's settings.
        alter: Changes the mock before the start.
        send: Changes every setpoint before it is sent.
        turn_at_m: See `Runner`.
        turned: See `Runner`.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        change: Callable[[FlightSettings], FlightSettings] = lambda settings: settings,
        alter: Callable[[MockVehicle], None] = lambda _vehicle: None,
        send: Callable[[Setpoint], Setpoint] = lambda setpoint: setpoint,
        turn_at_m: float = -math.inf,
        turned: float = 1.0,
    ) -> None:
        settings = change(
            plan_of(scenario=scenario).flight.model_copy(
                update={"after_capture": AfterCapture.SHADOW}
            )
        )
        self.chased = Chased()
        self.vehicle = _vehicle(scenario)
        alter(self.vehicle)
        self.runner = Runner(scenario, settings, turn_at_m=turn_at_m, turned=turned)
        self._scenario = scenario
        self._disc = settings.cycle.game.standoff
        clock = VirtualClock(-PERIOD_S)  # the first cycle is at zero
        ours, self._end = MemoryWire.pair(clock.now_s)
        link = PymavlinkLink(ours, clock.now_s, system_id=1)
        super().__init__(
            clock, FlownByHand(Flight(settings), Altering(link, send), self.runner, None)
        )
        self._changed_s = 0.0
        self._engaged_s = math.nan

    @property
    def since_s(self) -> float:
        """Time since engagement; NaN before."""
        return self.now_s - self._engaged_s

    @property
    def truth(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """True NED position from the site's point, and true ground velocity; the mock's origin is its start."""
        body = self.vehicle.truth
        east, north, _ = self._scenario.pursuer.position_m
        place = body.position_ned_m
        return (place[0] + north, place[1] + east, place[2]), body.velocity_ned_m_s[:2]

    def fly(self, *, station_s: float = 8.0, longest_s: float = LONGEST_S) -> Chased:
        """Fly until `station_s` after the capture, but at most `longest_s` after engagement."""
        self.run(
            LONGEST_S,
            lambda: self.since_s + PERIOD_S > min(longest_s, self.chased.flown_s + station_s),
        )
        return self.chased

    def advance(self) -> None:
        """Step the vehicle and the runner."""
        for frame in self.vehicle.step(self.now_s, [frame for _, frame in self._end.receive()]):
            self._end.send(frame)
        (north, east, _), _ = self.truth
        self.runner.advance(self.now_s, (north, east), running=self.since_s > 0.0)

    def act(self, _orders: Sequence[Event]) -> Outputs:
        """Run one cycle and record its results."""
        before = self.state
        hovers = before is State.STANDING_BY and self.now_s - self._changed_s < HOVER_S
        outputs: Outputs = self.pilot.run(self.now_s, () if hovers else ORDERS.get(before, ()))
        if outputs.state is not before:
            self._changed_s = self.now_s
        if outputs.alarm is not None:
            self.chased.alarms.append((self.since_s, outputs.alarm))
        certificate = outputs.certificate
        if (
            certificate is not None
            and self._scenario.target is not None
            and not certificate.no_game
        ):
            east_m, north_m, _ = certificate.meeting_point_game_m
            self.runner.goal_m = (north_m, east_m)
        if certificate is not None and outputs.setpoint is not None:
            self._engaged_s = self.now_s if math.isnan(self._engaged_s) else self._engaged_s
            self._note(certificate, outputs.setpoint)
        return outputs

    def _note(self, certificate: Certificate, setpoint: Setpoint) -> None:
        (north, east, down), speed = self.truth
        gap_m = math.dist((north, east), self.runner.place_m) - self._disc.radius_m
        slip_m_s = math.dist(speed, self.runner.velocity_m_s)
        self.chased.note(self.since_s, certificate, gap_m, -down - self._disc.height_m, slip_m_s)
        self.chased.fastest_m_s = max(self.chased.fastest_m_s, math.hypot(*speed))
        acceleration = setpoint.acceleration_ned_m_s2 or (0.0, 0.0, 0.0)
        self.chased.commands.append((*setpoint.velocity_ned_m_s, *acceleration))


def chase(scenario: Scenario, *, station_s: float = 8.0, **changes: Any) -> Chased:
    """Fly a chase from the ground to its end; see `Chase`."""
    return Chase(scenario, **changes).fly(station_s=station_s)


def _vehicle(scenario: Scenario) -> MockVehicle:
    site = scenario.site
    pursuer = scenario.pursuer
    vertical = {"MPC_Z_VEL_MAX_UP": pursuer.climb_m_s, "MPC_Z_VEL_MAX_DN": pursuer.descent_m_s}
    return MockVehicle(
        pursuer.autopilot,
        home=Home(site.latitude_deg, site.longitude_deg, site.altitude_amsl_m),
        start_ned=(pursuer.position_m[1], pursuer.position_m[0], 0.0),
        seed=scenario.seed,
        parameters=vertical if pursuer.autopilot == "px4" else None,
        ready_after_s=1.0,
    )


def altered(
    *, drag: float = 1.0, lag: float = 1.0, noise: float = 1.0
) -> Callable[[MockVehicle], None]:
    """Return a function that scales a mock's drag, lags (dead time, attitude, rotors) and estimator errors."""

    def alter(vehicle: MockVehicle) -> None:
        autopilot = vehicle.autopilot
        flavour = autopilot.flavour

        def plant(parameters: Mapping[str, float]):
            made: Any = flavour.plant(parameters)  # of a multicopter
            airframe = replace(
                made.airframe,
                drag_1_s=made.airframe.drag_1_s * drag,
                drag_1_m=made.airframe.drag_1_m * drag,
                attitude_gain_1_s=made.airframe.attitude_gain_1_s / lag,
                rate_gain_1_s=made.airframe.rate_gain_1_s / lag,
                rotor_lag_s=made.airframe.rotor_lag_s * lag,
            )
            return replace(made, airframe=airframe, setpoint_delay_s=made.setpoint_delay_s * lag)

        wander = replace(
            flavour.wander,
            velocity_sd_ned_m_s=tuple(noise * sd for sd in flavour.wander.velocity_sd_ned_m_s),
            position_sd_ned_m=tuple(noise * sd for sd in flavour.wander.position_sd_ned_m),
        )
        autopilot.flavour = replace(flavour, plant=plant, wander=wander)
        autopilot.plant = plant(autopilot.parameters)

    return alter
