"""Games of teams: their scenario file, `[[pursuer]]` and `[[evader]]` tables, and their play with point masses.

Positions are in the game frame, as in `guidance.sim.scenario`. A table can describe several equal players: the seed
scatters `count` of them over a disc, so a sweep can vary their number. Every evader has one outcome row.
"""

import math
from collections.abc import Hashable, Iterator, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema

from guidance.autopilots import AutopilotName
from guidance.config import Section
from guidance.flight.settings import TeamSection
from guidance.frames import Enu
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, End, Game
from guidance.game.arrays import FloatArray, Real
from guidance.game.game import NO_WIND
from guidance.game.rules import Rules, game_by
from guidance.game.team import TEAM_RULES, Matching, TeamRollout, match_teams, rollout_teams
from guidance.game.team.rollout import CAPTURES, held_m
from guidance.sim.batch import by_kind, target_extent
from guidance.sim.expect import Range, Ranges
from guidance.sim.outcome import achieved_value, winner_name
from guidance.sim.scenario import (
    PURSUER,
    AnyScenario,
    Point2,
    ScenarioLimits,
    Sensor,
    Site,
    Speed,
    Standoff,
    TakeoffHeight,
)
from guidance.sim.team_policies import own_rule
from guidance.strategies.own import as_one_text, is_own, policy_schema

PURSUER_PLAYS = (*PURSUER_POLICIES, CAPTURES, *TEAM_RULES)
"""Plays of a team's pursuers by name: policies against matched evaders, the play for captures, and rules."""

_TeamPursuerPolicy = Annotated[str, BeforeValidator(as_one_text), policy_schema(PURSUER_PLAYS)]
_TeamEvaderPolicy = Annotated[str, WithJsonSchema({"type": "string", "enum": [*EVADER_POLICIES]})]
GroundedHeight = Annotated[float, Field(ge=0.0)]


class PlayerGroup(Section):
    """One player, or several equal players around a place."""

    count: int = Field(1, ge=1, le=50, description="number of players of this table")
    scatter_m: float = Field(
        0.0, ge=0.0, le=1000.0, description="radius of the disc over which the seed scatters them"
    )
    speed_m_s: Speed = Field(description="speed in every direction")

    def _faults(self) -> Iterator[str]:
        if self.count > 1 and self.scatter_m == 0:
            yield f"scatter_m: missing; count = {self.count} players need a disc to be scattered over"


class PursuerGroup(PlayerGroup):
    """Pursuers in space."""

    policy: _TeamPursuerPolicy = Field(
        "optimal", description="strategy of the players; `captures` gives up distance for captures"
    )
    position_m: tuple[float, float, GroundedHeight] = Field(
        description="initial position: x east, y north, z up"
    )


class EvaderGroup(PlayerGroup):
    """Evaders in the plane."""

    policy: _TeamEvaderPolicy = Field("optimal", description="strategy of the players")
    position_m: Point2 = Field(description="initial position: x east, y north")


class TeamExpect(Ranges):
    """Expected results of a game of teams."""

    guaranteed: Range | None = Field(None, description="captures guaranteed at the start")
    captured: Range | None = Field(None, description="captures at the end")
    total: Range | None = Field(None, description="sum of the predicted values")
    worst_regret: Range | None = Field(None, description="largest regret of the evaders' rows")


class TeamFlightSection(TeamSection):
    """How mocks fly the scenario: separation, stand-off, limits, place and sensor."""

    autopilot: AutopilotName = Field("px4", description="the autopilot that the mocks play")
    takeoff_height_m: TakeoffHeight = Field(10.0, description="above home")
    standoff: Standoff = Standoff()
    limits: ScenarioLimits = ScenarioLimits()
    sensor: Sensor = Sensor()
    site: Site = Site()
    hold_s: float = Field(
        3.0, ge=2.5, description="time on station before landing; longer than a new role takes"
    )


class TeamScenario(AnyScenario):
    """A whole scenario file of teams."""

    pursuer: tuple[PursuerGroup, ...] = Field(
        min_length=1, description="a table [[pursuer]] for each group"
    )
    evader: tuple[EvaderGroup, ...] = Field(
        min_length=1, description="a table [[evader]] for each group"
    )
    capture_m: float = Field(0.0, ge=0.0, le=100.0, description="distance that counts as captured")
    hysteresis: float = Field(
        0.0, ge=0.0, description="least improvement for a new pair; m in tad, s in pe"
    )
    step_s: float = Field(
        0.05, gt=0.0, le=10.0, description="longest time for which velocities are held"
    )
    flight: TeamFlightSection = TeamFlightSection()
    expect: TeamExpect = TeamExpect()

    def _faults(self) -> Iterator[str]:
        yield from self._shared_faults((PURSUER,), pursuer=PURSUER_PLAYS, evader=EVADER_POLICIES)
        for number, group in enumerate(self.pursuer):
            if group.policy == CAPTURES and self.target is None:
                yield f"pursuer[{number}].policy = {CAPTURES!r}: needs target.position_m"
        slowest = min(group.speed_m_s for group in self.pursuer)
        fastest = max(group.speed_m_s for group in self.evader)
        if slowest <= fastest:
            ratio = f"speed ratio of the slowest pursuer to the fastest evader = {slowest:g} / {fastest:g}"
            yield f"{ratio}: must be above 1"


class Teams(NamedTuple):
    """The players of a scenario, one by one.

    Attributes:
        pursuers_m: (n, 3).
        evaders_m: (m, 3).
        pursuer_speed_m_s: (n,).
        evader_speed_m_s: (m,).
        target_m: (3,), None in PE.
        pursuer_policy: of each.
        evader_policy: of each.
    """

    pursuers_m: FloatArray
    evaders_m: FloatArray
    pursuer_speed_m_s: FloatArray
    evader_speed_m_s: FloatArray
    target_m: FloatArray | None
    pursuer_policy: tuple[str, ...]
    evader_policy: tuple[str, ...]


def teams_of(scenario: TeamScenario) -> Teams:
    """Place the players of a scenario; a player's place depends on the seed and not on the number of others."""
    pursuers = _scattered_players(scenario.pursuer, scenario.seed, 0)
    evaders = _scattered_players(scenario.evader, scenario.seed, 1)
    P, u, pursuer_policies = zip(*pursuers, strict=True)
    E, v, evader_policies = zip(*evaders, strict=True)
    target_m = None
    if scenario.target is not None:
        target_m = np.array([*scenario.target.position_m, 0.0])
    return Teams(
        pursuers_m=np.array(P),
        evaders_m=np.array(E),
        pursuer_speed_m_s=np.array(u),
        evader_speed_m_s=np.array(v),
        target_m=target_m,
        pursuer_policy=pursuer_policies,
        evader_policy=evader_policies,
    )


def _scattered_players(
    groups: Sequence[PursuerGroup | EvaderGroup], seed: int, side: int
) -> Iterator[tuple[Enu, float, str]]:
    """Yield place, speed and policy of each player."""
    for number, group in enumerate(groups):
        draws = np.random.default_rng([seed, side, number])
        x, y, z = (*group.position_m, 0.0)[:3]
        for _ in range(group.count):
            far_m = group.scatter_m * math.sqrt(draws.random())
            angle_rad = 2.0 * math.pi * draws.random()
            east_m = x + far_m * math.cos(angle_rad)
            north_m = y + far_m * math.sin(angle_rad)
            yield Enu((east_m, north_m, z)), group.speed_m_s, group.policy


def game_of(scenario: TeamScenario, pursuer_speed_m_s: Real, evader_speed_m_s: Real) -> Game:
    """Return the game of a scenario as mathematics: point capture in still air, with one speed in every direction.

    Args:
        scenario: Its target's shape.
        pursuer_speed_m_s: Arrays that broadcast with the pairs, as in `match_teams`.
        evader_speed_m_s: The same.
    """
    rules = Rules(
        speed_set="ball",
        speeds_m_s=(pursuer_speed_m_s, pursuer_speed_m_s, pursuer_speed_m_s),
        evader_speed_m_s=evader_speed_m_s,
        capture_radius_m=0.0,
        standoff_radius_m=0.0,
        standoff_height_m=0.0,
        wind_m_s=NO_WIND,
        target_velocity_m_s=NO_WIND,
        target_extent=target_extent(scenario),
    )
    return game_by(rules)


class TeamOutcome(NamedTuple):
    """The outcome for one evader of a game of teams. Columns are as in `Outcome`; NaN means "none".

    Attributes:
        scenario: Title.
        run: "maths", always.
        game: "pe" or "tad".
        evader: Number of the evader, from 0.
        pursuer_policy: Of the pursuers; several are joined by "+".
        evader_policy: Of this evader.
        seed: Seed of all random numbers.
        pursuers: Number of pursuers.
        evaders: Number of evaders.
        guaranteed: Captures guaranteed at the start, in the whole game.
        captured: Captures in the whole game.
        end: "captured", "arrived", "time_up", or "invalid" (only in sweeps).
        winner: "pursuer", "evader" or "none".
        predicted_winner: "pursuer" where the capture was guaranteed, else "evader" (TAD) or "none" (PE).
        first: Number of the pursuer that guaranteed the capture; −1 for none.
        second: Number of the pursuer that supports it; −1 for none.
        captor: Number of the pursuer that captured the evader; −1 for none.
        game_time_s: Time of its end.
        capture_time_s: The same if it is a capture.
        evader_to_target_m: Of the evader from its target; NaN in PE.
        predicted: TAD: the guaranteed distance, m. PE: the guaranteed time, s.
        lower_bound: PE: the time that the evader had at least, s. TAD: as predicted.
        achieved: In the unit of predicted; NaN without a capture.
        regret: Loss of the pursuers against the guarantee: achieved − predicted in PE, predicted − achieved in TAD.
        ratio: achieved / predicted.
        reason: Why it is invalid, else empty.
    """

    scenario: str
    run: str
    game: str
    evader: int = -1
    pursuer_policy: str = ""
    evader_policy: str = ""
    seed: int = 0
    pursuers: int = 0
    evaders: int = 0
    guaranteed: int = 0
    captured: int = 0
    end: str = "invalid"
    winner: str = "none"
    predicted_winner: str = "none"
    first: int = -1
    second: int = -1
    captor: int = -1
    game_time_s: float = math.nan
    capture_time_s: float = math.nan
    evader_to_target_m: float = math.nan
    predicted: float = math.nan
    lower_bound: float = math.nan
    achieved: float = math.nan
    regret: float = math.nan
    ratio: float = math.nan
    reason: str = ""


def play_teams(scenarios: Sequence[TeamScenario]) -> list[list[TeamOutcome]]:
    """Simulate scenarios; return the rows of each, one for every evader."""
    return by_kind(scenarios, _kind_of, _play_kind)


def played_teams(
    scenario: TeamScenario, teams: Sequence[Teams], *, keep_path: bool = False
) -> TeamRollout:
    """Simulate several teams of one kind as a batch, with the settings of a scenario."""
    target_m = None
    if teams[0].target_m is not None:
        target_m = np.array([[team.target_m] for team in teams])
    P = np.array([team.pursuers_m for team in teams])
    E = np.array([team.evaders_m for team in teams])
    pursuer_speed_m_s = np.array([team.pursuer_speed_m_s for team in teams])
    evader_speed_m_s = np.array([team.evader_speed_m_s for team in teams])
    game = game_of(scenario, pursuer_speed_m_s[..., None], evader_speed_m_s[:, None])
    return rollout_teams(
        game,
        P,
        E,
        target_m,
        pursuer_policy=[
            own_rule(name) if is_own(name) else name for name in teams[0].pursuer_policy
        ],
        evader_policy=teams[0].evader_policy,
        capture_m=scenario.capture_m,
        hysteresis=scenario.hysteresis,
        step_s=scenario.step_s,
        duration_s=scenario.time_limit_s,
        keep_path=keep_path,
    )


def opening_of(scenario: TeamScenario) -> Matching:
    """Match the teams of a scenario at its start."""
    teams = teams_of(scenario)
    pursuer_speed_m_s = teams.pursuer_speed_m_s[:, None]
    game = game_of(scenario, pursuer_speed_m_s, teams.evader_speed_m_s)
    spare_m = held_m(game, scenario.step_s)
    return match_teams(game, teams.pursuers_m, teams.evaders_m, teams.target_m, spare_m=spare_m)


def summary_of(rows: Sequence[TeamOutcome]) -> dict[str, Any]:
    """Return the summary of a game of teams."""
    first = rows[0]
    promised = [row.predicted for row in rows if row.predicted_winner == "pursuer"]
    regrets = [row.regret for row in rows if not math.isnan(row.regret)]
    return {
        "pursuers": first.pursuers,
        "evaders": first.evaders,
        "guaranteed": first.guaranteed,
        "captured": first.captured,
        "total": math.fsum(promised),
        "worst_regret": max(regrets, default=math.nan),
    }


def _policies(
    groups: Sequence[PursuerGroup] | Sequence[EvaderGroup],
) -> tuple[tuple[str, int], ...]:
    return tuple((group.policy, group.count) for group in groups)


def _kind_of(scenario: TeamScenario) -> Hashable:
    """Return a key that is equal for scenarios of one batch."""
    sides = (_policies(scenario.pursuer), _policies(scenario.evader))
    return (
        scenario.game,
        target_extent(scenario),
        *sides,
        scenario.capture_m,
        scenario.hysteresis,
        scenario.step_s,
        scenario.time_limit_s,
    )


def _play_kind(scenarios: Sequence[TeamScenario]) -> list[list[TeamOutcome]]:
    teams = [teams_of(scenario) for scenario in scenarios]
    rollout = played_teams(scenarios[0], teams)
    end_names = np.array([end.name.lower() for end in End])
    columns = end_names[rollout.end], rollout.time_s, rollout.distance_m, rollout.captor
    rows = []
    for row, scenario in enumerate(scenarios):
        fields = [column[row].tolist() for column in columns]
        ends = list(zip(*fields, strict=True))
        first = Matching(*(field[row] for field in rollout.first))
        outcomes = outcomes_of(scenario, "maths", teams[row], first, ends)
        rows.append(outcomes)
    return rows


def outcomes_of(
    scenario: TeamScenario, run: str, teams: Teams, first: Matching, ends: Sequence[Sequence[Any]]
) -> list[TeamOutcome]:
    """Return the rows of a game, one for each evader.

    Args:
        scenario: As played.
        run: The kind of run.
        teams: The players.
        first: The matching at the start.
        ends: Of each evader: the end, its time, s, the distance from the target, m, and the number of the captor.
    """
    captured_count = sum(end == "captured" for end, *_ in ends)
    rows = []
    pursuer_policies = "+".join(dict.fromkeys(teams.pursuer_policy))
    for j, (end, time_s, away_m, captor) in enumerate(ends):
        guarantor = first.first[j].item()
        predicted = float(first.value[j])
        achieved, judgement = achieved_value(
            scenario.game, end, time_s, away_m, predicted, promised=guarantor >= 0
        )
        outcome = TeamOutcome(
            scenario=scenario.title,
            run=run,
            game=scenario.game,
            evader=j,
            pursuer_policy=pursuer_policies,
            evader_policy=teams.evader_policy[j],
            seed=scenario.seed,
            pursuers=len(teams.pursuers_m),
            evaders=len(teams.evaders_m),
            guaranteed=int(first.guaranteed),
            captured=captured_count,
            end=end,
            predicted_winner=winner_name(first.winner[j]),
            first=guarantor,
            second=first.second[j].item(),
            captor=captor,
            game_time_s=time_s,
            evader_to_target_m=away_m,
            predicted=predicted,
            lower_bound=first.lower_bound[j].item(),
            achieved=achieved,
        )
        rows.append(outcome._replace(**judgement))
    return rows
