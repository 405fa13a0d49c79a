"""Invariants of every flight with faults, checked against the mock's true state and the bytes on its wire.

The walls are the fence, the floor, the ceiling and the stand-off (R - 1, h - 1). They are checked while the vehicle
flies our setpoints and for `BRAKING_S` afterwards, while it brakes in its hold mode. A breach is a violation if it is
more than 0.3 m larger than the unavoidable error: the true error of the estimate, the distance flown while no setpoints
arrived, and the distance that an approaching evader covered. Walls are not checked after the vehicle restarts in flight
or while it obeys another program. The service must notice the other program.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from guidance.control.polygon import Polygon
from guidance.flight import BEFORE_FLIGHT, FINAL, ORDERS, Event, Outputs, State
from guidance.flight.freshness import TELEMETRY_LIMIT_S
from guidance.flight.table import HANDING_OVER, SETPOINT_STATES, TRANSITIONS
from guidance.frames import Amsl
from guidance.messages import LocalPosition
from guidance.sim.scenario import EVADER, PURSUER
from guidance.sim.stepped import SteppedWorld
from sitl_mock import MockVehicle
from sitl_mock.faults import frames
from sitl_mock.mavlink import SPEC_BY_NAME
from sitl_mock.world import Home
from tests.faults.drawing import Case

Vector = tuple[float, float, float]

SPARE_M = 0.3
REMEMBERED_S = 3.0
BRAKING_S = 3.0
BLIND_AFTER_S = 0.1
ASKED_M_S = 0.05
GUIDED = frozenset({"OFFBOARD", "GUIDED"})
HOLDS = frozenset({"AUTO.LOITER", "HOLD", "LOITER", "BRAKE"})
SETPOINT = SPEC_BY_NAME["SET_POSITION_TARGET_LOCAL_NED"].message_id
_SETPOINT_BYTES = SETPOINT.to_bytes(3, "little")
LOST_AFTER_S = 1.5 + 0.1
NOTICED_S = 2.1
RESEMBLING_M_S = 0.75
RESEMBLING_S = 1.5
"""A stranger's velocity that resembles one that we sent in this time, also shortened by up to half, is no sign."""

REMEMBERED_CYCLES = 250
_STAMPED_S = 0.011
"""A stamp is whole milliseconds, and a step of the mock is 10 ms."""

_WRAP_S = 2.0**32 / 1e3
"""time_boot_ms has 32 bits."""

ENDS = frozenset(
    {State.LANDED, State.YIELDED, State.FAILED, State.HOLDING, State.RETURNING, State.LANDING}
)


class Violation(NamedTuple):
    """A violated invariant, its time after engagement (s) and its amount (m, or the unit of the invariant)."""

    invariant: str
    at_s: float
    amount: float
    said: str = ""


class Sight(NamedTuple):
    """True positions at one time, in the pursuer's local frame, and the errors of the service's estimates."""

    now_s: float
    pursuer_m: Vector
    evader_m: Vector
    error_m: tuple[float, float]
    evader_error_m: tuple[float, float]
    blind_m: float


class Recently:
    """Running maximum over the last `REMEMBERED_S` seconds."""

    def __init__(self) -> None:
        self._met: deque[tuple[float, float]] = deque()

    def take(self, now_s: float, value: float) -> float:
        """Add a value and return the maximum."""
        met = self._met
        while met and met[-1][1] <= value:
            met.pop()
        met.append((now_s, value))
        while now_s - met[0][0] > REMEMBERED_S:
            met.popleft()
        return met[0][1]


class Heard:
    """Measures gaps between the setpoints that the vehicle receives and accepts, after the faults of its link."""

    def __init__(self, vehicle: MockVehicle) -> None:
        self._vehicle = vehicle
        self._step_links = vehicle.step_links
        self._last_s = math.inf
        self._gap_s = 0.0
        vehicle.step_links = self._listen  # type: ignore[method-assign]

    def _listen(
        self, now_s: float, frames_in: Mapping[str, Sequence[bytes]]
    ) -> dict[str, list[bytes]]:
        taken = not self._vehicle.autopilot.conditions.offboard_refused
        if taken and any(
            _is_setpoint(frame) for arrived in frames_in.values() for frame in arrived
        ):
            self._gap_s = max(self._gap_s, now_s - self._last_s)
            self._last_s = now_s
        return self._step_links(now_s, frames_in)

    def longest_gap_s(self, now_s: float) -> float:
        """Return the longest time without a setpoint since the last call."""
        since_s = now_s - self._last_s if self._vehicle.mode in GUIDED else 0.0
        gap_s = max(self._gap_s, since_s)
        self._gap_s = 0.0
        return gap_s


class Watch:
    """Checks every cycle of one flight.

    Attributes:
        case: The flight's case; replaced when a copied flight continues with another case.
        is_forged: Whether another sender reports the vehicle's position. Its error is not the estimator's.
    """

    def __init__(self, case: Case, world: SteppedWorld) -> None:
        self.case = case
        self.is_forged = False
        self._pursuer = world.vehicles[PURSUER]
        self.rover = world.vehicles[EVADER]
        self._heard = Heard(self._pursuer)
        self._polygon = None if case.corners_m is None else Polygon(case.corners_m)
        self._level, self._height, self._blind, self._evaders = (Recently() for _ in range(4))
        self.engaged_s: float | None = None
        self._flown: deque[tuple[float, Vector]] = deque(maxlen=REMEMBERED_CYCLES)
        self._home_m: Vector | None = None
        self._home_off_m = (0.0, 0.0)
        self._guided_s = -math.inf
        self._asked: deque[tuple[float, Vector]] = deque(maxlen=REMEMBERED_CYCLES)
        self._resembled_s = -math.inf
        self._ours = False
        self._entered_m = 0.0
        self._before: Sight | None = None
        self._ended_s: float | None = None
        self._pilots: str | None = None
        self._states: list[State] = []
        self.worst: dict[str, Violation] = {}
        self.breaches_m: dict[str, float] = {}
        self._granted_m: dict[str, float] = {}
        self._asked_down_m_s = 0.0
        self._sunk_m = self._risen_m = 0.0

    def wrong(self, invariant: str, now_s: float, amount: float, said: str = "") -> None:
        """Record a violation; only the largest of each invariant is kept."""
        at_s = math.nan if self.engaged_s is None else now_s - self.engaged_s
        if invariant not in self.worst or amount > self.worst[invariant].amount:
            self.worst[invariant] = Violation(invariant, at_s, amount, said)

    def sent(self, now_s: float, passed: list[bytes], outputs: Outputs, flight: Any) -> None:
        """Check the frames sent in one cycle."""
        setpoints = [frame for frame in passed if _is_setpoint(frame)]
        if len(setpoints) > 1:
            self.wrong("one setpoint a cycle", now_s, len(setpoints))
        self._asked_down_m_s = 0.0
        for frame in setpoints:
            self._asked_down_m_s = frames.value(frame, "vz")
            north_m_s = frames.value(frame, "vx")
            east_m_s = frames.value(frame, "vy")
            self._asked.append((now_s, (north_m_s, east_m_s, self._asked_down_m_s)))
            self._numbers(now_s, frame)
            self._inwards(now_s, flight)
            self._permitted(now_s, outputs.state, self._measured_before_s(now_s, flight))
        if outputs.state is State.ENGAGED and flight.tracking.silence_s(now_s) > LOST_AFTER_S:
            self.wrong("no chase of an old place", now_s, flight.tracking.silence_s(now_s))

    def _numbers(self, now_s: float, frame: bytes) -> None:
        limits = self.case.scenario.speed_limits
        north, east, down = (frames.value(frame, name) for name in ("vx", "vy", "vz"))
        if not all(map(math.isfinite, (north, east, down))):
            self.wrong("numbers", now_s, math.inf)
            return
        over = max(
            math.hypot(north, east) - limits.speed_m_s,
            -down - limits.climb_m_s,
            down - limits.descent_m_s,
        )
        if over > 1e-3:
            self.wrong("speed limits", now_s, over)

    def _measured_before_s(self, now_s: float, flight: Any) -> float:
        """Return the true age of the position that the service uses: since the vehicle measured it."""
        local = flight.vehicle.latest.get(LocalPosition)
        if local is None:
            return math.inf
        vehicle_s = self._pursuer.autopilot.since_boot_s(now_s)
        since_arrival_s = flight.vehicle.silence_s(LocalPosition, now_s)
        return max(since_arrival_s, math.remainder(vehicle_s - local.time_boot_s, _WRAP_S))

    def _inwards(self, now_s: float, flight: Any) -> None:
        """Check that no setpoint descends below the floor or climbs above the ceiling, by the service's own height."""
        local = flight.vehicle.latest.get(LocalPosition)
        home_m = flight.tracking.home_ned_m
        if local is None or home_m is None:
            return
        limits = self.case.scenario.limits
        height_m = home_m[2] - local.position_ned_m[2] + flight.tracking.held_back_ned_m[2]
        if height_m < limits.floor_m - SPARE_M and self._asked_down_m_s > ASKED_M_S:
            self.wrong(
                "nothing is asked further out", now_s, self._asked_down_m_s, "below the floor"
            )
        if height_m > limits.ceiling_m + SPARE_M and self._asked_down_m_s < -ASKED_M_S:
            self.wrong(
                "nothing is asked further out", now_s, -self._asked_down_m_s, "above the ceiling"
            )

    def _permitted(self, now_s: float, state: State, age_s: float) -> None:
        if state in FINAL:
            self.wrong("silence after yielding", now_s, 1.0, str(state))
        elif state not in SETPOINT_STATES | HANDING_OVER:
            self.wrong("setpoints only where the state has them", now_s, 1.0, str(state))
        if age_s > TELEMETRY_LIMIT_S + 0.03:
            self.wrong("silence rather than old", now_s, age_s)

    def followed(self, now_s: float, outputs: Outputs, flight: Any) -> None:
        """Check the transitions of the state machine."""
        if self.engaged_s is None and outputs.state is State.ENGAGED:
            self.engaged_s = now_s
            self._home_off_m = self._home_off(flight.tracking.home_ned_m)
        if self._home_m is None and outputs.state not in BEFORE_FLIGHT:
            self._home_m = self._pursuer.autopilot.state.home_m
        for transition in outputs.transitions:
            legal = TRANSITIONS.get((transition.before, transition.event), transition.before)
            refused = transition.event in ORDERS and transition.after is transition.before
            if transition.after is not legal and not refused:
                self.wrong(
                    "the table",
                    now_s,
                    1.0,
                    f"{transition.before} {transition.event} {transition.after}",
                )
        self._accuse_rightly(now_s, outputs, flight)
        if outputs.fault is not None:
            self.wrong("no error of our own", now_s, 1.0, outputs.fault)
        if outputs.state in FINAL and self._ended_s is None:
            self._ended_s = now_s
        if self._ended_s is not None and outputs.state not in FINAL:
            self.wrong("an end is one", now_s, 1.0, str(outputs.state))
        self._follow_pilot(now_s)
        self._notice_another(now_s, outputs.state)

    def _home_off(self, told_ned_m: Vector | None) -> tuple[float, float]:
        """Return the error of the reported home before takeoff (horizontal, vertical); the flight keeps that home."""
        return (
            (0.0, 0.0)
            if told_ned_m is None or self._home_m is None
            else _apart(told_ned_m, self._home_m)
        )

    def _accuse_rightly(self, now_s: float, outputs: Outputs, flight: Any) -> None:
        accused = any(transition.event is Event.RIVAL for transition in outputs.transitions)
        if accused and "evader_forger" not in self.case.kinds:
            self.wrong(
                "no second evader where there is one", now_s, 1.0, flight.tracking.rival(now_s)
            )

    def _follow_pilot(self, now_s: float) -> None:
        """Check that the vehicle does not return to the guided mode after a pilot's switch."""
        wanted = {
            (fault.model_extra or {}).get("mode")
            for fault in self.case.scenario.fault
            if fault.kind == "pilot_mode"
        }
        mode = self._pursuer.mode
        if self._pilots is None and self.engaged_s is not None and mode in wanted:
            self._pilots = mode
        if self._pilots is not None and mode in GUIDED:
            self.wrong("a pilot is not fought", now_s, 1.0, mode)

    def see(self, now_s: float, flight: Any) -> None:
        """Check the vehicle's position; called from engagement on."""
        mode = self._pursuer.mode
        if self._pursuer.autopilot.boots > 1 or self._obeys_another(now_s):
            self._ours = False
        elif mode in GUIDED and self._pursuer.armed:
            self._guided_s = now_s
            self._ours = True
        elif mode not in HOLDS or now_s - self._guided_s > BRAKING_S:
            self._ours = False
        sight = self._sight(now_s, flight)
        allowed = self._allowed(sight)
        if self._ours and self._home_m is not None:
            self._walls(sight, self._home_m, allowed)
        else:
            self._entered_m = 0.0
        self._before = sight

    def _obeys_another(self, now_s: float) -> bool:
        begun_s = self._begun_s("second_source")
        return self.engaged_s is not None and now_s - self.engaged_s >= begun_s

    def _begun_s(self, kind: str) -> float:
        return min(
            (fault.at_s for fault in self.case.scenario.fault if fault.kind == kind),
            default=math.inf,
        )

    def _notice_another(self, now_s: float, state: State) -> None:
        """Check that another program is noticed within two seconds if it is the only fault."""
        if (
            self.case.kinds == ("second_source",)
            and self.engaged_s is not None
            and state in SETPOINT_STATES
        ):
            begun_s = self.engaged_s + self._begun_s("second_source")
            (fault,) = self.case.scenario.fault
            keys = fault.model_extra or {}
            theirs = (keys["north"], keys["east"], keys["down"])
            while self._asked and now_s - self._asked[0][0] > RESEMBLING_S:
                self._asked.popleft()
            if any(_resembles(theirs, ours) for _, ours in self._asked):
                self._resembled_s = now_s
            since_s = now_s - max(begun_s, self._resembled_s)
            if since_s > NOTICED_S:
                self.wrong("another program is noticed", now_s, since_s)

    def _allowed(self, sight: Sight) -> tuple[float, float, float]:
        """Return the largest recent errors: horizontal and vertical, both with the blind distance, and the evader's."""
        blind_m = self._blind.take(sight.now_s, sight.blind_m)
        level_m, height_m = sight.error_m
        evader_m = self._evaders.take(sight.now_s, math.hypot(*sight.evader_error_m))
        level_m = self._level.take(sight.now_s, level_m)
        height_m = self._height.take(sight.now_s, height_m)
        return level_m + blind_m, height_m + blind_m, evader_m

    def _walls(self, sight: Sight, home_m: Vector, allowed_m: tuple[float, float, float]) -> None:
        level_m, height_m, evader_m = allowed_m
        about_m = level_m + self._home_off_m[0]
        above_m = height_m + self._home_off_m[1]
        limits = self.case.scenario.limits
        north, east, down = (at - home for at, home in zip(sight.pursuer_m, home_m, strict=True))
        self._breach("fence", sight, math.hypot(north, east) - limits.fence_radius_m, about_m)
        if self._polygon is not None and not self._polygon.contains((north, east)):
            beyond_m = min(
                math.dist((north, east), point)
                for point in self._polygon.nearest_points((north, east))
            )
            self._breach("polygon", sight, beyond_m, about_m)
        self._weakened(sight)
        self._breach("floor", sight, limits.floor_m + down, above_m + self._sunk_m)
        self._breach("ceiling", sight, -down - limits.ceiling_m, above_m + self._risen_m)
        self._breach(
            "stand-off", sight, self._into(sight), math.hypot(level_m, height_m) + evader_m
        )

    def _weakened(self, sight: Sight) -> None:
        """Integrate how far a vehicle with a loss of thrust sinks or rises relative to its setpoint."""
        begun_s = math.inf if self.engaged_s is None else self.engaged_s
        spans = [
            (begun_s + fault.at_s, begun_s + fault.at_s + (fault.for_s or math.inf) + BRAKING_S)
            for fault in self.case.scenario.fault
            if fault.kind == "thrust_loss"
        ]
        if self._before is None or not any(first <= sight.now_s <= last for first, last in spans):
            self._sunk_m = self._risen_m = 0.0
            return
        off_m = self._pursuer.truth.velocity_ned_m_s[2] - self._asked_down_m_s
        off_m *= sight.now_s - self._before.now_s
        self._sunk_m += max(0.0, off_m)
        self._risen_m += max(0.0, -off_m)

    def _into(self, sight: Sight) -> float:
        """Return how far the vehicle's own motion took it into the stand-off; the evader's motion is not counted."""
        gap_m = self._gap(sight.pursuer_m, sight.evader_m)
        if self._before is None or gap_m >= 0.0:
            self._entered_m = 0.0
            return 0.0
        was_m = min(0.0, self._gap(self._before.pursuer_m, sight.evader_m))
        self._entered_m = max(0.0, self._entered_m + was_m - gap_m)
        return self._entered_m

    def _gap(self, pursuer_m: Vector, evader_m: Vector) -> float:
        disc = self.case.scenario.standoff
        beside_m = math.dist(pursuer_m[:2], evader_m[:2]) - max(0.5, disc.radius_m - 1.0)
        above_m = evader_m[2] - pursuer_m[2] - max(0.5, disc.height_m - 1.0)
        return max(beside_m, above_m)

    def _breach(self, wall: str, sight: Sight, breach_m: float, allowed_m: float) -> None:
        if breach_m > self.breaches_m.get(wall, 0.0):
            self.breaches_m[wall] = breach_m
        # The allowance at the time of the breach applies until the vehicle is back inside.
        allowed_m = max(allowed_m, self._granted_m.get(wall, 0.0))
        self._granted_m[wall] = allowed_m if breach_m > 0.0 else 0.0
        if breach_m > allowed_m + SPARE_M:
            excess_m = breach_m - allowed_m
            self.wrong(
                wall, sight.now_s, excess_m, f"{breach_m:.2f} m beyond, {allowed_m:.2f} m of error"
            )

    def _sight(self, now_s: float, flight: Any) -> Sight:
        pursuer = self._pursuer
        evader = self.rover
        frame = pursuer.autopilot.frame
        here = pursuer.truth.position_ned_m
        there = frame.to_local(*evader.autopilot.frame.to_geodetic(*evader.truth.position_ned_m))
        error = pursuer.autopilot.state.estimator.position_error_m
        level_m = math.hypot(*error[:2])
        height_m = abs(error[2])
        local = flight.vehicle.latest.get(LocalPosition)
        believed = flight.tracking.local_frame
        self._flown.append((pursuer.autopilot.since_boot_s(now_s), here))
        if local is not None and believed is not None:
            level = height = 0.0
            if not self.is_forged and "position_forger" not in self.case.kinds:
                was_m = self._was_at(local.time_boot_s)
                level, height = _apart(_in_frame(frame, believed, local.position_ned_m), was_m)
            unheard_s = flight.vehicle.silence_s(LocalPosition, now_s)
            if unheard_s > BLIND_AFTER_S:
                flown_m = math.hypot(*pursuer.truth.velocity_ned_m_s) * unheard_s
                level += flown_m
                height += flown_m
            level_m = max(level_m, level)
            height_m = max(height_m, height)
        evader_error = (0.0, 0.0)
        estimate = flight.tracking.evader(now_s)
        if estimate is not None and believed is not None:
            evader_error = _apart(_in_frame(frame, believed, estimate.position_ned_m), there)
        blind_s = self._heard.longest_gap_s(now_s)
        blind_m = (
            math.hypot(*pursuer.truth.velocity_ned_m_s) * blind_s
            if blind_s > BLIND_AFTER_S
            else 0.0
        )
        return Sight(now_s, here, there, (level_m, height_m), evader_error, blind_m)

    def _was_at(self, boot_s: float) -> Vector:
        """Return where the vehicle truly was at this time of its own clock; where it is if that is not known."""
        for flown_s, place_m in reversed(self._flown):
            if flown_s <= boot_s + _STAMPED_S:
                return place_m
        return self._flown[-1][1]

    def ended(self, now_s: float, state: State) -> None:
        """Check the final state."""
        if state not in ENDS:
            self.wrong("an end", now_s, 1.0, str(state))


def _is_setpoint(frame: bytes) -> bool:
    """Return whether a MAVLink 2 frame is a complete velocity setpoint."""
    return frame[7:10] == _SETPOINT_BYTES and frames.message_id(frame) == SETPOINT


def _resembles(theirs: Vector, ours: Vector) -> bool:
    """Whether a velocity is near ours, or near a part of ours between half and all of it."""
    square = sum(part * part for part in ours)
    along = sum(one * other for one, other in zip(theirs, ours, strict=True))
    share = min(1.0, max(0.5, along / square)) if square > 0.0 else 1.0
    return math.dist(theirs, [share * part for part in ours]) <= RESEMBLING_M_S


def _in_frame(frame: Any, believed: Any, position_ned_m: Vector) -> Vector:
    latitude_deg, longitude_deg, altitude = believed.wgs84_from_ned(position_ned_m)
    metres = altitude.metres if isinstance(altitude, Amsl) else altitude
    place: Vector = frame.to_local(*Home(latitude_deg, longitude_deg, metres))
    return place


def _apart(one: Vector, other: Vector) -> tuple[float, float]:
    return math.dist(one[:2], other[:2]), abs(one[2] - other[2])
