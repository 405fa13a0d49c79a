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
from matplotlib.patheffects import withStroke

from guidance.files import private_file
from guidance.flight import State
from guidance.frames import Vector
from guidance.game import Ball, End, Game
from guidance.game.team import Matching, TeamRollout
from guidance.game.team.regions import regions_of, survived
from guidance.log.scene import Array, circle, isochron
from guidance.session.plan import plan_of
from guidance.session.result import FlightResult, ending_words
from guidance.sim.batch import Batch, stack, starts
from guidance.sim.maths import game_of, moments, opening
from guidance.sim.outcome import Outcome
from guidance.sim.players import standoff, target_extent, target_game_m
from guidance.sim.scenario import Scenario
from guidance.sim.teams import Teams, TeamScenario, played_teams, teams_of
from guidance.viz.figures import Chase, chase_figure, figure_of, flown_chase, legend_below, save

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
    chase = Chase(
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
        courses=_courses(batch, 2.0 * played_s),
    )
    _save(chase, scenario.title, path)


def _save(chase: Chase, title: str, path: Path) -> None:
    figure = chase_figure(chase)
    figure.suptitle(title)
    save(figure, path)


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


def _courses(batch: Batch, until_s: float) -> dict[str, Array]:
    """Return the places of the players' courses, and no more of them than the game needs: some go on for minutes."""
    courses = {"P": batch.pursuer.course, "E": batch.evader.course}
    return {
        name: course.places_m[0][np.concatenate([[True], course.times_s[0, :-1] <= until_s])]
        for name, course in courses.items()
        if course is not None
    }


def _vector(place: Array) -> Vector:
    x, y, z = (float(part) for part in place)
    return (x, y, z)


def draw(result: FlightResult, outcome: Outcome, path: Path) -> None:
    """Draw the flight into a PNG: the game is from the engagement until the landing begins.

    Raises:
        OutputError: If the file cannot be written.
    """
    samples, count = result.samples, len(result.samples)
    playing = [sample.state in {State.ENGAGED, State.PAUSED, State.ON_STATION} for sample in samples]
    begun = playing.index(True) if True in playing else count
    ended = playing.index(False, begun) if False in playing[begun:] else count
    tracks = (np.array(places).reshape(-1, 3) for places in zip(*(sample[2:] for sample in samples), strict=True))
    pursuer, evader = tracks if samples else (np.zeros((0, 3)),) * 2
    reached_m = next((sample.evader_m for sample in samples if sample.state is State.ON_STATION), None)
    settings, fence = plan_of(scenario=result.scenario).flight.cycle, _fence(result.scenario)
    chase = flown_chase(
        settings, pursuer, evader, slice(begun, ended), result.engaged, reached_m=reached_m, fence=fence
    )
    with contextlib.suppress(OSError):  # `save` says what cannot be written
        private_file(path)
    _save(chase, f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}", path)


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
    teams = teams_of(scenario)
    played = played_teams(scenario, [teams], keep_path=True)
    matching = Matching(*(field[0] for field in played.first))
    figure = figure_of(9.6, 8.4)
    axes = figure.add_subplot()
    for j in range(len(teams.evaders_m)):
        _draw_region(axes, teams, matching, j)
    _draw_players(axes, teams, played)
    axes.set(xlabel="x east, m", ylabel="y north, m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(visible=True, linewidth=0.3)
    axes.set_axisbelow(True)
    figure.suptitle(scenario.title, fontsize=13)
    captured, unit = int(np.count_nonzero(played.end == End.CAPTURED)), "s" if scenario.game == "pe" else "m from T"
    foreseen = f"{int(matching.guaranteed)} captures guaranteed, {float(matching.total):.2f} {unit} in all"
    axes.set_title(f"{foreseen}; {captured} captured", fontsize=10, color="0.3")
    legend_below(figure, axes)
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


def _draw_region(axes: Any, teams: Teams, matching: Matching, j: int) -> None:  # noqa: ANN401 - matplotlib's
    """Draw the discs of an evader and its pursuers, shade their intersection, and mark the meeting point."""
    colour, goal = _EVADERS[j % len(_EVADERS)], teams.target_m
    roles = {"first": (matching.first[j], "-"), "second": (matching.second[j], (0, (2, 1.5)))}
    team = {role: (int(i), style) for role, (i, style) in roles.items() if i >= 0}
    for i, _ in team.values():
        thin = {"color": colour, "linewidth": 0.9, "linestyle": (0, (4, 3))}
        axes.plot(*region(teams, [i], j).T, **thin, label="first there, before one pursuer")
    if not team:
        return
    edge = region(teams, [i for i, _ in team.values()], j)
    shade = {"facecolor": to_rgba(colour, 0.14), "edgecolor": colour, "linewidth": 1.6}
    axes.fill(*edge.T, **shade, label="before both: the intersection")
    x, y, _ = matching.meeting_point_m[j]
    if goal is not None and "first" in team:
        axes.plot([x, goal[0]], [y, goal[1]], color=colour, linewidth=1.0, alpha=0.6, label="L, guaranteed")
    for role, (i, style) in team.items():
        line = {"color": "0.2", "linewidth": 1.4, "linestyle": style, "zorder": 4}
        axes.plot([teams.pursuers_m[i, 0], x], [teams.pursuers_m[i, 1], y], **line, label=f"matched, {role}")
    if "first" in team:
        star = {"markeredgecolor": "white", "markersize": 17, "zorder": 6, "linestyle": "none"}
        axes.plot([x], [y], "*", color=colour, **star, label="X*, meeting point")


def _draw_players(axes: Any, teams: Teams, played: TeamRollout) -> None:  # noqa: ANN401
    """Draw the tracks as played, and all players at their start."""
    own = {"markeredgecolor": "white", "zorder": 5, "linestyle": "none"}
    beside: dict[str, Any] = {"textcoords": "offset points", "fontsize": 10, "zorder": 7, "fontweight": "bold"}
    beside["path_effects"] = [withStroke(linewidth=3.0, foreground="white")]
    for i, (x, y, z) in enumerate(teams.pursuers_m):
        track = np.array([sample.pursuers_m[0, i] for sample in played.path])
        axes.plot(*track[:, :2].T, color=_PURSUER, linewidth=4.0, alpha=0.3, label="pursuer as played")
        axes.plot([x], [y], "^", color=_PURSUER, markersize=12, **own, label="pursuer, and its height")
        axes.annotate(f"P{i} · {z:g} m", (x, y), xytext=(9, -4), color=_PURSUER, **beside)
    for j, (x, y, _) in enumerate(teams.evaders_m):
        colour = _EVADERS[j % len(_EVADERS)]
        track = np.array([sample.evaders_m[0, j] for sample in played.path])
        axes.plot(*track[:, :2].T, color=colour, linewidth=4.0, alpha=0.5, label="evader as played")
        if played.end[0, j] == End.ARRIVED:
            axes.plot(*track[-1:, :2].T, "o", mfc="none", color=colour, markersize=18, label="arrived")
        axes.plot([x], [y], "o", color=colour, markersize=11, **own, label="evader")
        axes.annotate(f"E{j}", (x, y), xytext=(8, 6), color=colour, **beside)
    if teams.target_m is not None:
        axes.plot(*teams.target_m[:2], "kX", markersize=14, **own, label="T, target")
