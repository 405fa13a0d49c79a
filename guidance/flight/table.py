"""All states, all events, and the transition table of a flight.

A pair that is not in the table changes nothing: the event is recorded and the state stays. Therefore a forbidden
transition is visible as a missing line. No line leads from YIELDED to a commanding state. Only an order
(`Event.ENGAGE`), or the pilot's mode switch if configured (`Event.INVITED`), begins the game. An order to end a flight
is obeyed in every state from the start order on (`_BEGUN`). `ASKED_MODES` has the modes that these states request.
"""

from collections.abc import Iterable, Mapping
from enum import StrEnum

from guidance.autopilots import Mode


class State(StrEnum):
    """State of the flight."""

    CONNECTING = "connecting"  # no message yet
    CHECKING = "checking"  # in contact, not yet fit to fly
    READY = "ready"  # fit to fly, waiting for an order
    ARMING = "arming"
    CLIMBING = "climbing"  # the autopilot's own take-off
    POSITIONING = "positioning"  # the autopilot flies to the start
    STANDING_BY = "standing by"  # hovering in the autopilot's hold, silent
    OUT_OF_CONTACT = "out of contact"  # telemetry was lost while standing by; silent
    ENTERING = "entering"  # streaming a hover, waiting for HEARTBEAT to show the guided mode
    ENGAGED = "engaged"  # the game is played
    PAUSED = "paused"  # hovering in the guided mode until all inputs are back
    ON_STATION = "on station"  # the stand-off disc is reached
    HOLDING = "holding"  # handed to the autopilot's hold
    RETURNING = "returning"
    LANDING = "landing"
    LANDED = "landed"  # on the ground, disarmed: the end
    YIELDED = "yielded"  # a pilot, another program or the autopilot has the vehicle, or contact is lost: silent
    FAILED = "failed"  # could not be flown: silent for good


class Event(StrEnum):
    """Events: orders first, then events detected from telemetry."""

    START = "start"
    ENGAGE = "engage"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"

    HEARD = "vehicle heard"
    FIT = "checks passed"
    UNFIT = "checks failed"
    ARMED = "armed"
    ALOFT = "airborne at a start order"
    HOLD_ARMED = "hold ordered for a vehicle found armed"
    RETURN_ARMED = "return ordered for a vehicle found armed"
    LAND_ARMED = "landing ordered for a vehicle found armed"
    AT_HEIGHT = "take-off height reached"
    AT_START = "start position reached"
    GUIDED = "guided mode confirmed"
    INVITED = "pilot chose the guided mode"
    CAPTURED = "stand-off reached"
    DONE = "stand-off reached, return configured"
    STRAYED = "stand-off left"
    ESCAPED = "evader reached its target"
    PILOT = "external mode change"
    FOREIGN = "setpoints of another source"
    EVADER_LOST = "evader lost"
    MATE_SILENT = "mate nearby is silent"
    ASSIGNED = "another evader assigned"
    AIRCRAFT = "another aircraft nearby"
    HOME_MOVED = "home reported elsewhere"
    RIVAL = "second source of the evader's reports"
    SECOND_SENDER = "second source of the vehicle's telemetry"
    ESTIMATOR_RESET = "estimator reset"
    LOOP_STOPPED = "loop stopped for longer than the autopilot waits for setpoints"
    LOOP_LATE = "loop late"
    CLEAR = "all inputs back"
    TELEMETRY_LOST = "vehicle telemetry lost"
    LATE = "vehicle telemetry late"
    CONTACT = "telemetry and checks are good again"
    BATTERY_LOW = "battery low"
    BATTERY_UNKNOWN = "battery no longer known"
    FENCE = "outside the fence"
    FLOOR = "below the floor"
    CEILING = "above the ceiling"
    STAND_OFF = "inside the stand-off"
    NO_GAME = "evader too fast for this vehicle"
    POLICY_FAILED = "the user's policy has no answer"
    REBOOTED = "autopilot rebooted"
    DISARMED = "disarmed"
    TIMED_OUT = "phase took too long"
    CHASE_TIMED_OUT = "chase took too long"
    OPERATOR_LOST = "operator not heard"
    OPERATOR_GONE = "operator still not heard"
    FAULT = "guidance failed"


ORDERS = frozenset({Event.START, Event.ENGAGE, Event.HOLD, Event.RETURN, Event.LAND, Event.ABORT})

_FOUND = (State.CHECKING, State.READY)
_AIRBORNE = (State.CLIMBING, State.POSITIONING, State.STANDING_BY)
_COMMANDING = (State.ENTERING, State.ENGAGED, State.PAUSED, State.ON_STATION)
_LEAVING = (State.HOLDING, State.RETURNING, State.LANDING)
_BEGUN = {State.ARMING, *_AIRBORNE, State.OUT_OF_CONTACT, *_COMMANDING, *_LEAVING}

_ROWS: tuple[tuple[Iterable[State], Iterable[Event], State], ...] = (
    # Before flight.
    ((State.CONNECTING,), (Event.HEARD,), State.CHECKING),
    ((State.CHECKING,), (Event.FIT,), State.READY),
    ((State.READY,), (Event.UNFIT,), State.CHECKING),
    ((State.READY,), (Event.START,), State.ARMING),
    ((State.READY,), (Event.ALOFT,), State.STANDING_BY),
    ((State.ARMING,), (Event.ARMED,), State.CLIMBING),
    ((State.CHECKING, State.READY), (Event.TELEMETRY_LOST,), State.CONNECTING),
    ((State.CONNECTING, State.CHECKING, State.ARMING), (Event.TIMED_OUT,), State.FAILED),
    ((State.CONNECTING, State.CHECKING, State.READY), (Event.FAULT,), State.FAILED),
    # To the start.
    ((State.CLIMBING,), (Event.AT_HEIGHT,), State.POSITIONING),
    ((State.POSITIONING,), (Event.AT_START,), State.STANDING_BY),
    ((State.CLIMBING, State.POSITIONING), (Event.TIMED_OUT,), State.LANDING),
    # The game.
    ((State.STANDING_BY, State.HOLDING), (Event.ENGAGE,), State.ENTERING),
    ((State.STANDING_BY,), (Event.INVITED,), State.ENGAGED),
    ((State.ENTERING,), (Event.GUIDED,), State.ENGAGED),
    ((State.ENGAGED,), (Event.CAPTURED,), State.ON_STATION),
    ((State.ON_STATION,), (Event.STRAYED,), State.ENGAGED),
    ((State.ON_STATION,), (Event.DONE,), State.RETURNING),
    ((State.ENGAGED, State.ON_STATION), (Event.EVADER_LOST, Event.ESTIMATOR_RESET), State.PAUSED),
    ((State.ENGAGED, State.ON_STATION), (Event.LOOP_LATE, Event.MATE_SILENT), State.PAUSED),
    ((State.ON_STATION,), (Event.ASSIGNED,), State.ENGAGED),
    ((State.PAUSED,), (Event.CLEAR,), State.ENGAGED),
    ((State.ENTERING, State.PAUSED), (Event.TIMED_OUT,), State.HOLDING),
    ((State.ENGAGED, State.PAUSED), (Event.CHASE_TIMED_OUT,), State.HOLDING),
    ((State.ENGAGED, State.ON_STATION), (Event.NO_GAME, Event.POLICY_FAILED), State.HOLDING),
    ((State.ENGAGED,), (Event.ESCAPED,), State.HOLDING),
    # The end.
    ((*_AIRBORNE, State.OUT_OF_CONTACT, *_LEAVING), (Event.DISARMED,), State.LANDED),
    (_COMMANDING, (Event.DISARMED,), State.YIELDED),
    # From the start order on, and from each of these three to the other two: a person may be standing below.
    (_BEGUN - {State.HOLDING}, (Event.HOLD,), State.HOLDING),
    (_BEGUN - {State.RETURNING}, (Event.RETURN,), State.RETURNING),
    (_BEGUN - {State.LANDING}, (Event.LAND, Event.ABORT), State.LANDING),
    ((State.CONNECTING, *_FOUND), (Event.ABORT,), State.FAILED),
    # A vehicle that was found armed (guidance was started, or started again, in mid-air) is handed over like our own.
    (_FOUND, (Event.HOLD_ARMED,), State.HOLDING),
    (_FOUND, (Event.RETURN_ARMED,), State.RETURNING),
    (_FOUND, (Event.LAND_ARMED,), State.LANDING),
    # Interruptions.
    (_COMMANDING, (Event.FENCE, Event.FLOOR, Event.CEILING, Event.STAND_OFF), State.HOLDING),
    (_COMMANDING, (Event.LATE, Event.SECOND_SENDER), State.HOLDING),
    (_COMMANDING, (Event.FOREIGN, Event.RIVAL, Event.OPERATOR_LOST), State.HOLDING),
    (
        (*_COMMANDING, State.STANDING_BY, State.POSITIONING, State.HOLDING),
        (Event.BATTERY_LOW, Event.BATTERY_UNKNOWN),
        State.RETURNING,
    ),
    # In the climb the vehicle is above its takeoff place, and a return would continue the climb.
    ((State.CLIMBING,), (Event.BATTERY_LOW, Event.BATTERY_UNKNOWN), State.LANDING),
    ((State.STANDING_BY, State.HOLDING), (Event.OPERATOR_GONE,), State.RETURNING),
    # The autopilot has acted by then, and PX4 would return to OFFBOARD by itself with the first setpoint.
    (_COMMANDING, (Event.LOOP_STOPPED,), State.YIELDED),
    (_BEGUN, (Event.PILOT, Event.REBOOTED, Event.FAULT), State.YIELDED),
    (
        _BEGUN - {State.STANDING_BY, State.OUT_OF_CONTACT},
        (Event.TELEMETRY_LOST,),
        State.YIELDED,
    ),
    # Guidance commanded nothing, so the flight may continue, but only an order begins the game.
    ((State.STANDING_BY,), (Event.TELEMETRY_LOST,), State.OUT_OF_CONTACT),
    ((State.OUT_OF_CONTACT,), (Event.CONTACT,), State.STANDING_BY),
)
"""From any of these states, any of these events leads to that state."""

TRANSITIONS: Mapping[tuple[State, Event], State] = {
    (state, event): after for states, events, after in _ROWS for state in states for event in events
}

FINAL = frozenset({State.LANDED, State.YIELDED, State.FAILED})

BEFORE_FLIGHT = frozenset({State.CONNECTING, *_FOUND})
"""States before the start order. A vehicle that is armed here was armed by someone else."""

ACCEPTED = frozenset({State.ARMING, State.STANDING_BY, State.ENTERING})
"""States to which an accepted order to start or to engage leads. Home, fence and heights are fixed there."""

SETPOINT_STATES = frozenset(_COMMANDING)
"""The only states with setpoints; all others are silent."""

HANDING_OVER = frozenset(_LEAVING)
"""States that leave the guided mode. A hover is sent until HEARTBEAT shows another mode."""

ASKED_MODES: Mapping[State, Mode] = {
    State.CLIMBING: Mode.TAKEOFF,
    **dict.fromkeys(_COMMANDING, Mode.GUIDED),
    State.HOLDING: Mode.HOLD,
    State.RETURNING: Mode.RETURN,
    State.LANDING: Mode.LAND,
}
"""The mode that each state requests; ARMING requests the autopilot's `arming_mode`.

HEARTBEAT may also show the mode at the beginning of the state, until it shows another one. Any other mode is an
external mode change, and final.
"""


def next_state(state: State, event: Event) -> State:
    """Look up the transition; without one the state stays."""
    return TRANSITIONS.get((state, event), state)


def state_words(state: State, *, airborne: bool) -> str:
    """Return a state for people. A vehicle that was found in the air is not "ready" but not taken over yet."""
    return "not taken over" if state is State.READY and airborne else str(state)


def is_done(order: Event, state: State) -> bool:
    """True if the order leads to this state, so that repeating it is harmless."""
    return any(event is order and after is state for (_, event), after in TRANSITIONS.items())
