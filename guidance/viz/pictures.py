"""Pictures of a scenario: as the mathematics plays it, and as it was flown; and of a game of teams.

In a game of teams, the points that an evader reaches before a pursuer form a disc, before two pursuers the intersection
of two discs. The evader ends at the point of it that is closest to the target.
"""

import contextlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from guidance.files import private_file
from guidance.flight import State
from guidance.frames import Vector
from guidance.game import Ball, End, Game
from guidance.game.team import Matching, TeamRollout
from guidance.game.team.regions import regions_of, survived
from guidance.session.plan import plan_of
from guidance.session.result import FlightResult, ending_words
from guidance.sim.batch import stack, starts
from guidance.sim.maths import game_of, moments, opening
from guidance.sim.outcome import Outcome
from guidance.sim.players import evader_strategy, pursuer_strategy, speed_set, standoff, target_extent, target_game_m
from guidance.sim.scenario import Scenario
from guidance.sim.team_maths import opening_of, played_teams
from guidance.sim.teams import Teams, TeamScenario, teams_of
from guidance.viz.figures import (
    COURSE,
    Chase,
    draw_chase,
    draw_fence,
    figure_of,
    label_plan,
    label_space,
    legend_below,
    save,
    space_and_plan,
)
from guidance.viz.shapes import Array, circle, isochron, isochron_at

_POINTS_A_STEP = 8
_EVADERS = ("#0b5fa5", "#2e7d32", "#8e44ad", "#c77800", "#00838f", "#ad1457", "#5d4037", "#546e7a")
"""A colour for each evader and its discs; repeated after the last."""

_PURSUER = "#c1272d"


def draw_scenario(scenario: Scenario, path: Path) -> None:
    """Draw a scenario, as the mathematics plays it, into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    P, E = (_vector(start[0]) for start in starts([scenario]))
    played_s, pursuer, evader = played(scenario)
    batch, meeting_m = stack([scenario]), opening([scenario]).meeting_point_m[0]
    figure, plan = _drawn(
        Chase(
            (),
            pursuer,
            evader,
            standoff(scenario),
            reached_m=(*_vector(evader[-1])[:2], 0.0),
            isochron=isochron(game_of(batch, batch.believed_m_s), P, E),
            meeting_m=(*_vector(meeting_m)[:2], 0.0) if np.isfinite(meeting_m).all() else None,
            target_m=target_game_m(scenario),
            target_extent=target_extent(scenario),
            fence=_fence(scenario),
        )
    )
    _courses(plan, scenario, 2.0 * played_s)
    figure.suptitle(scenario.title)
    legend_below(figure, plan)
    save(figure, path)


def _drawn(chase: Chase) -> tuple[Figure, Any]:
    """Draw a chase in space and from above; return the figure and the axes from above."""
    figure, space, plan = space_and_plan()
    for axes, dimensions in ((space, 3), (plan, 2)):
        draw_chase(axes, chase, dimensions)
    label_plan(plan)
    for axes, dimensions in ((space, 3), (plan, 2)):
        draw_fence(axes, chase.fence, chase.fence_height_m, dimensions)
    label_space(space)
    return figure, plan


def _fence(scenario: Scenario) -> tuple[Array]:
    return (circle((*scenario.home_m, 0.0), scenario.limits.fence_radius_m, 361),)


def played(scenario: Scenario) -> tuple[float, Array, Array]:
    """Play a scenario as mathematics; return the duration (s) and both tracks, (n, 3), m.

    A step may be long. Hermite's cubic draws it from the positions and velocities at both ends.
    """
    steps = list(moments([scenario]))
    after = [*steps[1:], steps[-1]]
    now_s = np.array([step.now_s[0] for step in steps])
    pursuer = _curved(now_s, [step.pursuer_m[0] for step in steps], [step.flown_m_s[0] for step in after])
    evader = _curved(now_s, [step.evader_m[0] for step in steps], [step.run_m_s[0] for step in after])
    return float(now_s[-1]), pursuer, evader


def _curved(now_s: Array, places: Sequence[Array], rates: Sequence[Array]) -> Array:
    """Return a track through places (m), with more points between them; the rates (m/s) are those of the steps."""
    places_m, rates_m_s = np.array(places), np.array(rates)
    s = np.arange(_POINTS_A_STEP)[None, :, None] / _POINTS_A_STEP
    run = np.diff(now_s)[:, None, None] * rates_m_s[:, None][:-1]
    later = np.diff(now_s)[:, None, None] * rates_m_s[:, None][1:]
    begin, way = places_m[:-1, None], np.diff(places_m, axis=0)[:, None]
    curved = begin + s * way + s * (1.0 - s) * ((1.0 - s) * (run - way) - s * (later - way))
    return np.concatenate([curved.reshape(-1, 3), places_m[-1:]])


def _courses(plan: Any, scenario: Scenario, until_s: float) -> None:  # noqa: ANN401
    """Draw the players' courses, and no more of them than the game needs: some go on for minutes."""
    P, E = starts([scenario])
    for name, strategy in (
        ("P", pursuer_strategy(scenario, P[0], speed_set(scenario), scenario.seed)),
        ("E", evader_strategy(scenario, E[0], scenario.evader.speed_m_s, scenario.seed)),
    ):
        if strategy.course is not None:
            within = np.concatenate([[True], strategy.course.times_s[:-1] <= until_s])
            places = strategy.course.places_m[within]
            plan.plot(*places[:, :2].T, **COURSE, label=f"course of {name}")


def _vector(place: Array) -> Vector:
    x, y, z = (float(part) for part in place)
    return (x, y, z)


def draw(result: FlightResult, outcome: Outcome, path: Path) -> None:
    """Draw the flight into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    figure, plan = _drawn(chase_of(result))
    figure.suptitle(f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}")
    legend_below(figure, plan)
    with contextlib.suppress(OSError):  # `save` says what cannot be written
        private_file(path)
    save(figure, path)


def chase_of(result: FlightResult) -> Chase:
    """Return what is drawn of a flight: the game is from the engagement until the landing begins."""
    scenario = result.scenario
    playing = {State.ENGAGED, State.PAUSED, State.ON_STATION}
    samples = result.samples
    begun = next((place for place, one in enumerate(samples) if one.state in playing), len(samples))
    ended = next((place for place in range(begun, len(samples)) if samples[place].state not in playing), len(samples))
    pursuer, evader = (
        np.array(places).reshape(-1, 3)
        for places in ([one.pursuer_m for one in samples], [one.evader_m for one in samples])
    )
    settings = plan_of(scenario=scenario).flight.cycle
    engaged = None if result.engaged is None or result.engaged.no_game else result.engaged
    return Chase(
        (pursuer[:begun], pursuer[ended:]),
        pursuer[begun:ended],
        evader[begun:ended],
        settings.standoff,
        reached_m=next((one.evader_m for one in samples if one.state is State.ON_STATION), None),
        isochron=None if engaged is None else isochron_at(settings, engaged),
        meeting_m=None if engaged is None else (*engaged.meeting_point_game_m[:2], 0.0),
        target_m=settings.target_game_m,
        target_extent=settings.target_extent,
        fence=_fence(scenario),
    )


def _score(outcome: Outcome) -> str:
    unit = "s" if outcome.game == "pe" else "m from T"
    if math.isnan(outcome.achieved):
        return "no game was played" if math.isnan(outcome.predicted) else f"{outcome.predicted:.2f} {unit} predicted"
    return f"{outcome.achieved:.2f} {unit} flown, {outcome.predicted:.2f} {unit} predicted"


def draw_teams(scenario: TeamScenario, path: Path) -> None:
    """Draw a scenario of teams into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    teams, matching = teams_of(scenario), opening_of(scenario)
    played = played_teams(scenario, [teams], keep_path=True)
    figure = figure_of(9.6, 8.4)
    axes = figure.add_subplot()
    for j in range(len(teams.evaders_m)):
        _regions(axes, teams, matching, j)
        _team_meeting(axes, teams, matching, j)
    _tracks(axes, played)
    _team_players(axes, teams)
    axes.set(xlabel="x east, m", ylabel="y north, m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(visible=True, linewidth=0.3)
    axes.set_axisbelow(True)
    figure.suptitle(scenario.title, fontsize=13)
    axes.set_title(_said(scenario, matching, played), fontsize=10, color="0.3")
    figure.legend(*_once(axes), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    save(figure, path)


def region(teams: Teams, pursuers: list[int], evader: int, points: int = 721) -> Array:
    """Return the edge of the points that an evader reaches before some pursuers, (points, 2), m.

    Args:
        teams: All players.
        pursuers: Numbers of the pursuers.
        evader: Number of the evader.
        points: Number of directions.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    n = np.cos(angle), np.sin(angle)
    game = Game(Ball(teams.pursuer_speed_m_s[pursuers]), float(teams.evader_speed_m_s[evader]))
    regions = regions_of(game, teams.pursuers_m[pursuers], teams.evaders_m[evader])
    far = survived(regions, (n[0][:, None], n[1][:, None])).min(axis=1)
    return np.asarray(teams.evaders_m[evader, :2] + far[:, None] * np.stack(n, axis=-1))


def _regions(axes: Any, teams: Teams, matching: Matching, j: int) -> None:  # noqa: ANN401 - matplotlib's
    """Draw the discs of an evader and its pursuers, and shade their intersection."""
    team = [int(i) for i in (matching.first[j], matching.second[j]) if i >= 0]
    colour = _colour(j)
    for i in team:
        axes.plot(
            *region(teams, [i], j).T,
            color=colour,
            linewidth=0.9,
            linestyle=(0, (4, 3)),
            label="first there, before one pursuer",
        )
    if team:
        edge = region(teams, team, j)
        axes.fill(
            *edge.T,
            facecolor=to_rgba(colour, 0.14),
            edgecolor=colour,
            linewidth=1.6,
            label="before both: the intersection",
        )


def _team_meeting(axes: Any, teams: Teams, matching: Matching, j: int) -> None:  # noqa: ANN401
    """Draw the pursuers of an evader and the meeting point."""
    x, y, _ = matching.meeting_point_m[j]
    if matching.first[j] >= 0 and teams.target_m is not None:
        goal = teams.target_m
        axes.plot([x, goal[0]], [y, goal[1]], color=_colour(j), linewidth=1.0, alpha=0.6, label="L, guaranteed")
    for who, role, style in ((matching.first[j], "first", "-"), (matching.second[j], "second", (0, (2, 1.5)))):
        if who >= 0:
            place = teams.pursuers_m[int(who)]
            line = {"color": "0.2", "linewidth": 1.4, "linestyle": style, "zorder": 4}
            axes.plot([place[0], x], [place[1], y], **line, label=f"matched, {role}")
    if matching.first[j] >= 0:
        star = {"markeredgecolor": "white", "markersize": 17, "zorder": 6, "linestyle": "none"}
        axes.plot([x], [y], "*", color=_colour(j), **star, label="X*, meeting point")


def _tracks(axes: Any, played: TeamRollout) -> None:  # noqa: ANN401
    pursuers = np.array([sample.pursuers_m[0] for sample in played.path])
    evaders = np.array([sample.evaders_m[0] for sample in played.path])
    for i in range(pursuers.shape[1]):
        axes.plot(*pursuers[:, i, :2].T, color=_PURSUER, linewidth=4.0, alpha=0.3, label="pursuer as played")
    for j in range(evaders.shape[1]):
        axes.plot(*evaders[:, j, :2].T, color=_colour(j), linewidth=4.0, alpha=0.5, label="evader as played")
        if played.end[0, j] == End.ARRIVED:
            axes.plot(*evaders[-1:, j, :2].T, "o", mfc="none", color=_colour(j), markersize=18, label="arrived")


def _team_players(axes: Any, teams: Teams) -> None:  # noqa: ANN401
    own = {"markeredgecolor": "white", "zorder": 5, "linestyle": "none"}
    beside: dict[str, Any] = {"textcoords": "offset points", "fontsize": 10, "zorder": 7, "fontweight": "bold"}
    beside["path_effects"] = [withStroke(linewidth=3.0, foreground="white")]
    for i, (x, y, z) in enumerate(teams.pursuers_m):
        axes.plot([x], [y], "^", color=_PURSUER, markersize=12, **own, label="pursuer, and its height")
        axes.annotate(f"P{i} · {z:g} m", (x, y), xytext=(9, -4), color=_PURSUER, **beside)
    for j, (x, y, _) in enumerate(teams.evaders_m):
        axes.plot([x], [y], "o", color=_colour(j), markersize=11, **own, label="evader")
        axes.annotate(f"E{j}", (x, y), xytext=(8, 6), color=_colour(j), **beside)
    if teams.target_m is not None:
        axes.plot(*teams.target_m[:2], "kX", markersize=14, **own, label="T, target")


def _said(scenario: TeamScenario, matching: Matching, played: TeamRollout) -> str:
    captured = int(np.count_nonzero(played.end == End.CAPTURED))
    unit = "s in all" if scenario.game == "pe" else "m from T in all"
    return f"{int(matching.guaranteed)} captures guaranteed, {float(matching.total):.2f} {unit}; {captured} captured"


def _once(axes: Any) -> tuple[list[Any], list[str]]:  # noqa: ANN401
    """Return the legend without duplicates."""
    named = {name: handle for handle, name in reversed(list(zip(*axes.get_legend_handles_labels(), strict=True)))}
    return list(named.values())[::-1], list(named)[::-1]


def _colour(evader: int) -> str:
    return _EVADERS[evader % len(_EVADERS)]
