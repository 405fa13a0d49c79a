"""The result of a flight, and its outcome row, which has the columns of a mathematical run.

The predicted value is solved again where the game really began, to the set that counts as captured. It is the game that
was flown: in still air, because the autopilot holds the speed over the ground against the wind and no player knows it.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from guidance.cycle import Alarm, Certificate, CycleSettings
from guidance.flight import Authority, Event, Outputs, State, Transition
from guidance.flight.table import SETPOINT_STATES
from guidance.frames import Enu
from guidance.game import Solution, solve
from guidance.game.team import between, match_teams
from guidance.log.writer import Record, Recorder
from guidance.sim.outcome import Outcome, distances_of, outcome_of, winner_name
from guidance.sim.scenario import Scenario
from guidance.sim.teams import TeamOutcome, TeamScenario, outcomes_of, teams_of
from guidance.team import Member

PLAYING = frozenset({State.ENGAGED, State.PAUSED})
PLAYED = PLAYING | {State.ON_STATION}

_ENDS: Mapping[Event, str] = {
    Event.CAPTURED: "captured",
    Event.ESCAPED: "arrived",
    Event.PILOT: "yielded",
}


class FlightSample(NamedTuple):
    """One point of both tracks, in the game frame."""

    now_s: float
    state: State
    pursuer_m: Enu
    evader_m: Enu


@dataclass(slots=True)
class FlightResult:
    """Result of a flight.

    `cycle` has the game that was flown, `engaged` is the first certificate and `latest` the last one, `said` the
    autopilot's last warning before it flew, and `interrupted` whether a person ended the run.
    """

    scenario: Scenario
    cycle: CycleSettings
    ended: State
    reachable_speed_m_s: float = math.nan
    engaged: Certificate | None = None
    latest: Certificate | None = None
    captured: bool = False
    setpoints_sent: int = 0
    late_cycles: int = 0
    cycles: int = 0
    duration_s: float = 0.0
    wall_s: float = 0.0
    samples: list[FlightSample] = field(default_factory=list)
    transitions: list[Transition] = field(default_factory=list)
    alarms: list[tuple[float, Alarm]] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    record_stopped: str = ""
    record_dropped: int = 0
    said: str = ""
    interrupted: bool = False

    def note(
        self, now_s: float, outputs: Outputs, pursuer_m: Enu | None, evader_m: Enu | None
    ) -> None:
        """Add one cycle.

        Args:
            now_s: The present.
            outputs: Of the cycle.
            pursuer_m: Where it is in the game frame; None where that is not known.
            evader_m: The same of the evader.
        """
        self.cycles += 1
        self.setpoints_sent += outputs.setpoint is not None
        self.ended = outputs.state
        self.transitions.extend(outputs.transitions)
        if any(map(begins_game, outputs.transitions)):
            self.engaged = None
            self.captured = False
        if outputs.alarm is not None:
            self.alarms.append((now_s, outputs.alarm))
        if pursuer_m is not None and evader_m is not None:
            self.samples.append(FlightSample(now_s, outputs.state, pursuer_m, evader_m))
        if (certificate := outputs.certificate) is not None:
            self.latest = certificate
            reachable = (self.reachable_speed_m_s, certificate.reachable_speed_m_s)
            self.reachable_speed_m_s = min(
                (speed_m_s for speed_m_s in reachable if not math.isnan(speed_m_s)),
                default=math.nan,
            )
            self.limits.extend(
                name for name in certificate.active_limits if name not in self.limits
            )
            if self.engaged is None or math.isnan(self.engaged.value):
                self.engaged = certificate
            self.captured |= certificate.captured


class Capture(NamedTuple):
    """The capture of an evader: by whom, when, and where the captor saw it, in the game frame.

    The captor's estimate is what its record has. So terminal and report tell the same distance.
    """

    vehicle: str
    now_s: float
    evader_m: Enu


@dataclass(slots=True)
class EvaderResult:
    """Result of one evader: its track (time, position in the game frame), and its first capture."""

    track: list[tuple[float, Enu]] = field(default_factory=list)
    capture: Capture | None = None


class MissionResult(NamedTuple):
    """Result of a mission: one entry for each vehicle and each evader, by name; `members` are those of a team."""

    vehicles: dict[str, FlightResult]
    evaders: dict[str, EvaderResult]
    members: Mapping[str, Member]

    def least_distance_m(self, height_m: float) -> float:
        """Return the least horizontal distance of two flying vehicles at less than `height_m` of height."""
        tracks = []
        for flight in self.vehicles.values():
            track = {
                sample.now_s: sample.pursuer_m
                for sample in flight.samples
                if sample.state in SETPOINT_STATES
            }
            tracks.append(track)
        return least_distance_m(tracks, height_m)


def least_distance_m(tracks: Sequence[Mapping[float, Enu]], height_m: float) -> float:
    """Return the least horizontal distance of two vehicles whose heights differed by less than `height_m`.

    Args:
        tracks: Of each vehicle while it flew by setpoints: time, s, and place, m.
        height_m: Vehicles farther apart in height do not count.

    Returns:
        Infinity if heights always separated them.
    """
    least_m = math.inf
    for first, second in combinations(tracks, 2):
        for at_s in first.keys() & second.keys():
            first_m = first[at_s]
            second_m = second[at_s]
            if abs(first_m[2] - second_m[2]) < height_m:
                least_m = min(least_m, math.dist(first_m[:2], second_m[:2]))
    return least_m


def outcome_of_flight(result: FlightResult, way: str) -> Outcome:
    """Return the row of a flight; `way` is "fast", "live" or "vehicle"."""
    scenario = result.scenario
    if (
        began := next(
            (transition for transition in reversed(result.transitions) if begins_game(transition)),
            None,
        )
    ) is None:
        ends = {State.HOLDING, State.LANDING, State.RETURNING, State.YIELDED, State.FAILED}
        cause = next(
            (transition for transition in result.transitions if transition.after in ends), None
        )
        end = "yielded" if cause is not None and cause.event is Event.PILOT else "failed"
        reason = _unfinished(result) if cause is None else f"{cause.event} while {cause.before}"
        if cause is not None and cause.event is Event.TIMED_OUT and cause.detail:
            reason += f" ({cause.detail})"
        reason += f'; the autopilot said "{result.said}"' if result.said else ""
        return outcome_of(
            result.scenario,
            way,
            end=end,
            duration_s=result.duration_s,
            reason=f"never engaged: {reason}",
        )
    since_engagement = [
        transition for transition in result.transitions if transition.now_s > began.now_s
    ]
    end, end_s, reason = _ending(result, since_engagement)
    game = [sample for sample in result.samples if began.now_s <= sample.now_s <= end_s]
    # If the evader was too fast, the game has no value.
    value = math.nan
    winner = "none"
    if result.engaged is not None:
        solution = predicted(result.cycle, result.engaged)
        value = float(solution.value)
        winner = winner_name(int(solution.winner))
    distances: Mapping[str, Any] = {}
    if game:
        distances = distances_of(scenario, game[-1].pursuer_m, game[-1].evader_m)
    return outcome_of(
        scenario,
        way,
        end=end,
        game_time_s=end_s - began.now_s,
        **distances,
        predicted=value,
        predicted_winner=winner,
        time_needed_s=math.nan if result.engaged is None else result.engaged.time_needed_s,
        min_standoff_m=min(
            (math.dist(sample.pursuer_m[:2], sample.evader_m[:2]) for sample in game),
            default=math.nan,
        ),
        min_altitude_m=min((sample.pursuer_m[2] for sample in game), default=math.nan)
        + scenario.evader.height_m,
        duration_s=result.duration_s,
        reachable_speed_m_s=result.reachable_speed_m_s,
        limits=tuple(result.limits),
        alarms=len(result.alarms),
        events=tuple(dict.fromkeys(str(transition.event) for transition in since_engagement)),
        reason=reason,
    )


def closing_detail(
    result: FlightResult, way: str, record: Record | None, folder: Path | None
) -> str:
    """Return the detail of a broadcast's last event, as `guidance.log.entries.FLIGHT_OVER` describes it."""
    ending = "interrupted" if result.interrupted else ending_words(outcome_of_flight(result, way))
    detail = {"ended": f"{ending}; {result.ended}"}
    if isinstance(record, Recorder) and folder is not None:
        replay = record.path.absolute().relative_to(folder.absolute().parent)
        detail |= {"record": str(record.path), "replay": replay.as_posix()}
    return json.dumps(detail)


def ending_words(outcome: Outcome) -> str:
    """Say in a few words how a run ended."""
    words = {
        "arrived": "evader reached its target",
        "time_up": "time limit reached",
        "yielded": "yielded to a pilot",
    }
    return (
        f"failed: {outcome.reason}"
        if outcome.end == "failed"
        else words.get(outcome.end, outcome.end)
    )


def begins_game(transition: Transition) -> bool:
    """True if a game began; an operator may engage another one after a hold."""
    return transition.after is State.ENGAGED and transition.before not in PLAYED


def _ending(result: FlightResult, transitions: list[Transition]) -> tuple[str, float, str]:
    """Find the event that ended the game; return `Outcome.end`, its time, and the reason of a failure."""
    last = next(
        (
            transition
            for transition in transitions
            if transition.before in PLAYING and transition.after not in PLAYING
        ),
        None,
    )
    if last is None:
        return (
            "failed",
            result.samples[-1].now_s if result.samples else math.nan,
            _unfinished(result),
        )
    # During the game a mission gives no order but at the time limit.
    end = "time_up" if last.by is Authority.MISSION else _ENDS.get(last.event, "failed")
    if last.by is Authority.OPERATOR:
        return (end, last.now_s, f"{last.event} ordered by operator")
    if end != "failed":
        return (end, last.now_s, str(last.event) if end == "yielded" else "")
    # After a pause that lasted too long, the reason is the missing input.
    paused = [
        transition.event
        for transition in transitions
        if transition.after is State.PAUSED and transition.now_s < last.now_s
    ]
    return (
        end,
        last.now_s,
        str(paused[-1] if paused and last.event is Event.TIMED_OUT else last.event),
    )


def _unfinished(result: FlightResult) -> str:
    return f"still {result.ended} when the run was given up"


def predicted(cycle: CycleSettings, engaged: Certificate) -> Solution:
    """Solve the game that a flight played, where it began, to the set that counts as captured.

    Args:
        cycle: Settings of the flight.
        engaged: The certificate at engagement.
    """
    game = replace(cycle.game, capture_radius_m=cycle.tolerance_m)
    return solve(game, engaged.pursuer_game_m, engaged.evader_game_m, cycle.target_game_m)


def distance_to_target_m(cycle: CycleSettings, evader_m: Enu) -> float:
    """Return the distance of an evader from its target, whatever the target's shape; NaN in PE."""
    target_m = cycle.target_game_m
    if target_m is None:
        return math.nan
    return cycle.game.target_extent.distance_m(target_m, evader_m)


def team_rows(scenario: TeamScenario, way: str, result: MissionResult) -> list[TeamOutcome]:
    """Return the rows, one for each evader; the game began when the last vehicle engaged. Without a game: none."""
    flights = list(result.vehicles.values())
    first_engaged_s = []
    for flight in flights:
        engaged_s = [change.now_s for change in flight.transitions if change.event is Event.GUIDED]
        if not engaged_s:
            return []
        first_engaged_s.append(engaged_s[0])
    began_s = max(first_engaged_s)
    names = sorted(result.evaders)
    ends = [_team_end(result, name, began_s) for name in names]
    teams = teams_of(scenario)
    cycle = flights[0].cycle
    pursuers = [flight.cycle.game.pursuer for flight in flights]
    game = between(cycle.game, pursuers, teams.evader_speed_m_s)
    places_m = []
    for flight in flights:
        track = [(sample.now_s, sample.pursuer_m) for sample in flight.samples]
        places_m.append(_at(track, began_s))
    P = np.array(places_m)
    E = np.array([_at(result.evaders[name].track, began_s) for name in names]) * [1.0, 1.0, 0.0]
    first = match_teams(game, P, E, cycle.target_game_m)
    return outcomes_of(scenario, way, teams, first, ends)


def _team_end(result: MissionResult, name: str, began_s: float) -> tuple[str, float, float, int]:
    """Return how an evader's game ended: the end, its time, s, the distance from the target, m, and the captor."""
    evader = result.evaders[name]
    cycle = next(iter(result.vehicles.values())).cycle
    capture = evader.capture
    if capture is not None:
        captor = list(result.vehicles).index(capture.vehicle)
        away_m = distance_to_target_m(cycle, capture.evader_m)
        return "captured", capture.now_s - began_s, away_m, captor
    known_s = [member.board.over.get(name, math.inf) for member in result.members.values()]
    arrived_s = min(known_s, default=math.inf)
    end = "arrived" if math.isfinite(arrived_s) else "time_up"
    end_s = arrived_s if math.isfinite(arrived_s) else evader.track[-1][0]
    return end, end_s - began_s, distance_to_target_m(cycle, _at(evader.track, end_s)), -1


def _at(track: Sequence[tuple[float, Enu]], now_s: float) -> Enu:
    """Return the last place of a track until a time."""
    return next((position_m for at_s, position_m in reversed(track) if at_s <= now_s), track[0][1])
