"""The outcome of a run: one row, with the same columns for mathematics and for every kind of flight."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple, Protocol

from guidance.game import Winner
from guidance.sim.expect import WINNERS
from guidance.sim.scenario import Scenario


class Outcome(NamedTuple):
    """The outcome of one run; NaN if a value does not exist.

    Attributes:
        scenario: Title of the scenario.
        run: "maths", "fast", "live" or "vehicle".
        game: "pe" or "tad".
        pursuer_policy: Name.
        evader_policy: Name.
        seed: Of all random numbers.
        end: "captured", "arrived" (the evader at its target), "time_up", "yielded" (to a pilot), "failed", or "invalid"
            (the scenario allows no game; only in sweeps).
        winner: "pursuer", "evader" or "none".
        predicted_winner: Of the game's solution at engagement: "pursuer", "evader" or "none" (on the barrier).
        game_time_s: From engagement to the end of the game.
        capture_time_s: The same; NaN without a capture.
        final_distance_m: TAD: of the evader from its target at the end. PE: of the pursuer from the stand-off disc.
        predicted: The game's value at engagement: s until capture (PE), or m from the target (TAD); where the evader
            wins, the m that the pursuer comes short.
        time_needed_s: What the vehicle promised at engagement: the time to the meeting, from the velocity that it had
            and with its acceleration. In mathematics, where no pursuer accelerates, the game's own.
        achieved: What it came to in the same unit; NaN in PE without a capture, and in TAD where nobody got there.
        regret: What the pursuer lost against the value: achieved − predicted in PE, predicted − achieved in TAD, where
            it wants the evader far from the target; NaN where the value has another meaning, as the evader wins.
        ratio: achieved / predicted.
        min_standoff_m: Least horizontal distance between the players in the game.
        min_altitude_m: Least height of the pursuer above the site in the game.
        limits: Limits that changed a command in the game.
        alarms: Number of broken guarantees.
        events: Names of events since engagement.
        duration_s: Of the whole run.
        reason: Why the row is invalid or failed; otherwise empty.
    """

    scenario: str
    run: str
    game: str
    pursuer_policy: str
    evader_policy: str
    seed: int
    end: str
    winner: str
    predicted_winner: str
    game_time_s: float
    capture_time_s: float
    final_distance_m: float
    predicted: float
    time_needed_s: float
    achieved: float
    regret: float
    ratio: float
    min_standoff_m: float
    min_altitude_m: float
    limits: tuple[str, ...]
    alarms: int
    events: tuple[str, ...]
    duration_s: float
    reason: str = ""


def outcome_of(
    scenario: Scenario,
    run: str,
    *,
    end: str,
    game_time_s: float,
    final_distance_m: float,
    predicted: float,
    predicted_winner: str,
    time_needed_s: float,
    min_standoff_m: float,
    min_altitude_m: float,
    duration_s: float,
    limits: Iterable[str] = (),
    alarms: int = 0,
    events: Iterable[str] = (),
    reason: str = "",
) -> Outcome:
    """Return a complete row; derived columns are computed here for every kind of run.

    Args:
        scenario: Of the run.
        run: `maths`, `fast`, `live` or `vehicle`.
        end: As in `Outcome`.
        game_time_s: From engagement to the end.
        final_distance_m: As in `Outcome`.
        predicted: The game's value at engagement: s in PE, m in TAD.
        predicted_winner: `pursuer`, `evader` or `none`.
        time_needed_s: As in `Outcome`.
        min_standoff_m: As in `Outcome`.
        min_altitude_m: As in `Outcome`.
        duration_s: Of the whole run.
        limits: Names of the active ones.
        alarms: Their number.
        events: In order.
        reason: Why the run failed.
    """
    comparable = predicted_winner != "evader"
    achieved, regret = achieved_and_regret(scenario.game, end, game_time_s, final_distance_m, predicted)
    return Outcome(
        scenario=scenario.title,
        run=run,
        game=scenario.game,
        pursuer_policy=scenario.pursuer.policy,
        evader_policy=scenario.evader.policy,
        seed=scenario.seed,
        end=end,
        winner=WINNERS.get(end, "none"),
        predicted_winner=predicted_winner,
        game_time_s=game_time_s,
        capture_time_s=game_time_s if end == "captured" else math.nan,
        final_distance_m=final_distance_m,
        predicted=predicted,
        time_needed_s=time_needed_s,
        achieved=achieved,
        regret=regret if comparable else math.nan,
        ratio=achieved / predicted if comparable and predicted else math.nan,
        min_standoff_m=min_standoff_m,
        min_altitude_m=min_altitude_m,
        limits=tuple(limits),
        alarms=alarms,
        events=tuple(events),
        duration_s=duration_s,
        reason=reason,
    )


def achieved_and_regret(
    game: str, end: str, game_time_s: float, final_distance_m: float, predicted: float
) -> tuple[float, float]:
    """Return the achieved value of a game and the pursuer's regret, both in the unit of the value.

    Args:
        game: "pe" or "tad".
        end: As in `Outcome`.
        game_time_s: From engagement to the end.
        final_distance_m: Of the evader from its target, in TAD.
        predicted: The game's value at engagement: s in PE, m in TAD.
    """
    if game == "pe":
        achieved = game_time_s if end == "captured" else math.nan
        return achieved, achieved - predicted
    achieved = final_distance_m if end == "captured" else (0.0 if end == "arrived" else math.nan)
    return achieved, predicted - achieved


def final_distance_m(scenario: Scenario, pursuer_m: Sequence[float], evader_m: Sequence[float]) -> float:
    """Return `Outcome.final_distance_m` from the last positions; heights are above the evader's plane."""
    if scenario.target is not None:
        return math.dist(evader_m[:2], scenario.target.position_m)
    disc = scenario.standoff
    beside = max(0.0, math.dist(pursuer_m[:2], evader_m[:2]) - disc.radius_m)
    return math.hypot(beside, pursuer_m[2] - (disc.height_m - scenario.evader.height_m))


def winner_name(winner: int) -> str:
    """Return the name of a `guidance.game.Winner`."""
    return {int(Winner.PURSUER): "pursuer", int(Winner.EVADER): "evader"}.get(winner, "none")


def invalid(title: str, run: str, reason: str) -> Outcome:
    """Return the row of a scenario that allows no game."""
    nan = math.nan
    numbers = (nan, nan, nan, nan, nan, nan, nan, nan, nan, nan)
    return Outcome(title, run, "", "", "", 0, "invalid", "none", "none", *numbers, (), 0, (), nan, reason)


def rows(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Return outcomes as dictionaries."""
    return [outcome._asdict() for outcome in outcomes]


_DIGITS: Final = 9
"""Decimal places in JSON: nanoseconds and nanometres. Later digits are rounding errors, as in 5.4199999999998845."""


class OutcomeRow(Protocol):
    """A named tuple of columns."""

    def _asdict(self) -> dict[str, Any]: ...


def outcome_json(outcome: OutcomeRow) -> dict[str, Any]:
    """Return an outcome for JSON: numbers with nine decimal places, NaN as None."""
    return {name: _as_json(value) for name, value in outcome._asdict().items()}


def _as_json(value: Any) -> Any:  # noqa: ANN401 - any column
    if not isinstance(value, float):
        return value
    return None if math.isnan(value) else round(value, _DIGITS) + 0.0
