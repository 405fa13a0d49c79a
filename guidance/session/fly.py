"""One mocked flight from connecting to disarming, in whichever world and on whichever clock."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from guidance.certificate import Certificate
from guidance.clock import Clock, Timing
from guidance.flight import Flight, Happening, Outputs, State
from guidance.frames import Vector
from guidance.log.writer import Record
from guidance.messages import LocalPosition
from guidance.monitor import Alarm
from guidance.session.linked_flight import LinkedFlight, Stopped
from guidance.session.sequencer import MissionSequencer
from guidance.session.spec import plan_of
from guidance.sim.evader import EvaderPilot
from guidance.sim.players import evader_settings
from guidance.sim.scenario import Scenario
from guidance.sim.sensed_evader import SensedEvader
from guidance.sim.world import World

CYCLE_S = 0.02
"""50 Hz: the rate at which setpoints are computed and sent."""

MISSION_LIMIT_S = 900.0


class Progress(NamedTuple):
    """What the live line shows; `waiting` is what a vehicle on the ground is not ready for want of."""

    now_s: float
    state: State
    mode: str
    certificate: Certificate | None
    unit: str
    record_stopped: Stopped | None = None
    waiting: str = ""


class FlightSample(NamedTuple):
    """One point of both tracks, in the game frame."""

    now_s: float
    state: State
    pursuer_m: Vector
    evader_m: Vector


@dataclass(slots=True)
class FlightResult:
    """What a flight came to.

    `predicted` is what the first certificate said (s in PE, m in TAD), to the disc itself, `time_needed_s` when this
    vehicle would be there, and `achieved` what was flown, NaN where it did not come to that. What is compared with
    other runs is the `Outcome` made of it. `said` is the autopilot's last warning before it flew; `interrupted` whether
    a person ended the run.
    """

    scenario: Scenario
    ended: State
    predicted: float = math.nan
    time_needed_s: float = math.nan
    achieved: float = math.nan
    capture_time_s: float = math.nan
    meeting_point_m: Vector | None = None
    engaged_pursuer_m: Vector | None = None
    engaged_evader_m: Vector | None = None
    captured: bool = False
    timed_out: bool = False
    setpoints_sent: int = 0
    late_cycles: int = 0
    cycles: int = 0
    duration_s: float = 0.0
    wall_s: float = 0.0
    samples: list[FlightSample] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    alarms: list[tuple[float, Alarm]] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    record_stopped: Stopped | None = None
    said: str = ""
    interrupted: bool = False


def fly(
    scenario: Scenario,
    world: World,
    clock: Clock,
    recorder: Record | None,
    progress: Callable[[Progress], None],
) -> FlightResult:
    """Fly a scenario to its end.

    Raises:
        ConfigError: If the scenario names what does not exist.
        LinkError: If the world ends before the flight does.
    """
    flight = Flight(plan_of(scenario=scenario).flight)
    heard = SensedEvader(world.evader_source, scenario.sensor, scenario.seed, clock.now_s)
    linked = LinkedFlight(flight, world.pursuer, heard, recorder)
    evader = EvaderPilot(world.evader, evader_settings(scenario))
    director = MissionSequencer(hold_s=scenario.hold_s, time_limit_s=scenario.time_limit_s)
    result = FlightResult(scenario, State.CONNECTING)

    unit = "s" if scenario.target is None else "m"
    due_s = start_s = clock.now_s()
    worked_s = 0.0
    while not director.finished and due_s - start_s < MISSION_LIMIT_S:
        clock.sleep_until(due_s)
        world.advance()
        now_s = clock.now_s()
        late_s = now_s - due_s
        result.late_cycles += late_s > CYCLE_S
        due_s = max(due_s + CYCLE_S, now_s)  # a late cycle is not made up for by two at once

        pursuer_m = pursuer_game_m(flight)
        evader.step(now_s, pursuer_m, playing=director.playing)
        fresh = flight.tracking.silence_s(now_s) < 0.5
        orders = director.orders(now_s, evader_ready=evader.ready, evader_fresh=fresh)
        outputs = linked.run(now_s, orders, timing=Timing(late_s, worked_s))
        director.follow(now_s, outputs)
        if director.engaged_s == now_s:
            heard.engage(now_s)
            world.engage()
        if recorder is not None:
            for passed in world.drain():
                recorder.frame(*passed)
        note(result, now_s, outputs, pursuer_m, evader.position_game_m())
        worked_s = clock.now_s() - now_s
        progress(Progress(now_s, outputs.state, flight.mode_name, outputs.certificate, unit, linked.record_stopped))

    evader.stop()
    result.record_stopped = linked.record_stopped
    conclude(result, director, clock.now_s() - start_s)
    return result


def pursuer_game_m(flight: Flight) -> Vector | None:
    """Return where the vehicle's own telemetry has it in the game frame, None until heard."""
    local, frame = flight.vehicle.last(LocalPosition), flight.tracking.game_frame
    return None if local is None or frame is None else frame.position_from_ned(local.position_ned_m)


def note(
    result: FlightResult, now_s: float, outputs: Outputs, pursuer_m: Vector | None, evader_m: Vector | None
) -> None:
    """Take one cycle into a result."""
    result.cycles += 1
    result.setpoints_sent += outputs.setpoint is not None
    result.ended = outputs.state
    result.happenings.extend(outputs.happenings)
    if outputs.alarm is not None:
        result.alarms.append((now_s, outputs.alarm))
    if pursuer_m is not None and evader_m is not None:
        result.samples.append(FlightSample(now_s, outputs.state, pursuer_m, evader_m))
    certificate = outputs.certificate
    if certificate is None:
        return
    result.limits.extend(name for name in certificate.acted if name not in result.limits)
    if math.isnan(result.predicted):
        result.predicted, result.time_needed_s = certificate.value, certificate.time_needed_s
        result.meeting_point_m = certificate.meeting_point_game_m
        result.engaged_pursuer_m, result.engaged_evader_m = certificate.pursuer_game_m, certificate.evader_game_m
    if certificate.captured and not result.captured:
        result.captured = True
        result.achieved = _distance_to_target(result.scenario, certificate.evader_game_m)


def _distance_to_target(scenario: Scenario, evader_m: Vector) -> float:
    return math.nan if scenario.target is None else math.dist(evader_m[:2], scenario.target.position_m)


def conclude(result: FlightResult, director: MissionSequencer, duration_s: float) -> None:
    """Complete a result when the flight is over."""
    result.duration_s = duration_s
    result.timed_out = director.timed_out
    if director.engaged_s is None or director.captured_s is None:
        return
    result.capture_time_s = director.captured_s - director.engaged_s
    if result.scenario.target is None:
        result.achieved = result.capture_time_s
