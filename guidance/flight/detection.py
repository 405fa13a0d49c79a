"""Event detection, once per cycle and without memory.

It checks, most severe first: the vehicle and who commands it, its position, operator and battery, missing inputs, the
game, and the progress of the phase.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from guidance.autopilots import Autopilot, Finding, Mode, Verdict
from guidance.autopilots.description import type_name
from guidance.boot_clock import LATE_TELEMETRY_S
from guidance.control import Limiter
from guidance.cycle import Certificate
from guidance.flight.freshness import (
    CHARGE_LIMIT_S,
    HEARTBEAT_LIMIT_S,
    HOLD_S,
    NEEDED,
    STATUS_LIMIT_S,
    TELEMETRY_LIMIT_S,
)
from guidance.flight.observed import Observed
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import (
    ASKED_MODES,
    BEFORE_FLIGHT,
    FINAL,
    HANDING_OVER,
    SETPOINT_STATES,
    TRANSITIONS,
    Event,
    State,
)
from guidance.messages import Attitude, Heartbeat, Home, LocalPosition, Message, SystemStatus
from guidance.vehicle import VehicleState

if TYPE_CHECKING:
    from guidance.control.braking_law import Wall

# MAV_SYS_STATUS_SENSOR bits that must be healthy if the autopilot reports them.
_GPS = 1 << 5
_PREARM_CHECK = 1 << 28

JUDGED_AFTER_S: Final = 1.0
"""The autopilot's own check applies to the mode in HEARTBEAT after this time: ArduPilot checks once a second."""

_TO_DO: Final[Mapping[str, str]] = {
    "autopilot": "check the vehicle's power, the link's URL, vehicle.system_id and vehicle.autopilot",
    **{kind.__name__: needed.advice for kind, needed in NEEDED.items()},
    "fence": "is home set at the right place, and the fence about it?",
    "sender": "find what else sends with the vehicle's system id, or sign MAVLink",
    "delay": "use a faster link or request fewer streams on it; routers must pass TIMESYNC on; "
    "a simulator must run at the pace of real time",
    "prearm": "read the autopilot's own messages in the ground station, and fix what they name",
    "battery": "change or charge the battery",
}
"""Advice for each failed readiness check, by its name."""


def checks(observed: Observed, profile: Autopilot, now_s: float) -> tuple[Finding, ...]:
    """Evaluate every condition for arming and engaging.

    An unknown charge passes, since not every vehicle measures it.

    Args:
        observed: Everything received so far.
        profile: The expected autopilot.
        now_s: The present, on the clock that stamped the messages.
    """
    vehicle = observed.vehicle
    beat = vehicle.latest.get(Heartbeat)
    status = vehicle.latest.get(SystemStatus)
    value = (
        "not heard"
        if beat is None
        else f"MAV_AUTOPILOT {beat.autopilot}, want {profile.autopilot_id}"
    )
    rows = [("autopilot", beat is not None and beat.autopilot == profile.autopilot_id, value)]
    for kind, needed in NEEDED.items():
        if kind is Home and vehicle.home_fixed:
            continue
        age_s = vehicle.age_s(kind, now_s)
        value = f"{age_s:.1f} s old" if math.isfinite(age_s) else "not heard"
        rows.append((kind.__name__, age_s <= needed.limit_s, value))
    rows.append(("fence", *_place_in_fence(observed, now_s)))
    alone = not vehicle.has_second_sender(now_s)
    rows.append(("sender", alone, "alone" if alone else "positions of two senders"))
    delay_s = vehicle.clock.delay_s
    value = vehicle.clock.unknown_words if math.isnan(delay_s) else f"{delay_s:.2f} s"
    rows.append(("delay", delay_s <= LATE_TELEMETRY_S, value))
    if status is None:
        rows += [("prearm", False, "not heard"), ("battery", False, "not heard")]
    else:
        healthy, value = _prearm_check(status, profile, beat)
        rows.append(("prearm", healthy, value))
        battery = status.battery_remaining
        charge = "unknown" if math.isnan(battery) else f"{battery:.0%} left"
        rows.append(("battery", not battery < observed.battery_needed, charge))
    return tuple(Finding.of(passed, name, value, "", _TO_DO[name]) for name, passed, value in rows)


def _place_in_fence(observed: Observed, now_s: float) -> tuple[bool, str]:
    """Return whether the vehicle is inside the fence about the home that it has reported, and where it is."""
    view = observed.view(now_s)
    home_ned_m = observed.tracking.home_ned_m
    if view is None or home_ned_m is None:
        return False, "not heard"
    away_m = math.dist(view.situation.position_ned_m[:2], home_ned_m[:2])
    fences, _ = _BREACHES[Event.FENCE]
    room_m = min(wall.gap_m + wall.margin_m for wall in view.walls if wall.limiter in fences)
    if room_m >= 0.0:
        return True, f"{away_m:.1f} m from home"
    reach_m = observed.cycle.envelope.reach_m
    outside = f"{away_m:.1f} m from home, {-room_m:.1f} m outside the fence of {reach_m:.1f} m"
    return False, f"{outside}: set home where it is, or carry it into its fence"


def _prearm_check(
    status: SystemStatus, profile: Autopilot, beat: Heartbeat | None
) -> tuple[bool, str]:
    """Return whether the autopilot's own checks allow arming, and their result in words."""
    if status.sensors_health & _PREARM_CHECK:
        # A check in a mode without a position does not cover the arming mode.
        if beat is None or beat.armed or profile.mode_of(beat.custom_mode) is profile.arming_mode:
            return True, "healthy"
        title = profile.mode_title(profile.arming_mode)
        if status.sensors_present & _GPS and not status.sensors_health & _GPS:
            return False, f"healthy in this mode, but GPS is not, which {title} needs"
        return True, f"healthy in this mode; read again in {title} before it arms"
    failure = "the autopilot's own checks fail"
    if not (profile.prearm_always_told or status.sensors_present & _PREARM_CHECK):
        return True, failure
    if beat is not None and not beat.armed and beat.custom_mode in profile.setpoint_modes:
        # PX4 keeps OFFBOARD or our mode after a landing, and its checks then miss our setpoints or our readiness. It
        # refuses to arm if anything else is wrong.
        return True, "of a mode that misses setpoints; asked again as it arms"
    return False, failure


def arming_refusal(observed: Observed, profile: Autopilot, now_s: float) -> str:
    """Return why arming is not requested.

    Empty if the vehicle is inside its fence, the mode to arm in is shown, and the check made in it passes.
    """
    inside, place = _place_in_fence(observed, now_s)
    if not inside:
        return f"the vehicle is {place}"
    title = profile.mode_title(profile.arming_mode)
    if observed.mode is not profile.arming_mode:
        return f"HEARTBEAT does not show {title}"
    status = observed.vehicle.latest.get(SystemStatus)
    if status is None or observed.vehicle.age_s(SystemStatus, now_s) > STATUS_LIMIT_S:
        return "SYS_STATUS is not heard"
    if status.received_s < observed.mode_since_s + JUDGED_AFTER_S:
        return f"SYS_STATUS does not show the autopilot's own check of {title} yet"
    passes, found = _prearm_check(status, profile, observed.vehicle.latest.get(Heartbeat))
    return "" if passes else f"{found} in {title}"


def telemetry_gap(vehicle: VehicleState, now_s: float) -> str:
    """Return the missing messages of the vehicle, and for how long."""
    beat_s = vehicle.silence_s(Heartbeat, now_s)
    local_s = vehicle.silence_s(LocalPosition, now_s)
    everything_s = min(beat_s, local_s, vehicle.silence_s(Attitude, now_s))
    # A message that still came would be younger than that
    if everything_s > 0.5 * TELEMETRY_LIMIT_S:
        return f"no telemetry for {everything_s:.1f} s"
    rows = (
        ("HEARTBEAT", beat_s, HEARTBEAT_LIMIT_S),
        ("LOCAL_POSITION_NED", local_s, TELEMETRY_LIMIT_S),
    )
    late = [f"no {name} for {age_s:.1f} s" for name, age_s, limit_s in rows if age_s > limit_s]
    return "; ".join(late) if late else "telemetry is back"


LATE_LOOP_S = 0.25

LOSS_SPARE_S = 0.05
"""Allowance for the jitter of setpoints between sending and arrival at the autopilot."""

_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7
_BELOW_HEIGHT_M = 2.0

BREACH_M = 0.5
"""Distance beyond floor, ceiling or stand-off that counts as a breach. A hover wanders by less."""

LEFT_WITHIN_S = 5.0
"""For this long after an order, HEARTBEAT may show the pilot's old mode. It is up to 2 s late."""

UNDONE_WITHIN_S = 2.0
"""A request to arm that was given before an order may be carried out so much later."""


@dataclass(slots=True)
class Stage:
    """The present state, and notes since it was entered.

    Attributes:
        state: State of the flight.
        since_s: When it was entered.
        resets_seen: Estimator resets counted by then.
        reboots_seen: Reboots counted by then.
        other_mode_seen: Whether HEARTBEAT has shown another mode than the guided one.
        left: Modes that HEARTBEAT may still show: the mode at the start of the state, and the one requested before.
        chase_began_s: When the present chase began.
        operator_s: Time of the operator's last order or sign of life.
        battery_was_low: Whether the operator ordered the hold with a low or unknown battery; it stands then.
        may_be_armed: Whether guidance has requested arming, or the vehicle was armed when the start order came.
    """

    state: State = State.CONNECTING
    since_s: float = 0.0
    resets_seen: int = 0
    reboots_seen: int = 0
    other_mode_seen: bool = False
    left: frozenset[Mode] = frozenset()
    chase_began_s: float = 0.0
    operator_s: float = math.inf
    battery_was_low: bool = False
    may_be_armed: bool = False


class Moment(NamedTuple):
    """Inputs of event detection in one cycle."""

    now_s: float
    settings: FlightSettings
    observed: Observed
    stage: Stage
    certificate: Certificate | None
    refusals: Sequence[str]

    @property
    def in_state_s(self) -> float:
        """Time since the state was entered."""
        return self.now_s - self.stage.since_s


def events(now: Moment) -> Iterator[Event]:
    """Yield the events of this cycle, the most severe first; only those that are in the table for this state."""
    return (
        event
        for event, happens in _conditions(now)
        if happens and (now.stage.state, event) in TRANSITIONS
    )


def _conditions(now: Moment) -> Iterator[tuple[Event, bool]]:
    """Yield every event and whether its condition holds, the most severe first. Each is computed in its turn."""
    settings = now.settings
    observed = now.observed
    stage = now.stage
    certificate = now.certificate
    vehicle = observed.vehicle
    tracking = observed.tracking
    playing = stage.state in SETPOINT_STATES
    # Command of the vehicle, and contact with it.
    yield (
        Event.PILOT,
        _armed_by_another(now) or (shows_strange_mode(now) and not _waits_for_pilot(now)),
    )
    yield Event.REBOOTED, vehicle.reboots != stage.reboots_seen
    yield Event.TELEMETRY_LOST, _telemetry_lost(now)
    beat = vehicle.latest.get(Heartbeat)
    # An order may be newer than a request to arm that is still on its way.
    undone_s = UNDONE_WITHIN_S if stage.state in HANDING_OVER else 0.0
    yield (
        Event.DISARMED,
        beat is not None and not beat.armed and beat.received_s > stage.since_s + undone_s,
    )
    yield Event.LOOP_STOPPED, has_stopped(observed)
    yield Event.LATE, is_late(vehicle, now.now_s)
    yield Event.SECOND_SENDER, vehicle.has_second_sender(now.now_s)
    yield Event.FOREIGN, observed.foreign
    # Its position.
    view = observed.view(now.now_s) if playing else None
    beyond: list[Wall] = []
    if view is not None:
        beyond = [wall for wall in view.walls if wall.gap_m + wall.margin_m < 0.0]
    if beyond:
        for event, (limiters, allowed_m) in _BREACHES.items():
            gaps_m = [wall.gap_m + wall.margin_m for wall in beyond if wall.limiter in limiters]
            yield event, min(gaps_m, default=0.0) < -allowed_m
    # Rival sources, the operator and the battery.
    yield Event.RIVAL, playing and settings.hold_on_rival and tracking.rival(now.now_s) != ""
    silent_s = now.now_s - stage.operator_s
    allowed_s = settings.operator_timeout_s or math.inf
    yield Event.OPERATOR_LOST, silent_s > allowed_s
    yield Event.OPERATOR_GONE, silent_s > allowed_s + settings.operator_return_s
    yield Event.BATTERY_LOW, observed.battery_is_low and not stage.battery_was_low
    yield Event.BATTERY_UNKNOWN, observed.charge_is_old and not stage.battery_was_low
    # The inputs of the game.
    yield Event.ESTIMATOR_RESET, vehicle.resets != stage.resets_seen
    yield Event.LOOP_LATE, observed.dt_s > LATE_LOOP_S
    yield (
        Event.EVADER_LOST,
        playing and tracking.silence_s(now.now_s) > settings.cycle.evader_timeout_s,
    )
    # The team.
    yield Event.MATE_SILENT, playing and bool(observed.mates and observed.silent_mate(now.now_s))
    yield Event.ASSIGNED, observed.switched
    # The game.
    if certificate is not None:
        yield Event.NO_GAME, certificate.no_game
        yield Event.POLICY_FAILED, certificate.policy_fault is not None
        yield Event.ESCAPED, certificate.evader_arrived
        yield Event.CAPTURED, certificate.captured
    yield Event.DONE, settings.after_capture is AfterCapture.RETURN
    yield Event.STRAYED, certificate is not None and certificate.strayed
    # The end of the phase, and its time limit.
    if stage.state in _PROGRESS:
        progress, reached = _PROGRESS[stage.state]
        yield progress, reached(now)
    yield Event.TIMED_OUT, now.now_s - stage.since_s > settings.limits_s.get(stage.state, math.inf)
    yield (
        Event.CHASE_TIMED_OUT,
        now.now_s - stage.chase_began_s > (settings.longest_chase_s or math.inf),
    )


def has_stopped(observed: Observed) -> bool:
    """True if the last cycle is so long ago that the autopilot may have stopped waiting for setpoints."""
    return observed.dt_s >= observed.setpoint_timeout_s - LOSS_SPARE_S


def _other_autopilot(now: Moment) -> str:
    """Name the autopilot or vehicle type that sends HEARTBEATs instead of the configured one, if any does."""
    beat = now.observed.other_beat
    if beat is None or now.now_s - beat.received_s > HEARTBEAT_LIMIT_S:
        return ""
    return f"; MAV_AUTOPILOT {beat.autopilot}, {type_name(beat.vehicle_type)}, is heard instead"


def detail_of(event: Event, now: Moment) -> str:
    """Return the measurement behind an event; empty if the name is enough."""
    return _DETAILS[event](now) if event in _DETAILS else ""


def fit(now: Moment) -> bool:
    """True if every readiness check passes and preflight refuses nothing."""
    if now.refusals:
        return False
    rows = checks(now.observed, now.settings.autopilot, now.now_s)
    return all(row.verdict is Verdict.PASS for row in rows)


def is_late(vehicle: VehicleState, now_s: float) -> bool:
    """Return whether the telemetry is too late to fly by, or its last position came late and is too old.

    A position that came in time is too old because nothing arrives; that is lost telemetry.
    """
    if (
        vehicle.clock.delay_s > LATE_TELEMETRY_S
        and vehicle.age_s(LocalPosition, now_s) > TELEMETRY_LIMIT_S
    ):
        return True
    return vehicle.clock.is_late(now_s)


def lateness(vehicle: VehicleState) -> str:
    """Return in words how late the telemetry is."""
    if math.isnan(vehicle.clock.delay_s):
        return f"the delay of the telemetry is {vehicle.clock.unknown_words}"
    return f"telemetry is {vehicle.delay_s:.1f} s late; at most {LATE_TELEMETRY_S:g} s is allowed"


def telemetry_refusal(vehicle: VehicleState, now_s: float) -> str:
    """Return why the vehicle's telemetry bars an engagement now; empty if it does not."""
    if vehicle.has_second_sender(now_s):
        return "two senders report as the vehicle: their positions contradict each other"
    if is_late(vehicle, now_s):
        return lateness(vehicle)
    for kind, name in _READ_TO_ENGAGE.items():
        limit_s = NEEDED[kind].limit_s
        silence_s = vehicle.silence_s(kind, now_s)
        if silence_s > limit_s:
            return f"{name} was last heard {silence_s:.1f} s ago; at most {limit_s:g} s is allowed"
    return ""


_READ_TO_ENGAGE: Final[Mapping[type[Message], str]] = {
    Heartbeat: "HEARTBEAT",
    LocalPosition: "LOCAL_POSITION_NED",
    Attitude: "ATTITUDE",
    SystemStatus: "SYS_STATUS",
}
"""Messages that an engagement reads, also of a vehicle whose other checks passed at the start."""


_CHOSEN_IN: Final = frozenset({State.STANDING_BY, State.OUT_OF_CONTACT, State.HOLDING})
"""A pilot who chooses our mode in these states wants to engage."""


def shows_strange_mode(now: Moment) -> bool:
    """Return whether HEARTBEAT shows a mode that guidance did not request."""
    state = now.stage.state
    mode = now.observed.mode
    autopilot = now.settings.autopilot
    if mode is None or state in BEFORE_FLIGHT | FINAL:
        return False
    if state in HANDING_OVER and not now.observed.vehicle.armed:
        return False  # with the landing PX4 also ends the mode
    chosen = mode is Mode.GUIDED and autopilot.guided_is_ours and state in _CHOSEN_IN
    asked = autopilot.arming_mode if state is State.ARMING else ASKED_MODES.get(state)
    if chosen or mode is asked:
        return False
    if state is State.CLIMBING and mode is Mode.HOLD and Mode.TAKEOFF in autopilot.custom_modes:
        # Its own hold comes before the take-off and after it.
        in_the_air = bool(now.observed.beats) and not now.observed.on_ground
        return in_the_air and _height_m(now) < now.settings.takeoff_height_m - _BELOW_HEIGHT_M
    if mode in now.stage.left:
        # HEARTBEAT may be older than the order. A pilot's mode that stays is intended.
        return mode is Mode.OTHER and now.in_state_s > LEFT_WITHIN_S
    return True


def _armed_by_another(now: Moment) -> bool:
    """True if the vehicle was armed after the last HEARTBEAT before the start order and before our own request."""
    arming = now.stage.state is State.ARMING
    return arming and not now.stage.may_be_armed and any(beat.armed for beat in now.observed.beats)


def _waits_for_pilot(now: Moment) -> bool:
    """True if any mode is allowed, because the pilot's switch to the guided mode begins the game."""
    waiting = {State.STANDING_BY, State.OUT_OF_CONTACT}
    return now.stage.state in waiting and now.settings.engage_on is EngageOn.PILOT_MODE


def _telemetry_lost(now: Moment) -> bool:
    latest = now.observed.vehicle.latest
    if now.stage.state in HANDING_OVER and now.in_state_s < TELEMETRY_LIMIT_S:
        return False  # ordered without contact: send the request first
    beat = latest.get(Heartbeat)
    local = latest.get(LocalPosition)
    if beat is None or now.now_s - beat.received_s > HEARTBEAT_LIMIT_S:
        return True
    # Before the checks pass, the streams have just been requested.
    if now.stage.state in {State.CHECKING, State.READY}:
        return False
    if local is None:  # found armed and handed over: only its modes matter
        return now.stage.state not in HANDING_OVER
    if now.now_s - local.received_s > TELEMETRY_LIMIT_S:
        return True
    is_old = now.observed.position_age_s > TELEMETRY_LIMIT_S
    return is_old and not now.observed.vehicle.clock.delay_s > LATE_TELEMETRY_S


def _invited(now: Moment) -> bool:
    # Only a change of mode counts.
    if not now.stage.other_mode_seen or now.observed.mode is not Mode.GUIDED:
        return False
    if not _waits_for_pilot(now):
        return False
    if now.refusals or telemetry_refusal(now.observed.vehicle, now.now_s):
        return False
    too_far = now.observed.distance_refusal(now.now_s)
    return not (too_far or now.observed.tracking.height_refusal(now.now_s))


def _height_m(now: Moment) -> float:
    """Height above home; NaN if it is unknown."""
    local = now.observed.vehicle.latest.get(LocalPosition)
    home_ned_m = now.observed.tracking.home_ned_m
    if local is None or home_ned_m is None:
        return math.nan
    return home_ned_m[2] - local.position_ned_m[2]


def _at_height(now: Moment) -> bool:
    is_up = _height_m(now) > now.settings.takeoff_height_m - _AT_HEIGHT_M
    return is_up and now.observed.mode is not Mode.TAKEOFF


def _at_start(now: Moment) -> bool:
    start_ned_m = now.observed.start_ned_m
    local = now.observed.vehicle.latest.get(LocalPosition)
    if start_ned_m is None or local is None:
        return start_ned_m is None
    distance_m = math.dist(local.position_ned_m, start_ned_m)
    speed_m_s = math.hypot(*local.velocity_ned_m_s)
    return distance_m < _AT_START_M and speed_m_s < _AT_START_M_S


def _guided(now: Moment) -> bool:
    beat = now.observed.vehicle.latest.get(Heartbeat)  # one that is newer than the order
    return (
        beat is not None
        and beat.received_s > now.stage.since_s
        and now.observed.mode is Mode.GUIDED
    )


def _is_armed(now: Moment) -> bool:
    """True if the last HEARTBEAT shows the vehicle armed in the arming mode."""
    return now.observed.vehicle.armed and now.observed.mode is now.settings.autopilot.arming_mode


def _in_contact(now: Moment) -> bool:
    if now.in_state_s < now.settings.settle_s or _telemetry_lost(now):
        return False
    return fit(now)


def _clear(now: Moment) -> bool:
    settings = now.settings
    since_reset_s = now.now_s - now.observed.vehicle.reset_s
    if min(now.in_state_s, since_reset_s) < settings.settle_s:
        return False
    if now.observed.tracking.silence_s(now.now_s) > settings.cycle.evader_timeout_s:
        return False
    return not (_telemetry_lost(now) or now.observed.silent_mate(now.now_s))


def _pilot_words(now: Moment) -> str:
    mode = Mode.OTHER if now.observed.mode is None else now.observed.mode
    title = now.settings.autopilot.mode_title(mode)
    if _armed_by_another(now):
        return f"somebody else armed the vehicle as the start was ordered, and it is in {title}"
    return f"the vehicle is in {title}: a pilot or the autopilot chose that mode"


_BREACHES: Final[Mapping[Event, tuple[Collection[Limiter], float]]] = {
    Event.FENCE: ({Limiter.FENCE_RADIUS, Limiter.FENCE_POLYGON}, 0.0),
    Event.FLOOR: ({Limiter.FLOOR}, BREACH_M),
    Event.CEILING: ({Limiter.CEILING}, BREACH_M),
    Event.STAND_OFF: ({Limiter.STAND_OFF}, BREACH_M),
}
"""Walls that a vehicle may not cross by more than some distance, m."""

_DETAILS: Final[Mapping[Event, Callable[[Moment], str]]] = {
    Event.PILOT: _pilot_words,
    Event.REBOOTED: lambda _: "the autopilot rebooted",
    Event.TELEMETRY_LOST: lambda now: (
        f"{telemetry_gap(now.observed.vehicle, now.now_s)}{_other_autopilot(now)}"
    ),
    Event.LATE: lambda now: lateness(now.observed.vehicle),
    Event.DISARMED: lambda now: (
        "the vehicle disarmed while guidance flew it" if now.stage.state in SETPOINT_STATES else ""
    ),
    Event.LOOP_STOPPED: lambda now: (
        f"the autopilot waits for setpoints for {now.observed.setpoint_timeout_s:g} s, "
        f"and guidance stood still for {now.observed.dt_s:.1f} s"
    ),
    Event.TIMED_OUT: lambda now: (
        ""
        if now.stage.state is not State.ARMING
        else arming_refusal(now.observed, now.settings.autopilot, now.now_s)
    ),
    Event.BATTERY_UNKNOWN: lambda _: (
        f"the charge is not known for {CHARGE_LIMIT_S:g} s: SYS_STATUS, or its charge, no longer comes"
    ),
    Event.MATE_SILENT: lambda now: (
        f"{now.observed.silent_mate(now.now_s)} is near and was not heard for {HOLD_S:g} s"
    ),
    Event.POLICY_FAILED: lambda now: (
        "" if now.certificate is None else now.certificate.policy_fault or ""
    ),
    Event.ASSIGNED: lambda now: f"plays against {now.observed.tracking.playing} now",
}
"""The measurement behind an event whose name is not enough."""

_PROGRESS: Final[Mapping[State, tuple[Event, Callable[[Moment], bool]]]] = {
    State.CONNECTING: (
        Event.HEARD,
        lambda now: now.observed.vehicle.silence_s(Heartbeat, now.now_s) <= HEARTBEAT_LIMIT_S,
    ),
    State.CHECKING: (Event.FIT, fit),
    State.READY: (Event.UNFIT, lambda now: not fit(now)),
    State.ARMING: (Event.ARMED, _is_armed),
    State.CLIMBING: (Event.AT_HEIGHT, _at_height),
    State.POSITIONING: (Event.AT_START, _at_start),
    State.STANDING_BY: (Event.INVITED, _invited),
    State.ENTERING: (Event.GUIDED, _guided),
    State.PAUSED: (Event.CLEAR, _clear),
    State.OUT_OF_CONTACT: (Event.CONTACT, _in_contact),
}
"""The event that ends a phase, and its condition."""
