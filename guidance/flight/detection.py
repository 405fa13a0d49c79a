"""Event detection, once per cycle and without memory.

It checks, most severe first: the vehicle and who commands it, its position, operator and battery, missing inputs, the
game, and the progress of the phase.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from guidance.autopilots import Mode
from guidance.certificate import Certificate
from guidance.control import Limiter
from guidance.flight.heard import Heard
from guidance.flight.readiness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S, checks, telemetry_gap
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import HANDING_OVER, OUR_MODES, SETPOINT_STATES, TRANSITIONS, Event, State
from guidance.messages import Heartbeat, LocalPosition, SystemStatus

LATE_LOOP_S = 0.25
_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7

BREACH_M = 0.5
"""Distance beyond floor, ceiling or stand-off that counts as a breach. A hover wanders by less."""

_BREACHES: Final[Mapping[Limiter, tuple[Event, float]]] = {
    Limiter.FENCE_RADIUS: (Event.FENCE, 0.0),
    Limiter.FENCE_POLYGON: (Event.FENCE, 0.0),
    Limiter.FLOOR: (Event.FLOOR, BREACH_M),
    Limiter.CEILING: (Event.CEILING, BREACH_M),
    Limiter.STAND_OFF: (Event.STAND_OFF, BREACH_M),
}

LEFT_WITHIN_S = 5.0
"""For this long after an order, HEARTBEAT may show the pilot's old mode. It is up to 2 s late."""


@dataclass(slots=True)
class Stage:
    """The present state, and notes since it was entered.

    Attributes:
        state: State of the flight.
        since_s: When it was entered.
        resets_seen: Estimator resets counted by then.
        reboots_seen: Reboots counted by then.
        other_mode_seen: Whether HEARTBEAT has shown another mode than the guided one.
        mode_left: The mode that an order is ending, until HEARTBEAT shows another one.
        chase_began_s: When the present chase began.
        operator_s: Time of the operator's last order or sign of life.
        battery_was_low: Whether the operator ordered the hold with a low battery; it stands then.
    """

    state: State = State.CONNECTING
    since_s: float = 0.0
    resets_seen: int = 0
    reboots_seen: int = 0
    other_mode_seen: bool = False
    mode_left: Mode | None = None
    chase_began_s: float = 0.0
    operator_s: float = math.inf
    battery_was_low: bool = False

    def operator_silence_s(self, now_s: float) -> float:
        """Return the time since the operator's last sign of life; 0 before the first one."""
        return max(0.0, now_s - self.operator_s)


class Moment(NamedTuple):
    """Inputs of event detection in one cycle."""

    now_s: float
    dt_s: float
    settings: FlightSettings
    heard: Heard
    stage: Stage
    certificate: Certificate | None
    refusals: Sequence[str]
    rival: str
    battery_needed: float

    @property
    def heard_since_entry(self) -> bool:
        """True if a HEARTBEAT arrived after the state was entered."""
        heartbeat = self.heard.vehicle.last(Heartbeat)
        return heartbeat is not None and heartbeat.received_s > self.stage.since_s

    @property
    def in_state_s(self) -> float:
        """Time since the state was entered."""
        return self.now_s - self.stage.since_s


def events(now: Moment) -> Iterator[Event]:
    """Yield the events of this cycle, the most severe first; only those that are in the table for this state."""
    return (event for read in _READINGS for event in read(now) if (now.stage.state, event) in TRANSITIONS)


def detail_of(event: Event, now: Moment) -> str:
    """Return the measurement behind an event; empty if the name is enough."""
    match event:
        case Event.TELEMETRY_LOST:
            return telemetry_gap(now.heard.vehicle, now.now_s)
        case Event.LOOP_STOPPED:
            return f"guidance stood still for {now.dt_s:.1f} s, and the autopilot stopped waiting for setpoints"
        case Event.PILOT if now.heard.mode is not None:
            title = now.settings.autopilot.mode_title(now.heard.mode)
            return f"the vehicle is in {title}: a pilot or the autopilot chose that mode"
        case Event.REBOOTED:
            return "the autopilot rebooted"
        case Event.DISARMED if now.stage.state in SETPOINT_STATES:
            return "the vehicle disarmed while guidance flew it"
    return ""


def fit(now: Moment) -> bool:
    """Whether every readiness check passes and preflight refuses nothing."""
    settings = now.settings
    rows = checks(now.heard.vehicle, settings.autopilot, now.now_s, battery_minimum=now.battery_needed)
    return not now.refusals and all(row.passed for row in rows)


def _vehicle(now: Moment) -> Iterator[Event]:
    """Check who commands the vehicle, and whether it is in contact."""
    vehicle = now.heard.vehicle
    if _external_mode_change(now):
        yield Event.PILOT
    if vehicle.reboots != now.stage.reboots_seen:
        yield Event.REBOOTED
    if _telemetry_lost(now):
        yield Event.TELEMETRY_LOST
    if not vehicle.armed and now.heard_since_entry:
        yield Event.DISARMED
    if now.dt_s >= now.settings.autopilot.setpoint_timeout_s:
        yield Event.LOOP_STOPPED
    if now.heard.foreign:
        yield Event.FOREIGN


def _external_mode_change(now: Moment) -> bool:
    ours = OUR_MODES.get(now.stage.state)
    if ours is None or now.heard.mode is None or now.heard.mode in ours:
        return False
    if now.heard.mode is now.stage.mode_left:
        # HEARTBEAT may be older than the order. A pilot's mode that stays is intended.
        return now.heard.mode is Mode.OTHER and now.in_state_s > LEFT_WITHIN_S
    return not _waits_for_pilot(now)  # while waiting for the pilot's switch, any mode is allowed


def _waits_for_pilot(now: Moment) -> bool:
    waiting = {State.STANDING_BY, State.OUT_OF_CONTACT}
    return now.stage.state in waiting and now.settings.engage_on is EngageOn.PILOT_MODE


def _telemetry_lost(now: Moment) -> bool:
    vehicle = now.heard.vehicle
    if now.stage.state in HANDING_OVER and now.in_state_s < TELEMETRY_LIMIT_S:
        return False  # ordered without contact: send the request first
    if vehicle.age_s(Heartbeat, now.now_s) > HEARTBEAT_LIMIT_S:
        return True
    # Before the checks pass, the streams have just been requested.
    flying = now.stage.state not in {State.CHECKING, State.READY}
    age_s = vehicle.age_s(LocalPosition, now.now_s)
    if now.stage.state in HANDING_OVER and math.isinf(age_s):
        return False  # found armed and handed over: only its modes matter
    return flying and age_s > TELEMETRY_LIMIT_S


def _place(now: Moment) -> Iterator[Event]:
    """Check fence, floor, ceiling and stand-off."""
    view = now.heard.view(now.now_s) if now.stage.state in SETPOINT_STATES else None
    walls = () if view is None else view.walls
    for limiter, (event, allowed_m) in _BREACHES.items():
        if any(wall.limiter is limiter and wall.gap_m + wall.margin_m < -allowed_m for wall in walls):
            yield event


def _trust(now: Moment) -> Iterator[Event]:
    """Check rival sources, the operator and the battery."""
    settings, timeout_s = now.settings, now.settings.operator_timeout_s
    if settings.hold_on_rival and now.rival:
        yield Event.RIVAL
    if timeout_s is not None:
        silence_s = now.stage.operator_silence_s(now.now_s)
        if silence_s > timeout_s:
            yield Event.OPERATOR_LOST
        if silence_s > timeout_s + settings.operator_return_s:
            yield Event.OPERATOR_GONE
    status = now.heard.vehicle.last(SystemStatus)
    if not now.stage.battery_was_low and battery_low(status, now.battery_needed):
        yield Event.BATTERY_LOW


def battery_low(status: SystemStatus | None, needed: float) -> bool:
    """Return whether the charge is below the needed share; an unknown charge is not low."""
    return status is not None and status.battery_remaining < needed


def _missing(now: Moment) -> Iterator[Event]:
    """Check the inputs of the game."""
    if now.heard.vehicle.resets != now.stage.resets_seen:
        yield Event.ESTIMATOR_RESET
    if now.dt_s > LATE_LOOP_S:
        yield Event.LOOP_LATE
    if now.heard.tracking.silence_s(now.now_s) > now.settings.cycle.evader_timeout_s:
        yield Event.EVADER_LOST


def _game(now: Moment) -> Iterator[Event]:
    """Check the last certificate, and whether the pilot engages."""
    certificate = now.certificate
    if certificate is not None:
        if certificate.no_game:
            yield Event.NO_GAME
        if certificate.evader_arrived:
            yield Event.ESCAPED
        if certificate.captured:
            yield Event.CAPTURED
    # Only a change of mode counts.
    chosen = now.stage.other_mode_seen and now.heard.mode is Mode.GUIDED
    if chosen and _waits_for_pilot(now) and not now.refusals:
        yield Event.INVITED
    if now.stage.state is State.ON_STATION and now.settings.after_capture is AfterCapture.RETURN:
        yield Event.DONE
    if certificate is not None and certificate.strayed:
        yield Event.STRAYED


def _phase(now: Moment) -> Iterator[Event]:
    """Check whether the state has reached its end or its time limit."""
    ended = _PHASE_ENDS.get(now.stage.state)
    if ended is not None and ended[1](now):
        yield ended[0]
    if now.in_state_s > now.settings.limits_s.get(now.stage.state, math.inf):
        yield Event.TIMED_OUT
    longest_s = now.settings.longest_chase_s
    if longest_s is not None and now.now_s - now.stage.chase_began_s > longest_s:
        yield Event.CHASE_TIMED_OUT


def _armed(now: Moment) -> bool:
    # One HEARTBEAT must show both, so that the climb is not taken for a pilot's mode change.
    return now.heard.vehicle.armed and now.heard.mode in OUR_MODES[State.CLIMBING]


def _at_height(now: Moment) -> bool:
    local, home_ned_m = now.heard.vehicle.last(LocalPosition), now.heard.tracking.home_ned_m
    if local is None or home_ned_m is None:
        return False
    height_m = home_ned_m[2] - local.position_ned_m[2]
    return height_m > now.settings.takeoff_height_m - _AT_HEIGHT_M and now.heard.mode is not Mode.TAKEOFF


def _at_start(now: Moment) -> bool:
    if now.heard.start_ned_m is None:
        return True
    local = now.heard.vehicle.last(LocalPosition)
    return (
        local is not None
        and math.dist(local.position_ned_m, now.heard.start_ned_m) < _AT_START_M
        and math.hypot(*local.velocity_ned_m_s) < _AT_START_M_S
    )


def _clear(now: Moment) -> bool:
    settings = now.settings
    waited = now.in_state_s >= settings.settle_s
    settled = now.now_s - now.heard.vehicle.reset_s >= settings.settle_s
    heard = now.heard.tracking.silence_s(now.now_s) <= settings.cycle.evader_timeout_s
    return waited and settled and heard and not _telemetry_lost(now)


def _in_contact(now: Moment) -> bool:
    waited = now.in_state_s >= now.settings.settle_s
    return waited and not _telemetry_lost(now) and fit(now)


_READINGS: Final = (_vehicle, _place, _trust, _missing, _game, _phase)

_PHASE_ENDS: Final[Mapping[State, tuple[Event, Callable[[Moment], bool]]]] = {
    State.CONNECTING: (
        Event.HEARD,
        lambda now: now.heard.vehicle.age_s(Heartbeat, now.now_s) <= HEARTBEAT_LIMIT_S,
    ),
    State.CHECKING: (Event.FIT, fit),
    State.READY: (Event.UNFIT, lambda now: not fit(now)),
    State.ARMING: (Event.ARMED, _armed),
    State.CLIMBING: (Event.AT_HEIGHT, _at_height),
    State.POSITIONING: (Event.AT_START, _at_start),
    State.ENTERING: (Event.GUIDED, lambda now: now.heard_since_entry and now.heard.mode is Mode.GUIDED),
    State.PAUSED: (Event.CLEAR, _clear),
    State.OUT_OF_CONTACT: (Event.CONTACT, _in_contact),
}
"""The event that ends each phase, and its condition."""
