"""Inputs for tests of the flight: settings, messages of a healthy vehicle, and the context for detection of events."""

from dataclasses import replace

from guidance.autopilots import ARDUCOPTER, PX4, Mode
from guidance.control import Envelope
from guidance.cycle import Certificate, CycleSettings
from guidance.estimation import EvaderEstimate
from guidance.flight import FlightSettings
from guidance.flight.detection import Moment, Stage
from guidance.flight.observed import Observed
from guidance.frames import Enu, Ned
from guidance.game import Ball, Game, StandOff
from guidance.messages import (
    Attitude,
    Heartbeat,
    Home,
    LandedState,
    LocalPosition,
    SystemStatus,
    Timesync,
)
from guidance.strategies import Strategy
from guidance.vehicle import VehicleState, observe

NOW_S = 100.0
PREARM = 1 << 28
HOME_DOWN_M = -4.0
NOWHERE = Ned((0.0, 0.0, 0.0))
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
    game=Game(Ball(6.0), 3.0, standoff=StandOff(3.0, 5.0)),
    policy=Strategy("optimal"),
    tolerance_m=0.5,
    envelope=ENVELOPE,
    handling=replace(PX4.handling, servo=None),
    evader_timeout_s=1.5,
)
SETTINGS = FlightSettings(autopilot=PX4, cycle=CYCLE, takeoff_height_m=10.0, battery_minimum=0.25)
QUIET = Certificate(
    winner=1,
    value=5.0,
    margin_s=1.0,
    meeting_point_game_m=Enu(NOWHERE),
    meeting_time_s=5.0,
    speed_ratio=2.0,
    evader_age_s=0.1,
    pursuer_game_m=Enu(NOWHERE),
    evader_game_m=Enu(NOWHERE),
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
    return LocalPosition(at_s, at_s, Ned(position), Ned(velocity))


def home(at_s=NOW_S):
    return Home(at_s, 47.397742, 8.545594, 492.0, Ned((0.0, 0.0, HOME_DOWN_M)))


def timesync(at_s=NOW_S):
    """An answer without delay, of a vehicle whose clock is ours."""
    at_ns = round(at_s * 1e9)
    return Timesync(at_s, at_ns, at_ns)


def status(at_s=NOW_S, battery=0.9, *, present=PREARM, healthy=PREARM):
    return SystemStatus(at_s, present, healthy, battery)


def well(*changes, at_s=NOW_S):
    """Return the state of a healthy vehicle after its messages and then the changes."""
    said = [
        heartbeat(at_s),
        timesync(at_s - 0.02),
        local(at_s - 0.01),
        Attitude(at_s, at_s, 0.5),
        LandedState(at_s, 2),
        home(at_s),
        status(at_s),
    ]
    return observe(VehicleState(), [*said, *changes])


class Told:
    """A tracking that says what a test wants, of the present only."""

    local_frame = game_frame = None
    held_back_ned_m = NOWHERE
    playing = "red"
    too_high = ""

    def __init__(self, evader_ned_m, silence_s, rival, home_ned_m):
        self.home_ned_m = home_ned_m
        self._evader = (
            None if evader_ned_m is None else EvaderEstimate(evader_ned_m, NOWHERE, 3.0, 0.1)
        )
        self._silence_s = silence_s
        self._rival = rival

    def evader(self, now_s):
        assert now_s == NOW_S
        return self._evader

    def silence_s(self, now_s):
        assert now_s == NOW_S
        return self._silence_s

    def rival(self, now_s):
        assert now_s == NOW_S
        return self._rival

    def height_refusal(self, now_s):
        assert now_s == NOW_S
        return self.too_high


STAGE = {
    "since_s": NOW_S - 0.1,
    "chase_began_s": NOW_S,
    "operator_s": NOW_S,
    "left": frozenset({Mode.HOLD}),
    "may_be_armed": True,
}


def context(state, *, settings=SETTINGS, vehicle=None, **changes):
    """Return a context without events except for the changes."""
    observed = Observed(settings)
    observed.vehicle = well() if vehicle is None else vehicle
    observed.position_age_s = observed.vehicle.age_s(LocalPosition, NOW_S)
    heartbeat = observed.vehicle.latest.get(Heartbeat)
    observed.mode = None if heartbeat is None else settings.autopilot.mode_of(heartbeat.custom_mode)
    observed.dt_s = changes.pop("dt_s", 0.02)
    observed.beats = changes.pop("beats", ())
    observed.foreign = changes.pop("foreign", False)
    observed.battery_is_low = changes.pop("battery_is_low", False)
    observed.start_ned_m = changes.pop("start_ned_m", None)
    usual = {
        "evader_ned_m": None,
        "evader_silence_s": 0.1,
        "rival": "",
        "home_ned_m": Ned((0.0, 0.0, HOME_DOWN_M)),
    }
    observed.tracking = Told(*(changes.pop(name, value) for name, value in usual.items()))
    observed.position_ned_m = changes.pop("position_ned_m", Ned((0.0, 0.0, HOME_DOWN_M - 10.0)))
    about_home = replace(ENVELOPE, home_ned_m=Ned((0.0, 0.0, HOME_DOWN_M)))
    observed.cycle = replace(settings.cycle, envelope=changes.pop("envelope", about_home))
    stage = {
        **STAGE,
        **{name: changes.pop(name) for name in Stage.__dataclass_fields__ if name in changes},
    }
    return Moment(
        now_s=NOW_S,
        settings=settings,
        observed=observed,
        stage=Stage(state, **stage),
        certificate=changes.pop("certificate", QUIET),
        refusals=changes.pop("refusals", ()),
        **changes,
    )


BOTH = (PX4, ARDUCOPTER)
