"""How ArduPilot answers commands, as measured on 4.5.7: one function a command, one table of MAV_CMD numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.ardupilot import safety
from sitl_mock.craft import Severity
from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.missions import flyable
from sitl_mock.protocols import Command, CommandAnswer, Place, Result, on_earth

if TYPE_CHECKING:
    from sitl_mock.ardupilot.brain import ArduPilot

Answers = Sequence[CommandAnswer]

FORCE_ARM: Final = frozenset({2989.0, 21196.0})
FORCE_DISARM: Final = 21196.0
ACCEPTED: Final = (CommandAnswer(Result.ACCEPTED),)
FAILED: Final = (CommandAnswer(Result.FAILED),)
DENIED: Final = (CommandAnswer(Result.DENIED),)
UNSUPPORTED: Final = (CommandAnswer(Result.UNSUPPORTED),)
HIGHEST_M: Final = 100_000.0
_RELATIVE: Final = frozenset({3, 6})


def execute(brain: ArduPilot, now_s: float, command: Command) -> Answers:
    """Obey or refuse a command."""
    handler = _HANDLERS.get(command.number)
    if handler is None or (command.number == 22 and not brain.rig.flies):
        return UNSUPPORTED
    return handler(brain, now_s, command)


def _done(done: bool) -> Answers:
    return ACCEPTED if done else FAILED


def _set_mode(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    base, number = command.params[:2]
    if not math.isfinite(base + number) or not int(base) & 1:
        return DENIED
    mode = brain.by_number.get(int(number))
    return _done(mode is not None and brain.request(mode.name))


def _arm(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    """COMPONENT_ARM_DISARM; param2 2989 or 21196 forces."""
    craft = brain.craft
    want, force = command.params[:2]
    if want == 1.0:
        if craft.armed:
            return ACCEPTED
        reasons = [] if force in FORCE_ARM else safety.refusals(brain)
        for reason in reasons:
            craft.say(Severity.CRITICAL, f"Arm: {reason}")
        if reasons:
            return FAILED
        craft.arm()
        craft.set_home(craft.position_m)
        craft.say(Severity.INFO, "Arming motors")
        return ACCEPTED
    if want != 0.0:
        return UNSUPPORTED
    if craft.armed and brain.rig.flies and not craft.on_ground and force != FORCE_DISARM:
        return FAILED
    if craft.armed:
        craft.say(Severity.INFO, "Disarming motors")
    brain.disarm()
    return ACCEPTED


def _takeoff(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    """NAV_TAKEOFF: height above home, armed, in GUIDED, on the ground."""
    craft = brain.craft
    if command.is_int and command.frame not in _RELATIVE:
        return DENIED
    height_m = command.params[6]
    ready = craft.armed and craft.on_ground and brain.mode == "GUIDED"
    if not (ready and 0.0 < height_m < HIGHEST_M):
        return FAILED
    home = craft.home_m or craft.position_m
    brain.takeoff_m = home[2] - height_m
    brain.guided = None
    brain.entered_m = craft.position_m
    return ACCEPTED


def _to(mode: str) -> Callable[[ArduPilot, float, Command], Answers]:
    def handler(brain: ArduPilot, _now_s: float, _command: Command) -> Answers:
        if mode not in brain.by_name:
            return UNSUPPORTED
        return _done(brain.request(mode))

    return handler


def _start_mission(brain: ArduPilot, _now_s: float, _command: Command) -> Answers:
    if not flyable(brain.plans.mission.items):
        return FAILED
    return _done(brain.request("AUTO"))


def _set_mission_item(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    seq = command.params[0]
    return _done(math.isfinite(seq) and brain.mission.set_current(int(seq)))


def _reposition(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    """DO_REPOSITION: in GUIDED, or changing to it with param2 bit 0."""
    speed, flags, _, _, lat, lon, alt = command.params
    if not command.is_int or not on_earth(Place(lat, lon, alt)):
        return DENIED
    change = math.isfinite(flags) and int(flags) & 1
    if brain.mode != "GUIDED" and not (change and brain.request("GUIDED")):
        return DENIED
    craft = brain.craft
    north, east, down = craft.frame.to_local(lat, lon, alt)
    if command.frame in _RELATIVE:
        down = (craft.home_m or (0.0, 0.0, 0.0))[2] - alt
    brain.guided = Setpoint(Kind.TRAVEL, (north, east, down), speed_m_s=speed if speed > 0.0 else brain.speed_m_s)
    return ACCEPTED


def _change_speed(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    if not command.params[1] > 0.0:
        return FAILED
    brain.speed_m_s = brain.mission.speed_m_s = command.params[1]
    return ACCEPTED


def _set_home(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    craft = brain.craft
    use_current, *_, lat, lon, alt = command.params
    if use_current == 1.0:
        craft.set_home(craft.position_m)
        return ACCEPTED
    if not on_earth(Place(lat, lon, alt)):
        return DENIED
    craft.set_home(craft.frame.to_local(lat, lon, alt), given=True)
    return ACCEPTED


def _terminate(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    if command.params[0] > 0.5:
        brain.disarm()
        brain.craft.say(Severity.CRITICAL, "Terminating due to GCS request")
    return ACCEPTED


def _reboot(brain: ArduPilot, _now_s: float, command: Command) -> Answers:
    if brain.craft.armed:
        return FAILED
    if command.params[0] in {1.0, 3.0}:
        brain.craft.conditions.put("reboot", value=True)
    return ACCEPTED


def _prearm(brain: ArduPilot, _now_s: float, _command: Command) -> Answers:
    """RUN_PREARM_CHECKS: the reasons come as texts."""
    for reason in safety.failing(brain):
        brain.craft.say(Severity.CRITICAL, f"PreArm: {reason}")
    return ACCEPTED


_HANDLERS: Mapping[int, Callable[[ArduPilot, float, Command], Answers]] = MappingProxyType(
    {
        17: _to("LOITER"),
        20: _to("RTL"),
        21: _to("LAND"),
        22: _takeoff,
        176: _set_mode,
        178: _change_speed,
        179: _set_home,
        185: _terminate,
        192: _reposition,
        224: _set_mission_item,
        246: _reboot,
        300: _start_mission,
        400: _arm,
        401: _prearm,
    }
)
COMMANDS: Final = frozenset(_HANDLERS)
