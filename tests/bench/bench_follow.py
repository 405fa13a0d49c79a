"""This service beside the autopilots' own follow modes.

`python -m tests.bench.bench_follow --px4 URL --arducopter URL --out results.json`

Each mode flies the same chases after a leader that this program moves and reports:

    follow          PX4's AUTO_FOLLOW_TARGET (FOLLOW_TARGET) or ArduCopter's FOLLOW (GLOBAL_POSITION_INT)
    optimal         this service
    pure_pursuit, proportional_navigation, frpn
                    other laws in this service, behind its estimate, its velocity servo and its limits

Without URLs it flies on mocks in virtual time; the mocked ArduCopter has no FOLLOW. The vehicle is judged by its own
LOCAL_POSITION_NED, 50 times a second. It hovers at 20 m, the leader stands 60 m away, and the clock starts with the
leader's run. `reached_s` is the time until the vehicle is within 0.5 m of the stand-off circle, horizontally: a follow
mode may still be above it. A flight in which the simulator did not keep real time, or this program paused, is flown
again.

Results go to `--out`, one JSON row a chase, after each flight; chases that are in the file already are not flown.
`python -m tests.bench.follow_report` prints the tables and draws the picture from them. Never name a real vehicle here:
it flies at once.
"""

import argparse
import json
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from guidance.autopilots import Autopilot, Mode, autopilot_named
from guidance.clock import Clock, MonotonicClock, VirtualClock
from guidance.errors import GuidanceError
from guidance.flight import Event, Flight, FlightSettings, State
from guidance.flight.settings import AfterCapture
from guidance.frames import Amsl, LocalFrame, Ned
from guidance.game import solve
from guidance.league.frpn import FRPN_LEVEL
from guidance.links.mavlink.frames import Station
from guidance.links.mavlink.pymavlink_link import PymavlinkLink
from guidance.links.port import Wire
from guidance.links.wires.base import MemoryWire, share
from guidance.messages import (
    Command,
    EvaderReport,
    Home,
    LocalPosition,
    ParameterSet,
    Timesync,
)
from guidance.session.fly.loop import PERIOD_S
from guidance.session.open.discovery import autopilot_at, wait_until_placed
from guidance.session.open.url import laid_about
from guidance.session.plan import plan_of
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_scenario
from guidance.strategies.own import Ask, answer_of, is_own, load_policy
from guidance.vehicle import VehicleState, local_frame
from sitl_mock.vehicle.mock_vehicle import MockVehicle
from sitl_mock.world import Home as MockHome
from tests.harness.linked import FlownByHand

MODES: Final[Mapping[str, str]] = {
    "follow": "optimal",
    "optimal": "optimal",
    "pure_pursuit": "pure_pursuit",
    "proportional_navigation": "proportional_navigation",
    "frpn": FRPN_LEVEL,
}
"""The strategy of each mode. Before a follow mode takes over, the service brings the vehicle to its start."""

AWAY_M: Final = 60.0
HEIGHT_M: Final = 20.0
TOLERANCE_M: Final = 0.5
HOVER_S: Final = 6.0
STATION_S: Final = 10.0
SETTLED_S: Final = 2.0
OVERSHOOT_S: Final = 5.0
LONGEST_S: Final = 75.0
PREPARED_WITHIN_S: Final = 150.0
TURN_EVERY_S: Final = 4.0
STOP_AFTER_S: Final = 10.0
TRACE_S: Final = 0.2
LIMIT_RATIO: Final = 1.1
ROUND_TRIP_S: Final = 0.05
PACE_TOLERANCE: Final = 0.02
LONGEST_GAP_S: Final = 0.2
LONGEST_STALL_S: Final = 0.15
"""A chase in which this program paused for longer, or the simulator fell behind by more within a second, is flown
again: the machine was too busy."""

ATTEMPTS: Final = 2
FAR_M: Final = 60.0
"""Farther from home than this a chase leads back over home."""

UNDISTURBED: Final = (State.ENGAGED, State.ON_STATION, State.YIELDED)
"""States at the end of a chase; a follow mode has taken the vehicle from the service."""

RATES_HZ: Final = (10.0, 1.0, 4.0)

LEADER: Final = 42
"""System id of the leader."""

_COMPANION: Final = 191
_REAL32: Final = 9
_INT32: Final = 6
_INT8: Final = 2
_DO_SET_MODE: Final = 176


class Chase(NamedTuple):
    """One chase.

    Attributes:
        mode: One of `MODES`.
        speed_m_s: Of the vehicle.
        leader_m_s: Of the leader.
        course: One of `COURSES`.
        rate_hz: Of the leader's reports.
        delay_s: Of each report.
        variant: One of `VARIANTS`: the parameters of a follow mode.
    """

    mode: str
    speed_m_s: float = 6.0
    leader_m_s: float = 3.0
    course: str = "straight"
    rate_hz: float = 10.0
    delay_s: float = 0.0
    variant: str = "best"

    @property
    def key(self) -> str:
        """Its name in a file of results."""
        words = [self.mode, f"u{self.speed_m_s:g} v{self.leader_m_s:g}", self.course]
        words.append(f"{self.rate_hz:g} Hz")
        if self.delay_s:
            words.append(f"late {self.delay_s:g} s")
        if self.variant != "best":
            words.append(self.variant)
        return ", ".join(words)


def straight(_run_s: float) -> tuple[float, float]:
    """Run away at full speed: share of the speed, and turn from the direction away from the vehicle."""
    return 1.0, 0.0


def turning(run_s: float) -> tuple[float, float]:
    """Turn by 90° every 4 s: away, left, away, right."""
    turns_rad = (0.0, -math.pi / 2.0, 0.0, math.pi / 2.0)
    return 1.0, turns_rad[int(run_s / TURN_EVERY_S) % len(turns_rad)]


def stopping(run_s: float) -> tuple[float, float]:
    """Run away for 10 s, then stand."""
    return (1.0 if run_s < STOP_AFTER_S else 0.0), 0.0


COURSES: Final[Mapping[str, Callable[[float], tuple[float, float]]]] = {
    "straight": straight,
    "turning": turning,
    "stopping": stopping,
}

FOLLOW_MODE: Final[Mapping[str, tuple[float, ...]]] = {
    "px4": (1.0, 4.0, 8.0),
    "arducopter": (1.0, 23.0, 0.0),
}
"""Parameters of DO_SET_MODE: AUTO_FOLLOW_TARGET and FOLLOW."""

HOVER_MODE: Final = {"px4": Mode.HOLD, "arducopter": Mode.GUIDED}
"""The mode that flies DO_REPOSITION."""

VARIANTS: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    "px4": {
        "best": {"FLW_TGT_RS": 0.1, "FLW_TGT_MAX_VEL": 5.0},
        "quick estimate": {"FLW_TGT_RS": 0.02, "FLW_TGT_MAX_VEL": 10.0},
    },
    "arducopter": {
        "best": {"FOLL_POS_P": 1.0},
        "default gain": {"FOLL_POS_P": 0.1},
        "medium gain": {"FOLL_POS_P": 0.5},
    },
}
"""Parameters of a follow mode that differ between variants."""


def parameters(
    autopilot: str, chase: Chase, scenario: Scenario
) -> Iterator[tuple[str, float, int]]:
    """Return what is set before a chase: name, value and MAV_PARAM_TYPE. Speed limits hold for every mode."""
    limit_m_s = LIMIT_RATIO * chase.speed_m_s
    disc = scenario.standoff
    if autopilot == "px4":
        yield "MPC_XY_VEL_MAX", limit_m_s, _REAL32
        yield "MPC_XY_CRUISE", limit_m_s, _REAL32
        yield "FLW_TGT_DST", disc.radius_m, _REAL32
        yield "FLW_TGT_HT", disc.height_m, _REAL32
        yield "FLW_TGT_FA", 180.0, _REAL32
        yield "FLW_TGT_ALT_M", 0.0, _INT32
    else:
        yield "WPNAV_SPEED", 100.0 * limit_m_s, _REAL32
        yield "BATT_CAPACITY", 100_000.0, _INT32  # the simulated battery lasts for four flights
        yield "FOLL_ENABLE", 1.0, _INT8
        yield "FOLL_SYSID", float(LEADER), _REAL32
        yield "FOLL_DIST_MAX", 1000.0, _REAL32
        yield "FOLL_OFS_TYPE", 1.0, _INT8
        yield "FOLL_OFS_X", -disc.radius_m, _REAL32
        yield "FOLL_OFS_Y", 0.0, _REAL32
        yield "FOLL_OFS_Z", -disc.height_m, _REAL32
        yield "FOLL_ALT_TYPE", 1.0, _INT8
        yield "FOLL_YAW_BEHAVE", 0.0, _INT8
    for name, value in VARIANTS[autopilot][chase.variant].items():
        yield name, value, _REAL32


class Leader:
    """The evader: moves in the vehicle's local frame and reports, as an `EvaderSource` and in MAVLink.

    Args:
        clock: Of the flight.
        radio: Where MAVLink reports go; None sends none.
        autopilot: Decides which message.
    """

    def __init__(self, clock: Clock, radio: Wire | None, autopilot: str) -> None:
        self._clock = clock
        self._station = None if radio is None else Station(radio, LEADER, 1)
        self._autopilot = autopilot
        self._frame: LocalFrame | None = None
        self._chase = Chase("optimal")
        self._away_rad = 0.0
        self._began_s = math.inf
        self._moved_s = 0.0
        self._next_s = 0.0
        self._on_the_way: deque[EvaderReport] = deque()
        self._arrived: list[EvaderReport] = []
        self.position_ned_m = (0.0, 0.0, 0.0)
        self.velocity_m_s = (0.0, 0.0)

    def place(
        self,
        frame: LocalFrame,
        position_ned_m: tuple[float, float, float],
        away_rad: float,
        chase: Chase,
    ) -> None:
        """Stand at a place and report; `begin` makes it run."""
        self._frame = frame
        self.position_ned_m = position_ned_m
        self._away_rad = away_rad
        self._chase = chase
        self._moved_s = self._clock.now_s()
        self._next_s = self._moved_s

    def begin(self) -> None:
        """Run from now on."""
        self._began_s = self._clock.now_s()

    def advance(self) -> None:
        """Move to the present time, and send what is due."""
        frame = self._frame
        if frame is None:
            return
        now_s = self._clock.now_s()
        self._move(now_s)
        if now_s >= self._next_s - 1e-6:
            self._next_s = max(self._next_s + 1.0 / self._chase.rate_hz, now_s)
            self._on_the_way.append(self._report(frame, now_s))
        while self._on_the_way and now_s >= self._on_the_way[0].sent_s + self._chase.delay_s - 1e-6:
            report = self._on_the_way.popleft()._replace(received_s=now_s)
            self._arrived.append(report)
            if self._station is not None:
                self._station.send(self._message(report))

    def _move(self, now_s: float) -> None:
        self.velocity_m_s = (0.0, 0.0)
        if now_s >= self._began_s:
            share_of_speed, turn_rad = COURSES[self._chase.course](now_s - self._began_s)
            speed_m_s = share_of_speed * self._chase.leader_m_s
            course_rad = self._away_rad + turn_rad
            self.velocity_m_s = (
                speed_m_s * math.cos(course_rad),
                speed_m_s * math.sin(course_rad),
            )
        dt_s = now_s - self._moved_s
        self._moved_s = now_s
        north_m, east_m, down_m = self.position_ned_m
        north_m += self.velocity_m_s[0] * dt_s
        east_m += self.velocity_m_s[1] * dt_s
        self.position_ned_m = (north_m, east_m, down_m)

    def _report(self, frame: LocalFrame, now_s: float) -> EvaderReport:
        latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(Ned(self.position_ned_m))
        timesync = None
        if self._chase.delay_s:  # the sender answers TIMESYNC at once: only its positions are late
            asked_ns = round((now_s - 0.5 * ROUND_TRIP_S) * 1e9)
            timesync = Timesync(now_s + 0.5 * ROUND_TRIP_S, round(now_s * 1e9), asked_ns)
        return EvaderReport(
            received_s=now_s,
            sent_s=now_s,
            source="leader",
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
            altitude_amsl_m=altitude.metres,
            velocity_ned_m_s=Ned((*self.velocity_m_s, 0.0)),
            position_sd_m=0.05,
            velocity_sd_m_s=0.03,
            timesync=timesync,
        )

    def _message(self, report: EvaderReport) -> Any:
        sent_ms = round(report.sent_s * 1e3)
        latitude = round(report.latitude_deg * 1e7)
        longitude = round(report.longitude_deg * 1e7)
        velocity = report.velocity_ned_m_s
        if self._autopilot == "px4":
            zero = [0.0, 0.0, 0.0]
            level = [1.0, 0.0, 0.0, 0.0]
            return mavlink.MAVLink_follow_target_message(
                sent_ms,
                3,  # position and velocity
                latitude,
                longitude,
                report.altitude_amsl_m,
                list(velocity),
                zero,
                level,
                zero,
                zero,
                0,
            )
        heading_rad = self._away_rad
        if math.hypot(*velocity) > 0.0:
            heading_rad = math.atan2(velocity[1], velocity[0])
        return mavlink.MAVLink_global_position_int_message(
            sent_ms,
            latitude,
            longitude,
            round(report.altitude_amsl_m * 1e3),
            0,
            *(round(100.0 * part) for part in velocity),
            round(math.degrees(heading_rad) * 100.0) % 36000,
        )

    def receive(self) -> list[EvaderReport]:
        """See `EvaderSource`."""
        arrived = self._arrived
        self._arrived = []
        return arrived

    def counters(self) -> Mapping[str, int]:
        """See `EvaderSource`."""
        return {}

    def close(self) -> None:
        """See `EvaderSource`."""


@dataclass(slots=True)
class Measured:
    """What is seen of a chase, on the vehicle's own telemetry; distances are horizontal, to the leader."""

    radius_m: float
    reached_s: float = math.nan
    closest_m: float = math.inf
    overshoot_m: float = 0.0
    worst_m: float = 0.0
    distance_m: list[float] = field(default_factory=list)
    height_m: list[float] = field(default_factory=list)

    def note(self, run_s: float, distance_m: float, height_m: float) -> None:
        """Record one cycle."""
        if run_s >= TRACE_S * len(self.distance_m):
            self.distance_m.append(round(distance_m, 2))
            self.height_m.append(round(height_m, 1))
        self.closest_m = min(self.closest_m, distance_m)
        if math.isnan(self.reached_s) and distance_m <= self.radius_m + TOLERANCE_M:
            self.reached_s = run_s
        since_s = run_s - self.reached_s
        if since_s <= OVERSHOOT_S:
            self.overshoot_m = max(self.overshoot_m, self.radius_m - distance_m)
        if since_s >= SETTLED_S:
            self.worst_m = max(self.worst_m, abs(distance_m - self.radius_m))

    def over(self, run_s: float) -> bool:
        """Whether the chase has been seen to its end."""
        return run_s > LONGEST_S or run_s - self.reached_s > STATION_S


class Stalls:
    """How far a simulator fell behind real time within a second, at most."""

    def __init__(self) -> None:
        self._delays_s: deque[tuple[float, float]] = deque()
        self.worst_s = 0.0

    def note(self, position: LocalPosition) -> None:
        """Compare a position's own time with its arrival."""
        delay_s = position.received_s - position.time_boot_s
        self._delays_s.append((position.received_s, delay_s))
        while self._delays_s[0][0] < position.received_s - 1.0:
            self._delays_s.popleft()
        before_s = min(delay for _, delay in self._delays_s)
        self.worst_s = max(self.worst_s, delay_s - before_s)


class Aircraft:
    """One vehicle, its clock and its wires; flies one chase after another.

    Args:
        autopilot: Its description.
        clock: Real or virtual.
        wire: To the vehicle.
        system_id: Of the vehicle.
        scenario: The chase, about the vehicle's home.
        advance: Steps a mock; real vehicles fly by themselves.
        say: Receives one line of progress.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        clock: Clock,
        wire: Wire,
        *,
        system_id: int,
        advance: Callable[[], None],
        say: Callable[[str], None],
    ) -> None:
        self._autopilot = autopilot
        self._clock = clock
        ours, self._radio = share(wire, 2)
        self.link = PymavlinkLink(ours, clock.now_s, system_id=system_id)
        self._advance = advance
        self._say = say
        self._due_s = clock.now_s()
        self._cycled_s = self._due_s
        self._longest_gap_s = 0.0
        self.scenario = load_scenario("hover_chase")[1]

    def lay(self) -> None:
        """Wait until the vehicle knows its place, and lay the chase about its home."""
        home, frame = wait_until_placed(
            self.link, self._autopilot, self._clock, lambda _progress: None
        )
        self.scenario = laid_about(self.scenario, home, frame, self._autopilot.name)

    def fly(self, chase: Chase) -> dict[str, Any]:
        """Fly one chase, from wherever the vehicle is; return its row of results.

        Raises:
            RuntimeError: If the vehicle does not get to its start, or the game does not begin.
        """
        scenario = self._scenario_of(chase)
        settings = _settings(scenario)
        radio = self._radio if chase.mode == "follow" else None
        leader = Leader(self._clock, radio, self._autopilot.name)
        pilot = FlownByHand(Flight(settings, _asked(MODES[chase.mode])), self.link, leader, None)
        for name, value, kind in parameters(self._autopilot.name, chase, scenario):
            self.link.request(ParameterSet(name, value, kind))
        self._to_the_start(pilot, leader)
        vehicle = pilot.flight.vehicle
        value_s = self._place(leader, vehicle, chase, settings)
        self._hover(pilot, leader, HOVER_S / 2.0)
        measured = Measured(settings.cycle.game.standoff.radius_m)
        begun = _local(pilot)
        self._begin(pilot, leader, chase)
        begun_s = self._clock.now_s()
        self._longest_gap_s = 0.0
        stalls = Stalls()
        while not measured.over(self._clock.now_s() - begun_s):
            self._cycle(pilot, leader)
            position = _local(pilot)
            stalls.note(position)
            distance_m = math.dist(position.position_ned_m[:2], leader.position_ned_m[:2])
            height_m = leader.position_ned_m[2] - position.position_ned_m[2]
            measured.note(self._clock.now_s() - begun_s, distance_m, height_m)
        ended = _local(pilot)
        pace = (ended.time_boot_s - begun.time_boot_s) / (ended.received_s - begun.received_s)
        self._say(
            f"  state {pilot.flight.state}, pace {pace:.3f}, gap {self._longest_gap_s:.2f} s, "
            f"stall {stalls.worst_s:.2f} s"
        )
        state = pilot.flight.state
        if chase.mode != "follow":
            self._cycle(pilot, leader, Event.HOLD)
            self._hover(pilot, leader, 1.0)
        return _row(chase, measured, value_s, pace) | {
            "gap_s": round(self._longest_gap_s, 2),
            "stall_s": round(stalls.worst_s, 2),
            "ended": str(state),
        }

    def land(self) -> None:
        """Send the vehicle home, and do not wait for it."""
        self.link.request(self._autopilot.set_mode(Mode.RETURN))
        self.link.receive()

    def _scenario_of(self, chase: Chase) -> Scenario:
        pursuer = self.scenario.pursuer.model_copy(
            update={"speed_m_s": chase.speed_m_s, "policy": MODES[chase.mode]}
        )
        evader = self.scenario.evader.model_copy(update={"speed_m_s": chase.leader_m_s})
        limits = self.scenario.limits.model_copy(
            update={"fence_radius_m": 2000.0, "ceiling_m": 100.0}
        )
        return self.scenario.model_copy(
            update={"pursuer": pursuer, "evader": evader, "limits": limits}
        )

    def _cycle(self, pilot: FlownByHand, leader: Leader, *orders: Event) -> None:
        self._due_s = max(self._due_s + PERIOD_S, self._clock.now_s() - PERIOD_S)
        self._clock.sleep_until(self._due_s)
        self._advance()
        leader.advance()
        now_s = self._clock.now_s()
        self._longest_gap_s = max(self._longest_gap_s, now_s - self._cycled_s)
        self._cycled_s = now_s
        outputs = pilot.run(now_s, orders)
        for transition in outputs.transitions:
            self._say(f"    {transition.words}: {transition.before} -> {transition.after}")

    def _hover(self, pilot: FlownByHand, leader: Leader, seconds: float) -> None:
        until_s = self._clock.now_s() + seconds
        while self._clock.now_s() < until_s:
            self._cycle(pilot, leader)

    def _until(
        self, what: str, pilot: FlownByHand, leader: Leader, reached: Callable[[], bool]
    ) -> None:
        until_s = self._clock.now_s() + PREPARED_WITHIN_S
        while not reached():
            if self._clock.now_s() > until_s:
                raise RuntimeError(f"{what}: still {pilot.flight.state}")
            self._cycle(pilot, leader)

    def _to_the_start(self, pilot: FlownByHand, leader: Leader) -> None:
        """Take off, or climb to the start's height where the last chase has ended."""
        self._until("ready", pilot, leader, lambda: pilot.flight.state is State.READY)
        vehicle = pilot.flight.vehicle
        if not vehicle.on_ground:
            self._climb(pilot, leader)
            # A start takes over a vehicle in the air that its HEARTBEATs have shown in its hold for some seconds
            self.link.request(self._autopilot.set_mode(Mode.HOLD))
            follows = pilot.flight.follows
            self._until("start", pilot, leader, lambda: follows(Event.START, self._clock.now_s()))
        self._cycle(pilot, leader, Event.START)
        self._until("start", pilot, leader, lambda: pilot.flight.state is State.STANDING_BY)
        self._until("hover", pilot, leader, lambda: _is_still(pilot))
        self._hover(pilot, leader, HOVER_S / 2.0)

    def _climb(self, pilot: FlownByHand, leader: Leader) -> None:
        asked_s = -math.inf

        def at_height() -> bool:
            nonlocal asked_s
            now_s = self._clock.now_s()
            if now_s - asked_s > 3.0:
                asked_s = now_s
                # ArduCopter's FOLLOW takes DO_REPOSITION without leaving its mode
                self.link.request(self._autopilot.set_mode(HOVER_MODE[self._autopilot.name]))
                self.link.request(self._reposition(pilot.flight.vehicle))
            return _is_still(pilot) and self._height_m(pilot.flight.vehicle) > HEIGHT_M - 1.5

        self._until("climb", pilot, leader, at_height)
        self._hover(pilot, leader, 1.5)  # until HEARTBEAT shows the mode

    def _reposition(self, vehicle: VehicleState) -> Command:
        frame = self._frame(vehicle)
        local = vehicle.latest[LocalPosition]
        north_m, east_m, down_m = local.position_ned_m
        down_m += self._height_m(vehicle) - HEIGHT_M
        latitude_deg, longitude_deg, altitude = frame.wgs84_from_ned(Ned((north_m, east_m, down_m)))
        return self._autopilot.reposition(
            latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude.metres
        )

    def _frame(self, vehicle: VehicleState) -> LocalFrame:
        frame = local_frame(vehicle, self._autopilot.projection)
        if frame is None:
            raise RuntimeError("the vehicle's home is unknown")
        return frame

    def _home_ned_m(self, vehicle: VehicleState) -> tuple[float, float, float]:
        home = vehicle.latest[Home]
        north_m, east_m, down_m = self._frame(vehicle).ned_from_wgs84(
            home.latitude_deg, home.longitude_deg, Amsl(home.altitude_amsl_m)
        )
        return north_m, east_m, down_m

    def _height_m(self, vehicle: VehicleState) -> float:
        return self._home_ned_m(vehicle)[2] - vehicle.latest[LocalPosition].position_ned_m[2]

    def _place(
        self, leader: Leader, vehicle: VehicleState, chase: Chase, settings: FlightSettings
    ) -> float:
        """Place the leader 60 m away, north of the vehicle or towards home; return the game's value."""
        home_m = self._home_ned_m(vehicle)
        position_m = vehicle.latest[LocalPosition].position_ned_m
        to_north_m = home_m[0] - position_m[0]
        to_east_m = home_m[1] - position_m[1]
        away_rad = 0.0
        if math.hypot(to_north_m, to_east_m) > FAR_M:
            away_rad = math.atan2(to_east_m, to_north_m)
        north_m = position_m[0] + AWAY_M * math.cos(away_rad)
        east_m = position_m[1] + AWAY_M * math.sin(away_rad)
        leader.place(self._frame(vehicle), (north_m, east_m, home_m[2]), away_rad, chase)
        pursuer = np.array([0.0, 0.0, home_m[2] - position_m[2]])
        return float(solve(settings.cycle.game, pursuer, np.array([AWAY_M, 0.0, 0.0])).value)

    def _begin(self, pilot: FlownByHand, leader: Leader, chase: Chase) -> None:
        """Give the vehicle to the mode, and let the leader run in the same cycle."""
        if chase.mode == "follow":
            mode = FOLLOW_MODE[self._autopilot.name]
            self.link.request(Command(_DO_SET_MODE, (*mode, *[math.nan] * 4)))
        else:
            self._cycle(pilot, leader, Event.ENGAGE)
            self._until("engage", pilot, leader, lambda: pilot.flight.state is State.ENGAGED)
        leader.begin()


def _asked(strategy: str) -> Ask | None:
    """Return what asks a policy, however long it takes: the law is compared, not how busy the machine is."""
    return partial(answer_of, strategy, load_policy(strategy)) if is_own(strategy) else None


def _settings(scenario: Scenario) -> FlightSettings:
    flight = plan_of(scenario=scenario).flight
    return flight.model_copy(
        update={"after_capture": AfterCapture.SHADOW, "start_game_m": None, "limits_s": {}}
    )


def _local(pilot: FlownByHand) -> LocalPosition:
    return pilot.flight.vehicle.latest[LocalPosition]


def _is_still(pilot: FlownByHand) -> bool:
    return math.hypot(*_local(pilot).velocity_ned_m_s) < 0.3


def _row(chase: Chase, measured: Measured, value_s: float, pace: float) -> dict[str, Any]:
    """Return one row of results; what never happened is None."""
    reached = not math.isnan(measured.reached_s)
    return {
        **chase._asdict(),
        "value_s": round(value_s, 3),
        "reached_s": round(measured.reached_s, 2) if reached else None,
        "ratio": round(measured.reached_s / value_s, 3) if reached else None,
        "overshoot_m": round(measured.overshoot_m, 2) if reached else None,
        "closest_m": round(measured.closest_m, 2),
        "worst_m": round(measured.worst_m, 2) if reached else None,
        "pace": round(pace, 4),
        "every_s": TRACE_S,
        "distance_m": measured.distance_m,
        "height_m": measured.height_m,
    }


def chases() -> list[Chase]:
    """Return the chases in the order in which they are flown: first those that compare follow mode and service."""
    two = ("follow", "optimal")
    table = [Chase(mode) for mode in MODES]
    table += [Chase(mode, 8.0, 4.0) for mode in two]
    table += [Chase(mode, course="turning") for mode in two]
    table += [Chase(mode, course="stopping") for mode in two]
    table += [Chase(mode, delay_s=0.5) for mode in two]
    for rate_hz in RATES_HZ[1:]:
        for course in COURSES:
            table += [Chase(mode, course=course, rate_hz=rate_hz) for mode in two]
    table += [Chase(mode, 8.0, 4.0) for mode in MODES]
    for course in COURSES:
        table += [Chase(mode, course=course) for mode in MODES]
    table += [Chase(mode, delay_s=0.5) for mode in MODES]
    for rate_hz in RATES_HZ:
        for course in COURSES:
            table += [Chase(mode, course=course, rate_hz=rate_hz) for mode in MODES]
    for rate_hz in RATES_HZ:
        table += [Chase(mode, rate_hz=rate_hz, delay_s=0.5) for mode in MODES]
    return list(dict.fromkeys(table))


def variants(autopilot: str) -> list[Chase]:
    """Return the chases that compare a follow mode's parameters; as delivered, FOLLOW flies all courses and rates."""
    courses = ("straight", "turning")
    compared = [
        Chase("follow", course=course, variant=variant)
        for variant in VARIANTS[autopilot]
        for course in courses
    ]
    if autopilot == "arducopter":
        delivered = Chase("follow", variant="default gain")
        for rate_hz in RATES_HZ:
            compared += [delivered._replace(course=course, rate_hz=rate_hz) for course in COURSES]
            compared.append(delivered._replace(rate_hz=rate_hz, delay_s=0.5))
    return list(dict.fromkeys(compared))


class Results:
    """Rows of results in a file, written after each chase."""

    def __init__(self, path: Path | None, autopilot: str) -> None:
        self._path = path
        self._document: dict[str, Any] = {"autopilots": {}}
        if path is not None and path.is_file():
            self._document = json.loads(path.read_text(encoding="utf-8"))
        self._rows = self._document["autopilots"].setdefault(autopilot, {})

    def has(self, chase: Chase) -> bool:
        """Whether a chase was flown already."""
        return chase.key in self._rows

    def add(self, chase: Chase, row: Mapping[str, Any]) -> None:
        """Add or replace a chase's row."""
        self._rows[chase.key] = row
        if self._path is not None:
            written = self._path.with_suffix(".part")
            written.write_text(document_text(self._document), encoding="utf-8")
            written.replace(self._path)


def document_text(document: Mapping[str, Any]) -> str:
    """Return a file of results: one line a chase."""
    parts = []
    for autopilot, rows in document["autopilots"].items():
        lines = [f"{json.dumps(key)}: {json.dumps(row)}" for key, row in rows.items()]
        joined = ",\n".join(lines)
        parts.append(f"{json.dumps(autopilot)}: {{\n{joined}\n}}")
    joined = ",\n".join(parts)
    return f'{{"autopilots": {{\n{joined}\n}}}}\n'


def is_undisturbed(row: Mapping[str, Any]) -> bool:
    """Whether the simulator kept real time, this program did not pause, and the flight was not interrupted."""
    in_time = abs(row["pace"] - 1.0) <= PACE_TOLERANCE and row["gap_s"] <= LONGEST_GAP_S
    in_time = in_time and row["stall_s"] <= LONGEST_STALL_S
    return in_time and row["ended"] in UNDISTURBED


def fly_all(
    aircraft: Aircraft,
    table: Sequence[Chase],
    results: Results,
    *,
    until_s: float,
    say: Callable[[str], None],
) -> None:
    """Fly all chases; one that failed, or that the simulator flew too slowly, once more."""
    for chase in table:
        if results.has(chase):
            continue
        for _ in range(ATTEMPTS):
            if time.monotonic() > until_s:
                say("out of time")
                return
            say(chase.key)
            try:
                row = aircraft.fly(chase)
            except RuntimeError as error:
                say(f"  not flown: {error}")
                continue
            facts = {key: row[key] for key in ("ratio", "overshoot_m", "closest_m", "worst_m")}
            say(f"  {facts}")
            if is_undisturbed(row):
                results.add(chase, row)
                break


def at_url(url: str, name: str, arguments: argparse.Namespace) -> None:
    """Fly all chases on the vehicle at a URL."""
    clock = MonotonicClock()

    def say(line: str) -> None:
        print(f"{name} {clock.now_s():6.0f} s  {line}", flush=True)

    with autopilot_at(url, name, clock, who=url) as (wire, sender, autopilot):
        aircraft = Aircraft(
            autopilot,
            clock,
            wire,
            system_id=sender.system_id,
            advance=lambda: None,
            say=say,
        )
        aircraft.lay()
        until_s = time.monotonic() + 60.0 * arguments.minutes
        table = variants(name) if arguments.variants else chases()
        table = [chase for chase in table if arguments.only in chase.key]
        results = Results(arguments.out, name)
        try:
            fly_all(aircraft, table, results, until_s=until_s, say=say)
        finally:
            aircraft.land()


def on_a_mock(name: str, arguments: argparse.Namespace) -> None:
    """Fly all chases on a mock in virtual time."""
    clock = VirtualClock(-PERIOD_S)
    ours, end = MemoryWire.pair(clock.now_s)
    site = load_scenario("hover_chase")[1].site
    home = MockHome(site.latitude_deg, site.longitude_deg, site.altitude_amsl_m)
    vertical = {"MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_MAX_DN": 1.5}
    vehicle = MockVehicle(
        name,
        home=home,
        seed=1,
        parameters=vertical if name == "px4" else None,
        ready_after_s=1.0,
    )

    def advance() -> None:
        for frame in vehicle.step(clock.now_s(), [frame for _, frame in end.receive()]):
            end.send(frame)

    def say(line: str) -> None:
        print(f"mocked {name} {clock.now_s():6.0f} s  {line}", flush=True)

    aircraft = Aircraft(autopilot_named(name), clock, ours, system_id=1, advance=advance, say=say)
    aircraft.scenario = aircraft.scenario.model_copy(
        update={"pursuer": aircraft.scenario.pursuer.model_copy(update={"autopilot": name})}
    )
    table = [chase for chase in chases() if arguments.only in chase.key]
    if name == "arducopter":  # the mock has no FOLLOW
        table = [chase for chase in table if chase.mode != "follow"]
    until_s = time.monotonic() + 60.0 * arguments.minutes
    results = Results(arguments.out, f"mocked {name}")
    fly_all(aircraft, table, results, until_s=until_s, say=say)


def main() -> None:
    """Fly the chases."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--px4", metavar="URL", help="a running PX4 simulator")
    parser.add_argument("--arducopter", metavar="URL", help="a running ArduCopter simulator")
    parser.add_argument("--only", default="", help="chases whose name contains this")
    parser.add_argument(
        "--variants", action="store_true", help="compare the follow mode's parameters instead"
    )
    parser.add_argument("--minutes", type=float, default=600.0, help="begin no chase after these")
    parser.add_argument("--out", type=Path, help="file of results, which is continued")
    arguments = parser.parse_args()
    urls = {"px4": arguments.px4, "arducopter": arguments.arducopter}
    for name, url in urls.items():
        if url is not None:
            try:
                at_url(url, name, arguments)
            except GuidanceError as error:
                sys.exit(f"{name}: {error}")
        elif not any(urls.values()):
            on_a_mock(name, arguments)


if __name__ == "__main__":
    main()
