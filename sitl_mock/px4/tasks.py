"""What the flown mode asks of the motors: one function a mode, in one table.

On the ground nothing but a climb leaves idling, and what counts as one is the mode's: any upward setpoint of a stream,
a goal of an automatic mode that is a third of a metre higher, a throttle stick above 65 %.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sitl_mock.dynamics import Kind, Setpoint
from sitl_mock.px4 import flying
from sitl_mock.px4.modes import AFTER, MANUAL_MODES
from sitl_mock.px4.sticks import by_stick
from sitl_mock.vehicle_state import Severity

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sitl_mock.px4.commander import Px4

IDLING: Final = Setpoint(Kind.IDLING)
STEP_S: Final = 0.02
_WISH_M: Final = 0.3
_THROTTLE_WISH: Final = 0.3


def fly(px4: Px4) -> Setpoint:
    """The flown mode's setpoint."""
    task = _TASKS.get(px4.mode)
    if task is not None:
        return task(px4)
    return _manual(px4) if px4.mode in MANUAL_MODES else Setpoint(Kind.BRAKE)


def _offboard(px4: Px4) -> Setpoint:
    if px4.rates is not None:
        px4.setpoint = px4.rates.advance(STEP_S)
    return px4.setpoint if not px4.state.on_ground or px4.wants_to_climb() else IDLING


def _manual(px4: Px4) -> Setpoint:
    state = px4.state
    if state.on_ground and state.pilot.sticks.throttle <= _THROTTLE_WISH:
        return IDLING
    return by_stick(state, px4.plan, STEP_S, slow=px4.mode == "POSITION_SLOW")


def _takeoff(px4: Px4) -> Setpoint:
    if flying.takeoff_done(px4.state, px4.plan):
        _go_on(px4, "height reached")
    return flying.takeoff(px4.state, px4.plan)


def _mission(px4: Px4) -> Setpoint:
    state, flight = px4.state, px4.mission
    setpoint = flying.mission(state, flight, px4.plan)
    if flight.over == "return":
        px4.intention = "RTL"
    elif flight.over == "finished":
        if not state.on_ground:
            state.say(Severity.INFO, "Mission finished, loitering")
        _go_on(px4, "mission finished")
    down_again = state.on_ground and state.flew and (flight.over or flight.landing)
    return IDLING if down_again else setpoint


def _in_the_air(task: Callable[[Px4], Setpoint]) -> Callable[[Px4], Setpoint]:
    def guarded(px4: Px4) -> Setpoint:
        return IDLING if px4.state.on_ground else task(px4)

    return guarded


def _or_from_the_ground(task: Callable[[Px4], Setpoint]) -> Callable[[Px4], Setpoint]:
    """A goal that is higher takes off."""

    def guarded(px4: Px4) -> Setpoint:
        setpoint = task(px4)
        state = px4.state
        return setpoint if not state.on_ground or setpoint.position_ned_m[2] < state.position_m[2] - _WISH_M else IDLING

    return guarded


def _go_on(px4: Px4, event: str) -> None:
    """A mode has done its work: the table says what comes next, and that is the intention now."""
    after = AFTER[px4.mode, event]
    done = px4.plan
    if px4.intention == px4.mode:
        px4.intention = after
    px4.enter(after)
    if event == "height reached":
        px4.plan.goal_m = (done.entered_m[0], done.entered_m[1], done.height_m)
        px4.plan.heading_kept = True


def _orbit(px4: Px4) -> Setpoint:
    orbit = px4.plan.orbit
    return Setpoint(Kind.BRAKE, yaw_rad=px4.plan.yaw_rad) if orbit is None else orbit.fly(px4.state, STEP_S)


def _follow(px4: Px4) -> Setpoint:
    follow = px4.plan.follow
    return Setpoint(Kind.BRAKE) if follow is None else follow.fly(px4.state, STEP_S)


def _hold(px4: Px4) -> Setpoint:
    return flying.hold(px4.state, px4.plan)


def _return(px4: Px4) -> Setpoint:
    return flying.return_home(px4.state, px4.plan)


def _land(px4: Px4) -> Setpoint:
    return flying.land(px4.state, px4.plan)


def _descend(px4: Px4) -> Setpoint:
    return flying.descend(px4.state, px4.plan)


_TASKS: Final[Mapping[str, Callable[[Px4], Setpoint]]] = MappingProxyType(
    {
        "OFFBOARD": _offboard,
        "TAKEOFF": _takeoff,
        "MISSION": _mission,
        "HOLD": _or_from_the_ground(_hold),
        "FOLLOW": _or_from_the_ground(_follow),
        "ORBIT": _in_the_air(_orbit),
        "RTL": _in_the_air(_return),
        "LAND": _in_the_air(_land),
        "PRECLAND": _in_the_air(_land),
        "DESCEND": _in_the_air(_descend),
    }
)
