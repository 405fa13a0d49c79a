"""ArduPilot's decisions over one vehicle, a copter or a rover.

There is no intention beside the mode: whatever changes it, a client, the pilot or a failsafe, changes it for good.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.ardupilot import guided, safety
from sitl_mock.ardupilot.avoidance import avoiding
from sitl_mock.ardupilot.guided import read_attitude
from sitl_mock.ardupilot.legs import Legs
from sitl_mock.ardupilot.maneuvers import Speeds
from sitl_mock.ardupilot.totals import tell_totals
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions import MissionFlight
from sitl_mock.modes import Need
from sitl_mock.pilot import OVERRIDE_S, Sticks
from sitl_mock.vehicle_state import Landed, Severity, VehicleState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.ardupilot.firmware import Firmware
    from sitl_mock.ardupilot.maneuvers import Circle, Turn
    from sitl_mock.protocols import Command, CommandAnswer, PlanItem, PlanStore
    from sitl_mock.world import Vector

CHECK_S: Final = 0.1
DECIDE_S: Final = 0.02
AT_REST: Final = Sticks(throttle=-1.0)
GUIDED_MODES: Final = frozenset({"GUIDED", "GUIDED_NOGPS"})
_TRAVEL, _STREAM = Kind.TRAVEL, Kind.STREAM
_STOPPED: Final = Setpoint(Kind.STOPPED)
_IDLING: Final = Setpoint(Kind.IDLING)
_FLY_THERE: Final = 2
_LANDED_S: Final = 1.1
_TEXTS: Final = {"fence breached": (Severity.NOTICE, "Fence Breached")}


class ArduPilot:
    """The flavour's decisions over one vehicle.

    Attributes:
        mode: Name of the mode that is flown.
        guided: Last setpoint in GUIDED, None while there is none.
        takeoff_m: Down coordinate of the take-off in GUIDED, NaN when it is over.
        takeoff_s: When it was asked for.
        just_taken_off: Nothing has been asked for since the take-off in GUIDED.
        paused: DO_PAUSE_CONTINUE has stopped the flight.
        turn: Where CONDITION_YAW turns the nose, None where the flight decides.
        speeds: What DO_CHANGE_SPEED asked for, until the kind of guided flight changes.
        entered_m: Where the mode began.
        stage: Part of RTL, which is flown in AUTO as well.
        goal_m: Where RTL leads: north and east, and the down coordinate it flies there at.
        may_lift: MISSION_START has let AUTO take off; else it waits for the throttle stick.
        handled: Failsafe triggers that have acted; they act again after they have gone.
    """

    def __init__(self, state: VehicleState, plans: PlanStore, firmware: Firmware[ArduPilot]) -> None:
        self.state = state
        self.plans = plans
        self.firmware = firmware
        self.mission = MissionFlight(plans, skip_home=True, clocked=firmware.flies)
        self.legs = Legs()
        self.by_name = firmware.modes.by_name()
        self.by_number = firmware.modes.by_number()
        self.after = firmware.modes.after()
        self.mode = firmware.first_mode
        self.guided: Setpoint | None = None
        self.stream_s = -math.inf
        self.takeoff_m = math.nan
        self.takeoff_s = -math.inf
        self.just_taken_off = False
        self.paused = False
        self.turn: Turn | None = None
        self.speeds = Speeds()
        self.switched: int | None = None
        self.entered_m: Vector = state.position_m
        self.entered_yaw_rad = state.yaw_rad
        self.stage = ""
        self.stage_s = 0.0
        self.goal_m: Vector = state.position_m
        self.circle: Circle | None = None
        self.may_lift = False
        self.there: frozenset[Need] = frozenset()
        self.handled: set[str] = set()
        self.in_failsafe = False
        self._check_s = -math.inf

    # What the others see

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.by_name[self.mode].number

    @property
    def intended_mode(self) -> int:
        """CURRENT_MODE.intended_custom_mode: the mode."""
        return self.custom_mode

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode."""
        return self.by_name[self.mode].base_mode | (128 if self.state.armed else 0)

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status: standby on the ground (a rover: disarmed), active, critical."""
        if self.in_failsafe:
            return 5
        if not self.firmware.flies:
            return 4 if self.state.armed else 3
        return 3 if self.state.on_ground else 4

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.state.on_ground:
            return Landed.ON_GROUND
        if self.mode == "GUIDED" and math.isfinite(self.takeoff_m):
            return Landed.TAKEOFF
        return Landed.LANDING if self.mode == "LAND" or self.stage == "land" else Landed.IN_AIR

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        return not safety.failing(self.state)

    # What comes in

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:
        """Obey or refuse a command."""
        return self.firmware.execute(self, now_s, command)

    def set_mode(self, _now_s: float, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message."""
        mode = self.by_number.get(custom_mode)
        if base_mode & 1 and mode is not None:
            self.request(mode.name)

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint, in GUIDED only; it ends a take-off."""
        if self.state.conditions.offboard_refused:
            return
        setpoint = None
        if message.get_type() == "SET_ATTITUDE_TARGET":
            if self.firmware.flies and self.mode in GUIDED_MODES:
                setpoint = read_attitude(self.state.parameters, message)
        elif self.mode == "GUIDED":
            setpoint = guided.read(self.state, message)
        if setpoint is not None:
            self.follow(setpoint)
            self.stream_s = now_s

    def follow(self, setpoint: Setpoint) -> None:
        """Fly a guided setpoint; another kind of one forgets the speeds that were asked for (`pva_control_start`)."""
        if self.guided is None or self.guided.kind is not setpoint.kind or self.just_taken_off:
            self.speeds = Speeds()
        self.just_taken_off = False
        self.guided = setpoint
        self.turn = None
        self.takeoff_m = math.nan

    def guide(self, _now_s: float, item: PlanItem) -> bool:
        """Take a mission item with current 2, older clients' way to fly somewhere; 3 has no effect."""
        if item.current != _FLY_THERE:
            return True
        setpoint = guided.item_setpoint(self.state, item) if self.mode == "GUIDED" else None
        if setpoint is None:
            return False
        self.follow(setpoint)
        return True

    def switch(self, _now_s: float, mode: str) -> None:
        """Take the pilot's mode switch."""
        self.request(mode)

    def request(self, mode: str) -> bool:
        """Ask for a mode; a refusal leaves the old one. A disarmed copter takes any."""
        if mode == self.mode:
            return True
        self._look()
        why = self._against(mode)
        if why:
            self.state.say(Severity.WARNING, f"Mode change to {mode} failed: {why}")
            return False
        self.enter(mode)
        return True

    def _against(self, mode: str) -> str:
        """Why a mode cannot be entered, empty if it can."""
        missing = self.by_name[mode].needs - self.there
        if mode == "GUIDED" and self.state.conditions.offboard_refused:
            return "init failed"
        if not self.state.armed and self.firmware.flies:
            return ""
        if missing:
            return "requires position" if missing & {Need.LOCAL_POSITION, Need.GLOBAL_POSITION} else "init failed"
        if mode == "AUTO" and self.firmware.flies and self.state.on_ground and not self.mission.takes_off:
            self.state.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            return "init failed"
        return ""

    def enter(self, mode: str) -> None:
        """Begin a mode, asked for or not."""
        if mode == self.mode:
            return
        self.mode = mode
        self.guided = None
        self.takeoff_m = math.nan
        self.paused = False
        self.turn = None
        self.circle = None
        self.may_lift = False
        self.speeds = Speeds()
        self.stage = ""
        self.entered_m = self.state.position_m
        self.entered_yaw_rad = self.state.yaw_rad
        self.legs = Legs()
        if mode == "AUTO":
            self.mission.start()

    # What is decided

    def tick(self, now_s: float) -> Setpoint:
        """Check when it is time, then say what the motors shall do."""
        if now_s >= self._check_s + CHECK_S - 1e-9:
            self._check_s = now_s
            self._check()
        if not self.state.armed:
            return _STOPPED
        setpoint = self.firmware.flights[self.mode](self)
        if self.turn is None:
            return setpoint
        return setpoint._replace(yaw_rad=self.turn.advance(DECIDE_S), yaw_rate_rad_s=math.nan)

    @property
    def sticks(self) -> Sticks:
        """The pilot's sticks; those of the simulator's radio, throttle down, where nobody moves any."""
        pilot = self.state.pilot
        return pilot.sticks if pilot.fresh(self.state.now_s, OVERRIDE_S) else AT_REST

    def guided_setpoint(self) -> Setpoint:
        """GUIDED: the last setpoint, or a stop when it is older than the timeout."""
        firmware, state = self.firmware, self.state
        if self.guided is None:
            return Setpoint(Kind.BRAKE)
        if self.paused:
            return guided.STOP
        kind = self.guided.kind
        if kind is _TRAVEL:
            return self.speeds.applied(self.guided)
        timeout_s = (
            float(state.parameters[firmware.guided_timeout]) if firmware.guided_timeout else firmware.guided_timeout_s
        )
        if state.now_s - self.stream_s > timeout_s:
            return guided.STOP if kind is _STREAM else guided.LEVEL
        if kind is _STREAM and firmware.flies and self.plans.fence.items:
            return avoiding(state, self.plans, self.guided)
        return self.guided

    def mission_over(self) -> None:
        """A rover's AUTO has come to its end."""
        if self.mission.over == "return":
            self.enter(self.after["AUTO", "mission asks to return"])
        elif self.mission.over == "finished":
            self.enter(self.after["AUTO", "mission finished in the air"])

    def set_home(self, place_m: Vector, *, given: bool = False) -> None:
        """Put home somewhere, and tell it and the origin to everybody."""
        self.state.set_home(place_m, given=given)
        self.state.news += ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")

    def disarm(self) -> None:
        """Motors off."""
        self.state.disarm()
        self.handled.clear()
        self.in_failsafe = False
        self.takeoff_m = math.nan

    def _look(self) -> None:
        self.there = safety.available(self.state, self.plans)

    def _check(self) -> None:
        state = self.state
        if state.home_m is None and state.estimator.global_valid:
            self.set_home(state.position_m)
            state.say(Severity.INFO, "EKF3 IMU0 is using GPS")
        self._look()
        if self.plans.news:
            tell_totals(state, self.plans)
        if self.firmware.flies:
            self._hear_switch()
        if state.armed:
            self._act_on_failsafes()
            self._disarm_by_itself()

    def _act_on_failsafes(self) -> None:
        """Let new triggers change the mode, once each until they have gone."""
        state = self.state
        present = dict(safety.wrong(state, self.plans, flies=self.firmware.flies))
        self.handled &= present.keys()
        self.in_failsafe = bool(self.handled)
        for name, parameter in present.items():
            choice = int(state.parameters[parameter])
            if name in self.handled or choice == 0:
                continue
            self.handled.add(name)
            after = self.after.get(("any", f"{name}, {parameter} = {choice}"))
            if after is None:
                continue
            self.in_failsafe = True
            state.say(*_TEXTS.get(name, (Severity.CRITICAL, f"Failsafe: {name}")))
            if state.on_ground and self.firmware.flies:
                self.disarm()
                return
            if self.mode != "LAND":
                self.enter(self._runnable(after))

    def _runnable(self, mode: str) -> str:
        while not self.by_name[mode].needs <= self.there:
            mode = self.after.get((mode, "cannot run"), self.firmware.hold_mode)
        return mode

    def _disarm_by_itself(self) -> None:
        state = self.state
        if not self.firmware.flies or not state.on_ground:
            return
        landing = self.mode in {"LAND", "RTL", "SMART_RTL", "AUTO"}
        if state.flew and landing and state.standing_s > _LANDED_S:
            self.disarm()
            return
        delay_s = float(state.parameters["DISARM_DELAY"])
        idle_s = state.now_s - max(state.armed_s, state.landed_s)
        if delay_s > 0.0 and idle_s > delay_s and not math.isfinite(self.takeoff_m):
            self.disarm()

    def _hear_switch(self) -> None:
        """The mode switch of the transmitter: a new position of its channel asks for that position's mode."""
        channel = int(self.state.parameters["FLTMODE_CH"])
        slot = self.state.pilot.switch_position(channel)
        if slot is None or slot == self.switched:
            return
        self.switched = slot
        mode = self.by_number.get(int(self.state.parameters[f"FLTMODE{slot}"]))
        if mode is not None:
            self.request(mode.name)

    @property
    def idling(self) -> Setpoint:
        """Motors turning on the ground."""
        return _IDLING
