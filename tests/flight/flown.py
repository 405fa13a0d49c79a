"""A flight fed by hand: its vehicle says what the test has it say, cycle by cycle."""

import math
from collections import Counter

from guidance.autopilots import Mode
from guidance.flight import Event, Flight, Inputs, State
from guidance.frames import Ned
from guidance.messages import Attitude, EvaderReport, LandedState
from tests.flight.scenes import (
    HOME_DOWN_M,
    SETTINGS,
    heartbeat,
    home,
    local,
    status,
    timesync,
)

CYCLE_S = 0.02
SLOW_S = 0.1
"""A longer cycle, where only the order of events matters."""
START_S = 50.0


def outcome_of(flight):
    """Return the outcome of the evader's last report, None before the first one."""
    observer = flight.tracking.observers.get(flight.tracking.playing)
    return None if observer is None else observer.track.outcome


class Flown:
    """A flight and its vehicle's word for it: every cycle a position, every second (or at once) a HEARTBEAT."""

    def __init__(self, settings=SETTINGS):
        self.flight = Flight(settings)
        self.autopilot = settings.autopilot
        self.now_s = START_S
        self.mode = Mode.HOLD
        self.armed = False
        self.landed = 1
        self.position = [0.0, 0.0, HOME_DOWN_M]
        self.velocity = [0.0, 0.0, 0.0]
        self.yaw_rad = 0.7
        self.evader = (60.0, 0.0)
        self.outputs = None
        self.beat_s = -math.inf
        self.without_position = False
        self.outcomes = Counter()

    @property
    def state(self):
        return self.flight.state

    def cycle(
        self, *orders, beat=False, dt_s=CYCLE_S, more=(), reports=(), refusals=(), silent=False
    ):
        self.now_s += dt_s
        said = (
            []
            if silent or self.without_position
            else [local(self.now_s, tuple(self.position), tuple(self.velocity))]
        )
        if beat or (not silent and self.now_s - self.beat_s >= 1.0 - 1e-9):
            self.beat_s = self.now_s
            said += [
                timesync(self.now_s),
                heartbeat(self.now_s, self.mode, armed=self.armed, autopilot=self.autopilot),
                Attitude(self.now_s, self.now_s, self.yaw_rad),
                LandedState(self.now_s, self.landed),
                status(self.now_s),
                home(self.now_s),
            ]
        observed = [*([] if self.evader is None else [self.report()]), *reports]
        self.outputs = self.flight.step(
            self.now_s, self.inputs([*said, *more], observed, orders, refusals)
        )
        self.outcomes[outcome_of(self.flight)] += 1 if observed else 0
        return self.outputs

    def inputs(self, *read):
        return Inputs(*read)

    def report(self):
        north_m, east_m = self.evader
        latitude_deg = 47.397742 + math.degrees(north_m / 6371000.0)
        longitude_deg = 8.545594 + math.degrees(
            east_m / (6371000.0 * math.cos(math.radians(47.397742)))
        )
        return EvaderReport(
            self.now_s,
            self.now_s,
            "test",
            latitude_deg,
            longitude_deg,
            492.0,
            Ned((0.0, 0.0, 0.0)),
            0.1,
            0.1,
        )

    def cycles(self, seconds, *, dt_s=CYCLE_S, **given):
        return [self.cycle(dt_s=dt_s, **given) for _ in range(round(seconds / dt_s))]

    def armed_as_asked(self):
        """The autopilot takes the mode to arm in, is asked to arm, and arms."""
        self.mode = self.autopilot.arming_mode
        while ARM not in commands([self.cycle(beat=True)]):
            assert self.state is State.ARMING
        self.armed = True
        return self

    def climbing(self, height_m=5.0):
        self.cycles(0.1)
        self.cycle(Event.START)
        self.armed_as_asked()
        self.cycle(beat=True)
        self.landed = 3
        if Mode.TAKEOFF in self.autopilot.custom_modes:
            self.mode = Mode.TAKEOFF
        self.cycles(2.0, dt_s=SLOW_S)
        self.position[2] = HOME_DOWN_M - height_m
        self.cycles(1.0, dt_s=SLOW_S)
        assert self.state is State.CLIMBING
        return self

    def standing_by(self, height_m=10.0):
        self.cycle()
        self.cycle()
        assert self.state is State.READY
        self.armed = True
        self.landed = 2
        self.position[2] = HOME_DOWN_M - height_m
        self.cycle(beat=True)
        self.cycle(Event.START)
        assert self.state is State.STANDING_BY
        return self

    def engaged(self, evader=(60.0, 0.0), height_m=10.0):
        self.evader = evader
        self.standing_by(height_m)
        self.cycle(Event.ENGAGE)
        self.mode = Mode.GUIDED
        self.cycle(beat=True)
        assert self.state is State.ENGAGED
        return self


def commands(outputs):
    return [request.command for output in outputs for request in output.requests]


SET_MODE = 176
ARM = 400
TAKEOFF = 22
REPOSITION = 192
INTERVAL = 511
MESSAGE = 512
