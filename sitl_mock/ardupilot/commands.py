"""ArduPilot's answers to commands, as measured on 4.5.7: one function per command, in a table by MAV_CMD number."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot import safety
from sitl_mock.ardupilot.answers import (
    ANSWERED,
    ANSWERED_WITH_ONE,
    CALIBRATIONS,
    answer_calibration,
)
from sitl_mock.ardupilot.guided import STOP
from sitl_mock.ardupilot.maneuvers import turn_from
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.protocols import Command, CommandAnswer, Place, Result, is_on_earth
from sitl_mock.protocols.command import ACCEPTED, DENIED, UNSUPPORTED, Answers
from sitl_mock.protocols.services import HIGHEST_M
from sitl_mock.vector import Vector
from sitl_mock.vehicle.setpoints import GLOBAL_TERRAIN
from sitl_mock.vehicle.state import Severity

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.ardupilot.commander import ArduPilot

FORCE_ARM: Final = frozenset({2989.0, 21196.0})
FORCE_DISARM: Final = 21196.0
FAILED: Final = (CommandAnswer(Result.FAILED),)
_WITH_POSITION: Final = frozenset({"GUIDED"})
_SPEED_MODES: Final = frozenset({"GUIDED", "AUTO", "RTL"})
_COPTER_ONLY: Final = frozenset({22, 84, 85, 115, 183, 193, 195, 197, 201, 42002, 42003})
_MOST_PULSE_US: Final = 0xFFFF
_ROI_NONE: Final = 197
_RELATIVE: Final = frozenset({3, 6})


def execute(commander: ArduPilot, command: Command) -> Answers:
    """Execute or refuse a command; commands without effect here get the measured answer."""
    number = command.number
    if not commander.firmware.flies and number in _COPTER_ONLY:
        return UNSUPPORTED
    handler = _HANDLERS.get(number)
    if handler is not None:
        return handler(commander, command)
    if number in CALIBRATIONS:
        return answer_calibration(commander, command)
    if number in commander.firmware.answers:
        return (CommandAnswer(commander.firmware.answers[number]),)
    result = ANSWERED.get(number) if commander.firmware.flies else None
    if commander.firmware.flies and command.params[0] == 1.0:
        result = ANSWERED_WITH_ONE.get(number, result)
    if result is None:
        return UNSUPPORTED
    return (CommandAnswer(result),)


def _done(done: bool) -> Answers:
    return ACCEPTED if done else FAILED


def _set_mode(commander: ArduPilot, command: Command) -> Answers:
    base, number = command.params[:2]
    if not math.isfinite(base + number) or not int(base) & 1:
        return DENIED
    mode = commander.by_number.get(int(number))
    return _done(mode is not None and commander.request(mode.name))


def _arm(commander: ArduPilot, command: Command) -> Answers:
    """COMPONENT_ARM_DISARM; param2 2989 or 21196 forces."""
    state = commander.state
    want, force = command.params[:2]
    if want == 1.0:
        return _arm_now(commander, forced=force in FORCE_ARM)
    if want != 0.0:
        return UNSUPPORTED
    if state.armed and commander.firmware.flies and not state.on_ground and force != FORCE_DISARM:
        return FAILED
    commander.disarm()
    return ACCEPTED


def _arm_now(commander: ArduPilot, *, forced: bool) -> Answers:
    state = commander.state
    if state.armed:
        return ACCEPTED
    if forced:
        reasons = []
    else:
        reasons = safety.refusals(state, commander.plans, commander.by_name[commander.mode])
    for text in (*safety.warnings(state.parameters), *reasons):
        state.say(Severity.CRITICAL, f"Arm: {text}")
    if reasons:
        return FAILED
    state.arm()
    if not state.home_given:
        commander.set_home(state.position_m)
    state.say(Severity.INFO, "Arming motors")
    return ACCEPTED


def _takeoff(commander: ArduPilot, command: Command) -> Answers:
    """NAV_TAKEOFF: height above home, armed, in GUIDED, on the ground."""
    state = commander.state
    if command.is_int and command.frame not in _RELATIVE:
        return DENIED
    height_m = command.params[6]
    ready = state.armed and state.on_ground and commander.mode in _WITH_POSITION
    if not (ready and 0.0 < height_m < HIGHEST_M):
        return FAILED
    home = state.position_m if state.home_m is None else state.home_m
    commander.flight.take_off(state.now_s, state.position_m, home[2] - height_m)
    return ACCEPTED


def _to(mode: str) -> Callable[[ArduPilot, Command], Answers]:
    def handler(commander: ArduPilot, _command: Command) -> Answers:
        if mode not in commander.by_name:
            return UNSUPPORTED
        return _done(commander.request(mode))

    return handler


def _start_mission(commander: ArduPilot, _command: Command) -> Answers:
    """MISSION_START: AUTO, which may then take off without the throttle stick."""
    commander.flight.may_lift = commander.request("AUTO")
    return _done(commander.flight.may_lift)


def _enable_fence(commander: ArduPilot, command: Command) -> Answers:
    """DO_FENCE_ENABLE: 0 and 1 set FENCE_ENABLE; other values have no effect."""
    enable = command.params[0]
    if enable in {0.0, 1.0}:
        commander.state.parameters.set("FENCE_ENABLE", enable)
    return ACCEPTED


def _set_mission_item(commander: ArduPilot, command: Command) -> Answers:
    """DO_SET_MISSION_CURRENT: DENIED without such an item, or with home as the only item."""
    seq = command.params[0]
    if (
        not math.isfinite(seq)
        or commander.mission.count < 2
        or not commander.mission.set_current(int(seq))
    ):
        return DENIED
    return ACCEPTED


def _reposition(commander: ArduPilot, command: Command) -> Answers:
    """DO_REPOSITION in GUIDED, or with a change to it (param2 bit 0); the speed in param1 is ignored.

    Beyond the fence it fails without a change of the mode.
    """
    _, flags, _, _, lat, lon, alt = command.params
    if not command.is_int:
        return UNSUPPORTED
    change = math.isfinite(flags) and int(flags) & 1
    if not is_on_earth(Place(lat, lon, alt)) or (commander.mode != "GUIDED" and not change):
        return DENIED
    state = commander.state
    north, east, down = state.frame.to_local(lat, lon, alt)
    if command.frame in _RELATIVE:
        home_d = 0.0 if state.home_m is None else state.home_m[2]
        down = home_d - alt
    setpoint = Setpoint(Kind.TRAVEL, Vector((north, east, down)))
    if command.frame in GLOBAL_TERRAIN:
        setpoint = STOP
    if not (commander.may_fly_to(setpoint) and commander.request("GUIDED")):
        return FAILED
    commander.flight.follow(setpoint)
    return ACCEPTED


def _change_speed(commander: ArduPilot, command: Command) -> Answers:
    """DO_CHANGE_SPEED: only in GUIDED, AUTO and RTL."""
    kind, speed_m_s = command.params[:2]
    if not speed_m_s > 0.0 or commander.mode not in _SPEED_MODES:
        return FAILED
    commander.flight.speeds.change(kind, speed_m_s)
    if kind <= 1.9:
        commander.mission.speed_m_s = speed_m_s
    return ACCEPTED


def _yaw(commander: ArduPilot, command: Command) -> Answers:
    """CONDITION_YAW."""
    angle, rate, direction, relative = command.params[:4]
    if not 0.0 <= angle <= 360.0 or relative not in {0.0, 1.0}:
        return FAILED
    slew = float(commander.state.parameters.get("ATC_SLEW_YAW", 6000.0)) * 0.01
    flight = commander.flight
    yaw_rad = commander.state.yaw_rad if flight.turn is None else flight.turn.heading_rad
    flight.turn = turn_from(
        yaw_rad, angle, rate, direction, relative=relative == 1.0, slew_deg_s=slew
    )
    return ACCEPTED


def _look_at(commander: ArduPilot, command: Command) -> Answers:
    """DO_SET_ROI and DO_SET_ROI_LOCATION: the nose turns there until the next setpoint, or DO_SET_ROI_NONE."""
    if command.number == _ROI_NONE:
        commander.flight.turn = None
        return ACCEPTED
    lat, lon, alt = command.params[4:]
    if lat == lon == alt == 0.0:
        return ACCEPTED
    if not is_on_earth(Place(lat, lon, alt)):
        return DENIED
    state = commander.state
    north, east, _ = state.frame.to_local(lat, lon, alt)
    bearing_rad = math.atan2(east - state.position_m[1], north - state.position_m[0])
    slew_deg_s = float(state.parameters["ATC_SLEW_YAW"]) * 0.01
    bearing_deg = math.degrees(bearing_rad) % 360.0
    commander.flight.turn = turn_from(
        state.yaw_rad, bearing_deg, 0.0, 0.0, relative=False, slew_deg_s=slew_deg_s
    )
    return ACCEPTED


def _set_servo(commander: ArduPilot, command: Command) -> Answers:
    """DO_SET_SERVO: sets an output without a function; those of the motors are in use."""
    channel, pulse_us = command.params[:2]
    parameters = commander.state.parameters
    if not math.isfinite(channel + pulse_us):
        return FAILED
    if parameters.get(f"SERVO{int(channel)}_FUNCTION", 1):
        text = f"ServoRelayEvent: Channel {int(channel)} is already in use"
        commander.state.say(Severity.INFO, text)
        return FAILED
    commander.state.servos[int(channel)] = min(max(int(pulse_us), 0), _MOST_PULSE_US)
    return ACCEPTED


def _pause(commander: ArduPilot, command: Command) -> Answers:
    """DO_PAUSE_CONTINUE: 0 pauses, 1 continues, in GUIDED and between waypoints in AUTO."""
    if command.params[0] not in {0.0, 1.0}:
        return DENIED
    pause = command.params[0] == 0.0
    under_way = commander.mode == "GUIDED" or (
        commander.mode == "AUTO" and not commander.state.on_ground
    )
    if not under_way:
        commander.state.say(Severity.INFO, f"Failed to {'pause' if pause else 'resume'}")
        return FAILED
    commander.flight.paused = pause
    return ACCEPTED


def _set_home(commander: ArduPilot, command: Command) -> Answers:
    state = commander.state
    use_current, *_, lat, lon, alt = command.params
    if use_current == 1.0 or (lat == 0.0 and lon == 0.0 and alt == 0.0):
        if not state.estimator.position_valid:
            return FAILED
        commander.set_home(state.position_m, given=use_current == 1.0)
        return ACCEPTED
    if not is_on_earth(Place(lat, lon, alt)):
        return DENIED
    commander.set_home(state.frame.to_local(lat, lon, alt), given=True)
    return ACCEPTED


def _terminate(commander: ArduPilot, command: Command) -> Answers:
    if not command.params[0] > 0.5:
        return FAILED
    commander.state.say(Severity.CRITICAL, "Terminating due to GCS request")
    commander.disarm(safety.DisarmMethod.TERMINATION)
    return ACCEPTED


def _reboot(commander: ArduPilot, command: Command) -> Answers:
    if commander.state.armed or command.params[0] not in {1.0, 3.0}:
        return FAILED
    commander.state.conditions.put("reboot", value=True)
    return ACCEPTED


def _prearm(commander: ArduPilot, _command: Command) -> Answers:
    """RUN_PREARM_CHECKS: reports failing checks as texts."""
    if commander.state.armed:
        return (CommandAnswer(Result.TEMPORARILY_REJECTED),)
    state = commander.state
    failing = safety.failing(state, commander.plans, commander.by_name[commander.mode])
    for reason in (*safety.warnings(state.parameters), *failing):
        commander.state.say(Severity.CRITICAL, f"PreArm: {reason}")
    return ACCEPTED


def _tell_home(commander: ArduPilot, _command: Command) -> Answers:
    """GET_HOME_POSITION."""
    if commander.state.home_m is None:
        return FAILED
    commander.state.news += ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")
    return ACCEPTED


def _land_start(commander: ArduPilot, _command: Command) -> Answers:
    """DO_LAND_START: fails because the mock's missions have no landing sequence."""
    commander.state.say(Severity.WARNING, "Unable to start landing sequence")
    commander.state.say(
        Severity.WARNING, "Mode change to AUTO RTL failed: No landing sequence found"
    )
    return FAILED


def _storage(commander: ArduPilot, command: Command) -> Answers:
    """PREFLIGHT_STORAGE: 2 resets all parameters at the next boot; other values are DENIED."""
    if command.params[0] != 2.0:
        return DENIED
    commander.state.parameters.reset_at_boot = True
    commander.state.say(Severity.WARNING, "All parameters reset, reboot board")
    return ACCEPTED


def _arm_by_button(commander: ArduPilot, _command: Command) -> Answers:
    """SOLO_BTN_FLY_HOLD: arms in LOITER on the ground, lands in the air."""
    if commander.state.armed:
        return _done(commander.request("LAND"))
    return _arm_now(commander, forced=False) if commander.request("LOITER") else FAILED


def _disarm_by_button(commander: ArduPilot, _command: Command) -> Answers:
    """SOLO_BTN_PAUSE_CLICK and _FLY_CLICK: disarm on the ground."""
    if commander.state.armed and commander.state.on_ground:
        commander.disarm(safety.DisarmMethod.BUTTON)
    return ACCEPTED


def _banner(commander: ArduPilot, _command: Command) -> Answers:
    """DO_SEND_BANNER, also before a list of parameters: version, and of a copter its board's id and its frame."""
    state = commander.state
    state.say(Severity.INFO, commander.firmware.banner)
    if commander.firmware.flies:
        state.say(Severity.INFO, f"{state.system_id:032x}")
        state.say(Severity.INFO, f"Frame: QUAD/{'X' if state.parameters['FRAME_TYPE'] else 'PLUS'}")
    return ACCEPTED


_HANDLERS: Mapping[int, Callable[[ArduPilot, Command], Answers]] = MappingProxyType(
    {
        17: _to("LOITER"),
        20: _to("RTL"),
        21: _to("LAND"),
        22: _takeoff,
        84: _takeoff,
        85: _to("LAND"),
        176: _set_mode,
        115: _yaw,
        178: _change_speed,
        179: _set_home,
        185: _terminate,
        192: _reposition,
        193: _pause,
        224: _set_mission_item,
        246: _reboot,
        207: _enable_fence,
        300: _start_mission,
        400: _arm,
        401: _prearm,
        410: _tell_home,
        183: _set_servo,
        189: _land_start,
        195: _look_at,
        _ROI_NONE: _look_at,
        201: _look_at,
        245: _storage,
        42002: _arm_by_button,
        42003: _disarm_by_button,
        42428: _banner,
    }
)
