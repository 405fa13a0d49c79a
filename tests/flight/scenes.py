"""A flight by hand: settings, messages of a vehicle that is well, and the context that events are read from."""

from dataclasses import replace

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.certificate import Certificate
from guidance.control import Acceleration, Envelope, measure_fence
from guidance.cycle import CycleSettings
from guidance.flight import FlightSettings
from guidance.flight.detection import EventContext
from guidance.game import Ball, StandOff
from guidance.messages import Attitude, Heartbeat, Home, LandedState, LocalPosition, SystemStatus
from guidance.strategies import Strategy
from guidance.vehicle import VehicleState, observe

NOW_S = 100.0
PREARM = 1 << 28
HOME_DOWN_M = -4.0
NOWHERE = (0.0, 0.0, 0.0)
ENVELOPE = Envelope(
    floor_m=3.0,
    ceiling_m=60.0,
    speed_m_s=9.0,
    climb_m_s=3.0,
    descent_m_s=1.5,
    acceleration_m_s2=5.0,
    vertical_acceleration_m_s2=2.0,
    jerk_m_s3=20.0,
    yaw_rate_rad_s=1.0,
    fence_radius_m=300.0,
)
CYCLE = CycleSettings(
    speed_set=Ball(6.0),
    strategy=Strategy("optimal"),
    declared_evader_speed_m_s=3.0,
    standoff=StandOff(3.0, 5.0),
    tolerance_m=0.5,
    envelope=ENVELOPE,
    following=None,
    acceleration=Acceleration(3.0, 3.0),
    evader_timeout_s=1.5,
)
SETTINGS = FlightSettings(autopilot=PX4, cycle=CYCLE, takeoff_height_m=10.0, battery_minimum=0.25)
QUIET = Certificate(
    winner=1,
    value=5.0,
    margin_s=1.0,
    meeting_point_game_m=NOWHERE,
    meeting_time_s=5.0,
    speed_ratio=2.0,
    evader_age_s=0.1,
    pursuer_game_m=NOWHERE,
    evader_game_m=NOWHERE,
    gap_m=10.0,
    height_gap_m=0.0,
    desired_ned_m_s=NOWHERE,
    command_ned_m_s=NOWHERE,
    active_limits=(),
    captured=False,
    strayed=False,
    evader_arrived=False,
    no_game=False,
)


def settings_of(autopilot=PX4, **changes):
    return SETTINGS.model_copy(update={"autopilot": autopilot, **changes})


def heartbeat(at_s=NOW_S, mode=Mode.HOLD, *, armed=True, autopilot=PX4):
    number = 999 if mode is Mode.OTHER else autopilot.custom_modes[mode]
    return Heartbeat(at_s, number, armed, 4, autopilot.autopilot_id)


def local(at_s=NOW_S, position=(0.0, 0.0, HOME_DOWN_M - 10.0), velocity=NOWHERE):
    return LocalPosition(at_s, at_s, position, velocity)


def home(at_s=NOW_S):
    return Home(at_s, 47.397742, 8.545594, 492.0, (0.0, 0.0, HOME_DOWN_M))


def status(at_s=NOW_S, battery=0.9, *, present=PREARM, healthy=PREARM):
    return SystemStatus(at_s, present, healthy, battery)


def well(*changes, at_s=NOW_S):
    """All that a vehicle which is well has said, and then the changes."""
    said = [
        heartbeat(at_s),
        local(at_s - 0.01),
        Attitude(at_s, at_s, 0.5),
        LandedState(at_s, 2),
        home(at_s),
        status(at_s),
    ]
    return observe(VehicleState(), [*said, *changes])


def context(state, **changes):
    """A context in which nothing happens but what the changes say."""
    given = {
        "now_s": NOW_S,
        "dt_s": 0.02,
        "state": state,
        "since_s": NOW_S - 0.1,
        "settings": SETTINGS,
        "vehicle": well(),
        "resets_seen": 0,
        "reboots_seen": 0,
        "evader_silence_s": 0.1,
        "envelope": replace(ENVELOPE, home_ned_m=(0.0, 0.0, HOME_DOWN_M)),
        "position_ned_m": (0.0, 0.0, HOME_DOWN_M - 10.0),
        "evader_ned_m": None,
        "start_ned_m": None,
        "home_ned_m": (0.0, 0.0, HOME_DOWN_M),
        "certificate": QUIET,
        "refusals": (),
        "foreign": False,
        "other_mode_seen": False,
        "mode_left": None,
        "chase_s": 0.0,
        "rival": "",
        "operator_silence_s": 0.0,
    }
    given |= changes
    given.setdefault("battery_needed", given["settings"].battery_minimum)
    envelope, position, heartbeat = given["envelope"], given["position_ned_m"], given["vehicle"].last(Heartbeat)
    autopilot = given["settings"].autopilot
    given["fence"] = None if position is None else measure_fence(position, envelope)
    given["mode"] = None if heartbeat is None else autopilot.mode_of(heartbeat.custom_mode)
    return EventContext(**given)


BOTH = (PX4, ARDUCOPTER)
