"""Event detection, once per cycle and without memory.

It checks, most severe first: the vehicle and who commands it, its position, operator and battery, missing inputs, the
game, and the progress of the phase.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final, NamedTuple

from guidance.autopilots import AutopilotProfile, Finding, Mode, Verdict
from guidance.certificate import Certificate
from guidance.control import Limiter
from guidance.flight.heard import HOLD_S, Heard
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import HANDING_OVER, OUR_MODES, SETPOINT_STATES, TRANSITIONS, Event, State
from guidance.flight.tracking import Tracking
from guidance.messages import Attitude, Heartbeat, Home, LandedState, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

# MAV_SYS_STATUS_SENSOR bits that must be healthy if the autopilot reports them.
_PREARM_CHECK = 1 << 28

HEARTBEAT_LIMIT_S = 3.0
TELEMETRY_LIMIT_S = 1.0

_LARGEST_AGE_S: Final[Mapping[type, float]] = {
    Heartbeat: HEARTBEAT_LIMIT_S,
    LocalPosition: TELEMETRY_LIMIT_S,
    Attitude: TELEMETRY_LIMIT_S,
    LandedState: 2.0 * TELEMETRY_LIMIT_S,
    Home: math.inf,
}
"""Messages needed for arming and engaging."""


_TO_DO: Final[Mapping[str, str]] = {
    "autopilot": "check the vehicle's power, the link's URL, vehicle.system_id and vehicle.autopilot",
    "Heartbeat": "check the vehicle's power and the link",
    "LocalPosition": "wait for the estimator's position; check that LOCAL_POSITION_NED is streamed",
    "Attitude": "check that ATTITUDE is streamed",
    "LandedState": "check that EXTENDED_SYS_STATE is streamed",
    "Home": "wait for a position fix: home is set with it",
    "prearm": "read the autopilot's own messages in the ground station, and mend what they name",
    "battery": "change or charge the battery",
}
"""Advice for each failed readiness check, by its name."""


def _check(name: str, passed: bool, found: str) -> Finding:
    return Finding.of(passed, name, found, "", _TO_DO[name])


def checks(
    vehicle: VehicleState, profile: AutopilotProfile, now_s: float, *, battery_minimum: float
) -> tuple[Finding, ...]:
    """Evaluate every condition for arming and engaging.

    Args:
        vehicle: Last known state of the vehicle.
        profile: The expected autopilot.
        now_s: The present, on the clock that stamped the messages.
        battery_minimum: Least battery remaining, 0 to 1; unknown (NaN) passes, since not every vehicle measures it.
    """
    heartbeat = vehicle.last(Heartbeat)
    found = "not heard" if heartbeat is None else f"MAV_AUTOPILOT {heartbeat.autopilot}, want {profile.autopilot_id}"
    rows = [_check("autopilot", heartbeat is not None and heartbeat.autopilot == profile.autopilot_id, found)]
    for kind, limit_s in _LARGEST_AGE_S.items():
        age_s = vehicle.age_s(kind, now_s)
        found = f"{age_s:.1f} s old" if math.isfinite(age_s) else "not heard"
        rows.append(_check(kind.__name__, math.isfinite(age_s) and age_s <= limit_s, found))
    return (*rows, *_status(vehicle, profile, battery_minimum))


def evader_refusal(tracking: Tracking, settings: FlightSettings, now_s: float) -> str:
    """Return why this evader may not be engaged now; empty if it may."""
    silence_s, limit_s = tracking.silence_s(now_s), settings.cycle.evader_timeout_s
    if silence_s > limit_s:
        heard = "was never heard" if math.isinf(silence_s) else f"was last heard {silence_s:.1f} s ago"
        return f"the evader {heard}; at most {limit_s:g} s is allowed"
    rival = tracking.rival(now_s)
    if rival and settings.hold_on_rival:
        return f"two sources report as the evader (told apart by {rival}); silence one, or set evader.second_source"
    return ""


def telemetry_gap(vehicle: VehicleState, now_s: float) -> str:
    """Return the missing messages of the vehicle, and for how long."""
    beat_s, local_s = vehicle.age_s(Heartbeat, now_s), vehicle.age_s(LocalPosition, now_s)
    everything_s = min(beat_s, local_s, vehicle.age_s(Attitude, now_s))
    if everything_s > 0.5 * TELEMETRY_LIMIT_S:  # a message that still came would be younger than that
        return f"no telemetry for {everything_s:.1f} s"
    rows = (("HEARTBEAT", beat_s, HEARTBEAT_LIMIT_S), ("LOCAL_POSITION_NED", local_s, TELEMETRY_LIMIT_S))
    late = (f"no {name} for {age_s:.1f} s" for name, age_s, limit_s in rows if age_s > limit_s)
    return "; ".join(late) or "telemetry is back"


def _status(vehicle: VehicleState, profile: AutopilotProfile, battery_minimum: float) -> tuple[Finding, Finding]:
    status = vehicle.last(SystemStatus)
    if status is None:
        return _check("prearm", False, "not heard"), _check("battery", False, "not heard")
    reported = profile.prearm_always_told or bool(status.sensors_present & _PREARM_CHECK)
    healthy = bool(status.sensors_health & _PREARM_CHECK)
    found = "healthy" if healthy else "the autopilot's own checks fail"
    beat = vehicle.last(Heartbeat)
    guided = beat is not None and not beat.armed and profile.mode_of(beat.custom_mode) is Mode.GUIDED
    if reported and not healthy and guided and profile.stream_before_guided:
        # PX4 keeps OFFBOARD after a landing, and its checks then miss our setpoints. We arm in its hold, where it
        # refuses by itself what really is wrong.
        reported, found = False, "of a mode that misses setpoints; asked again as it arms"
    battery = status.battery_remaining
    return (
        _check("prearm", healthy or not reported, found),
        _check("battery", not battery < battery_minimum, "unknown" if math.isnan(battery) else f"{battery:.0%} left"),
    )


LATE_LOOP_S = 0.25
_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7

BREACH_M = 0.5
"""Distance beyond floor, ceiling or stand-off that counts as a breach. A hover wanders by less."""

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


class Moment(NamedTuple):
    """Inputs of event detection in one cycle."""

    now_s: float
    settings: FlightSettings
    heard: Heard
    stage: Stage
    certificate: Certificate | None
    refusals: Sequence[str]
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
    return (event for event, happens in _CONDITIONS_IN[now.stage.state] if happens(now))


def detail_of(event: Event, now: Moment) -> str:
    """Return the measurement behind an event; empty if the name is enough."""
    heard, detail = now.heard, ""
    match event:
        case Event.TELEMETRY_LOST:
            detail = telemetry_gap(heard.vehicle, now.now_s)
        case Event.LOOP_STOPPED:
            detail = f"guidance stood still for {heard.dt_s:.1f} s, and the autopilot stopped waiting for setpoints"
        case Event.PILOT if heard.mode is not None:
            title = now.settings.autopilot.mode_title(heard.mode)
            detail = f"the vehicle is in {title}: a pilot or the autopilot chose that mode"
        case Event.MATE_SILENT:
            detail = f"{heard.silent_mate(now.now_s)} is near and was not heard for {HOLD_S:g} s"
        case Event.ASSIGNED:
            detail = f"plays against {heard.tracking.playing} now"
        case Event.REBOOTED:
            detail = "the autopilot rebooted"
        case Event.DISARMED if now.stage.state in SETPOINT_STATES:
            detail = "the vehicle disarmed while guidance flew it"
    return detail


def fit(now: Moment) -> bool:
    """Whether every readiness check passes and preflight refuses nothing."""
    settings = now.settings
    rows = checks(now.heard.vehicle, settings.autopilot, now.now_s, battery_minimum=now.battery_needed)
    return not now.refusals and all(row.verdict is Verdict.PASS for row in rows)


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
    local = vehicle.last(LocalPosition)
    if local is None:  # found armed and handed over: only its modes matter
        return flying and now.stage.state not in HANDING_OVER
    return flying and now.now_s - local.received_s > TELEMETRY_LIMIT_S


def _beyond(allowed_m: float, *limiters: Limiter) -> "Condition":
    """Return whether a wall of these kinds has been crossed by more than the allowed distance."""

    def crossed(now: Moment) -> bool:
        view = now.heard.seen or now.heard.view(now.now_s)
        walls = () if view is None else view.walls
        return any(-(wall.gap_m + wall.margin_m) > allowed_m for wall in walls if wall.limiter in limiters)

    return crossed


def _certified(fact: str) -> "Condition":
    """Return whether the certificate of this state says something of the game."""
    return lambda now: getattr(now.certificate, fact, False)


def _operator_silent(now: Moment, longer_s: float = 0.0) -> bool:
    timeout_s = now.settings.operator_timeout_s
    return timeout_s is not None and now.now_s - now.stage.operator_s > timeout_s + longer_s


def is_low(vehicle: VehicleState, needed: float) -> bool:
    """Return whether the battery's charge is below the needed share; an unknown charge is not low."""
    status = vehicle.last(SystemStatus)
    return status is not None and status.battery_remaining < needed


def _evader_lost(now: Moment) -> bool:
    return now.heard.tracking.silence_s(now.now_s) > now.settings.cycle.evader_timeout_s


def _invited(now: Moment) -> bool:
    # Only a change of mode counts.
    chosen = now.stage.other_mode_seen and now.heard.mode is Mode.GUIDED
    return chosen and _waits_for_pilot(now) and not now.refusals


def _chase_too_long(now: Moment) -> bool:
    return now.now_s - now.stage.chase_began_s > (now.settings.longest_chase_s or math.inf)


def _at_height(now: Moment) -> bool:
    local, home_ned_m = now.heard.vehicle.last(LocalPosition), now.heard.tracking.home_ned_m
    if local is None or home_ned_m is None:
        return False
    height_m = home_ned_m[2] - local.position_ned_m[2]
    return height_m > now.settings.takeoff_height_m - _AT_HEIGHT_M and now.heard.mode is not Mode.TAKEOFF


def _at_start(now: Moment) -> bool:
    start_ned_m, local = now.heard.start_ned_m, now.heard.vehicle.last(LocalPosition)
    if start_ned_m is None or local is None:
        return start_ned_m is None
    near = math.dist(local.position_ned_m, start_ned_m) < _AT_START_M
    return near and math.hypot(*local.velocity_ned_m_s) < _AT_START_M_S


def _clear(now: Moment) -> bool:
    settings = now.settings
    waited = now.in_state_s >= settings.settle_s
    settled = now.now_s - now.heard.vehicle.reset_s >= settings.settle_s
    missing = _evader_lost(now) or _telemetry_lost(now) or now.heard.silent_mate(now.now_s)
    return waited and settled and not missing


Condition = Callable[[Moment], bool]

_CONDITIONS: Final[tuple[tuple[Event, Condition], ...]] = (
    # Who commands the vehicle, and whether it is in contact.
    (Event.PILOT, _external_mode_change),
    (Event.REBOOTED, lambda now: now.heard.vehicle.reboots != now.stage.reboots_seen),
    (Event.TELEMETRY_LOST, _telemetry_lost),
    (Event.DISARMED, lambda now: not now.heard.vehicle.armed and now.heard_since_entry),
    (Event.LOOP_STOPPED, lambda now: now.heard.dt_s >= now.settings.autopilot.setpoint_timeout_s),
    (Event.FOREIGN, attrgetter("heard.foreign")),
    # Its position.
    (Event.FENCE, _beyond(0.0, Limiter.FENCE_RADIUS, Limiter.FENCE_POLYGON)),
    (Event.FLOOR, _beyond(BREACH_M, Limiter.FLOOR)),
    (Event.CEILING, _beyond(BREACH_M, Limiter.CEILING)),
    (Event.STAND_OFF, _beyond(BREACH_M, Limiter.STAND_OFF)),
    # Rival sources, the operator and the battery.
    (Event.RIVAL, lambda now: now.settings.hold_on_rival and now.heard.tracking.rival(now.now_s) != ""),
    (Event.OPERATOR_LOST, _operator_silent),
    (Event.OPERATOR_GONE, lambda now: _operator_silent(now, now.settings.operator_return_s)),
    (Event.BATTERY_LOW, lambda now: not now.stage.battery_was_low and is_low(now.heard.vehicle, now.battery_needed)),
    # The inputs of the game.
    (Event.ESTIMATOR_RESET, lambda now: now.heard.vehicle.resets != now.stage.resets_seen),
    (Event.LOOP_LATE, lambda now: now.heard.dt_s > LATE_LOOP_S),
    (Event.EVADER_LOST, _evader_lost),
    # The team.
    (Event.MATE_SILENT, lambda now: bool(now.heard.mates and now.heard.silent_mate(now.now_s))),
    (Event.ASSIGNED, attrgetter("heard.switched")),
    # The game.
    (Event.NO_GAME, _certified("no_game")),
    (Event.ESCAPED, _certified("evader_arrived")),
    (Event.CAPTURED, _certified("captured")),
    (Event.INVITED, _invited),
    (Event.DONE, lambda now: now.settings.after_capture is AfterCapture.RETURN),
    (Event.STRAYED, _certified("strayed")),
    # The end of the phase, and its time limit.
    (Event.HEARD, lambda now: now.heard.vehicle.age_s(Heartbeat, now.now_s) <= HEARTBEAT_LIMIT_S),
    (Event.FIT, fit),
    (Event.UNFIT, lambda now: not fit(now)),
    # One HEARTBEAT must show both, so that the climb is not taken for a pilot's mode change.
    (Event.ARMED, lambda now: now.heard.vehicle.armed and now.heard.mode in OUR_MODES[State.CLIMBING]),
    (Event.AT_HEIGHT, _at_height),
    (Event.AT_START, _at_start),
    (Event.GUIDED, lambda now: now.heard_since_entry and now.heard.mode is Mode.GUIDED),
    (Event.CLEAR, _clear),
    (Event.CONTACT, lambda now: now.in_state_s >= now.settings.settle_s and not _telemetry_lost(now) and fit(now)),
    (Event.TIMED_OUT, lambda now: now.in_state_s > now.settings.limits_s.get(now.stage.state, math.inf)),
    (Event.CHASE_TIMED_OUT, _chase_too_long),
)
"""The condition of every detected event, the most severe event first."""

_CONDITIONS_IN: Final[Mapping[State, Sequence[tuple[Event, Condition]]]] = {
    state: [one for one in _CONDITIONS if (state, one[0]) in TRANSITIONS] for state in State
}
