"""How PX4 answers commands, as measured on v1.17: one function a command, one table of MAV_CMD numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.craft import Severity
from sitl_mock.missions import flyable
from sitl_mock.protocols import Command, CommandAnswer, Place, Result, on_earth
from sitl_mock.px4 import checks
from sitl_mock.px4.modes import BY_NAME, BY_NUMBER

if TYPE_CHECKING:
    from sitl_mock.px4.brain import Px4

Answers = Sequence[CommandAnswer]

FORCE_MAGIC: Final = 21196
SECOND_ACK_S: Final = 0.02
"""The commander answers in its own cycle, after the receiver has."""

ACCEPTED: Final = (CommandAnswer(Result.ACCEPTED),)
REFUSED: Final = (CommandAnswer(Result.TEMPORARILY_REJECTED),)
DENIED: Final = (CommandAnswer(Result.DENIED),)
UNSUPPORTED: Final = (CommandAnswer(Result.UNSUPPORTED),)


def execute(px4: Px4, now_s: float, command: Command) -> Answers:
    """Obey or refuse a command."""
    handler = _HANDLERS.get(command.number)
    return UNSUPPORTED if handler is None else handler(px4, now_s, command)


def _granted(granted: bool) -> Answers:
    return ACCEPTED if granted else REFUSED


def _set_mode(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_SET_MODE: two answers, the first of which means nothing."""
    base, main, sub = command.params[:3]
    real = CommandAnswer(Result.DENIED, delay_s=SECOND_ACK_S)
    if math.isfinite(base + main) and int(base) & 1:
        number = int(main) << 16 | (int(sub) if math.isfinite(sub) else 0) << 24
        mode = BY_NUMBER.get(number)
        if mode is not None and mode.name != "TERMINATION":
            granted = px4.request(now_s, mode.name)
            real = real._replace(result=Result.ACCEPTED if granted else Result.TEMPORARILY_REJECTED)
    return (CommandAnswer(Result.ACCEPTED), real)


def _arm(px4: Px4, _now_s: float, command: Command) -> Answers:
    """COMPONENT_ARM_DISARM; param2 21196 forces, which disarms in the air as well."""
    want, force = command.params[:2]
    if want not in {0.0, 1.0}:
        return (CommandAnswer(Result.UNSUPPORTED),)
    if want == 1.0:
        return _arm_now(px4)
    craft = px4.craft
    if not craft.armed:
        return ACCEPTED
    if not craft.on_ground and force != FORCE_MAGIC:
        craft.say(Severity.CRITICAL, "Disarming denied! Not landed")
        return REFUSED
    px4.disarm()
    return ACCEPTED


def _arm_now(px4: Px4) -> Answers:
    craft = px4.craft
    if craft.armed:
        return ACCEPTED
    px4.there = checks.available(craft, px4.plans, px4.stream_s)
    reasons = checks.refusals(craft, BY_NAME[px4.intention], px4.there)
    if reasons:
        craft.say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
        for reason in reasons:
            craft.say(Severity.CRITICAL, reason)
        return REFUSED
    craft.arm()
    px4.home.arm(craft, in_mission=px4.mode == "MISSION")
    craft.pilot.settle()
    craft.say(Severity.INFO, "Armed by external command")
    return ACCEPTED


def _takeoff(px4: Px4, now_s: float, command: Command) -> Answers:
    altitude_m = command.params[6]
    if not (math.isnan(altitude_m) or on_earth(Place(0.0, 0.0, altitude_m))):
        return DENIED
    return _granted(px4.begin_takeoff(now_s, altitude_m))


def _to(mode: str) -> Callable[[Px4, float, Command], Answers]:
    def handler(px4: Px4, now_s: float, _command: Command) -> Answers:
        return _granted(px4.request(now_s, mode))

    return handler


def _start_mission(px4: Px4, now_s: float, command: Command) -> Answers:
    if not flyable(px4.plans.mission.items):
        return DENIED
    first = command.params[0]
    if math.isfinite(first) and first > 0.0:
        px4.mission.set_current(int(first))
    return _granted(px4.request(now_s, "MISSION"))


def _set_mission_item(px4: Px4, _now_s: float, command: Command) -> Answers:
    seq = command.params[0]
    return ACCEPTED if math.isfinite(seq) and px4.mission.set_current(int(seq)) else DENIED


def _reposition(px4: Px4, now_s: float, command: Command) -> Answers:
    """DO_REPOSITION: param2 bit 0 changes to Hold; NaN keeps what is."""
    speed, flags, _, yaw, lat, lon, alt = command.params
    given = Place(*(default if math.isnan(value) else value for value, default in ((lat, 0.0), (lon, 0.0), (alt, 0.0))))
    if not on_earth(given):
        return DENIED
    if math.isfinite(flags) and int(flags) & 1 and px4.mode != "HOLD" and not px4.request(now_s, "HOLD"):
        return REFUSED
    if px4.mode != "HOLD":
        return DENIED
    craft, plan = px4.craft, px4.plan
    north, east, down = craft.position_m
    if math.isfinite(lat + lon):
        north, east, _ = craft.frame.to_local(lat, lon, 0.0)
    if math.isfinite(alt):
        home = craft.home_m or (0.0, 0.0, 0.0)
        relative = command.frame in {3, 6}
        down = home[2] - alt if relative else craft.frame.origin.alt_amsl_m - alt
    plan.goal_m = (north, east, down)
    plan.speed_m_s = speed if math.isfinite(speed) else math.nan
    if math.isfinite(yaw):
        plan.yaw_rad = yaw if abs(yaw) <= 2.0 * math.pi else math.radians(yaw)
    return ACCEPTED


def _change_speed(px4: Px4, _now_s: float, command: Command) -> Answers:
    if command.params[1] > 0.0:
        px4.plan.speed_m_s = px4.mission.speed_m_s = command.params[1]
    return ACCEPTED


def _set_home(px4: Px4, _now_s: float, command: Command) -> Answers:
    craft = px4.craft
    use_current, *_, lat, lon, alt = command.params
    if use_current == 1.0:
        craft.set_home(craft.position_m)
    elif on_earth(Place(lat, lon, alt)):
        craft.set_home(craft.frame.to_local(lat, lon, alt), given=True)
    else:
        return DENIED
    return ACCEPTED


def _terminate(px4: Px4, _now_s: float, command: Command) -> Answers:
    if command.params[0] > 0.5:
        px4.mode = px4.intention = "TERMINATION"
        px4.craft.say(Severity.EMERGENCY, "Flight termination")
    return ACCEPTED


def _reboot(px4: Px4, _now_s: float, command: Command) -> Answers:
    if px4.craft.armed:
        return REFUSED
    if command.params[0] in {1.0, 3.0}:
        px4.craft.conditions.put("reboot", value=True)
    return ACCEPTED


def _calibrate(px4: Px4, _now_s: float, _command: Command) -> Answers:
    return REFUSED if px4.craft.armed else ACCEPTED


_HANDLERS: Mapping[int, Callable[[Px4, float, Command], Answers]] = MappingProxyType(
    {
        20: _to("RTL"),
        21: _to("LAND"),
        22: _takeoff,
        176: _set_mode,
        178: _change_speed,
        179: _set_home,
        185: _terminate,
        192: _reposition,
        193: lambda px4, now_s, command: _granted(
            px4.request(now_s, "MISSION" if command.params[0] == 1.0 else "HOLD")
        ),
        224: _set_mission_item,
        241: _calibrate,
        246: _reboot,
        300: _start_mission,
        400: _arm,
    }
)
COMMANDS: Final = frozenset(_HANDLERS)
