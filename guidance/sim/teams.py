"""The scenario file of teams: `[[pursuer]]` and `[[evader]]` tables, simulated with point masses.

Positions are in the game frame, as in `guidance.sim.scenario`. A table can describe several equal players: the seed
scatters `count` of them over a disc, so a sweep can vary their number.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, WithJsonSchema, model_validator

from guidance.autopilots import AutopilotName
from guidance.config import Section
from guidance.flight.settings import TeamSection
from guidance.game import EVADER_POLICIES, PURSUER_POLICIES, Ball, Game
from guidance.sim.expect import CheckedExpectation, Range
from guidance.sim.scenario import Point2, Point3, ScenarioLimits, Sensor, Site, Standoff, Target

Array = NDArray[np.float64]

_NEEDS_TARGET = "task_oriented"


class PlayerGroup(Section):
    """One player, or several equal players around a place."""

    count: int = Field(1, ge=1, le=50, description="number of players of this table")
    scatter_m: float = Field(
        0.0, ge=0.0, le=1000.0, description="radius of the disc over which the seed scatters the players"
    )
    speed_m_s: float = Field(gt=0.0, le=30.0, description="speed in every direction")
    policy: str = Field("optimal", description="strategy of the players")
    position_m: Point3 | Point2 = Field(description="initial position")

    @model_validator(mode="after")
    def _check_scatter(self) -> Self:
        if self.count > 1 and self.scatter_m == 0:
            raise ValueError(f"scatter_m: missing; count = {self.count} players need a disc to be scattered over")
        return self


class PursuerGroup(PlayerGroup):
    """Pursuers in space."""

    policy: Annotated[str, WithJsonSchema({"type": "string", "enum": [*PURSUER_POLICIES]})] = Field(
        "optimal", description="strategy of the players"
    )
    position_m: Point3 = Field(description="initial position: x east, y north, z up")


class EvaderGroup(PlayerGroup):
    """Evaders in the plane."""

    policy: Annotated[str, WithJsonSchema({"type": "string", "enum": [*EVADER_POLICIES]})] = Field(
        "optimal", description="strategy of the players"
    )
    position_m: Point2 = Field(description="initial position: x east, y north")


class TeamExpect(Section):
    """Expected results of a game of teams."""

    guaranteed: Range | None = Field(None, description="captures guaranteed at the start")
    captured: Range | None = Field(None, description="captures at the end")
    total: Range | None = Field(None, description="sum of the predicted values")
    worst_regret: Range | None = Field(None, description="largest regret of the evaders' rows")

    def verdicts(self, summary: dict[str, Any]) -> list[CheckedExpectation]:
        """Compare the expectations with a game's summary."""
        wanted = ((column, getattr(self, column)) for column in TeamExpect.model_fields)
        return [
            CheckedExpectation(column, str(range_), summary[column], range_.holds(summary[column]))
            for column, range_ in wanted
            if range_ is not None
        ]


class TeamFlightSection(TeamSection):
    """How mocks fly the scenario: separation, stand-off, limits, place and sensor."""

    autopilot: AutopilotName = Field("px4", description="the autopilot that the mocks play")
    takeoff_height_m: float = Field(10.0, ge=2.0, le=120.0, description="above home")
    standoff: Standoff = Standoff()
    limits: ScenarioLimits = ScenarioLimits()
    sensor: Sensor = Sensor()
    site: Site = Site()
    hold_s: float = Field(3.0, ge=2.5, description="time on station before landing; longer than a new role takes")


class TeamScenario(Section):
    """A whole scenario file of teams."""

    title: str = Field(description="short title")
    description: str = Field("", description="purpose of the scenario")
    game: Literal["pe", "tad"] = Field(description="pursuit-evasion, or target-attacker-defender")
    pursuer: tuple[PursuerGroup, ...] = Field(min_length=1, description="a table [[pursuer]] for each group")
    evader: tuple[EvaderGroup, ...] = Field(min_length=1, description="a table [[evader]] for each group")
    target: Target | None = Field(None, description='with game = "tad"')
    capture_m: float = Field(0.0, ge=0.0, le=100.0, description="distance that counts as captured")
    hysteresis: float = Field(0.0, ge=0.0, description="least improvement for a new pair; m in tad, s in pe")
    step_s: float = Field(0.05, gt=0.0, le=10.0, description="longest time for which velocities are held")
    seed: int = Field(0, ge=0, description="seed of the scattered positions")
    time_limit_s: float = Field(300.0, gt=0.0, description="longest duration of the game")
    flight: TeamFlightSection = TeamFlightSection()
    expect: TeamExpect = TeamExpect()

    @model_validator(mode="after")
    def _check(self) -> Self:
        slowest, fastest = min(one.speed_m_s for one in self.pursuer), max(one.speed_m_s for one in self.evader)
        if slowest <= fastest:
            raise ValueError(
                f"speed ratio of the slowest pursuer to the fastest evader = {slowest:g} / {fastest:g}: must be above 1"
            )
        if (self.game == "tad") != (self.target is not None):
            raise ValueError(
                'target.position_m: needed with game = "tad", the place the evaders want to reach, and not '
                'allowed with game = "pe"'
            )
        if any(one.position_m[2] < 0 for one in self.pursuer):
            raise ValueError("pursuer.position_m: a height is negative; it must be zero or more")
        for player, groups, known in (
            ("pursuer", self.pursuer, PURSUER_POLICIES),
            ("evader", self.evader, EVADER_POLICIES),
        ):
            for number, policy in enumerate(one.policy for one in groups):
                if policy not in known:
                    raise ValueError(f"{player}[{number}].policy = {policy!r}: allowed are {', '.join(known)}")
                if policy == _NEEDS_TARGET and self.target is None:
                    raise ValueError(f"{player}[{number}].policy = {policy!r}: needs target.position_m")
        return self


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

    pursuers_m: Array
    evaders_m: Array
    pursuer_speed_m_s: Array
    evader_speed_m_s: Array
    target_m: Array | None
    pursuer_policy: tuple[str, ...]
    evader_policy: tuple[str, ...]

    @property
    def game(self) -> Game:
        """The game, with each player's speed."""
        return Game(Ball(self.pursuer_speed_m_s[:, None]), self.evader_speed_m_s)


def teams_of(scenario: TeamScenario) -> Teams:
    """Place the players of a scenario; a player's place depends on the seed and not on the number of others."""
    P, u, plays = _players(scenario.pursuer, scenario.seed, 0)
    E, v, flees = _players(scenario.evader, scenario.seed, 1)
    target = None if scenario.target is None else np.array([*scenario.target.position_m, 0.0])
    return Teams(P, E, u, v, target, plays, flees)


def _players(groups: Sequence[PlayerGroup], seed: int, side: int) -> tuple[Array, Array, tuple[str, ...]]:
    places, speeds, policies = [], [], []
    for number, group in enumerate(groups):
        draws = np.random.default_rng([seed, side, number])
        x, y, z = (*group.position_m, 0.0)[:3]
        for _ in range(group.count):
            far, turn = group.scatter_m * math.sqrt(draws.random()), 2.0 * math.pi * draws.random()
            places.append((x + far * math.cos(turn), y + far * math.sin(turn), z))
        speeds += [group.speed_m_s] * group.count
        policies += [group.policy] * group.count
    return np.array(places), np.array(speeds), tuple(policies)
