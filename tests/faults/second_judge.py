"""A second judge of fault flights, written from docs/faults.md without knowledge of the first one.

    python -m tests.faults.second_judge                           # 60 flights of seed 26
    python -m tests.faults.second_judge --flights 1000 --seed 26
    python -m tests.faults.second_judge --seed 26 --only 218      # one flight

It sees the frames on both vehicles' wires, the true motion of both vehicles, the setpoint and mode that the autopilot
really flies, and the names of the service's own events. It judges the invariants of docs/faults.md but "replay bit for
bit", which needs the record. Exit code 1 if a flight violates one.
"""

import argparse
import math
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as dialect

from guidance.sim.scenario import EVADER, EVADER_ID, PURSUER, PURSUER_ID
from guidance.sim.stepped import SteppedWorld
from tests.faults import flying
from tests.faults.drawing import PILOT_MODES, Case, draw_case

Vector = tuple[float, float, float]

GUIDED = {"OFFBOARD", "GUIDED"}
HOLDS = ("HOLD", "LOITER", "BRAKE")
WALLS = ("fence", "polygon", "floor", "ceiling", "stand-off")
PROGRAMS = {"second_source"}
PILOTS = {"pilot_mode", "pilot_sticks"}

ALLOWED_M = 0.3
BEFORE_S = 3.0
"""The errors of reported positions count as the largest of this time."""

BRAKING_S = 3.0
"""The walls hold this much longer than the vehicle follows our setpoints."""

FRESH_S = 0.15
"""A setpoint that is flown longer than this after it was sent has no successor: frames are lost, late or not sent."""

CYCLE_S = 0.02
CATCH_UP = 1.1
"""Commands may exceed the game's speeds by 10 %."""

OLDEST_S = 1.0
NOTICED_S = 2.0
RESEMBLING_S = 1.5
RESEMBLING_M_S = 0.75
"""A stranger's setpoint that resembles one of ours of this time, or a shortened one, need not be noticed."""

PROMPT_S = 0.1
SILENCE_S = 1.5
"""The evader counts as lost after this long without a report (`evader.timeout_s`)."""

SETTLED_S = 3.0
HOVER_M_S = 0.5
HOLD_M_S = 1.4
"""Largest speed of a hold by setpoints: 0.5 m/s back to the place, 0.6 m/s on each axis against the drift."""
EVERYTHING_IGNORED = 0x1FF


class Wrong(NamedTuple):
    """The worst violation of one invariant."""

    name: str
    at_s: float
    size: float
    text: str


class Largest:
    """The largest of the values of the last `BEFORE_S`."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, float]] = deque()

    def add(self, now_s: float, value: float) -> float:
        """Add a value; return the largest."""
        while self._kept and self._kept[-1][1] <= value:
            self._kept.pop()
        self._kept.append((now_s, value))
        while self._kept[0][0] < now_s - BEFORE_S:
            self._kept.popleft()
        return self._kept[0][1]


class Told:
    """Data of one vehicle from its frames: positions in the pursuer's local frame, and arrival times."""

    def __init__(self, system_id: int, names: Sequence[str]) -> None:
        self._system_id = system_id
        self._names = names
        self.positions_m: dict[str, Vector] = {}
        self.heard_s = -math.inf
        self.fresh_s = -math.inf
        self.home_m: Vector | None = None
        self.modes: list[int] = []
        self._newest_ms = -math.inf
        self._decoder = dialect.MAVLink(None)

    def hear(self, now_s: float, frame: bytes, place: Any) -> None:
        """Take a frame; `place` turns latitude, longitude and altitude into a position."""
        message = decoded(self._decoder, frame)
        if (
            message is None
            or message.get_srcSystem() != self._system_id
            or message.get_srcComponent() != 1
        ):
            return
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.modes.append(message.custom_mode)
        elif kind == "HOME_POSITION":
            self.home_m = place(
                message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3
            )
        elif kind in self._names:
            if kind == "LOCAL_POSITION_NED":
                position = (message.x, message.y, message.z)
            else:
                position = place(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
            self.heard_s = now_s
            if (
                message.time_boot_ms > self._newest_ms
                or message.time_boot_ms < self._newest_ms - 2000
            ):
                self._newest_ms = message.time_boot_ms
                self.fresh_s = now_s
            self.positions_m[kind] = position

    def error_m(self, true_m: Vector) -> Vector:
        """Return the largest error of the last reported positions: horizontal, vertical and in space."""
        errors = [difference(position, true_m) for position in self.positions_m.values()]
        return (
            max((math.hypot(one[0], one[1]) for one in errors), default=0.0),
            max((abs(one[2]) for one in errors), default=0.0),
            max((math.hypot(*one) for one in errors), default=0.0),
        )


WANTED = {0, 32, 33, 84, 242}


def decoded(decoder: Any, frame: bytes) -> Any:
    """Return the message of a frame if it is whole and matters here, else None."""
    if len(frame) < 12:
        return None
    number = frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")
    if number not in WANTED:
        return None
    try:
        return decoder.decode(bytearray(frame))
    except dialect.MAVError:
        return None


def difference(one: Vector, other: Vector) -> Vector:
    """Return one minus other."""
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def outside_m(point: tuple[float, float], corners: Sequence[tuple[float, float]]) -> float:
    """Return how far a point is outside of a convex or other simple polygon; 0 inside."""
    inside = False
    nearest = math.inf
    for (a_n, a_e), (b_n, b_e) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (a_e > point[1]) != (b_e > point[1]) and point[0] < a_n + (point[1] - a_e) / (
            b_e - a_e
        ) * (b_n - a_n):
            inside = not inside
        along = (point[0] - a_n) * (b_n - a_n) + (point[1] - a_e) * (b_e - a_e)
        share = min(1.0, max(0.0, along / ((b_n - a_n) ** 2 + (b_e - a_e) ** 2)))
        nearest = min(
            nearest, math.dist(point, (a_n + share * (b_n - a_n), a_e + share * (b_e - a_e)))
        )
    return 0.0 if inside else nearest


class SecondJudge:
    """Judges one flight. `tests.faults.flying` calls it in the place of its own judge.

    Args:
        case: The flight.
        world: Both vehicles. Their frames are copied from its `drain`.
    """

    def __init__(self, case: Case, world: SteppedWorld) -> None:
        self.case = case
        self.worst: dict[str, Wrong] = {}
        self.breaches_m: dict[str, float] = dict.fromkeys(WALLS, 0.0)
        self._world = world
        self._frames: list[Any] = []
        world.drain = self._drain  # type: ignore[method-assign]
        self._pursuer = Told(PURSUER_ID, ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"))
        self._evader = Told(EVADER_ID, ("GLOBAL_POSITION_INT",))
        self._decoder = dialect.MAVLink(None)
        self._sent: deque[tuple[float, Vector]] = deque(maxlen=500)
        self._first_s = self._last_s = math.nan
        self._home_error_m: Vector = (0.0, 0.0, 0.0)
        self._errors = [Largest() for _ in range(4)]
        self._excused_m = dict.fromkeys(WALLS, 0.0)
        self._followed_s = -math.inf
        self._age_s = 0.0
        self._foreign_s = math.nan
        self._strange_s = -math.inf
        self._noticed = False
        self._weak_s = -math.inf
        self._sunk_m = self._risen_m = 0.0
        self._told_left_s = math.nan
        self._flown_by_pilot = False
        self._pilot_modes = PILOT_MODES[case.scenario.pursuer.autopilot]
        self._boots = world.vehicles[PURSUER].autopilot.boots
        self._free = False
        self._intruded_m = 0.0
        self._before: tuple[float, Vector, Vector] | None = None

    def _drain(self) -> Sequence[Any]:
        passed = SteppedWorld.drain(self._world)
        self._frames += passed
        return passed

    # Called by tests.faults.flying

    def sent(self, now_s: float, ours: Sequence[bytes], outputs: Any, _flight: Any) -> None:
        """Judge one cycle's frames to the vehicle, and the events of the service."""
        frames = self._frames
        self._frames = []
        place = self._world.vehicles[PURSUER].autopilot.frame.to_local
        for one in frames:
            if one.topic == f"{PURSUER}/mavlink_raw/out":
                self._pursuer.hear(now_s, one.frame, place)
            elif one.topic == f"{EVADER}/mavlink_raw/out":
                self._evader.hear(now_s, one.frame, place)
        messages = [
            message for frame in ours if (message := decoded(self._decoder, frame)) is not None
        ]
        setpoints = [one for one in messages if one.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
        self._follow(now_s)
        if len(setpoints) > 1:
            self.wrong(
                "one setpoint per cycle", now_s, len(setpoints), f"{len(setpoints)} setpoints"
            )
        for message in setpoints:
            self._judge_setpoint(now_s, message)
        names = {str(transition.event) for transition in outputs.transitions}
        self._noticed |= "setpoints of another source" in names
        if (
            "second source of the evader's reports" in names
            and "evader_forger" not in self.case.kinds
        ):
            self.wrong("no false rival", now_s, 1.0, f"kinds {', '.join(self.case.kinds)}")

    def followed(self, _now_s: float, _outputs: Any, _flight: Any) -> None:
        """Transitions are not on the wire."""

    def see(self, now_s: float, _flight: Any) -> None:
        """Judge the true motion."""
        pursuer = self._world.vehicles[PURSUER]
        body = pursuer.truth
        position = body.position_ned_m
        velocity = body.velocity_ned_m_s
        level_m, height_m, whole_m = self._pursuer.error_m(position)
        evader_m = self._evader_m()
        _, _, evader_error_m = self._evader.error_m(evader_m)
        level_m, height_m, whole_m, evader_error_m = (
            largest.add(now_s, value)
            for largest, value in zip(
                self._errors, (level_m, height_m, whole_m, evader_error_m), strict=True
            )
        )
        self._weaken(now_s, velocity[2])
        before = self._before
        self._before = (now_s, position, evader_m)
        if math.isnan(self._first_s):
            return
        self._notice_reboots()
        limits = self.case.scenario.limits
        standoff = self.case.scenario.standoff
        up_m = -position[2]
        home = self._home_error_m
        away_m = math.hypot(position[0], position[1])
        breaches = {
            "fence": (away_m - limits.fence_radius_m, level_m + home[0]),
            "polygon": (
                outside_m(position[:2], self.case.corners_m) if self.case.corners_m else -math.inf,
                level_m + home[0],
            ),
            "floor": (limits.floor_m - up_m, height_m + home[1] + self._sunk_m),
            "ceiling": (up_m - limits.ceiling_m, height_m + home[1] + self._risen_m),
            "stand-off": (
                self._intrusion_m(
                    before, position, evader_m, standoff.radius_m - 1.0, standoff.height_m - 1.0
                ),
                whole_m + evader_error_m + home[1] + self._sunk_m,
            ),
        }
        judged = not self._free and now_s - self._followed_s <= BRAKING_S and self._counts(pursuer)
        for name, (breach_m, error_m) in breaches.items():
            self._judge_wall(now_s, name, breach_m, error_m, velocity, judged=judged)

    def ended(self, now_s: float, state: Any) -> None:
        """Judge the end: handed over, and silent since."""
        pushed = bool(self._sent) and math.hypot(*self._sent[-1][1]) > HOLD_M_S
        # A refused hold is a hover of ours
        if now_s - self._last_s < FRESH_S and now_s < flying.LONGEST_S and pushed:
            self.wrong(
                "a proper end", now_s, now_s - self._last_s, f"setpoints to the end, state {state}"
            )

    def wrong(self, name: str, now_s: float, size: float, text: str) -> None:
        """Keep the worst violation of each invariant."""
        if name not in self.worst or size > self.worst[name].size:
            self.worst[name] = Wrong(name, now_s, size, text)

    # Setpoints

    def _judge_setpoint(self, now_s: float, message: Any) -> None:
        velocity = (message.vx, message.vy, message.vz)
        values = (message.x, message.y, message.z, *velocity, message.afx, message.afy, message.afz)
        values = (*values, message.yaw, message.yaw_rate)
        if not all(map(math.isfinite, values)):
            self.wrong("numbers", now_s, 1.0, f"{values}")
            return
        if math.isnan(self._first_s):
            self._first_s = now_s
            told = self._pursuer.home_m
            true = self._world.vehicles[PURSUER].autopilot.state.home_m
            off = (
                difference(told, (0.0, 0.0, true[2] if true else 0.0)) if told else (0.0, 0.0, 0.0)
            )
            self._home_error_m = (math.hypot(off[0], off[1]), abs(off[2]), 0.0)
        self._last_s = now_s
        self._sent.append((now_s, velocity))
        self._judge_speed(now_s, velocity)
        self._judge_age(now_s, velocity)
        self._judge_height(now_s, velocity)
        if now_s - self._told_left_s > PROMPT_S:
            self.wrong(
                "silence after yielding",
                now_s,
                now_s - self._told_left_s,
                "after HEARTBEAT of another mode",
            )
        if now_s - self._foreign_s > NOTICED_S + PROMPT_S and not self._noticed:
            self.wrong(
                "another program is noticed",
                now_s,
                now_s - self._foreign_s,
                "setpoints beside a stranger's",
            )

    def _judge_speed(self, now_s: float, velocity: Vector) -> None:
        speeds = self.case.scenario.pursuer.speeds
        shares = (
            math.hypot(velocity[0], velocity[1]) / speeds.speed_m_s,
            -velocity[2] / speeds.climb_m_s,
            velocity[2] / speeds.descent_m_s,
        )
        if max(shares) > CATCH_UP + 1e-3:
            self.wrong("speed limits", now_s, max(shares), f"velocity {velocity}")

    def _judge_age(self, now_s: float, velocity: Vector) -> None:
        age_s = now_s - self._pursuer.fresh_s
        if age_s > OLDEST_S + 2 * CYCLE_S:
            self.wrong("no old position", now_s, age_s, f"position {age_s:.2f} s old")
        silent_s = now_s - self._evader.heard_s
        if silent_s > SILENCE_S + SETTLED_S and math.hypot(*velocity) > HOVER_M_S:
            self.wrong(
                "no chase of an old place",
                now_s,
                math.hypot(*velocity),
                f"evader silent for {silent_s:.1f} s",
            )

    def _judge_height(self, now_s: float, velocity: Vector) -> None:
        limits = self.case.scenario.limits
        up_m = -self._world.vehicles[PURSUER].truth.position_ned_m[2]
        error_m = self._errors[1].add(now_s, 0.0) + self._home_error_m[1] + 0.1
        if up_m < limits.floor_m - error_m and velocity[2] > 0.05:
            self.wrong(
                "nothing is asked further out", now_s, velocity[2], f"descends at {up_m:.2f} m"
            )
        if up_m > limits.ceiling_m + error_m and velocity[2] < -0.05:
            self.wrong(
                "nothing is asked further out", now_s, -velocity[2], f"climbs at {up_m:.2f} m"
            )

    # The setpoints that the vehicle follows

    def _follow(self, now_s: float) -> None:
        """Find out whether our setpoints are flown, and since when they are not."""
        pursuer = self._world.vehicles[PURSUER]
        if math.isnan(self._first_s):
            self._pursuer.modes.clear()
            return
        guided = pursuer.mode in GUIDED
        if guided:
            flown = pursuer.autopilot.report.setpoint.velocity_ned_m_s
            sent_s = next(
                (at_s for at_s, one in reversed(self._sent) if math.dist(one, flown) < 1e-3),
                -math.inf,
            )
            # A vehicle that gave up an old setpoint and brakes by itself has not followed a new one since.
            self._age_s = (
                now_s - sent_s if math.isfinite(sent_s) else max(self._age_s, now_s - self._last_s)
            )
            if not math.isfinite(sent_s) and PROGRAMS & set(self.case.kinds):
                self._free = True
            self._look_for_strangers(now_s, flown)
            self._followed_s = now_s
            if self._flown_by_pilot:
                self.wrong(
                    "a pilot is not fought",
                    now_s,
                    now_s - self._followed_s,
                    f"{pursuer.mode} again",
                )
        elif self._followed_s > -math.inf:
            self._flown_by_pilot |= (
                bool(PILOTS & set(self.case.kinds)) and pursuer.mode in self._pilot_modes
            )
            if pursuer.autopilot.commander.custom_mode in self._pursuer.modes and math.isnan(
                self._told_left_s
            ):
                self._told_left_s = now_s
        self._pursuer.modes.clear()

    def _look_for_strangers(self, now_s: float, flown: Vector) -> None:
        """Find out since when setpoints are flown that resemble none of ours, at least twice a second."""
        if not PROGRAMS & set(self.case.kinds) or not all(map(math.isfinite, flown)):
            return
        ours = [one for at_s, one in self._sent if now_s - at_s <= RESEMBLING_S]
        shares = (0.5, 0.625, 0.75, 0.875, 1.0)
        if all(
            math.dist(flown, [share * part for part in one]) > RESEMBLING_M_S
            for one in ours
            for share in shares
        ):
            self._foreign_s = now_s if math.isnan(self._foreign_s) else self._foreign_s
            self._strange_s = now_s
        elif now_s - self._strange_s > 0.5 + PROMPT_S:
            self._foreign_s = math.nan

    def _counts(self, pursuer: Any) -> bool:
        """Return whether the walls hold in this mode: ours, or the hold after it, unless a pilot flies."""
        if pursuer.mode in GUIDED:
            return True
        return any(name in pursuer.mode for name in HOLDS) and not PILOTS & set(self.case.kinds)

    def _notice_reboots(self) -> None:
        self._free |= self._world.vehicles[PURSUER].autopilot.boots != self._boots

    # Walls

    def _judge_wall(
        self,
        now_s: float,
        name: str,
        breach_m: float,
        error_m: float,
        velocity: Vector,
        *,
        judged: bool,
    ) -> None:
        if breach_m <= 0.0:
            self._excused_m[name] = 0.0
        if self._age_s > FRESH_S:  # the vehicle still flies the last setpoint and then brakes
            speed_m_s = math.hypot(velocity[0], velocity[1])
            ahead_m = 0.35 * speed_m_s + speed_m_s**2 / 6.0
            if name in {"floor", "ceiling"}:
                ahead_m = 0.35 * abs(velocity[2]) + velocity[2] ** 2 / 4.0
            self._excused_m[name] = max(self._excused_m[name], breach_m + ahead_m)
        if not judged or breach_m <= 0.0:
            return
        self._excused_m[name] = max(self._excused_m[name], error_m)
        over_m = breach_m - self._excused_m[name]
        self.breaches_m[name] = max(self.breaches_m[name], over_m)
        if over_m > ALLOWED_M:
            self.wrong(
                name,
                now_s,
                over_m,
                f"{breach_m:.2f} m outside, of which {self._excused_m[name]:.2f} m excused",
            )

    def _intrusion_m(
        self,
        before: tuple[float, Vector, Vector] | None,
        position: Vector,
        evader_m: Vector,
        radius_m: float,
        height_m: float,
    ) -> float:
        """Return how deep the vehicle itself has flown into the evader's space; the evader's own approach is free."""

        def depth_m(vehicle: Vector, evader: Vector) -> float:
            away_m = math.hypot(vehicle[0] - evader[0], vehicle[1] - evader[1])
            return min(radius_m - away_m, height_m + vehicle[2])

        if before is None or depth_m(position, evader_m) <= 0.0:
            self._intruded_m = 0.0
            return 0.0
        _, was, evader_was = before
        own_m = max(0.0, depth_m(position, evader_was)) - max(0.0, depth_m(was, evader_was))
        self._intruded_m = min(max(0.0, self._intruded_m + own_m), depth_m(position, evader_m))
        return self._intruded_m

    def _weaken(self, now_s: float, down_m_s: float) -> None:
        """Integrate the actual minus the commanded vertical motion while the rotors are weak and 3 s longer."""
        if self._world.vehicles[PURSUER].autopilot.conditions.thrust_share < 1.0:
            self._weak_s = now_s
        if now_s - self._weak_s > BEFORE_S or self._before is None:
            return
        wanted_m_s = self._sent[-1][1][2] if self._sent else 0.0
        moved_m = (down_m_s - wanted_m_s) * (now_s - self._before[0])
        self._sunk_m += max(0.0, moved_m)
        self._risen_m += max(0.0, -moved_m)

    def _evader_m(self) -> Vector:
        evader = self._world.vehicles[EVADER].autopilot
        pursuer = self._world.vehicles[PURSUER].autopilot
        place: Vector = pursuer.frame.to_local(
            *evader.frame.to_geodetic(*self._world.vehicles[EVADER].truth.position_ned_m)
        )
        return place


def judged(
    seed: int, number: int, starts: flying.Starts
) -> tuple[str, Mapping[str, float], Sequence[Wrong]]:
    """Fly one flight under this judge; return its end, its breaches and its violations."""
    flying.Watch = SecondJudge  # type: ignore[assignment,misc]
    row = flying.fly(draw_case(seed, number), None, starts)
    return row.end, row.breaches_m, tuple(row.violations)  # type: ignore[arg-type]


def main(arguments: Sequence[str]) -> int:
    """Fly and judge; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.faults.second_judge", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--flights", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first flight")
    parser.add_argument("--seed", type=int, default=26)
    parser.add_argument("--only", type=int, help="one flight")
    given = parser.parse_args(arguments)
    numbers = (
        [given.only] if given.only is not None else range(given.first, given.first + given.flights)
    )
    starts = flying.Starts()
    bad = 0
    began_s = time.process_time()
    largest = dict.fromkeys(WALLS, 0.0)
    for done, number in enumerate(numbers, start=1):
        end, breaches, wrongs = judged(given.seed, number, starts)
        largest = {name: max(value, breaches[name]) for name, value in largest.items()}
        if wrongs:
            bad += 1
            print(f"{number}: {end}; {', '.join(draw_case(given.seed, number).kinds)}")
            for one in wrongs:
                print(
                    f"    {one.name} at {one.at_s:.2f} s: {one.size:.2f} ({one.text})", flush=True
                )
        elif given.only is not None:
            print(f"{number}: {end}")
        if done % 20 == 0:
            print(f"{done} of {len(numbers)} flights, {done - bad} as wanted", flush=True)
    print(
        f"{len(numbers) - bad} of {len(numbers)} flights as wanted, {time.process_time() - began_s:.0f} s of processor"
    )
    print(
        "largest breach beyond what is allowed for errors: "
        + ", ".join(f"{k} {v:.2f} m" for k, v in largest.items())
    )
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
