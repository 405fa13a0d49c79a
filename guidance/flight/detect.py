"""What has happened? One small question an event, asked once a cycle of what was heard; no memory of its own."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from guidance.autopilots import Mode
from guidance.cycle import Certificate
from guidance.flight.readiness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S, checks
from guidance.flight.settings import AfterCapture, EngageOn, FlightSettings
from guidance.flight.table import OUR_MODES, TRANSITIONS, Event, State
from guidance.frames import Vector
from guidance.messages import Heartbeat, LocalPosition, SystemStatus
from guidance.vehicle import VehicleState

LATE_LOOP_S = 0.25
_AT_START_M = 1.0
_AT_START_M_S = 0.4
_AT_HEIGHT_M = 0.7


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything an event may be read from, at one cycle."""

    now_s: float
    dt_s: float
    state: State
    since_s: float
    settings: FlightSettings
    vehicle: VehicleState
    resets_seen: int
    reboots_seen: int
    evader_silence_s: float
    start_ned_m: Vector | None
    home_ned_m: Vector | None
    certificate: Certificate | None
    refusals: Sequence[str]
    foreign: bool
    other_mode_seen: bool

    @property
    def mode(self) -> Mode | None:
        """The mode that HEARTBEAT shows, None until one was heard."""
        heartbeat = self.vehicle.last(Heartbeat)
        return None if heartbeat is None else self.settings.profile.mode_of(heartbeat.custom_mode)

    @property
    def heard_since_entry(self) -> bool:
        """True once a HEARTBEAT arrived after the state was entered."""
        heartbeat = self.vehicle.last(Heartbeat)
        return heartbeat is not None and heartbeat.received_s > self.since_s


def events(scene: Scene) -> Iterator[Event]:
    """Yield what happened, the gravest first; asked is only what the table has an answer to in this state."""
    return (event for event, happened in _QUESTIONS.items() if (scene.state, event) in TRANSITIONS and happened(scene))


def fit(scene: Scene) -> bool:
    """True when every readiness check passes and preflight refuses nothing."""
    settings = scene.settings
    rows = checks(scene.vehicle, settings.profile, scene.now_s, battery_minimum=settings.battery_minimum)
    return not scene.refusals and all(row.passed for row in rows)


def _telemetry_lost(scene: Scene) -> bool:
    vehicle = scene.vehicle
    if vehicle.age_s(Heartbeat, scene.now_s) > HEARTBEAT_LIMIT_S:
        return True
    # Before the checks pass, the streams have only just been asked for.
    flying = scene.state not in {State.CHECKING, State.READY}
    return flying and vehicle.age_s(LocalPosition, scene.now_s) > TELEMETRY_LIMIT_S


def _another_hand(scene: Scene) -> bool:
    ours = OUR_MODES.get(scene.state)
    if _waiting_for_the_pilot(scene):
        return False  # who flies here, in whichever mode, is to choose the guided one
    return ours is not None and scene.mode is not None and scene.mode not in ours


def _waiting_for_the_pilot(scene: Scene) -> bool:
    return scene.state is State.STANDING_BY and scene.settings.engage_on is EngageOn.PILOT_MODE


def _invited(scene: Scene) -> bool:
    # A change, not a mode that the vehicle was left in.
    return _waiting_for_the_pilot(scene) and scene.other_mode_seen and scene.mode is Mode.GUIDED


def _armed(scene: Scene) -> bool:
    # Both in one HEARTBEAT: armed, and in a mode of ours, so that the climb is not mistaken for a pilot's.
    return scene.vehicle.armed and scene.mode in OUR_MODES[State.CLIMBING]


def _at_height(scene: Scene) -> bool:
    local, home_ned_m = scene.vehicle.last(LocalPosition), scene.home_ned_m
    if local is None or home_ned_m is None:
        return False
    height_m = home_ned_m[2] - local.position_ned_m[2]
    return height_m > scene.settings.takeoff_height_m - _AT_HEIGHT_M and scene.mode is not Mode.TAKEOFF


def _at_start(scene: Scene) -> bool:
    if scene.start_ned_m is None:
        return True
    local = scene.vehicle.last(LocalPosition)
    return (
        local is not None
        and math.dist(local.position_ned_m, scene.start_ned_m) < _AT_START_M
        and math.hypot(*local.velocity_ned_m_s) < _AT_START_M_S
    )


def _battery_low(scene: Scene) -> bool:
    status = scene.vehicle.last(SystemStatus)
    return status is not None and status.battery_remaining < scene.settings.battery_minimum


def _evader_lost(scene: Scene) -> bool:
    return scene.evader_silence_s > scene.settings.cycle.evader_timeout_s


def _clear(scene: Scene) -> bool:
    waited = scene.now_s - scene.since_s >= scene.settings.settle_s
    settled = scene.now_s - scene.vehicle.reset_s >= scene.settings.settle_s
    return waited and settled and not (_evader_lost(scene) or _telemetry_lost(scene))


def _reset(scene: Scene) -> bool:
    return scene.vehicle.resets != scene.resets_seen


def _timed_out(scene: Scene) -> bool:
    return scene.now_s - scene.since_s > scene.settings.limits_s.get(scene.state, math.inf)


def _certified(scene: Scene, name: str) -> bool:
    return scene.certificate is not None and bool(getattr(scene.certificate, name))


_QUESTIONS: Mapping[Event, Callable[[Scene], bool]] = {
    Event.PILOT: _another_hand,
    Event.REBOOTED: lambda scene: scene.vehicle.reboots != scene.reboots_seen,
    Event.TELEMETRY_LOST: _telemetry_lost,
    Event.DISARMED: lambda scene: scene.heard_since_entry and not scene.vehicle.armed,
    Event.LOOP_STOPPED: lambda scene: scene.dt_s >= scene.settings.profile.setpoint_timeout_s,
    Event.FOREIGN: lambda scene: scene.foreign,
    Event.FENCE: lambda scene: _certified(scene, "outside_fence"),
    Event.BATTERY_LOW: _battery_low,
    Event.ESTIMATOR_RESET: _reset,
    Event.LOOP_LATE: lambda scene: scene.dt_s > LATE_LOOP_S,
    Event.EVADER_LOST: _evader_lost,
    Event.NO_GAME: lambda scene: _certified(scene, "no_game"),
    Event.ESCAPED: lambda scene: _certified(scene, "evader_arrived"),
    Event.CAPTURED: lambda scene: _certified(scene, "captured"),
    Event.INVITED: _invited,
    Event.DONE: lambda scene: scene.settings.after_capture is AfterCapture.RETURN,
    Event.STRAYED: lambda scene: _certified(scene, "strayed"),
    Event.HEARD: lambda scene: scene.vehicle.age_s(Heartbeat, scene.now_s) <= HEARTBEAT_LIMIT_S,
    Event.FIT: fit,
    Event.UNFIT: lambda scene: not fit(scene),
    Event.ARMED: _armed,
    Event.AT_HEIGHT: _at_height,
    Event.AT_START: _at_start,
    Event.GUIDED: lambda scene: scene.heard_since_entry and scene.mode is Mode.GUIDED,
    Event.CLEAR: _clear,
    Event.TIMED_OUT: _timed_out,
}
