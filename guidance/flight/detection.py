"""Event detection, once per cycle and without memory.

It checks, most severe first: the vehicle and who commands it, its position, operator and battery, missing inputs, the
game, and the progress of the phase.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from guidance.autopilots import Mode
from guidance.certificate import Certificate
from guidance.control import Envelope, FenceGeometry
from guidance.flight.readiness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S, checks, telemetry_gap
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import HANDING_OVER, OUR_MODES, SETPOINT_STATES, TRANSITIONS, Event, State
from guidance.frames import Vector
from guidance.messages import Heartbeat, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

LATE_LOOP_S = 0.25
_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7

BREACH_M = 0.5
"""Distance beyond floor, ceiling or stand-off that counts as a breach. A hover wanders by less."""

LEFT_WITHIN_S = 5.0
"""Time after an order in which HEARTBEAT may still show the pilot's old mode. It is up to 2 s late."""


class EventContext(NamedTuple):
    """Everything that event detection uses in one cycle."""

    now_s: float
    dt_s: float
    state: State
    since_s: float
    settings: FlightSettings
    vehicle: VehicleState
    mode: Mode | None
    resets_seen: int
    reboots_seen: int
    evader_silence_s: float
    envelope: Envelope
    position_ned_m: Vector | None
    fence: FenceGeometry | None
    evader_ned_m: Vector | None
    start_ned_m: Vector | None
    home_ned_m: Vector | None
    certificate: Certificate | None
    refusals: Sequence[str]
    foreign: bool
    other_mode_seen: bool
    mode_left: Mode | None
    chase_s: float
    rival: str
    battery_needed: float
    operator_silence_s: float
    battery_was_low: bool = False

    @property
    def heard_since_entry(self) -> bool:
        """Whether a HEARTBEAT arrived after the state was entered."""
        heartbeat = self.vehicle.last(Heartbeat)
        return heartbeat is not None and heartbeat.received_s > self.since_s


def events(context: EventContext) -> Iterator[Event]:
    """Yield the events of this cycle, the most severe first; only those that are in the table for this state."""
    return (event for read in _READINGS for event in read(context) if (context.state, event) in TRANSITIONS)


def detail_of(event: Event, context: EventContext) -> str:
    """Return the measurement behind an event; empty if the name is enough."""
    match event:
        case Event.TELEMETRY_LOST:
            return telemetry_gap(context.vehicle, context.now_s)
        case Event.LOOP_STOPPED:
            return f"guidance stood still for {context.dt_s:.1f} s, and the autopilot stopped waiting for setpoints"
        case Event.PILOT if context.mode is not None:
            title = context.settings.autopilot.mode_title(context.mode)
            return f"the vehicle is in {title}: a pilot or the autopilot chose that mode"
        case Event.REBOOTED:
            return "the autopilot rebooted"
        case Event.DISARMED if context.state in SETPOINT_STATES:
            return "the vehicle disarmed while guidance flew it"
    return ""


def fit(context: EventContext) -> bool:
    """Whether every readiness check passes and preflight refuses nothing."""
    settings = context.settings
    rows = checks(context.vehicle, settings.autopilot, context.now_s, battery_minimum=context.battery_needed)
    return not context.refusals and all(row.passed for row in rows)


def _vehicle(context: EventContext) -> Iterator[Event]:
    """Check who commands the vehicle, and whether it is in contact."""
    vehicle = context.vehicle
    if _external_mode_change(context):
        yield Event.PILOT
    if vehicle.reboots != context.reboots_seen:
        yield Event.REBOOTED
    if _telemetry_lost(context):
        yield Event.TELEMETRY_LOST
    if not vehicle.armed and context.heard_since_entry:
        yield Event.DISARMED
    if context.dt_s >= context.settings.autopilot.setpoint_timeout_s:
        yield Event.LOOP_STOPPED
    if context.foreign:
        yield Event.FOREIGN


def _external_mode_change(context: EventContext) -> bool:
    ours = OUR_MODES.get(context.state)
    if ours is None or context.mode is None or context.mode in ours:
        return False
    if context.mode is context.mode_left:
        # HEARTBEAT may be older than the order. A pilot's mode that stays is intended.
        return context.mode is Mode.OTHER and context.now_s - context.since_s > LEFT_WITHIN_S
    return not _waits_for_pilot(context)  # while waiting for the pilot's switch, any mode is allowed


def _waits_for_pilot(context: EventContext) -> bool:
    waiting = {State.STANDING_BY, State.OUT_OF_CONTACT}
    return context.state in waiting and context.settings.engage_on is EngageOn.PILOT_MODE


def _may_be_invited(context: EventContext) -> bool:
    return _waits_for_pilot(context) and not context.refusals


def _telemetry_lost(context: EventContext) -> bool:
    vehicle = context.vehicle
    if context.state in HANDING_OVER and context.now_s - context.since_s < TELEMETRY_LIMIT_S:
        return False  # ordered without contact: send the request first
    if vehicle.age_s(Heartbeat, context.now_s) > HEARTBEAT_LIMIT_S:
        return True
    # Before the checks pass, the streams have just been requested.
    flying = context.state not in {State.CHECKING, State.READY}
    age_s = vehicle.age_s(LocalPosition, context.now_s)
    if context.state in HANDING_OVER and math.isinf(age_s):
        return False  # found armed and handed over: only its modes matter
    return flying and age_s > TELEMETRY_LIMIT_S


def _place(context: EventContext) -> Iterator[Event]:
    """Check fence, floor, ceiling and stand-off."""
    here, envelope = context.position_ned_m, context.envelope
    if context.fence is not None and context.fence.outside:
        yield Event.FENCE
    if here is None:
        return
    height_m = envelope.home_ned_m[2] - here[2]
    if height_m < envelope.floor_m - BREACH_M:
        yield Event.FLOOR
    if height_m > envelope.ceiling_m + BREACH_M:
        yield Event.CEILING
    limit, evader = envelope.stand_off, context.evader_ned_m
    if limit is None or evader is None:
        return
    beside_m, above_m = math.dist(here[:2], evader[:2]), evader[2] - here[2]
    if beside_m < limit.radius_m - BREACH_M and above_m < limit.height_m - BREACH_M:
        yield Event.STAND_OFF


def _trust(context: EventContext) -> Iterator[Event]:
    """Check rival sources, the operator and the battery."""
    settings, silence_s = context.settings, context.operator_silence_s
    if context.rival and settings.hold_on_rival:
        yield Event.RIVAL
    timeout_s = math.inf if settings.operator_timeout_s is None else settings.operator_timeout_s
    if silence_s > timeout_s:
        yield Event.OPERATOR_LOST
    if silence_s > timeout_s + settings.operator_return_s:
        yield Event.OPERATOR_GONE
    status = context.vehicle.last(SystemStatus)
    if not context.battery_was_low and battery_low(status, context.battery_needed):
        yield Event.BATTERY_LOW


def battery_low(status: SystemStatus | None, needed: float) -> bool:
    """Whether the charge is below the needed share; an unknown charge is not low."""
    return status is not None and status.battery_remaining < needed


def _missing(context: EventContext) -> Iterator[Event]:
    """Check the inputs of the game."""
    if context.vehicle.resets != context.resets_seen:
        yield Event.ESTIMATOR_RESET
    if context.dt_s > LATE_LOOP_S:
        yield Event.LOOP_LATE
    if context.evader_silence_s > context.settings.cycle.evader_timeout_s:
        yield Event.EVADER_LOST


def _game(context: EventContext) -> Iterator[Event]:
    """Check the last certificate, and whether the pilot engages."""
    certificate = context.certificate
    if certificate is not None:
        if certificate.no_game:
            yield Event.NO_GAME
        if certificate.evader_arrived:
            yield Event.ESCAPED
        if certificate.captured:
            yield Event.CAPTURED
    # Only a change of mode counts.
    if context.other_mode_seen and context.mode is Mode.GUIDED and _may_be_invited(context):
        yield Event.INVITED
    if context.state is State.ON_STATION and context.settings.after_capture is AfterCapture.RETURN:
        yield Event.DONE
    if certificate is not None and certificate.strayed:
        yield Event.STRAYED


def _phase(context: EventContext) -> Iterator[Event]:
    """Check whether the state has reached its end or its time limit."""
    ended = _PHASE_ENDS.get(context.state)
    if ended is not None and ended[1](context):
        yield ended[0]
    if context.now_s - context.since_s > context.settings.limits_s.get(context.state, math.inf):
        yield Event.TIMED_OUT
    longest_s = context.settings.longest_chase_s
    if longest_s is not None and context.chase_s > longest_s:
        yield Event.CHASE_TIMED_OUT


def _armed(context: EventContext) -> bool:
    # One HEARTBEAT must show both, so that the climb is not taken for a pilot's mode change.
    return context.vehicle.armed and context.mode in OUR_MODES[State.CLIMBING]


def _at_height(context: EventContext) -> bool:
    local, home_ned_m = context.vehicle.last(LocalPosition), context.home_ned_m
    if local is None or home_ned_m is None:
        return False
    height_m = home_ned_m[2] - local.position_ned_m[2]
    return height_m > context.settings.takeoff_height_m - _AT_HEIGHT_M and context.mode is not Mode.TAKEOFF


def _at_start(context: EventContext) -> bool:
    if context.start_ned_m is None:
        return True
    local = context.vehicle.last(LocalPosition)
    return (
        local is not None
        and math.dist(local.position_ned_m, context.start_ned_m) < _AT_START_M
        and math.hypot(*local.velocity_ned_m_s) < _AT_START_M_S
    )


def _clear(context: EventContext) -> bool:
    settings = context.settings
    waited = context.now_s - context.since_s >= settings.settle_s
    settled = context.now_s - context.vehicle.reset_s >= settings.settle_s
    heard = context.evader_silence_s <= settings.cycle.evader_timeout_s
    return waited and settled and heard and not _telemetry_lost(context)


def _in_contact(context: EventContext) -> bool:
    waited = context.now_s - context.since_s >= context.settings.settle_s
    return waited and not _telemetry_lost(context) and fit(context)


_READINGS: Final = (_vehicle, _place, _trust, _missing, _game, _phase)

_PHASE_ENDS: Final[Mapping[State, tuple[Event, Callable[[EventContext], bool]]]] = {
    State.CONNECTING: (
        Event.HEARD,
        lambda context: context.vehicle.age_s(Heartbeat, context.now_s) <= HEARTBEAT_LIMIT_S,
    ),
    State.CHECKING: (Event.FIT, fit),
    State.READY: (Event.UNFIT, lambda context: not fit(context)),
    State.ARMING: (Event.ARMED, _armed),
    State.CLIMBING: (Event.AT_HEIGHT, _at_height),
    State.POSITIONING: (Event.AT_START, _at_start),
    State.ENTERING: (Event.GUIDED, lambda context: context.heard_since_entry and context.mode is Mode.GUIDED),
    State.PAUSED: (Event.CLEAR, _clear),
    State.OUT_OF_CONTACT: (Event.CONTACT, _in_contact),
}
"""The event that ends each phase, and its condition."""
