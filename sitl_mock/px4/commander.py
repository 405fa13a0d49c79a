"""PX4's commander: from the intended mode and the state of the vehicle to the mode that is flown.

Every 0.1 s it checks which needs of the modes are met and which failsafes are triggered. The flown mode is the
intended one unless a failsafe overrides it; a mode that cannot run is replaced by the next in the table of `modes.py`.
The intention is kept: when setpoints return, so does OFFBOARD.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions.flight import MissionFlight
from sitl_mock.px4 import flying, offboard, safety
from sitl_mock.px4.arming_report import ArmingReport
from sitl_mock.px4.calibration import Calibration
from sitl_mock.px4.external_modes import EXECUTOR_COMPONENT, EXTERNAL, ArmingVerdict, ExternalModes
from sitl_mock.px4.failures import MotorFailures
from sitl_mock.px4.ground import LANDED_S, HomeKeeper, LandDetector
from sitl_mock.px4.maneuvers import Follow
from sitl_mock.px4.modes import (
    AFTER,
    AVAILABLE,
    BY_NAME,
    MANUAL_MODES,
    NAV_STATES,
    NOT_FOR_USERS,
    TITLES,
    NotAMode,
    requested_mode,
)
from sitl_mock.px4.offboard import BodyRates, read_attitude
from sitl_mock.px4.safety import MODE_OF, TEXTS, Action, Failsafes
from sitl_mock.vector import ZERO, Vector
from sitl_mock.vehicle.modes import Available, Need
from sitl_mock.vehicle.state import Landed, Severity, VehicleState

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sitl_mock.protocols import Command, CommandAnswer, PlanItem, PlanStore

_CHECK_S: Final = 0.1
_MONITORED_S: Final = 10.0 / 3.0
"""AVAILABLE_MODES_MONITOR is sent this often once the modes have changed."""
_REPORTED_AGAIN_S: Final = 1.0
_SEVERITY_OF_MODE: Final = {"HOLD": 2, "RTL": 3, "LAND": 4, "DESCEND": 4, "TERMINATION": 6}
_STOPPED: Final = Setpoint(Kind.STOPPED)
_OVERRIDE_SPEED: Final = "MAN_OVERRIDE_SPD"
_LANDING: Final = frozenset({"LAND", "DESCEND", "PRECLAND"})
_COMPLETED_AGAIN_S: Final = 0.05
_STREAMED: Final = frozenset({"OFFBOARD", *EXTERNAL})
_FOREIGN_SHARE: Final = 0.15
"""Part of the time in which setpoints of 50 Hz prevail over those of PX4's own task; fitted to 2.1 m in 4 s."""


def acknowledged(command: Command, answer: CommandAnswer) -> dict[str, Any]:
    """Return the fields of VehicleCommandAck."""
    system, component = command.source
    return {
        "command": command.number,
        "result": int(answer.result),
        "result_param1": answer.progress,
        "result_param2": answer.result_param2,
        "target_system": system,
        "target_component": component,
    }


class Px4:
    """PX4's decisions over one vehicle.

    Args:
        state: The vehicle.
        plans: Its mission, fence and rally points.
        execute: Handles commands.
        fly: Returns the flown mode's setpoint.
    """

    def __init__(
        self,
        state: VehicleState,
        plans: PlanStore,
        execute: Callable[[Px4, float, Command], Sequence[CommandAnswer]],
        fly: Callable[[Px4], Setpoint],
    ) -> None:
        self.state: VehicleState = state
        self._execute = execute
        self._fly = fly
        self.plans = plans
        self.failures = MotorFailures(int(state.parameters["SYS_FAILURE_EN"]) == 1)
        self.mission = MissionFlight(plans, climbs_first=True, ends_for_good=True)
        self.failsafes = Failsafes()
        self.home = HomeKeeper()
        self._intention = "HOLD"
        self._after_disarming = "HOLD"
        self.mode = "HOLD"
        self.plan: flying.ModePlan = flying.ModePlan(state.position_m)
        self.met_needs: frozenset[Need] = frozenset()
        self.setpoint = Setpoint(Kind.BRAKE)
        self.rates: BodyRates | None = None
        self.stream_s = -math.inf
        self.in_failsafe = False
        self.pilot_counts = False
        self.lost_peers: frozenset[str] = frozenset()
        self._check_s = -math.inf
        self._refused_s = -math.inf
        self._delays = False
        self.calibration = Calibration()
        self._sticks_known = False
        self.ground = LandDetector()
        self._takeoff_height_m = math.nan
        self.external = ExternalModes(state.parameters)
        self.verdict: ArmingVerdict = self.external.verdict("HOLD")
        self._by_executor = False
        self._report = ArmingReport()
        self._monitored_s = -math.inf
        self.external_control: Any = None
        self._completed_s = -math.inf
        self._foreign_share = 0.0
        self._foreign = Setpoint(Kind.BRAKE)

    # Reported state

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return BY_NAME[self.mode].number

    @property
    def intended_mode(self) -> int:
        """CURRENT_MODE.intended_custom_mode."""
        return BY_NAME[self.external.flown(self.intention)].number

    @property
    def intention(self) -> str:
        """The mode that a person or a program has chosen, which failsafes override."""
        return self._intention

    @intention.setter
    def intention(self, mode: str) -> None:
        self._intention = mode
        if BY_NAME[mode].may_arm and mode != "TAKEOFF":
            self._after_disarming = mode

    @property
    def available_modes(self) -> Sequence[Available]:
        """The modes of AVAILABLE_MODES: external ones under their names, replaced ones not for users to choose."""
        replaced = {self.external.internal(name) for name in EXTERNAL} - set(EXTERNAL)
        hidden = {BY_NAME[name].number for name in replaced}
        labels = {BY_NAME[name].number: self.external.label(name) for name in EXTERNAL}
        listed = []
        for mode in AVAILABLE:
            label = labels.get(mode.number)
            name = mode.name
            properties = mode.properties
            if label is not None:
                properties &= ~NOT_FOR_USERS
                name = label if label else mode.name
            elif mode.number in hidden:
                properties |= NOT_FOR_USERS
            listed.append(mode._replace(properties=properties, name=name))
        return listed

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        return BY_NAME[self.mode].base_mode | (128 if self.state.armed else 0)

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status: not ready, standby, active, critical, flight termination."""
        if self.mode == "TERMINATION":
            return 8
        if self.state.armed:
            return 5 if self.in_failsafe else 4
        return 3 if self.ready_to_arm else 0

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.ground.on_ground(self.state):
            return Landed.ON_GROUND
        if self.mode == "TAKEOFF" or (self.mode == "MISSION" and self.mission.climbing):
            return Landed.TAKEOFF
        coming_down = (self.mode == "RTL" and self.plan.stage == "land") or (
            self.mode == "MISSION" and (self.mission.landing or self.mission.over == "landed")
        )
        return Landed.LANDING if self.mode in _LANDING or coming_down else Landed.IN_AIR

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        return not self.refusals()

    def refusals(self) -> list[str]:
        """Return the reasons for not arming in the intended mode."""
        # The arming check of the program behind a mode may have changed its needs.
        entry = BY_NAME[self.intention]
        reasons = safety.refusals(
            self.state,
            entry._replace(
                needs=self.needs_of(self.intention),
                may_arm=entry.may_arm and self.intention not in self.verdict.unarmable,
            ),
            self.met_needs,
        )
        if self.verdict.holds_all:
            reasons.append("Mode changes nothing: an external arming check fails")
        return reasons

    def needs_of(self, mode: str) -> frozenset[Need]:
        """Return what a mode needs: by the table, or as the program behind it has declared."""
        return self.verdict.needs.get(mode, BY_NAME[mode].needs)

    # Inputs

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """Execute or refuse a command."""
        return self._execute(self, now_s, command)

    def answered(self, command: Command, answers: Sequence[CommandAnswer]) -> None:
        """Publish the answers to a command, which inside PX4 are a topic."""
        for answer in answers:
            self.external.out.append(("vehicle_command_ack", acknowledged(command, answer)))

    def execute_topic(self, now_s: float, command: Command) -> None:
        """Execute or refuse a command that is a topic; MAVLink's first answer to a mode change is not sent there."""
        self._by_executor = command.source[1] >= EXECUTOR_COMPONENT
        answers = self._execute(self, now_s, command)
        self._by_executor = False
        self.answered(command, answers[-1:])

    def set_mode(self, now_s: float, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message."""
        self.ask_for(
            now_s, requested_mode(base_mode, custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)
        )

    def ask_for(self, now_s: float, mode: str | NotAMode) -> bool:
        """Request the mode that a client named; False if refused."""
        if isinstance(mode, NotAMode):
            if mode is NotAMode.REFUSED:
                self.state.say(Severity.CRITICAL, "Unsupported auto mode")
            return mode is NotAMode.IGNORED
        return self.request(now_s, mode, with_text=False)

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint: proof of life in every mode, flown in OFFBOARD only."""
        by_attitude = message.get_type() == "SET_ATTITUDE_TARGET"
        setpoint = (
            read_attitude(self.state, message, self.rates)
            if by_attitude
            else offboard.read_position_target(self.state, message)
        )
        if isinstance(setpoint, str):
            self.state.say(Severity.ERROR, setpoint)
            return
        self.stream_s = now_s
        self.rates = setpoint if isinstance(setpoint, BodyRates) else None
        if isinstance(setpoint, Setpoint):
            self.setpoint = setpoint

    def take_trajectory(self, message: Any) -> None:  # noqa: ANN401 - a record
        """Take a TrajectorySetpoint, which OFFBOARD and external modes fly.

        In other modes PX4's own task writes the same topic 125 times a second, and the controller uses the last one.
        """
        setpoint = offboard.read_trajectory(message)
        if self.mode in _STREAMED:
            self.rates = None
            self.setpoint = setpoint
        else:
            self._foreign = setpoint
            self._foreign_share = min(self._foreign_share + _FOREIGN_SHARE, 1.0)

    def go_to(self, position_m: Vector, yaw_rad: float, speed_m_s: float) -> None:
        """Take a GotoSetpoint, which external modes fly; NaN leaves heading or speed to PX4."""
        if self.mode in EXTERNAL:
            self.rates = None
            self.setpoint = Setpoint(
                Kind.TRAVEL,
                position_m,
                yaw_rad=yaw_rad,
                speed_m_s=flying.cruise_m_s(self.state, speed_m_s),
            )

    def _complete_landing(self, now_s: float) -> None:
        """Publish that a landing is completed: LAND does so until it is disarmed, RTL once."""
        state = self.state
        if not (state.on_ground and state.flew and state.standing_s >= LANDED_S):
            return
        if self.mode == "LAND" and now_s >= self._completed_s - 1e-9:
            self._completed_s = max(self._completed_s + _COMPLETED_AGAIN_S, now_s)
            self.plan.completed = False
        if self.mode in {"LAND", "RTL"}:
            self.complete()

    def complete(self) -> None:
        """Publish once that the navigator has finished the flown mode."""
        if not self.plan.completed:
            self.plan.completed = True
            state = NAV_STATES[self.mode][0]
            self.external.out.append(("mode_completed", {"nav_state": state}))

    def guide(self, _now_s: float, _item: PlanItem) -> bool:
        """PX4 does not fly to single mission items."""
        return False

    def switch(self, now_s: float, mode: str) -> None:
        """Take the pilot's mode switch."""
        self.request(now_s, mode)

    def request(self, now_s: float, mode: str, *, with_text: bool = True) -> bool:
        """Request a mode: always granted while disarmed, otherwise only if it can run.

        Args:
            now_s: The present time.
            mode: Its name.
            with_text: A refusal has a text; DO_SET_MODE has an answer only.
        """
        if self.mode == "TERMINATION":
            return False
        mode = self.external.internal(mode)
        self.look()
        if self.state.armed and mode != "LAND" and not self.can_run(mode):
            if with_text and now_s > self._refused_s + _REPORTED_AGAIN_S:
                # At most once a second.
                self._refused_s = now_s
                name = TITLES.get(mode, mode.replace("_", " ").title())
                self.state.say(Severity.CRITICAL, f"Switching to {name} is currently not available")
            return False
        self.intention = mode
        self.external.charge(mode, by_user=not self._by_executor)
        self.state.pilot.settle()
        if self.state.armed:
            self.failsafes.answer()
        self.enter(mode)
        self._check_s = now_s
        return True

    def look(self) -> None:
        """Check a new mission, and which needs are met now."""
        state = self.state
        replaced = self.mission.judge(state) and not self.mission.valid
        if replaced and state.armed and self.mode == "MISSION":
            # The mission in flight ends because its replacement cannot be flown.
            self.say_no_mission()
            if self.intention == "MISSION" and not state.on_ground:
                self.intention = AFTER["MISSION", "mission finished"]
                self.enter(self.intention)
        self.met_needs = safety.available(state, self.stream_s, has_mission=self.mission.valid)
        self.verdict = self.external.verdict(self.external.flown(self.intention))

    def can_run(self, mode: str) -> bool:
        """True if the mode's needs were met at the last check."""
        return self.needs_of(mode) <= self.met_needs

    def wants_to_climb(self) -> bool:
        """True if the streamed setpoint commands a climb: by height, climb rate or thrust."""
        if self.mode != "OFFBOARD":
            return False
        setpoint = self.setpoint
        if setpoint.kind is Kind.DIRECT:
            return setpoint.acceleration_ned_m_s2[2] < 0.0
        to = setpoint.position_ned_m[2]
        along = setpoint.velocity_ned_m_s[2]
        push = setpoint.acceleration_ned_m_s2[2]
        return to < self.state.position_m[2] or along < 0.0 or push < 0.0

    # Decisions

    def tick(self, now_s: float) -> Setpoint:
        """Run the checks when due; return the setpoint of the flown mode."""
        self.home.update(self.state, in_mission=self.mode == "MISSION" and not self.mission.over)
        state = self.state
        wanted = self.external.update(
            now_s, armed=state.armed, intended=self.external.flown(self.intention)
        )
        if wanted is not None and not state.armed:
            self.request(now_s, wanted)
        if self.mission.is_unjudged:
            self.look()
        if now_s >= self._check_s + _CHECK_S - 1e-9:
            self._check_s = now_s
            self._check(now_s)
        if self.calibration.kind:
            self.calibration.advance(state, now_s)
        if not state.armed:
            self.mission.rest()
        if not state.armed or self.mode == "TERMINATION":
            self.ground.left = False
            return _STOPPED
        self._complete_landing(now_s)
        setpoint = self._fly(self)
        if self._foreign_share > 0.999 and not state.on_ground:
            self._foreign_share -= 1.0
            setpoint = self._foreign
        # What a control mode from outside leaves of the setpoint.
        if self.external_control is not None:
            if not self.external_control.flag_armed:
                setpoint = _STOPPED
            elif not self.external_control.flag_multicopter_position_control_enabled:
                # The last attitude, about level.
                setpoint = Setpoint(Kind.DIRECT, acceleration_ned_m_s2=ZERO)
        self.ground.notice_lifting(state, now_s, setpoint)
        return setpoint

    def _check(self, now_s: float) -> None:
        state = self.state
        self.look()
        lost = safety.lost_peers(self.state)
        if lost != self.lost_peers:
            for severity, text in safety.peer_texts(self.lost_peers, lost):
                self.state.say(severity, text)
            self.lost_peers = lost
        self.report(now_s)
        if self.external.revision and now_s >= self._monitored_s + _MONITORED_S:
            self._monitored_s = now_s
            state.notices.append(("AVAILABLE_MODES_MONITOR", self.external.revision & 0xFF))
        if not state.armed:
            self.home.follow(state)
            # Disarmed in Hold, a client's first MANUAL_CONTROL switches to POSCTL (measured).
            sticks = Need.PILOT in self.met_needs and not math.isfinite(self.state.pilot.radio_s)
            if sticks and not self._sticks_known and self.intention == "HOLD":
                self.intention = "POSCTL"
            self._sticks_known |= sticks
            self.failsafes.clear()
            self.in_failsafe = False
            self.external.failsafe_acts = False
            self.pilot_counts = False
            if self.mode != "TERMINATION":
                self.enter(self.intention)
            return
        self.pilot_counts |= Need.PILOT in self.met_needs
        is_manual = self.mode in MANUAL_MODES or self.mode == "TERMINATION"
        if not is_manual and Need.PILOT in self.met_needs and self._sticks_override():
            state.say(Severity.INFO, "Pilot took over using sticks")
            self.request(now_s, AFTER["any", "stick moved, COM_RC_OVERRIDE"])
        action, new = self.failsafes.update(
            now_s,
            safety.wrong(
                state,
                self.plans,
                self.intention,
                self.lost_peers,
                pilot_counts=self.pilot_counts,
            ),
            state.parameters,
        )
        for name in new:
            if name in TEXTS:
                state.say(*TEXTS[name])
        if action is Action.DISARM:
            self.disarm()
            return
        self._choose(action)
        self._disarm_by_itself(now_s)

    def report(self, now_s: float, *, force: bool = False) -> None:
        """Send the report of the arming checks if it is due, or now."""
        self.state.events += self._report.update(now_s, self, force=force)

    def _choose(self, action: Action) -> None:
        """Choose the flown mode: the intention, overridden by failsafes, replaced while it cannot run."""
        if self.mode == "TERMINATION":
            return
        mode = self.intention
        forced = MODE_OF.get(action)
        if mode == "OFFBOARD":  # a lost stream leads to RTL even if a failsafe demands Hold
            mode = self._runnable(mode)
        if forced is not None and _SEVERITY_OF_MODE.get(mode, 0) < _SEVERITY_OF_MODE[forced]:
            mode = forced
        mode = self._runnable(mode)
        if mode == "disarmed":
            self.disarm()
            return
        failing = mode != self.intention or action >= Action.HOLD
        delays = self.failsafes.delays
        if failing and (not self.in_failsafe or (self._delays and not delays)):
            text = "Failsafe activated"
            if delays:
                wait_s = int(self.state.parameters["COM_FAIL_ACT_T"])
                text += f": entering Hold for {wait_s} seconds"
            self.state.say(Severity.CRITICAL, text)
        self.in_failsafe = failing
        self.external.failsafe_acts = failing
        self._delays = delays
        self.enter(mode)

    def _runnable(self, mode: str) -> str:
        """The mode or its first replacement that can run; COM_OBL_RC_ACT chooses for a lost stream."""
        while mode != "disarmed" and not self.can_run(mode):
            event = "cannot run"
            if mode == "OFFBOARD":
                event = (
                    f"stream lost, COM_OBL_RC_ACT = {int(self.state.parameters['COM_OBL_RC_ACT'])}"
                )
            mode = AFTER.get((mode, event), "RTL")
        return mode

    def enter(self, mode: str) -> None:
        """Start flying a mode, or the external one that replaces it."""
        state = self.state
        state.events += self.external.fallbacks(mode)
        mode = self.external.flown(mode)
        if mode == self.mode:
            return
        self.mode = mode
        self._foreign_share = 0.0
        if mode in EXTERNAL:
            self.setpoint = offboard.STAND  # until the program behind it sends one
        self.plan = flying.ModePlan(state.position_m, yaw_rad=state.yaw_rad)
        if mode == "TAKEOFF":
            self.plan.height_m = self._takeoff_down_m()
        self.mission.begun = False
        if mode == "FOLLOW":
            home = state.position_m if state.home_m is None else state.home_m
            self.plan.follow = Follow(home[2])
        state.pilot.settle()

    def begin_mission(self) -> bool:
        """Start or resume the mission, armed and in its mode; False if it has no item left to fly."""
        state = self.state
        goes_on = self.mission.start()
        if goes_on:
            state.say(Severity.INFO, "Executing Mission")
        else:
            self.say_no_mission()
        return goes_on

    def say_no_mission(self) -> None:
        """Report that the mission has no item left to fly."""
        then = "refusing takeoff" if self.state.on_ground else "loitering"
        self.state.say(Severity.CRITICAL, f"No valid mission available, {then}")

    def _takeoff_down_m(self) -> float:
        state = self.state
        default = state.position_m[2] - float(state.parameters["MIS_TAKEOFF_ALT"])
        if math.isnan(self._takeoff_height_m):
            return default
        return min(
            state.frame.origin.alt_amsl_m - self._takeoff_height_m, state.position_m[2] - 0.5
        )

    def begin_takeoff(self, now_s: float, altitude_amsl_m: float) -> bool:
        """NAV_TAKEOFF: climb to an altitude above mean sea level; NaN means MIS_TAKEOFF_ALT."""
        self._takeoff_height_m = altitude_amsl_m
        granted = self.request(now_s, "TAKEOFF")
        if granted and self.mode == "TAKEOFF":
            self.plan.height_m = self._takeoff_down_m()
            if self.state.armed:
                self.say_default_height()
        return granted

    def say_default_height(self) -> None:
        """Report a take-off for which nobody gave a height."""
        if math.isnan(self._takeoff_height_m):
            height_m = float(self.state.parameters["MIS_TAKEOFF_ALT"])
            self.state.say(Severity.INFO, f"Using default takeoff altitude: {height_m:.1f} m")

    def disarm(self) -> None:
        """Stop the motors; the intention becomes the last one in which arming is possible, or that of an executor."""
        self.state.disarm()
        self.failsafes.clear()
        self.in_failsafe = False
        if self.mode == "TERMINATION":
            return
        self.intention = self.external.after_disarming(self._after_disarming)
        self.enter(self.intention)

    def _sticks_override(self) -> bool:
        """True if the pilot moves the sticks far enough, or since v1.18 fast enough, to take over."""
        parameters = self.state.parameters
        pilot = self.state.pilot
        if _OVERRIDE_SPEED in parameters:
            least_1_s = float(parameters[_OVERRIDE_SPEED])
            return least_1_s >= 0.0 and pilot.speed_1_s > least_1_s
        mask = int(parameters["COM_RC_OVERRIDE"])
        covered = mask & 2 if self.mode == "OFFBOARD" else mask & 1
        return bool(covered) and pilot.moved * 100.0 > float(parameters["COM_RC_STICK_OV"])

    def _disarm_by_itself(self, now_s: float) -> None:
        state = self.state
        if not state.on_ground:
            return
        if state.flew:
            self.ground.notice_landing(state)
            landed_s = float(state.parameters["COM_DISARM_LAND"])
            coming_down = self.mode not in {"TAKEOFF"} and not self.wants_to_climb()
            if landed_s > 0.0 and coming_down and state.standing_s > LANDED_S + landed_s:
                state.say(Severity.INFO, "Disarmed by landing")
                self.disarm()
            return
        patience_s = float(state.parameters["COM_DISARM_PRFLT"])
        if patience_s > 0.0 and now_s - state.armed_s > patience_s:
            state.say(Severity.INFO, "Disarmed by auto preflight disarming")
            self.disarm()
