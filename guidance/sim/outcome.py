"""The outcome of a run: one row, with the same columns for mathematics and for every kind of flight."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from guidance.game import Winner
from guidance.sim.expect import WINNERS
from guidance.sim.scenario import Scenario


class Outcome(NamedTuple):
    """The outcome of one run. NaN means "there is none". Every column has one meaning in both games.

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
        predicted_winner: Of the game's solution at engagement: "pursuer", "evader" or "none" (on the barrier,
            or, in mathematics, so close to it that a cycle of held velocities decides).
        game_time_s: From engagement to the end of the game.
        capture_time_s: The same if the evader was captured.
        distance_to_disc_m: Distance of the pursuer from the stand-off disc at the end.
        evader_to_target_m: TAD: distance of the evader from its target at the end.
        predicted_capture_time_s: PE: the game's value at engagement.
        predicted_evader_to_target_m: TAD, pursuer predicted to win: the game's value at engagement, the distance of the
            evader from its target at the capture.
        predicted_short_m: TAD, evader predicted to win: by how much the pursuer is short of a capture.
        time_needed_s: The vehicle's promise at engagement: time to the meeting, from its velocity and with its
            acceleration. In mathematics, where no pursuer accelerates, the game's own.
        regret: The pursuer's loss against the value. PE: capture_time_s − predicted_capture_time_s, s. TAD:
            predicted_evader_to_target_m − evader_to_target_m, m.
        ratio: Achieved over predicted value, of the same two columns.
        reachable_speed_m_s: Smallest speed over the ground that the vehicle was seen to reach while asked for more; the
            configured speed if there was no such time. NaN in mathematics.
        min_standoff_m: Least horizontal distance of the players in the game.
        min_altitude_m: Least height of the pursuer above the site in the game.
        limits: Limits that changed a command in the game.
        alarms: Number of alarms of the monitor.
        events: Events since engagement, in order.
        duration_s: Of the whole run.
        reason: Why the row is invalid or failed; otherwise empty.
    """

    scenario: str
    run: str
    game: str = ""
    pursuer_policy: str = ""
    evader_policy: str = ""
    seed: int = 0
    end: str = "invalid"
    winner: str = "none"
    predicted_winner: str = "none"
    game_time_s: float = math.nan
    capture_time_s: float = math.nan
    distance_to_disc_m: float = math.nan
    evader_to_target_m: float = math.nan
    predicted_capture_time_s: float = math.nan
    predicted_evader_to_target_m: float = math.nan
    predicted_short_m: float = math.nan
    time_needed_s: float = math.nan
    regret: float = math.nan
    ratio: float = math.nan
    reachable_speed_m_s: float = math.nan
    min_standoff_m: float = math.nan
    min_altitude_m: float = math.nan
    limits: tuple[str, ...] = ()
    alarms: int = 0
    events: tuple[str, ...] = ()
    duration_s: float = math.nan
    reason: str = ""

    @property
    def predicted(self) -> float:
        """The game's value if the pursuer was predicted to win: s in PE, m in TAD."""
        return (
            self.predicted_capture_time_s
            if self.game == "pe"
            else self.predicted_evader_to_target_m
        )

    @property
    def achieved(self) -> float:
        """The same as played; in TAD NaN unless the evader was captured or arrived."""
        if self.game == "pe":
            return self.capture_time_s
        return self.evader_to_target_m if self.end in {"captured", "arrived"} else math.nan


def outcome_of(
    scenario: Scenario,
    run: str,
    *,
    end: str,
    predicted: float = math.nan,
    **measured: Any,  # noqa: ANN401 - columns
) -> Outcome:
    """Return a complete row: compute the columns that follow from the others, the same for every kind of run.

    Args:
        scenario: Of the run.
        run: `maths`, `fast`, `live` or `vehicle`.
        end: See `Outcome`.
        predicted: The game's value at engagement, for either winner.
        **measured: Other columns of `Outcome` that the run measures or predicts.
    """
    names = (scenario.title, run, scenario.game, scenario.pursuer.policy, scenario.evader.policy)
    row = Outcome(*names, scenario.seed, end, **measured)
    winnable = row.predicted_winner != "evader"
    _, columns = achieved_value(
        row.game, end, row.game_time_s, row.evader_to_target_m, predicted, promised=winnable
    )
    in_tad = "predicted_evader_to_target_m" if winnable else "predicted_short_m"
    columns["predicted_capture_time_s" if row.game == "pe" else in_tad] = predicted
    return row._replace(**columns)


def achieved_value(
    game: str, end: str, time_s: float, away_m: float, predicted: float, *, promised: bool
) -> tuple[float, dict[str, Any]]:
    """Return the achieved value of a game in the unit of the value, and the columns that follow from it and the end.

    Args:
        game: "pe" or "tad".
        end: As in `Outcome`.
        time_s: From engagement to the end.
        away_m: Distance of the evader from its target at the end, in TAD.
        predicted: The game's value at engagement: s in PE, m in TAD.
        promised: Whether the value was the pursuer's; else there is neither regret nor ratio.
    """
    capture_time_s = time_s if end == "captured" else math.nan
    if game == "pe":
        achieved = capture_time_s
        loss = achieved - predicted
    else:
        final_distances_m = {"captured": away_m, "arrived": 0.0}
        achieved = final_distances_m.get(end, math.nan)
        loss = predicted - achieved
    regret = loss if promised else math.nan
    ratio = achieved / predicted if promised and predicted else math.nan
    return achieved, {
        "winner": WINNERS.get(end, "none"),
        "capture_time_s": capture_time_s,
        "regret": regret,
        "ratio": ratio,
    }


def distances_of(
    scenario: Scenario, pursuer_m: Sequence[float], evader_m: Sequence[float]
) -> dict[str, float]:
    """Return the columns that follow from the players' positions at the end, above the evader's plane."""
    disc = scenario.standoff
    target = scenario.target
    apart_m = math.dist(pursuer_m[:2], evader_m[:2])
    beside_m = max(0.0, apart_m - disc.radius_m)
    disc_height_m = disc.height_m - scenario.evader.height_m
    above_m = pursuer_m[2] - disc_height_m
    evader_to_target_m = math.nan
    if target is not None:
        evader_to_target_m = target.extent.distance_m(target.position_m, evader_m)
    return {
        "distance_to_disc_m": math.hypot(beside_m, above_m),
        "evader_to_target_m": evader_to_target_m,
    }


def winner_name(winner: int) -> str:
    """Return the name of a `guidance.game.Winner`."""
    return {int(Winner.PURSUER): "pursuer", int(Winner.EVADER): "evader"}.get(winner, "none")


def outcome_json(outcome: Any) -> dict[str, Any]:  # noqa: ANN401 - an `Outcome`, or one of teams
    """Return an outcome for JSON: numbers with nine decimal places, NaN as None.

    Nine are nanoseconds and nanometres. Later digits are rounding errors, as in 5.4199999999998845.
    """
    return {
        name: value
        if not isinstance(value, float)
        else None
        if math.isnan(value)
        else round(value, 9) + 0.0
        for name, value in outcome._asdict().items()
    }
