"""A mission in flight: its legs, its orders and its progress."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from sitl_mock.protocols import PlanItem, PlanStore
from sitl_mock.vector import Vector
from sitl_mock.vehicle.state import Severity, VehicleState

WAYPOINT: Final = 16
LOITER_UNLIMITED: Final = 17
LOITER_TIME: Final = 19
RETURN: Final = 20
LAND: Final = 21
TAKEOFF: Final = 22
LOITER_TURNS: Final = 18
NAV_DELAY: Final = 93
CONDITION_DELAY: Final = 112
CONDITION_DISTANCE: Final = 114
CONDITION_YAW: Final = 115
DO_JUMP: Final = 177
DO_CHANGE_SPEED: Final = 178
JUMP_TAG: Final = 600
DO_JUMP_TAG: Final = 601
_CONDITIONS: Final = frozenset({CONDITION_DELAY, CONDITION_DISTANCE, CONDITION_YAW})
_JUMPS: Final = frozenset({DO_JUMP, DO_JUMP_TAG})
_NOT_REPORTED: Final = _JUMPS | {
    *(181, 182, 183, 184, 202, 203, 206, 208, 211, 215, 216, 217, 218),
    *(531, 532, 534, 1000, 2000, 2001, 2500, 2501),
}
"""Items without a position that ArduCopter 4.5.7 executes without MISSION_ITEM_REACHED."""
_PLACES: Final = frozenset(
    {WAYPOINT, LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME, LAND, TAKEOFF, 82}
)
_RESTARTED: Final = frozenset({WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, 82})
"""Items that ArduPilot begins again when the mission changes."""
_RELATIVE_FRAMES: Final = frozenset({3, 6, 10, 11})
_RUN_OUT: Final = frozenset({"finished", "landed"})
"""Ends of a mission behind its last item."""
_HEIGHT_REACHED_M: Final = 0.8
_REACHED_M: Final = 2.0
_LANDED_S: Final = 2.8
"""PX4 completes a landing item when the landing is detected (measured)."""
_TAKEN_OFF_M: Final = 0.25
"""ArduPilot ends a mission's take-off this close to its height, independent of horizontal drift (measured)."""


class Leg(NamedTuple):
    """The motion of the present item.

    Attributes:
        position_m: Where to fly, or the centre of a circle.
        yaw_rad: Heading, NaN for the default.
        speed_m_s: Set by DO_CHANGE_SPEED, NaN for the default.
        landing: It is a landing.
        taking_off: It is a take-off.
        waiting: A NAV_DELAY has not passed yet.
        turns: Circles to fly around the position, NaN for none.
        radius_m: Their radius, negative for counter-clockwise, 0 for the default.
    """

    position_m: Vector
    yaw_rad: float = math.nan
    speed_m_s: float = math.nan
    landing: bool = False
    taking_off: bool = False
    waiting: bool = False
    turns: float = math.nan
    radius_m: float = 0.0

    @property
    def circling(self) -> bool:
        """True for LOITER_TURNS."""
        return not math.isnan(self.turns)


def flyable(items: Sequence[PlanItem]) -> bool:
    """True if a mission has an item that moves the vehicle."""
    return any(item.command in _PLACES or item.command == RETURN for item in items)


def _is_nowhere(item: PlanItem) -> bool:
    """True for a position without a height, which PX4 stores, and before which it waits for ever (measured)."""
    has_height = math.isfinite(item.z) or item.command in {LAND, TAKEOFF}
    return item.command in _PLACES and not has_height


def _rejected(items: Sequence[PlanItem], state: VehicleState) -> bool:
    """True for what PX4 accepts but does not fly: a landing first, a take-off to below home or behind a position.

    Each was uploaded to v1.17.
    """
    if items[0].command == LAND and state.on_ground:
        return True
    home_amsl_m = state.frame.origin.alt_amsl_m - (state.home_m[2] if state.home_m else 0.0)
    is_first = True
    for item in items:
        if item.command == TAKEOFF:
            zero_m = 0.0 if item.frame in _RELATIVE_FRAMES else home_amsl_m
            if not is_first or item.z <= zero_m:
                return True
        if item.command in _PLACES or item.command == RETURN:
            is_first = False
    return False


@dataclass(slots=True)
class MissionFlight:
    """Progress through the mission in a plan store.

    Attributes:
        plans: Where the mission is.
        skip_home: The first item is home and is not flown to (ArduPilot).
        climbs_first: If the first position is higher, the vehicle climbs to its height first (PX4).
        ends_for_good: A finished mission has no present item until it is replaced, an item is chosen, or the vehicle
            has been disarmed (PX4); else it starts again at its first item.
        begun: It has been started since the mode or arming began.
        landing_reported: Its end by a landing has been reported (PX4).
        valid: There is a mission, and it passed the checks after its upload (PX4).
        clocked: Positions count as reached at `due_s`, according to the planned motion, and LOITER_TURNS is flown
            (ArduCopter).
        due_s: Planned arrival at the present position.
        speed_m_s: Set by DO_CHANGE_SPEED, NaN for the default.
        reached: Sequence numbers reached but not yet reported.
        over: Reason for the end of the mission: finished, return or landed; "" while flying.
        turned_rad: Angle flown of LOITER_TURNS, kept by the commander; NaN before the circle begins.
        orders: Items without a position whose effect is the commander's, in their order.
        turning: The turn of the last CONDITION_YAW is in progress; kept by the commander.
        conditions: Items behind a condition are executed beside the flight to the next position, when the condition
            is met, and dropped when the position is reached first (ArduPilot). PX4 skips conditions.
    """

    plans: PlanStore
    skip_home: bool = False
    climbs_first: bool = False
    ends_for_good: bool = False
    begun: bool = False
    landing_reported: bool = False
    valid: bool = False
    clocked: bool = False
    conditions: bool = False
    due_s: float = math.inf
    speed_m_s: float = math.nan
    over: str = ""
    reached: list[int] = field(default_factory=list)
    turned_rad: float = math.nan
    orders: list[PlanItem] = field(default_factory=list)
    turning: bool = False
    _revision: int = -1
    _flown_revision: int = -1
    _judged_revision: int = -1
    _rested: bool = False
    _hold_until_s: float = math.inf
    _behind: list[PlanItem] = field(default_factory=list)
    _condition_until_s: float = math.inf
    _stay: Leg | None = None
    _jumps: dict[int, int] = field(default_factory=dict)
    _climb_judged: bool = False
    _climb: Leg | None = None

    @property
    def current(self) -> int:
        """Sequence number of the present item."""
        return self.plans.current

    @current.setter
    def current(self, seq: int) -> None:
        self.plans.current = seq

    @property
    def count(self) -> int:
        """Items in the mission."""
        return len(self.plans.mission.items)

    @property
    def takes_off(self) -> bool:
        """True if the first moving item is a take-off."""
        items = self.plans.mission.items[1:] if self.skip_home else self.plans.mission.items
        first = next(
            (item.command for item in items if item.command in _PLACES or item.command == RETURN),
            None,
        )
        return first == TAKEOFF

    def set_current(self, seq: int) -> bool:
        """Continue at an item; False if it does not exist."""
        if not 0 <= seq < self.count:
            return False
        self.current = max(seq, 1) if self.skip_home and self.count > 1 else seq
        self._revision = self.plans.mission.revision
        self.over = ""
        self._forget_progress()
        return True

    def start(self) -> bool:
        """Start or resume; False if there is nothing left to fly.

        A finished mission starts at its first item, unless it ends for good. A new one starts at the number of the
        present item, if it has that many, as on both autopilots.
        """
        revision = self.plans.mission.revision
        self.begun = True
        if self.ends_for_good:
            is_new = self._flown_revision != revision
            ends = self.over in _RUN_OUT and self._revision == revision
            if not self.valid or (ends and not self._rested):
                self.over = "finished"
                return False
            restarts = self._rested and not is_new and self.current + 1 >= self.count
        else:
            is_new = self._revision != revision
            is_beside = not int(self.skip_home) <= self.current < self.count
            restarts = bool(self.over) or is_beside
        if restarts:
            self.current = 1 if self.skip_home and self.count > 1 else 0
        if restarts or is_new:
            self.speed_m_s = math.nan
        if restarts or (is_new and self.ends_for_good):
            self._jumps.clear()
        self._revision = revision
        self._flown_revision = revision
        self._rested = False
        self.landing_reported = False
        self.over = ""
        self._forget_progress()
        self._stay = None
        self._climb_judged = not self.climbs_first
        self._climb = None
        return True

    @property
    def is_unjudged(self) -> bool:
        """True if a mission was uploaded since the last check."""
        return self._judged_revision != self.plans.mission.revision

    def judge(self, state: VehicleState) -> bool:
        """Check a mission once after its upload; True if there was one to check."""
        plan = self.plans.mission
        if not self.is_unjudged:
            return False
        self._judged_revision = plan.revision
        self.valid = flyable(plan.items) and not _rejected(plan.items, state)
        return True

    def reset(self) -> None:
        """Forget the present item: the next start is at the first one (ArduPilot, when it is disarmed)."""
        self.current = 0
        self._forget_progress()
        self._jumps.clear()

    def forget(self) -> None:
        """Notice that the mission was cleared (ArduPilot)."""
        self.reset()
        self.over = ""

    def rest(self) -> None:
        """Notice that the vehicle is disarmed."""
        self.begun = False
        self._rested = True

    def _replace(self, state: VehicleState) -> None:
        """Go on with a mission that was uploaded in flight: at the item that is due (PX4), or at the present number.

        PX4 does not climb to its height first. ArduPilot ends a mission that has no such item, and lets a finished
        one rest until AUTO begins again.
        """
        if self.ends_for_good:
            self.start()
            self._climb_judged = True
            return
        self._revision = self.plans.mission.revision
        if self.over:
            return
        item = self._item()
        if item is not None and item.command in _RESTARTED:
            self._forget_progress()
            state.say(Severity.CRITICAL, "Auto mission changed, restarted command")

    def _forget_progress(self) -> None:
        """Drop the progress of the present item, and the items behind a condition."""
        self._hold_until_s = math.inf
        self.due_s = math.inf
        self.turned_rad = math.nan
        self._behind.clear()
        self._condition_until_s = math.inf

    @property
    def landing(self) -> bool:
        """True if the present item is a landing."""
        item = self._item()
        return item is not None and item.command == LAND

    @property
    def climbing(self) -> bool:
        """True if the vehicle is climbing to the first position's height."""
        item = self._item()
        return self._climb is not None or (item is not None and item.command == TAKEOFF)

    def following(self, state: VehicleState) -> Leg | None:
        """Return the next leg if the vehicle does not stop at the present position."""
        items = self.plans.mission.items
        item = self._item()
        if (
            item is None
            or item.command != WAYPOINT
            or item.param1 > 0.0
            or self.current + 1 >= len(items)
        ):
            return None
        ahead = items[self.current + 1]
        return self._leg_to(state, ahead) if ahead.command == WAYPOINT else None

    def leg(self, state: VehicleState, entered_m: Vector) -> Leg:
        """Return the leg to fly now; advances to the next item when one is reached."""
        stay = Leg(state.position_m if state.on_ground else entered_m)
        if self._revision != self.plans.mission.revision:
            self._replace(state)
        if self.skip_home:
            self.current = max(self.current, 1)
            # After the end of one of ArduPilot's missions another does not begin.
            if self.over:
                return stay
        climb = self._first_climb(state)
        if climb is not None:
            return climb
        for _ in range(self.count + 1):
            item = self._item()
            if item is None:
                break
            if item.command not in _PLACES and item.command != NAV_DELAY:
                self._do(item)
                continue
            if item.command == NAV_DELAY or _is_nowhere(item):
                # A delay, and a position without height, keep the last leg.
                last = stay if self._stay is None or state.on_ground else self._stay
                leg = last._replace(waiting=True, taking_off=False, landing=False, turns=math.nan)
            else:
                leg = self._leg_to(state, item)
            # The items behind a condition are executed as far as conditions are met.
            while self._behind and self._met(state, self._behind[0], leg):
                self._order(self._behind.pop(0))
                self._condition_until_s = math.inf
            self._stay = leg._replace(waiting=False)
            if not self._reached(state, item, leg):
                return leg
            self.reached.append(item.seq)
            self._forget_progress()
            self.current += 1
        if not self.over:
            self.over = "finished"
        return stay

    def _first_climb(self, state: VehicleState) -> Leg | None:
        """Return the climb to the first position's height, while it lasts; a NAV_DELAY comes before it."""
        item = self._item()
        if item is not None and item.command == NAV_DELAY:
            return None
        if not self._climb_judged:
            self._climb_judged = True
            first = next(
                (
                    item
                    for item in self.plans.mission.items[self.current :]
                    if item.command in _PLACES
                ),
                None,
            )
            down_m = self._leg_to(state, first).position_m[2] if first is not None else math.inf
            if down_m < state.position_m[2] - _HEIGHT_REACHED_M:
                north, east, _ = state.position_m
                self._climb = Leg(
                    Vector((north, east, down_m)),
                    speed_m_s=self.speed_m_s,
                    taking_off=state.on_ground,
                )
                home_m = state.home_m[2] if state.home_m else 0.0
                state.say(Severity.INFO, f"Climb to {home_m - down_m:.1f} meters above home")
        climb = self._climb
        if (
            climb is not None
            and state.flew
            and state.position_m[2] - climb.position_m[2] < _HEIGHT_REACHED_M
        ):
            self._climb = None
        return self._climb

    def _item(self) -> PlanItem | None:
        items = self.plans.mission.items
        return items[self.current] if self.current < len(items) else None

    def _do(self, item: PlanItem) -> None:
        """Execute an item without a position: change speed, jump, return; others are skipped."""
        if item.command == RETURN:
            self.over = "return"
            self._tell_done(item)
            return
        if item.command in _JUMPS:
            goal = int(item.param1)
            if item.command == DO_JUMP_TAG:
                # The item behind the JUMP_TAG, which may be missing.
                tags = (
                    item.seq
                    for item in self.plans.mission.items
                    if item.command == JUMP_TAG and int(item.param1) == goal
                )
                goal = next(tags, -1)
            # A jump that leads nowhere, or has been done often enough, is skipped.
            jumps = self._jumps.get(item.seq, 0)
            if jumps < item.param2 and 0 <= goal < self.count:
                self._jumps[item.seq] = jumps + 1
                self.current = goal
                return
        elif self.conditions:
            if self._behind or item.command in _CONDITIONS:
                self._behind.append(item)
            else:
                self._order(item)
        elif item.command == DO_CHANGE_SPEED and item.param2 > 0.0:
            self.speed_m_s = item.param2
        self._tell_done(item)
        self.current += 1

    def _order(self, item: PlanItem) -> None:
        """Execute an item, or leave it to the commander (ArduPilot)."""
        if item.command == DO_CHANGE_SPEED:
            if item.param2 > 0.0:
                self.speed_m_s = item.param2
        elif item.command not in _CONDITIONS:
            self.orders.append(item)
        if item.command not in _NOT_REPORTED:
            self.reached.append(item.seq)

    def _met(self, state: VehicleState, item: PlanItem, leg: Leg) -> bool:
        """True if a condition is met, and for every other item."""
        if item.command == CONDITION_DISTANCE:
            return math.dist(state.position_m[:2], leg.position_m[:2]) < item.param1
        if item.command not in _CONDITIONS:
            return True
        begins = self._condition_until_s == math.inf
        if item.command == CONDITION_YAW:
            if begins:
                self._condition_until_s = state.now_s
                self.turning = True
                self.orders.append(item)
            return not self.turning
        if begins:
            self._condition_until_s = state.now_s + max(item.param1, 0.0)
        return state.now_s >= self._condition_until_s

    def _tell_done(self, item: PlanItem) -> None:
        """Report an item without a position as reached (PX4), instead of the one just before it."""
        if self.climbs_first:
            if self.reached and self.reached[-1] == item.seq - 1:
                self.reached.pop()
            self.reached.append(item.seq)

    def _leg_to(self, state: VehicleState, item: PlanItem) -> Leg:
        position_m = state.position_m
        origin = state.frame.origin
        altitude = item.z if math.isfinite(item.z) else math.nan
        if item.frame in _RELATIVE_FRAMES:
            altitude += origin.alt_amsl_m - (state.home_m[2] if state.home_m else 0.0)
        target_m = state.frame.to_local(item.latitude_deg, item.longitude_deg, altitude)
        if not math.isfinite(target_m[0] + target_m[1]) or (item.x == 0 and item.y == 0):
            target_m = position_m.level_with(target_m[2])
        if item.command == TAKEOFF and state.on_ground:
            target_m = position_m.level_with(target_m[2])
        yaw = (
            math.radians(item.param4)
            if math.isfinite(item.param4) and item.param4 != 0.0
            else math.nan
        )
        circles = item.command == LOITER_TURNS and self.clocked
        return Leg(
            target_m,
            yaw,
            self.speed_m_s,
            landing=item.command == LAND,
            taking_off=item.command == TAKEOFF,
            turns=item.param1 if circles else math.nan,
            radius_m=item.param3 if circles else 0.0,
        )

    def _reached(self, state: VehicleState, item: PlanItem, leg: Leg) -> bool:
        if item.command == LOITER_UNLIMITED or _is_nowhere(item):
            return False
        if item.command == NAV_DELAY:
            return self._held(state, item.param1)
        if leg.circling:
            return self.turned_rad >= leg.turns * math.tau
        if item.command == LAND:
            least_s = _LANDED_S if self.climbs_first else 1.0
            if not (state.flew and state.on_ground and state.standing_s > least_s):
                return False
            self.over = "landed"
            return True
        # The vehicle is, or by plan should be, at the item's position.
        if self.clocked and item.command != TAKEOFF:
            is_near = state.now_s >= self.due_s
        else:
            north, east, down = leg.position_m - state.position_m
            radius_m = float(state.parameters.get("NAV_ACC_RAD", _REACHED_M))
            if item.command == WAYPOINT and item.param2 > 0.0:
                radius_m = item.param2
            off_m = max(_HEIGHT_REACHED_M, min(radius_m, 2.0))
            if item.command == TAKEOFF and not self.climbs_first:
                radius_m = math.inf
                off_m = _TAKEN_OFF_M
            is_near = state.flew and math.hypot(north, east) < radius_m and abs(down) < off_m
        holds = item.command in {WAYPOINT, LOITER_TIME}
        return is_near and self._held(state, item.param1 if holds else 0.0)

    def _held(self, state: VehicleState, hold_s: float) -> bool:
        """True if a time has passed since the first call for the present item; NaN and less than 0 are no time."""
        if self._hold_until_s == math.inf:
            self._hold_until_s = state.now_s + (hold_s if hold_s > 0.0 else 0.0)
        return state.now_s >= self._hold_until_s
