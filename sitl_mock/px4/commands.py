"""PX4's answers to commands, as measured on v1.17: one function per command, in a table by MAV_CMD number.

`PLAIN` has the commands without effect in the mock; each was sent to PX4 on the ground with all parameters 0. Commands
without a handler that are not in `PLAIN` are UNSUPPORTED.
"""

from __future__ import annotations

import math
import re
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.missions.fence import violated
from sitl_mock.protocols import Command, CommandAnswer, Place, Result, is_on_earth
from sitl_mock.protocols.command import ACCEPTED, DENIED, UNSUPPORTED, Answers
from sitl_mock.px4 import failures
from sitl_mock.px4.external_modes import NAME_OF
from sitl_mock.px4.maneuvers import Orbit
from sitl_mock.px4.modes import requested_mode
from sitl_mock.vector import Vector
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.px4.commander import Px4

REFUSED: Final = (CommandAnswer(Result.TEMPORARILY_REJECTED),)
SILENCE: Final[Answers] = ()


_TAKEN: Final = frozenset({80, 187, 191, 195, 196, 197, 201, 620, 2510, 42006, 43003})
"""Accepted: region of interest, go-around, actuators, logging, compass by heading, external position.

620 is in no dialect and is accepted too.
"""
_UNANSWERED: Final = frozenset(
    {1, 2, 35, 93, 203, 204, 205, 206, 214, 220, 242, 243, 260, 310, 311, 500, 521}
    | {530, 531, 532, 1000, 1001, 2003, 2511, 3000, 30001, 30002, 42600}
)
"""Not answered: commands for cameras, gimbals, grippers and other components that do not exist here."""
_OTHER: Final[Mapping[int, Answers]] = {
    189: (CommandAnswer(Result.CANCELLED),),
    211: (CommandAnswer(Result.IN_PROGRESS),),
    212: (CommandAnswer(Result.IN_PROGRESS),),
    262: (CommandAnswer(Result.FAILED),),
    2600: (CommandAnswer(Result.FAILED),),
    43004: (CommandAnswer(Result.ACCEPTED), CommandAnswer(Result.UNSUPPORTED, delay_s=0.02)),
}

_WITH_ONE: Final[Mapping[int, Answers]] = {
    262: ACCEPTED,
    310: ACCEPTED,
    2510: UNSUPPORTED,
    2511: ACCEPTED,
}
_WITH_NAN: Final[Mapping[int, Answers]] = {
    211: DENIED,
    2510: UNSUPPORTED,
    2511: ACCEPTED,
    43003: REFUSED,
}
"""Answers that differ when all parameters are 1 or NaN."""

PLAIN: Final[Mapping[int, Answers]] = MappingProxyType(
    dict.fromkeys(_TAKEN, ACCEPTED) | dict.fromkeys(_UNANSWERED, SILENCE) | dict(_OTHER)
)


def reposition(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_REPOSITION: fly to a position in Hold; NaN keeps the present value, heights are AMSL in every frame."""
    speed, flags, _, yaw, lat, lon, alt = command.params
    if not math.isfinite(flags) or int(flags) != 1:
        return UNSUPPORTED
    position = Place(*(0.0 if math.isnan(value) else value for value in (lat, lon, alt)))
    if not is_on_earth(position):
        return DENIED
    if px4.mode != "HOLD" and not px4.request(now_s, "HOLD"):
        return REFUSED
    px4.intention = "HOLD"
    state = px4.state
    if not state.armed:
        return ACCEPTED
    # A height alone keeps the horizontal goal, a horizontal position alone keeps the height.
    plan = px4.plan
    north, east, down = state.position_m
    if math.isfinite(lat + lon):
        north, east, _ = state.frame.to_local(lat, lon, 0.0)
    elif math.isfinite(alt) and math.isfinite(plan.goal_m[0]):
        north, east, _ = plan.goal_m
    if math.isfinite(alt):
        down = state.frame.origin.alt_amsl_m - alt
    goal_m = Vector((north, east, down))
    if violated(px4.plans.fence.items, state.frame, goal_m):
        state.say(Severity.CRITICAL, "Reposition is outside geofence")
        return ACCEPTED
    plan.goal_m = goal_m
    plan.heading_kept = math.isfinite(yaw)
    if speed > 0.0:
        plan.speed_m_s = speed
    if math.isfinite(yaw):
        plan.yaw_rad = yaw if abs(yaw) <= 2.0 * math.pi else math.radians(yaw)
    return ACCEPTED


def change_altitude(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_CHANGE_ALTITUDE: DO_REPOSITION with a height (AMSL) alone."""
    nan = math.nan
    return reposition(
        px4, now_s, command._replace(params=(nan, 1.0, nan, nan, nan, nan, command.params[0]))
    )


def orbit(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_ORBIT: circle a given position or the present one; the sign of the radius is the direction."""
    radius, speed, facing, _, lat, lon, alt = command.params
    if px4.mode != "ORBIT" and not px4.request(now_s, "ORBIT"):
        px4.state.say(Severity.CRITICAL, "Orbit command rejected")
        return REFUSED
    state = px4.state
    plan = px4.plan
    if not plan.orbit:
        plan.orbit = Orbit(state.position_m, state.yaw_rad)
    if not plan.orbit.change(state, radius, speed, facing, (lat, lon, alt)):
        state.say(Severity.CRITICAL, "Orbit radius limit exceeded")
    return ACCEPTED


SET_NAV_STATE: Final = 100001
FORCE_MAGIC: Final = 21196
SECOND_ACK_S: Final = 0.02
"""The commander answers in its own cycle, after the MAVLink receiver."""


def execute(px4: Px4, now_s: float, command: Command) -> Answers:
    """Execute or refuse a command."""
    handler = _HANDLERS.get(command.number)
    if handler is not None:
        return handler(px4, now_s, command)
    # A command that changes nothing.
    first = command.params[0]
    by_first = _WITH_NAN if math.isnan(first) else _WITH_ONE if first == 1.0 else {}
    return by_first.get(command.number, PLAIN.get(command.number, UNSUPPORTED))


def _granted(granted: bool) -> Answers:
    return ACCEPTED if granted else REFUSED


def _set_mode(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_SET_MODE: two answers; only the second one means anything."""
    base, main, sub = (
        (int(value) & 0xFF if math.isfinite(value) else 0) for value in command.params[:3]
    )
    granted = px4.ask_for(now_s, requested_mode(base, main, sub))
    real = Result.ACCEPTED if granted else Result.TEMPORARILY_REJECTED
    return (CommandAnswer(Result.ACCEPTED), CommandAnswer(real, delay_s=SECOND_ACK_S))


def _arm(px4: Px4, _now_s: float, command: Command) -> Answers:
    """COMPONENT_ARM_DISARM; param2 21196 forces, so it also disarms in the air."""
    want, force = command.params[:2]
    if want not in {0.0, 1.0}:
        return (CommandAnswer(Result.UNSUPPORTED),)
    if want == 1.0:
        return _arm_now(px4)
    state = px4.state
    if not state.armed:
        return ACCEPTED
    if not state.on_ground and force != FORCE_MAGIC:
        state.say(Severity.CRITICAL, "Disarming denied: not landed")
        return REFUSED
    px4.disarm()
    state.say(Severity.INFO, "Disarmed by external command")
    return ACCEPTED


def _arm_now(px4: Px4, by: str = "external command") -> Answers:
    state = px4.state
    if state.armed:
        return ACCEPTED
    if px4.calibration.kind:
        state.say(Severity.CRITICAL, "Arming denied: calibrating")
        return REFUSED
    px4.look()
    reasons = px4.refusals()
    if reasons:
        state.say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
        for reason in reasons:
            if not reason.startswith("Mode "):
                state.say(Severity.CRITICAL, reason)
        return REFUSED
    state.arm()
    px4.home.arm(state, in_mission=px4.mode == "MISSION")
    state.pilot.settle()
    state.say(Severity.INFO, f"Armed by {by}")
    if px4.mode == "TAKEOFF":
        px4.say_default_height()
    return ACCEPTED


def _run_checks(px4: Px4, now_s: float, _command: Command) -> Answers:
    """RUN_PREARM_CHECKS: reports them."""
    px4.look()
    px4.report(now_s, force=True)
    return ACCEPTED


def _set_state(px4: Px4, now_s: float, command: Command) -> Answers:
    """SET_NAV_STATE, which programs beside PX4 send: a mode by its number in VehicleStatus."""
    number = command.params[0]
    mode = NAME_OF.get(int(number + 0.5)) if 0.0 <= number < 256.0 else None
    if mode is None:  # disarmed PX4 takes any number
        return _granted(not px4.state.armed)
    return _granted(px4.request(now_s, mode, with_text=False))


def _takeoff(px4: Px4, now_s: float, command: Command) -> Answers:
    altitude_m = command.params[6]
    if not (math.isnan(altitude_m) or is_on_earth(Place(0.0, 0.0, altitude_m))):
        return DENIED
    return _granted(px4.begin_takeoff(now_s, altitude_m))


def _to(mode: str, text: str) -> Callable[[Px4, float, Command], Answers]:
    def handler(px4: Px4, now_s: float, _command: Command) -> Answers:
        granted = px4.request(now_s, mode)
        if granted:
            px4.state.say(Severity.INFO, text)
        return _granted(granted)

    return handler


def _start_mission(px4: Px4, now_s: float, command: Command) -> Answers:
    """MISSION_START: changes the mode and arms."""
    px4.look()
    if not px4.mission.valid:
        px4.state.say(Severity.CRITICAL, "Mission start denied! No valid mission")
        return DENIED
    first = command.params[0]
    if not (math.isfinite(first) and -1.0 <= first < px4.mission.count):
        return DENIED
    granted = px4.request(now_s, "MISSION") and _arm_now(px4, "mission start") is ACCEPTED
    if granted and first >= 0.0 and int(first) != px4.mission.current:
        px4.mission.set_current(int(first))
    return _granted(granted)


def _change_speed(px4: Px4, _now_s: float, command: Command) -> Answers:
    """DO_CHANGE_SPEED: applies until the present mode ends; a speed of 0 or less restores the default."""
    speed = command.params[1]
    px4.plan.speed_m_s = px4.mission.speed_m_s = speed if speed > 0.0 else math.nan
    return ACCEPTED


def _set_home(px4: Px4, _now_s: float, command: Command) -> Answers:
    state = px4.state
    use_current, *_, lat, lon, alt = command.params
    if use_current == 1.0:
        state.set_home(state.position_m)
    elif is_on_earth(Place(lat, lon, alt)):
        state.set_home(state.frame.to_local(lat, lon, alt), given=True)
    else:
        return DENIED
    return ACCEPTED


def _terminate(px4: Px4, _now_s: float, command: Command) -> Answers:
    """DO_FLIGHTTERMINATION: only while armed."""
    if not (command.params[0] > 0.5 and px4.state.armed):
        return DENIED
    px4.mode = px4.intention = "TERMINATION"
    px4.state.say(Severity.EMERGENCY, "Flight termination")
    return ACCEPTED


def _reboot(_px4: Px4, _now_s: float, command: Command) -> Answers:
    """PREFLIGHT_REBOOT_SHUTDOWN: the simulator cannot restart itself, so all but "do nothing" is denied (measured)."""
    first = command.params[0]
    return ACCEPTED if math.isfinite(first) and int(first) == 0 else DENIED


def _storage(px4: Px4, _now_s: float, command: Command) -> Answers:
    """PREFLIGHT_STORAGE: 0 loads, 1 saves, 2 and 4 reset all parameters, 3 the sensor calibration; others: silence.

    2 keeps the flight counters. The system id stays because the simulator's start script sets it.
    """
    if px4.state.armed:
        return REFUSED
    first = command.params[0]
    choice = int(first) if math.isfinite(first) else -1
    if choice not in range(5):
        return SILENCE
    if choice in _KEPT_BY_RESET:
        kept = _KEPT_BY_RESET[choice]
        px4.state.parameters.reset(lambda name: kept.fullmatch(name) is not None)
    return ACCEPTED


_KEPT_BY_RESET: Final[Mapping[int, re.Pattern[str]]] = {
    2: re.compile("MAV_SYS_ID|LND_FLIGHT_T_HI|LND_FLIGHT_T_LO|COM_FLIGHT_UUID"),
    3: re.compile(r"(?!CAL_(ACC|GYRO|MAG)).*"),
    4: re.compile("MAV_SYS_ID"),
}
"""Parameters that a reset keeps, by the command's first parameter."""


def _inject_failure(px4: Px4, _now_s: float, command: Command) -> Answers:
    """INJECT_FAILURE with SYS_FAILURE_EN: of all units and types SIH takes those of the battery and the motors."""
    if not int(px4.state.parameters["SYS_FAILURE_EN"]):
        return DENIED
    if not all(math.isfinite(value) for value in command.params[:3]):
        return SILENCE
    unit, kind, instance = (math.trunc(value + 0.5) for value in command.params[:3])
    if unit == failures.BATTERY:
        answer = failures.fail_battery(px4.state, kind, instance)
    elif unit == failures.MOTOR and px4.failures.fails_motors:
        answer = px4.failures.fail_motor(px4.state, kind, instance)
    else:
        answer = None
    if answer is None:
        return SILENCE
    return ACCEPTED if answer else UNSUPPORTED


def _calibrate(px4: Px4, now_s: float, command: Command) -> Answers:
    """PREFLIGHT_CALIBRATION: texts follow the answer."""
    return px4.calibration.execute(px4.state, now_s, command)


_HANDLERS: Mapping[int, Callable[[Px4, float, Command], Answers]] = MappingProxyType(
    {
        20: _to("RTL", "Returning to launch"),
        21: _to("LAND", "Landing at current position"),
        22: _takeoff,
        23: _to("PRECLAND", "Precision landing"),
        34: orbit,
        84: _takeoff,
        176: _set_mode,
        178: _change_speed,
        179: _set_home,
        185: _terminate,
        186: change_altitude,
        192: reposition,
        241: _calibrate,
        245: _storage,
        246: _reboot,
        300: _start_mission,
        400: _arm,
        401: _run_checks,
        420: _inject_failure,
        SET_NAV_STATE: _set_state,
    }
)
COMMANDS: Final = frozenset(_HANDLERS) | frozenset(PLAIN)
