"""Event detection: one predicate an event, evaluated once a cycle on what was heard, without memory of its own."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from guidance.autopilots import Mode
from guidance.certificate import Certificate
from guidance.control import Envelope, FenceGeometry
from guidance.flight.readiness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S, checks
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import HANDING_OVER, OUR_MODES, TRANSITIONS, Event, State
from guidance.frames import Vector
from guidance.messages import Heartbeat, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

LATE_LOOP_S = 0.25
_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7

BREACH_M = 0.5
"""How far beyond floor, ceiling or stand-off a vehicle is when the limit counts as broken: hovering wanders by less."""

LEFT_WITHIN_S = 5.0
"""How long after an order a pilot's mode may still be shown before it counts as kept: HEARTBEAT is up to 2 s late."""


@dataclass(frozen=True, slots=True)
class EventContext:
    """Everything an event may be read from, at one cycle."""

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
    mode_left: Mode | None = None
    chase_s: float = 0.0
    rival: str = ""
    battery_needed: float | None = None
    operator_silence_s: float = 0.0

    @property
    def battery_limit(self) -> float:
        """The share of the charge below which it returns, the settings' where none was reckoned."""
        return self.settings.battery_minimum if self.battery_needed is None else self.battery_needed

    @property
    def heard_since_entry(self) -> bool:
        """True once a HEARTBEAT arrived after the state was entered."""
        heartbeat = self.vehicle.last(Heartbeat)
        return heartbeat is not None and heartbeat.received_s > self.since_s


def events(context: EventContext) -> Iterator[Event]:
    """Yield what happened, the most severe first; only events that the table answers in this state are tested."""
    return (
        event for event, happened in _DETECTORS.items() if (context.state, event) in TRANSITIONS and happened(context)
    )


def fit(context: EventContext) -> bool:
    """True when every readiness check passes and preflight refuses nothing."""
    settings = context.settings
    rows = checks(context.vehicle, settings.autopilot, context.now_s, battery_minimum=context.battery_limit)
    return not context.refusals and all(row.passed for row in rows)


def _telemetry_lost(context: EventContext) -> bool:
    vehicle = context.vehicle
    if vehicle.age_s(Heartbeat, context.now_s) > HEARTBEAT_LIMIT_S:
        return True
    # Before the checks pass, the streams have only just been asked for.
    flying = context.state not in {State.CHECKING, State.READY}
    age_s = vehicle.age_s(LocalPosition, context.now_s)
    if context.state in HANDING_OVER and math.isinf(age_s):
        return False  # found armed and handed over at once: its modes are heard, and no setpoint rests on its position
    return flying and age_s > TELEMETRY_LIMIT_S


def _external_mode_change(context: EventContext) -> bool:
    ours = OUR_MODES.get(context.state)
    if _waiting_for_the_pilot(context):
        return False  # who flies here, in whichever mode, is to choose the guided one
    if context.mode is not None and context.mode is context.mode_left:
        # The order is younger than what HEARTBEAT shows. But a pilot's mode that stays is the pilot's answer.
        return context.mode is Mode.OTHER and context.now_s - context.since_s > LEFT_WITHIN_S
    return ours is not None and context.mode is not None and context.mode not in ours


def _waiting_for_the_pilot(context: EventContext) -> bool:
    return context.state is State.STANDING_BY and context.settings.engage_on is EngageOn.PILOT_MODE


def _invited(context: EventContext) -> bool:
    # A change, not a mode that the vehicle was left in.
    return _waiting_for_the_pilot(context) and context.other_mode_seen and context.mode is Mode.GUIDED


def _armed(context: EventContext) -> bool:
    # Both in one HEARTBEAT: armed, and in a mode of ours, so that the climb is not mistaken for a pilot's.
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


def _operator_gone(context: EventContext) -> bool:
    settings = context.settings
    return context.operator_silence_s > settings.operator_timeout_s + settings.operator_return_s


def _battery_low(context: EventContext) -> bool:
    status = context.vehicle.last(SystemStatus)
    return status is not None and status.battery_remaining < context.battery_limit


def _evader_lost(context: EventContext) -> bool:
    return context.evader_silence_s > context.settings.cycle.evader_timeout_s


def _clear(context: EventContext) -> bool:
    waited = context.now_s - context.since_s >= context.settings.settle_s
    settled = context.now_s - context.vehicle.reset_s >= context.settings.settle_s
    return waited and settled and not (_evader_lost(context) or _telemetry_lost(context))


def _reset(context: EventContext) -> bool:
    return context.vehicle.resets != context.resets_seen


def _timed_out(context: EventContext) -> bool:
    return context.now_s - context.since_s > context.settings.limits_s.get(context.state, math.inf)


def _height_m(context: EventContext) -> float:
    """Height above home, NaN where the vehicle has not told where it is."""
    return math.nan if context.position_ned_m is None else context.envelope.home_ned_m[2] - context.position_ned_m[2]


def _inside_stand_off(context: EventContext) -> bool:
    limit, here, evader = context.envelope.stand_off, context.position_ned_m, context.evader_ned_m
    if limit is None or here is None or evader is None:
        return False
    beside_m, above_m = math.dist(here[:2], evader[:2]), evader[2] - here[2]
    return beside_m < limit.radius_m - BREACH_M and above_m < limit.height_m - BREACH_M


def _certified(context: EventContext, name: str) -> bool:
    return context.certificate is not None and bool(getattr(context.certificate, name))


_DETECTORS: Mapping[Event, Callable[[EventContext], bool]] = {
    Event.PILOT: _external_mode_change,
    Event.REBOOTED: lambda context: context.vehicle.reboots != context.reboots_seen,
    Event.TELEMETRY_LOST: _telemetry_lost,
    Event.DISARMED: lambda context: context.heard_since_entry and not context.vehicle.armed,
    Event.LOOP_STOPPED: lambda context: context.dt_s >= context.settings.autopilot.setpoint_timeout_s,
    Event.FOREIGN: lambda context: context.foreign,
    Event.FENCE: lambda context: context.fence is not None and context.fence.outside,
    Event.FLOOR: lambda context: _height_m(context) < context.envelope.floor_m - BREACH_M,
    Event.CEILING: lambda context: _height_m(context) > context.envelope.ceiling_m + BREACH_M,
    Event.STAND_OFF: _inside_stand_off,
    Event.RIVAL: lambda context: context.settings.hold_on_rival and bool(context.rival),
    Event.OPERATOR_LOST: lambda context: context.operator_silence_s > context.settings.operator_timeout_s,
    Event.OPERATOR_GONE: _operator_gone,
    Event.BATTERY_LOW: _battery_low,
    Event.ESTIMATOR_RESET: _reset,
    Event.LOOP_LATE: lambda context: context.dt_s > LATE_LOOP_S,
    Event.EVADER_LOST: _evader_lost,
    Event.NO_GAME: lambda context: _certified(context, "no_game"),
    Event.ESCAPED: lambda context: _certified(context, "evader_arrived"),
    Event.CAPTURED: lambda context: _certified(context, "captured"),
    Event.INVITED: _invited,
    Event.DONE: lambda context: context.settings.after_capture is AfterCapture.RETURN,
    Event.STRAYED: lambda context: _certified(context, "strayed"),
    Event.HEARD: lambda context: context.vehicle.age_s(Heartbeat, context.now_s) <= HEARTBEAT_LIMIT_S,
    Event.FIT: fit,
    Event.UNFIT: lambda context: not fit(context),
    Event.ARMED: _armed,
    Event.AT_HEIGHT: _at_height,
    Event.AT_START: _at_start,
    Event.GUIDED: lambda context: context.heard_since_entry and context.mode is Mode.GUIDED,
    Event.CLEAR: _clear,
    Event.TIMED_OUT: _timed_out,
    Event.CHASE_TIMED_OUT: lambda context: context.chase_s > context.settings.longest_chase_s,
}
