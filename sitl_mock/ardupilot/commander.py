"""ArduPilot's decisions for one vehicle, a copter or a rover.

Unlike PX4 it has no intended mode: a mode change by a client, the pilot or a failsafe is permanent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from sitl_mock.ardupilot import fence, guided, safety
from sitl_mock.ardupilot.flight import ModeFlight
from sitl_mock.ardupilot.guided import read_attitude
from sitl_mock.ardupilot.plans import report_totals, warn_of_old_messages
from sitl_mock.ardupilot.safety import DisarmMethod
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions.flight import MissionFlight
from sitl_mock.vehicle.modes import Need
from sitl_mock.vehicle.pilot import CENTRED, RADIO_HELD_S, Sticks, override_time_s
from sitl_mock.vehicle.state import Landed, Severity, VehicleState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sitl_mock.ardupilot.modes import Firmware
    from sitl_mock.protocols import Command, CommandAnswer, PlanItem, PlanKind, PlanStore
    from sitl_mock.vector import Vector
    from sitl_mock.vehicle.modes import Available

_CHECK_S: Final = 0.1
AT_REST: Final = Sticks(throttle=-1.0)
GUIDED_MODES: Final = frozenset({"GUIDED", "GUIDED_NOGPS"})
_STOPPED: Final = Setpoint(Kind.STOPPED)
_FLY_THERE: Final = 2


class ArduPilot:
    """The commander of one vehicle.

    Attributes:
        mode: Name of the flown mode.
        flight: State of that mode.
        failsafes: Failsafes that have acted.
        met_needs: Needs of modes that were met at the last check.
        switched: Last position of the mode switch.
        disarmed_by: How it was disarmed last.
    """

    def __init__(
        self, state: VehicleState, plans: PlanStore, firmware: Firmware[ArduPilot]
    ) -> None:
        self.state = state
        self.plans = plans
        self.firmware = firmware
        self.mission = MissionFlight(plans, skip_home=True, clocked=firmware.flies, conditions=True)
        self.by_name = firmware.modes.by_name()
        self.by_number = firmware.modes.by_number()
        self.after = firmware.modes.after()
        self.mode = firmware.first_mode
        self.flight = ModeFlight(state.position_m, state.yaw_rad)
        self.failsafes = safety.FailsafeLatch()
        self.met_needs: frozenset[Need] = frozenset()
        self.switched: int | None = None
        self.disarmed_by = DisarmMethod.BY_CLIENT
        self._check_s = -math.inf
        self._warned: set[tuple[str, PlanKind]] = set()

    # Reported state

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
        if self.failsafes.acting:
            return 5
        if not self.firmware.flies:
            return 4 if self.state.armed else 3
        return 3 if self.state.on_ground else 4

    @property
    def landed_state(self) -> int:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.state.on_ground:
            return Landed.ON_GROUND
        if self.mode == "GUIDED" and self.flight.taking_off:
            return Landed.TAKEOFF
        return (
            Landed.LANDING if self.mode == "LAND" or self.flight.stage == "land" else Landed.IN_AIR
        )

    @property
    def ready_to_arm(self) -> bool:
        """The PREARM bit of SYS_STATUS."""
        return not safety.failing(self.state, self.plans, self.by_name[self.mode])

    @property
    def available_modes(self) -> Sequence[Available]:
        """The modes of AVAILABLE_MODES."""
        return self.firmware.modes.available()

    # Inputs

    def execute(self, now_s: float, command: Command) -> Sequence[CommandAnswer]:  # noqa: ARG002 - a Commander
        """Execute or refuse a command."""
        return self.firmware.execute(self, command)

    def answered(self, _command: Command, _answers: Sequence[CommandAnswer]) -> None:
        """Do nothing: the answers go to the client only."""

    def set_mode(self, _now_s: float, base_mode: int, custom_mode: int) -> None:
        """Take a SET_MODE message."""
        mode = self.by_number.get(custom_mode)
        if base_mode & 1 and mode is not None:
            self.request(mode.name)

    def offer(self, now_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        """Take a setpoint (only in GUIDED); it ends a take-off. One beyond the fence changes nothing."""
        if self.state.conditions.offboard_refused:
            return
        setpoint = None
        if message.get_type() == "SET_ATTITUDE_TARGET":
            if self.firmware.flies and self.mode in GUIDED_MODES:
                setpoint = read_attitude(self.state.parameters, message)
        elif self.mode == "GUIDED":
            setpoint = guided.read_position_target(self.state, message)
        if setpoint is not None and self.may_fly_to(setpoint):
            self.flight.follow(setpoint)
            self.flight.stream_s = now_s

    def may_fly_to(self, setpoint: Setpoint) -> bool:
        """False if a copter's setpoint has a position beyond the fence."""
        if not self.firmware.flies or math.isnan(setpoint.position_ned_m[0]):
            return True
        return fence.contains(self.state, self.plans, setpoint.position_ned_m)

    def guide(self, _now_s: float, item: PlanItem) -> bool:
        """Fly to a mission item with current 2, as older clients request; 3 has no effect."""
        if item.current != _FLY_THERE:
            return True
        setpoint = guided.item_setpoint(self.state, item) if self.mode == "GUIDED" else None
        if setpoint is None or not self.may_fly_to(setpoint):
            return False
        self.flight.follow(setpoint)
        return True

    def switch(self, _now_s: float, mode: str) -> None:
        """Take the pilot's mode switch."""
        self.request(mode)

    def request(self, mode: str) -> bool:
        """Request a mode; after a refusal the old one stays. A disarmed copter accepts any mode."""
        if mode == self.mode:
            return True
        self._look()
        state = self.state
        missing = self.by_name[mode].needs - self.met_needs
        objection = ""
        if mode == "GUIDED" and state.conditions.offboard_refused:
            objection = "init failed"
        elif not state.armed and self.firmware.flies:
            objection = ""  # a disarmed copter accepts any mode
        elif missing & {Need.LOCAL_POSITION, Need.GLOBAL_POSITION}:
            objection = "requires position"
        elif missing:
            objection = "init failed"
        elif (
            mode == "AUTO"
            and self.firmware.flies
            and state.on_ground
            and not self.mission.takes_off
        ):
            state.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            objection = "init failed"
        if objection:
            state.say(Severity.WARNING, f"Mode change to {mode} failed: {objection}")
            return False
        self.enter(mode)
        return True

    def enter(self, mode: str) -> None:
        """Begin a mode."""
        if mode == self.mode:
            return
        self.mode = mode
        self.flight = ModeFlight(self.state.position_m, self.state.yaw_rad)
        if mode == "AUTO":
            self.mission.start()

    # Decisions

    def tick(self, now_s: float) -> Setpoint:
        """Run the checks when due; return the setpoint of the flown mode."""
        if now_s >= self._check_s + _CHECK_S - 1e-9:
            self._check_s = now_s
            state = self.state
            if state.home_m is None and state.estimator.global_valid:
                self.set_home(state.position_m)
                state.say(Severity.INFO, "EKF3 IMU0 is using GPS")
            self._look()
            is_flying = state.armed and self.mode == "AUTO" and not self.mission.over
            self.plans.in_flight = is_flying
            if self.plans.news:
                if not self.mission.count:
                    self.mission.forget()
                report_totals(state, self.plans)
            if self.plans.old_messages:
                warn_of_old_messages(state, self.plans, self._warned)
            if self.firmware.flies:
                self._hear_switch()
            if state.armed:
                self._act_on_failsafes()
                method = None
                if self.firmware.flies:
                    method = safety.disarms_by_itself(
                        state, self.mode, taking_off=self.flight.taking_off
                    )
                if method is not None:
                    self.disarm(method)
        if not self.state.armed:
            return _STOPPED
        setpoint = self.firmware.flights[self.mode](self)
        return self.flight.with_turn(setpoint)

    @property
    def sticks(self) -> Sticks:
        """The pilot's sticks; without a pilot those of the simulator's radio (a copter's throttle is down)."""
        now_s = self.state.now_s
        pilot = self.state.pilot
        rest = AT_REST if self.firmware.flies else CENTRED
        radio_held = now_s - pilot.heard_s <= RADIO_HELD_S
        radio = pilot.sticks if radio_held else rest
        return pilot.overriding(radio, now_s, override_time_s(self.state.parameters))

    def guided_setpoint(self) -> Setpoint:
        """Return the setpoint of GUIDED."""
        return self.flight.guided_setpoint(self.state, self.plans, self.firmware)

    def mission_over(self) -> None:
        """Change the mode at the end of a rover's mission."""
        if self.mission.over == "return":
            self.enter(self.after["AUTO", "mission asks to return"])
        elif self.mission.over == "finished":
            self.enter(self.after["AUTO", "mission finished in the air"])

    def set_home(self, place_m: Vector, *, given: bool = False) -> None:
        """Put home somewhere, and tell it and the origin to everybody."""
        self.state.set_home(place_m, given=given)
        self.state.news += ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")

    def disarm(self, method: DisarmMethod = DisarmMethod.BY_CLIENT) -> None:
        """Motors off."""
        if self.state.armed:
            self.state.say(Severity.INFO, "Disarming motors")
        self.disarmed_by = method
        self.state.disarm()
        self.failsafes.clear()
        self.flight.takeoff_m = math.nan
        self.mission.reset()

    def _look(self) -> None:
        self.met_needs = safety.available(self.state, self.plans)

    def _act_on_failsafes(self) -> None:
        """Let new triggers change the mode, once each until they are gone."""
        state = self.state
        for name, event in self.failsafes.new(state, self.plans, flies=self.firmware.flies):
            after = self.after.get(("any", event))
            if after is None:
                continue
            self.failsafes.act(state, name)
            if state.on_ground and self.firmware.flies:
                self.disarm(safety.BY_FAILSAFE[name])
                return
            if self.mode != "LAND":
                # A mode that cannot run falls back to the next one.
                mode = after
                while not self.by_name[mode].needs <= self.met_needs:
                    mode = self.after.get((mode, "cannot run"), self.firmware.hold_mode)
                self.enter(mode)

    def _hear_switch(self) -> None:
        """The transmitter's mode switch: a new position of its channel requests that position's mode."""
        parameters = self.state.parameters
        channel = int(parameters["FLTMODE_CH"])
        time_s = override_time_s(parameters)
        slot = self.state.pilot.switch_position(channel, self.state.now_s, time_s)
        if slot is None or slot == self.switched:
            return
        self.switched = slot
        mode = self.by_number.get(int(parameters[f"FLTMODE{slot}"]))
        if mode is not None:
            self.request(mode.name)
