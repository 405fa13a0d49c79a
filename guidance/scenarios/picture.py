"""The flight as a picture: both tracks in space and from above, where the game began and where it was to end."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from guidance.flight import State
from guidance.frames import Vector
from guidance.game import Game, StandOff, solve
from guidance.scenarios.flown import ending_words
from guidance.scenarios.fly import FlightResult
from guidance.scenarios.outcome import Outcome
from guidance.scenarios.settings import game, target_game_m

Array = NDArray[np.float64]

PURSUER_LINE = {"color": "#c1272d", "linewidth": 1.8}
EVADER_LINE = {"color": "#0b5fa5", "linewidth": 1.8, "linestyle": "--"}
_BEFORE = {"color": "0.6", "linewidth": 0.8}
ISOCHRON_LINE = {"color": "0.25", "linewidth": 1.0, "linestyle": ":"}
DISC_LINE = {"color": "#2e7d32", "linewidth": 1.2, "linestyle": "-."}


def draw(result: FlightResult, outcome: Outcome, path: Path) -> None:
    """Draw the flight into a PNG.

    Raises:
        OSError: If the file cannot be written.
    """
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 0.06, 0.9])
    space = figure.add_subplot(grid[0], projection="3d")
    plan = figure.add_subplot(grid[2])
    before, playing = _split(result)
    for axes, columns in ((space, [0, 1, 2]), (plan, [0, 1])):
        _tracks(axes, before, playing, columns)
        _geometry(axes, result, len(columns))
    label_space(space)
    label_plan(plan)
    figure.suptitle(f"{outcome.scenario}: {ending_words(outcome)}, {_score(outcome)}")
    figure.legend(*plan.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path, dpi=130)


def isochron(a_game: Game, pursuer_m: Vector, evader_m: Vector, points: int = 181) -> Array:
    """Points (points, 2) where an evader running straight at full speed is caught, one for each heading, m.

    The paper's Apollonius circle for a Ball and point capture. Found from the game itself: TAD towards a far target in
    each heading ends where that heading's run ends.
    """
    headings = np.linspace(0.0, 2.0 * np.pi, points)
    far = 1e6 * np.stack([np.cos(headings), np.sin(headings), np.zeros(points)], axis=-1)
    P = np.broadcast_to(np.array(pursuer_m), (points, 3)).copy()
    E = np.broadcast_to(np.array([evader_m[0], evader_m[1], 0.0]), (points, 3)).copy()
    return np.asarray(solve(a_game, P, E, E + far).meeting_point_m[:, :2])


def _split(result: FlightResult) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Tracks (n, 3) of pursuer and evader before the engagement, and from it on until the landing begins."""
    playing = {State.ENGAGED, State.PAUSED, State.ON_STATION}
    rows = [(sample.state in playing, sample.pursuer_m, sample.evader_m) for sample in result.samples]
    begun = next((index for index, row in enumerate(rows) if row[0]), len(rows))
    ended = next((index for index in range(begun, len(rows)) if not rows[index][0]), len(rows))

    def tracks(part: list[tuple[bool, Vector, Vector]]) -> tuple[Array, Array]:
        return (
            np.array([row[1] for row in part]).reshape(-1, 3),
            np.array([row[2] for row in part]).reshape(-1, 3),
        )

    return tracks(rows[:begun]), tracks(rows[begun:ended])


def _tracks(axes: Any, before: tuple[Array, Array], playing: tuple[Array, Array], columns: list[int]) -> None:  # noqa: ANN401 - 2D or 3D axes
    axes.plot(*before[0][:, columns].T, **_BEFORE, label="pursuer before")
    for track, style, name in ((playing[0], PURSUER_LINE, "pursuer"), (playing[1], EVADER_LINE, "evader")):
        axes.plot(*track[:, columns].T, **style, label=name)
        if len(track):
            axes.plot(*track[:1, columns].T, "o", color=style["color"], label=f"{name[0].upper()} at engagement")
            axes.plot(
                *track[-1:, columns].T, "s", mfc="white", color=style["color"], label=f"{name[0].upper()} at the end"
            )


def _geometry(axes: Any, result: FlightResult, dimensions: int) -> None:  # noqa: ANN401
    flat = [np.zeros] * (dimensions - 2)
    if result.engaged_pursuer_m is not None and result.engaged_evader_m is not None:
        curve = isochron(game(result.scenario), result.engaged_pursuer_m, result.engaged_evader_m)
        axes.plot(*curve.T, *(zero(len(curve)) for zero in flat), **ISOCHRON_LINE, label="isochron at engagement")
    if result.meeting_point_m is not None:
        name = "q*" if result.scenario.target is None else "g*"
        x, y, _ = result.meeting_point_m
        axes.plot(
            [x], [y], *(zero(1) for zero in flat), "k*", markersize=11, linestyle="none", label=f"{name}, meeting point"
        )
    if result.samples:
        _disc(axes, result, dimensions)
    target = target_game_m(result.scenario)
    if target is not None:
        axes.plot(*([c] for c in target[:dimensions]), "kX", markersize=9, linestyle="none", label="T, target")


def _disc(axes: Any, result: FlightResult, dimensions: int) -> None:  # noqa: ANN401
    """Draw the stand-off disc where the game ended."""
    ends = [sample for sample in result.samples if sample.state is State.ON_STATION]
    if ends:
        draw_disc(axes, game(result.scenario).standoff, ends[0].evader_m, dimensions)


def draw_disc(axes: Any, standoff: StandOff, evader_m: Vector, dimensions: int) -> None:  # noqa: ANN401
    """Draw the stand-off disc about an evader."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    x = evader_m[0] + standoff.radius_m * np.cos(angle)
    y = evader_m[1] + standoff.radius_m * np.sin(angle)
    height = [np.full_like(x, standoff.height_m)] * (dimensions - 2)
    axes.plot(x, y, *height, **DISC_LINE, label="stand-off disc")


def label_space(axes: Any) -> None:  # noqa: ANN401
    """Label 3D axes and give them equal scales."""
    axes.set(xlabel="x east, m", zlabel="z up, m")
    axes.set_ylabel("y north, m", labelpad=10.0)
    axes.locator_params(nbins=5)
    axes.set_zlim(bottom=0.0)
    spans = [high - low for low, high in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
    axes.set_box_aspect(spans, zoom=0.95)  # equal scales, and room for the labels
    axes.view_init(elev=22.0, azim=-60.0)


def label_plan(axes: Any) -> None:  # noqa: ANN401
    """Label axes seen from above and give them equal scales."""
    axes.set(xlabel="x east, m", ylabel="y north, m", title="from above")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(visible=True, linewidth=0.3)


def _score(outcome: Outcome) -> str:
    unit = "s" if outcome.game == "pe" else "m from T"
    return f"{outcome.achieved:.2f} {unit} flown, {outcome.predicted:.2f} {unit} predicted"
