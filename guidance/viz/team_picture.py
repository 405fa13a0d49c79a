"""A game of teams as a picture from above: discs, their intersections, the matching, and the tracks.

The points that an evader reaches before a pursuer form a disc, before two pursuers the intersection of two discs. The
evader ends at the point of it that is closest to the target.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.patheffects import withStroke

from guidance.game import End
from guidance.game.team import Matching, TeamRollout
from guidance.game.team.discs import Discs, rim
from guidance.sim.team_maths import opening_of, played_teams
from guidance.sim.teams import Teams, TeamScenario, teams_of
from guidance.viz.figures import figure_of, save
from guidance.viz.shapes import Array

_EVADERS = ("#0b5fa5", "#2e7d32", "#8e44ad", "#c77800", "#00838f", "#ad1457", "#5d4037", "#546e7a")
"""A colour for each evader and its discs; repeated after the last."""

_PURSUER = "#c1272d"


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
        _meeting(axes, teams, matching, j)
    _tracks(axes, played)
    _players(axes, teams)
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
    w = teams.pursuers_m[pursuers] - teams.evaders_m[evader]
    ratio = teams.pursuer_speed_m_s[pursuers] / teams.evader_speed_m_s[evader]
    discs = Discs(ratio**2 - 1.0, w[:, 0], w[:, 1], w[:, 2])
    far = rim(discs, (n[0][:, None], n[1][:, None])).min(axis=1)
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


def _meeting(axes: Any, teams: Teams, matching: Matching, j: int) -> None:  # noqa: ANN401
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


def _players(axes: Any, teams: Teams) -> None:  # noqa: ANN401
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
