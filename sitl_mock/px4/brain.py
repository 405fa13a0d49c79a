"""PX4's commander: an intention, what is there to carry it out, and the mode that is flown in the end.

Every 0.1 s: look what is available and what is wrong, then flown mode = intention, overruled by the failsafe action,
then stepped down while it cannot run (table in `modes.py`). The intention outlives all that: when the stream comes
back, so does OFFBOARD.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

from sitl_mock.craft import Craft, Landed, Severity
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions import MissionFlight
from sitl_mock.modes import Need
from sitl_mock.protocols import Command, CommandAnswer, PlanItem, PlanStore
from sitl_mock.px4 import checks, commands, flying, offboard
from sitl_mock.px4.failsafe import MODE_OF, Action, Failsafes
from sitl_mock.px4.home import HomeKeeper
from sitl_mock.px4.modes import AFTER, BY_NAME, BY_NUMBER

CHECK_S: Final = 0.1
_MANUAL: Final = frozenset({"POSCTL", "ALTCTL", "STABILIZED", "MANUAL", "ACRO"})
_PLACED: Final = ("HOLD", "TAKEOFF", "RTL", "LAND", "MISSION")
_OFF_THE_GROUND_M: Final = 0.3
_SEVERITY_OF_MODE: Final = {"HOLD": 2, "RTL": 3, "LAND": 4, "DESCEND": 4, "TERMINATION": 6}
_STOPPED: Final = Setpoint(Kind.STOPPED)
_IDLING: Final = Setpoint(Kind.IDLING)


class Px4:
    """The flavour's decisions over one craft."""

    def __init__(self, craft: Craft, plans: PlanStore) -> None:
        self.craft = craft
        self.plans = plans
        self.mission = MissionFlight(plans)
        self.failsafes = Failsafes()
        self.home = HomeKeeper()
        self.intention = "HOLD"
        self.mode = "HOLD"
        self.plan = flying.Plan(craft.position_m)
        self.there: frozenset[Need] = frozenset()
        self.setpoint = Setpoint(Kind.BRAKE)
        self.stream_s = -math.inf
        self.in_failsafe = False
        self.pilot_counts = False
        self._check_s = -math.inf
        self._takeoff_height_m = math.nan

    # What the others see

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return BY_NAME[self.mode].number

    @property
    def intended_mode(self) -> int:
        """CURRENT_MODE.intended_custom_mode."""
        return BY_NAME[self.intention].number

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        return BY_NAME[self.mode].base_mode | (128 if self.craft.armed else 0)

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status: boot, standby, active, critical, flight termination."""
        if self.mode == "TERMINATION":
            return 8
        if self.in_failsafe:
            return 5
        if not self.craft.estimator.altitude_valid:
            return 1
        return 4 if self.craft.armed else 3

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.craft.on_ground:
            return Landed.ON_GROUND
        if self.mode == "TAKEOFF":
            return Landed.TAKEOFF
        return Landed.LANDING if self.mode in {"LAND", "DESCEND"} else Landed.IN_AIR

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        return not checks.refusals(self.craft, BY_NAME[self.intention], self.there)

    # What comes in

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """Obey or refuse a command."""
        return commands.execute(self, now_s, command)

    def set_mode(self, now_s: float, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message."""
        mode = BY_NUMBER.get(custom_mode)
        if base_mode & 1 and mode is not None:
            self.request(now_s, mode.name)

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint: proof of life in every mode, followed in OFFBOARD only."""
        setpoint = offboard.read(self.craft, message)
        if isinstance(setpoint, str):
            self.craft.say(Severity.ERROR, setpoint)
            return
        self.stream_s = now_s
        self.setpoint = setpoint

    def guide(self, _now_s: float, _item: PlanItem) -> bool:
        """PX4 takes no mission item as an order."""
        return False

    def switch(self, now_s: float, mode: str) -> None:
        """Take the pilot's mode switch."""
        self.request(now_s, mode)

    def request(self, now_s: float, mode: str) -> bool:
        """Ask for a mode: always granted while disarmed, else only if it can run."""
        if self.mode == "TERMINATION":
            return False
        if mode != "OFFBOARD":  # the stream is seen by the periodic check only (measured: 0.06 to 0.12 s)
            self.there = checks.available(self.craft, self.plans, self.stream_s)
        if self.craft.armed and not self.can_run(mode):
            self.craft.say(Severity.CRITICAL, f"Switching to {mode.capitalize()} is currently not available")
            return False
        self.intention = mode
        self.craft.pilot.settle()
        if self.craft.armed:
            self.failsafes.answer()
        self._enter(mode)
        self._check_s = now_s
        return True

    def can_run(self, mode: str) -> bool:
        """Whether everything a mode needs was there at the last check."""
        return BY_NAME[mode].needs <= self.there

    # What is decided

    def tick(self, now_s: float) -> Setpoint:
        """Check when it is time, then say what the motors shall do."""
        self.home.update(self.craft, in_mission=self.mode == "MISSION" and not self.mission.over)
        if now_s >= self._check_s + CHECK_S - 1e-9:
            self._check_s = now_s
            self._check(now_s)
        if not self.craft.armed or self.mode == "TERMINATION":
            return _STOPPED
        return self._fly()

    def _check(self, now_s: float) -> None:
        craft = self.craft
        self.there = checks.available(craft, self.plans, self.stream_s)
        if not craft.armed:
            self.home.follow(craft)
            self.failsafes.clear()
            self.in_failsafe = False
            self.pilot_counts = False
            if self.mode != "TERMINATION":
                self._enter(self.intention)
            return
        self.pilot_counts = self.pilot_counts or Need.PILOT in self.there
        self._pilot_takes_over(now_s)
        action, new = self.failsafes.update(
            now_s, checks.wrong(craft, self.plans, self.intention, pilot_counts=self.pilot_counts), craft.parameters
        )
        for name in new:
            craft.say(Severity.WARNING, f"Failsafe: {name}")
        if action is Action.DISARM:
            self.disarm()
            return
        self._choose(action)
        self._disarm_by_itself(now_s)

    def _choose(self, action: Action) -> None:
        """Intention, overruled by the failsafe, stepped down until it can run."""
        mode = self.intention
        if self.mode == "TERMINATION":
            return
        forced = MODE_OF.get(action)
        if forced is not None and _SEVERITY_OF_MODE.get(mode, 0) < _SEVERITY_OF_MODE[forced]:
            mode = forced
        while not self.can_run(mode):
            event = "cannot run"
            if mode == "OFFBOARD":
                event = f"stream lost, COM_OBL_RC_ACT = {int(self.craft.parameters['COM_OBL_RC_ACT'])}"
            mode = AFTER.get((mode, event), "RTL")
            if mode == "disarmed":
                self.disarm()
                return
        failing = mode != self.intention or action >= Action.HOLD
        if failing and not self.in_failsafe:
            self.craft.say(Severity.CRITICAL, "Failsafe activated")
        self.in_failsafe = failing
        self._enter(mode)

    def _enter(self, mode: str) -> None:
        if mode == self.mode:
            return
        self.mode = mode
        craft = self.craft
        self.plan = flying.Plan(craft.position_m, yaw_rad=craft.yaw_rad)
        if mode == "TAKEOFF":
            self.plan.height_m = self._takeoff_down_m()
        if mode == "MISSION":
            self.mission.start()
        craft.pilot.settle()

    def _takeoff_down_m(self) -> float:
        craft = self.craft
        default = craft.position_m[2] - float(craft.parameters["MIS_TAKEOFF_ALT"])
        if math.isnan(self._takeoff_height_m):
            return default
        return min(craft.frame.origin.alt_amsl_m - self._takeoff_height_m, craft.position_m[2] - 0.5)

    def begin_takeoff(self, now_s: float, altitude_amsl_m: float) -> bool:
        """NAV_TAKEOFF: climb to an altitude above sea level, NaN for MIS_TAKEOFF_ALT."""
        self._takeoff_height_m = altitude_amsl_m
        granted = self.request(now_s, "TAKEOFF")
        if granted and self.mode == "TAKEOFF":
            self.plan.height_m = self._takeoff_down_m()
        return granted

    def disarm(self) -> None:
        """Motors off; the intention stays, except that a finished take-off or landing is over."""
        self.craft.disarm()
        self.failsafes.clear()
        self.in_failsafe = False
        if self.mode == "TERMINATION":
            return
        if self.intention in {"TAKEOFF", "LAND", "RTL", "DESCEND"}:
            self.intention = "HOLD"
        self._enter(self.intention)

    def _pilot_takes_over(self, now_s: float) -> None:
        parameters = self.craft.parameters
        mask = int(parameters["COM_RC_OVERRIDE"])
        covered = mask & 2 if self.mode == "OFFBOARD" else mask & 1
        if self.mode in _MANUAL or not covered or Need.PILOT not in self.there or self.mode == "TERMINATION":
            return
        if self.craft.pilot.moved * 100.0 > float(parameters["COM_RC_STICK_OV"]):
            self.craft.say(Severity.INFO, "Pilot took over using sticks")
            self.request(now_s, AFTER["any", "stick moved, COM_RC_OVERRIDE"])

    def _disarm_by_itself(self, now_s: float) -> None:
        craft = self.craft
        if not craft.on_ground:
            return
        if craft.flew:
            landed_s = float(craft.parameters["COM_DISARM_LAND"])
            coming_down = self.mode not in {"TAKEOFF"} and not self._climbing()
            if landed_s > 0.0 and coming_down and craft.standing_s > 1.0 + landed_s:
                craft.say(Severity.INFO, "Disarmed by landing")
                self.disarm()
            return
        patience_s = float(craft.parameters["COM_DISARM_PRFLT"])
        if patience_s > 0.0 and now_s - craft.armed_s > patience_s:
            craft.say(Severity.INFO, "Disarmed by auto preflight disarming")
            self.disarm()

    def _climbing(self) -> bool:
        """Whether a stream asks to leave the ground: by height, by climb rate, or by thrust alone."""
        if self.mode != "OFFBOARD":
            return False
        to, along, push = (
            self.setpoint.position_ned_m[2],
            self.setpoint.velocity_ned_m_s[2],
            self.setpoint.acceleration_ned_m_s2[2],
        )
        by_thrust = math.isnan(to) and math.isnan(along) and push < 0.0
        return along < 0.0 or to < self.craft.position_m[2] - _OFF_THE_GROUND_M or by_thrust

    def _fly(self) -> Setpoint:
        """The flown mode's setpoint; on the ground nothing but a climb leaves idling."""
        mode, craft, plan = self.mode, self.craft, self.plan
        if mode == "OFFBOARD":
            return self.setpoint if not craft.on_ground or self._climbing() else _IDLING
        if mode in _MANUAL:
            climbing = craft.pilot.sticks.throttle > 0.1
            return flying.by_stick(craft, plan) if climbing or not craft.on_ground else _IDLING
        if mode == "TAKEOFF":
            if flying.takeoff_done(craft, plan):
                self._go_on("height reached")
            return flying.takeoff(craft, plan)
        if mode == "MISSION":
            setpoint = self._fly_mission()
            return _IDLING if craft.on_ground and craft.flew else setpoint
        return _IDLING if craft.on_ground else self._fly_auto(mode)

    def _fly_auto(self, mode: str) -> Setpoint:
        craft, plan = self.craft, self.plan
        if mode == "HOLD":
            return flying.hold(craft, plan)
        if mode == "RTL":
            return flying.return_home(craft, plan)
        if mode == "LAND":
            return flying.land(craft, plan)
        return flying.descend(craft, plan)

    def _fly_mission(self) -> Setpoint:
        setpoint = flying.mission(self.craft, self.mission, self.plan)
        if self.mission.over == "return":
            self.intention = "RTL"
        elif self.mission.over:
            self._go_on("mission finished")
        return setpoint

    def _go_on(self, event: str) -> None:
        """A mode has done its work: the table says what comes next, and that is the intention now."""
        after = AFTER[self.mode, event]
        done = self.plan
        if self.intention == self.mode:
            self.intention = after
        self._enter(after)
        if event == "height reached":
            self.plan.goal_m = (done.entered_m[0], done.entered_m[1], done.height_m)
