"""Scenarios as pure mathematics: point masses that fly what their strategies say, one game or a batch.

Velocities are held from cycle to cycle as in a flight, and the end is located exactly: a step is never longer than the
least time in which the end could come, so that none is stepped over. Every game has its own clock, and a game in a
batch is the same, bit for bit, as alone.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from guidance.flight import Event, State
from guidance.flight.settings import LIMITS_S
from guidance.game import Game, Solution, solve
from guidance.game.arrays import Real, quiet
from guidance.game.rollout import NANOSECOND_S, Ahead, look_ahead
from guidance.sim.batch import Array, Batch, keep, kind_of, stack, starts
from guidance.sim.outcome import Outcome, final_distance_m, outcome_of, winner_name
from guidance.sim.scenario import Scenario
from guidance.sim.sensor import PERFECT, TIMEOUT_S, Known, Received, begin, known, listen, next_event_s
from guidance.strategies import OPTIMAL, StrategyMemory, evade, pursue

CYCLE_S = 0.02
"""How long velocities are held at most: the cycle of a flight."""

_SHARE_LEFT = 0.75
"""Games that have ended are cleared away when so few are left; until then they stand still."""

_LONG_LOST_S = LIMITS_S[State.PAUSED]
_RUNNING, _CAPTURED, _ARRIVED, _TIME_UP, _FAILED = range(5)
_ENDS = ("running", "captured", "arrived", "time_up", "failed")
_LIMITS = ("fence", "floor", "ceiling")


class Moment(NamedTuple):
    """A batch of games at one moment of each, rows (n, …).

    Attributes:
        row: Number of the game.
        now_s: Its own clock.
        pursuer_m: Position.
        evader_m: Position.
        flown_m_s: Velocity of the pursuer in the step before.
        run_m_s: Velocity of the evader in the step before.
        step_s: How long that was.
        heard: What the pursuer was told; None where it sees everything.
        lost_s: For how long it has waited for news.
        standoff_m: Least horizontal distance so far.
        altitude_m: Least height above the evader's plane so far.
        met: Which of `_LIMITS` have held the pursuer back, (n, 3).
        lost: Whether the evader was ever lost.
        no_game: Whether the evader was too fast for a game.
        end: One of `_ENDS`.
    """

    row: NDArray[np.intp]
    now_s: Array
    pursuer_m: Array
    evader_m: Array
    flown_m_s: Array
    run_m_s: Array
    step_s: Array
    heard: Received | None
    lost_s: Array
    standoff_m: Array
    altitude_m: Array
    met: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    no_game: NDArray[np.bool_]
    end: NDArray[np.int8]


def play(
    scenarios: Sequence[Scenario], *, cycle_s: float = CYCLE_S, on_end: Callable[[], None] = lambda: None
) -> list[Outcome]:
    """Play scenarios to their ends; outcomes in their order. Faults are not played: they are an autopilot's.

    Args:
        scenarios: What is played, of any kinds.
        cycle_s: How long velocities are held at most.
        on_end: Called whenever a game has ended, in any order.
    """
    kinds: dict[Hashable, list[int]] = {}
    for index, scenario in enumerate(scenarios):
        kinds.setdefault(kind_of(scenario), []).append(index)
    outcomes: dict[int, Outcome] = {}
    for indices in kinds.values():
        alike = [scenarios[index] for index in indices]
        for row, outcome in _play_alike(alike, cycle_s):
            outcomes[indices[row]] = outcome
            on_end()
    return [outcomes[index] for index in range(len(scenarios))]


def moments(scenarios: Sequence[Scenario], *, cycle_s: float = CYCLE_S) -> Iterator[Moment]:
    """Play scenarios of one kind; yield every moment, with some games that have ended still among them."""
    batch, moment = stack(scenarios), _begin(scenarios)
    with quiet(np):
        while len(moment.row):
            game = game_of(batch, batch.evader_speed_m_s)
            ahead = look_ahead(np, game, moment.pursuer_m, moment.evader_m, batch.target_m)
            moment = moment._replace(end=_judge(batch, moment, ahead))
            yield moment
            running = moment.end == _RUNNING
            if np.count_nonzero(running) <= _SHARE_LEFT * len(running):
                batch, moment, ahead = (keep(part, running) for part in (batch, moment, ahead))
            if len(moment.row):
                moment = _advance(batch, moment, ahead, cycle_s)


def opening(scenarios: Sequence[Scenario]) -> Solution:
    """Solve the games of scenarios of one kind at their engagement, as the pursuer knows them then."""
    batch = stack(scenarios)
    P, E = starts(scenarios)
    return solve(game_of(batch, batch.believed_m_s), P, E, batch.target_m)


def _play_alike(scenarios: Sequence[Scenario], cycle_s: float) -> Iterator[tuple[int, Outcome]]:
    first = opening(scenarios)
    told = np.zeros(len(scenarios), dtype=bool)
    for moment in moments(scenarios, cycle_s=cycle_s):
        for place in np.flatnonzero((moment.end != _RUNNING) & ~told[moment.row]):
            row = int(moment.row[place])
            told[row] = True
            yield row, _outcome(scenarios[row], first, row, moment, int(place))


def _begin(scenarios: Sequence[Scenario]) -> Moment:
    P, E = starts(scenarios)
    count = len(scenarios)
    zeros = np.zeros(count)
    no = np.zeros(count, dtype=bool)
    sensor = scenarios[0].sensor
    return Moment(
        row=np.arange(count),
        now_s=zeros,
        pursuer_m=P,
        evader_m=E,
        flown_m_s=np.zeros_like(P),
        run_m_s=np.zeros_like(E),
        step_s=zeros,
        heard=None if sensor == PERFECT else begin(sensor, E),
        lost_s=zeros,
        standoff_m=_beside(P, E),
        altitude_m=P[:, 2],
        met=np.zeros((count, len(_LIMITS)), dtype=bool),
        lost=no,
        no_game=no,
        end=np.zeros(count, dtype=np.int8),
    )


def _judge(batch: Batch, moment: Moment, ahead: Ahead) -> NDArray[np.int8]:
    """Say which games have ended now; capture comes before arrival where both are now."""
    now = np.where(moment.now_s >= batch.limit_s, _TIME_UP, _RUNNING)
    now = np.where(moment.no_game | (moment.lost_s >= _LONG_LOST_S), _FAILED, now)
    now = np.where(ahead.arrival_s <= NANOSECOND_S, _ARRIVED, now)
    now = np.where(ahead.capture_s <= NANOSECOND_S, _CAPTURED, now)
    return np.where(moment.end == _RUNNING, now, moment.end).astype(np.int8)


def _advance(batch: Batch, moment: Moment, ahead: Ahead, cycle_s: float) -> Moment:
    """Ask both players, and move both for as long as nothing can happen; games that have ended stand still."""
    sensor, heard, seen = batch.kind.sensor, moment.heard, _everything(batch, moment)
    if heard is not None:
        heard = listen(sensor, batch.noise, heard, moment.now_s, moment.evader_m, moment.run_m_s)
        seen = known(batch.noise, heard, batch.believed_m_s, moment.now_s)
    v, w = _velocities(batch, moment, seen, exact=heard is None)
    no_game = ~np.isfinite(v[:, 0])
    waiting = seen.age_s > TIMEOUT_S
    v[no_game | waiting] = 0.0
    h = np.minimum(cycle_s, batch.limit_s - moment.now_s)
    for limit in (ahead.capture_s, ahead.arrival_s, ahead.turn_s, *_changes_s(batch, moment, heard)):
        h = np.minimum(h, limit)
    h = np.where(moment.end == _RUNNING, h, 0.0)
    P, met = _held_back(batch, moment.pursuer_m + h[:, None] * v)
    E = moment.evader_m + h[:, None] * w
    return moment._replace(
        now_s=moment.now_s + h,
        pursuer_m=P,
        evader_m=E,
        flown_m_s=v,
        run_m_s=w,
        step_s=h,
        heard=heard,
        lost_s=np.where(waiting, moment.lost_s + h, 0.0),
        standoff_m=np.minimum(moment.standoff_m, _beside(P, E)),
        altitude_m=np.minimum(moment.altitude_m, P[:, 2]),
        met=moment.met | met,
        lost=moment.lost | waiting,
        no_game=moment.no_game | no_game,
    )


def game_of(batch: Batch, evader_speed_m_s: Real, age_s: Real = 0.0) -> Game:
    """Return the games of a batch; captured is who is within the tolerance of the disc, in the way of its speed set."""
    return Game(
        batch.speeds,
        evader_speed_m_s,
        capture_radius_m=batch.tolerance_m,
        standoff=batch.standoff,
        information_age_s=age_s,
        wind_m_s=batch.wind_m_s,
    )


def _everything(batch: Batch, moment: Moment) -> Known:
    """What a pursuer knows that sees the evader itself."""
    bound = batch.believed_m_s
    if not batch.agreed:
        bound = np.maximum(bound, np.sqrt(moment.run_m_s[:, 0] ** 2 + moment.run_m_s[:, 1] ** 2))
    return Known(moment.evader_m, moment.run_m_s, bound, np.zeros(len(moment.row)))


def _velocities(batch: Batch, moment: Moment, seen: Known, *, exact: bool) -> tuple[Array, Array]:
    """Return both players' velocities, (n, 3); two optimal players that agree on the game are solved once."""
    P, E, T = moment.pursuer_m, moment.evader_m, batch.target_m
    game = game_of(batch, seen.speed_bound_m_s, 0.0 if exact else np.minimum(seen.age_s, TIMEOUT_S))
    if exact and batch.agreed and batch.pursuer.name == batch.evader.name == OPTIMAL:
        solution = solve(game, P, E, T, evader_velocity_m_s=seen.velocity_m_s)
        return solution.pursuer_velocity_m_s, solution.evader_velocity_m_s
    memory = StrategyMemory(moment.flown_m_s, moment.now_s)
    flown = pursue(batch.pursuer, game, P, seen.position_m, T, seen.velocity_m_s, memory, dt_s=moment.step_s)
    run = evade(batch.evader, game_of(batch, batch.evader_speed_m_s), P, E, T, memory)
    return flown, run


def _changes_s(batch: Batch, moment: Moment, heard: Received | None) -> Iterator[Array]:
    """In how long, (n,), a course turns or a report is due."""
    for strategy in (batch.pursuer, batch.evader):
        if strategy.course is not None:
            yield strategy.course.corner_s(moment.now_s) - moment.now_s
    if heard is not None:
        yield next_event_s(batch.kind.sensor, heard) - moment.now_s


def _held_back(batch: Batch, P: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Keep the pursuer within the fence, above the floor and below the ceiling; say which of them it met."""
    x, y = P[:, 0] - batch.home_m[:, 0], P[:, 1] - batch.home_m[:, 1]
    out = np.sqrt(x**2 + y**2)
    beyond = out > batch.fence_m
    back = np.where(beyond, 1.0 - batch.fence_m / np.where(beyond, out, 1.0), 0.0)
    low, high = P[:, 2] < batch.lowest_m, P[:, 2] > batch.highest_m
    height = np.minimum(np.maximum(P[:, 2], batch.lowest_m), batch.highest_m)
    held = np.stack([P[:, 0] - back * x, P[:, 1] - back * y, height], axis=-1)
    return held, np.stack([beyond, low, high], axis=-1)


def _beside(P: Array, E: Array) -> Array:
    return np.asarray(np.sqrt((P[:, 0] - E[:, 0]) ** 2 + (P[:, 1] - E[:, 1]) ** 2))


def _outcome(scenario: Scenario, first: Solution, row: int, moment: Moment, place: int) -> Outcome:
    end = _ENDS[moment.end[place]]
    P, E = moment.pursuer_m[place], moment.evader_m[place]
    events = {
        Event.EVADER_LOST: bool(moment.lost[place]),
        Event.NO_GAME: bool(moment.no_game[place]),
        Event.CAPTURED: end == "captured",
        Event.ESCAPED: end == "arrived",
    }
    return outcome_of(
        scenario,
        "maths",
        end=end,
        game_time_s=float(moment.now_s[place]),
        final_distance_m=final_distance_m(scenario, P, E),
        predicted=float(first.value[row]),
        predicted_winner=winner_name(int(first.winner[row])),
        time_needed_s=float(first.meeting_time_s[row]),
        min_standoff_m=float(moment.standoff_m[place]),
        min_altitude_m=float(moment.altitude_m[place]) + scenario.evader.height_m,
        duration_s=float(moment.now_s[place]),
        limits=[name for name, met in zip(_LIMITS, moment.met[place], strict=True) if met],
        events=[str(event) for event, happened in events.items() if happened],
        reason="" if end != "failed" else str(Event.NO_GAME if moment.no_game[place] else Event.EVADER_LOST),
    )
