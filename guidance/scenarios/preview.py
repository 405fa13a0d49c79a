"""A scenario as a picture, before anything flies: who starts where, what is promised, and how mathematics plays it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from guidance.errors import OutputError
from guidance.frames import Vector
from guidance.scenarios.batch import Array, stack, starts
from guidance.scenarios.courses import evader_strategy, pursuer_strategy
from guidance.scenarios.maths import game_of, moments, opening
from guidance.scenarios.model import Scenario
from guidance.scenarios.picture import (
    EVADER_LINE,
    ISOCHRON_LINE,
    PURSUER_LINE,
    draw_disc,
    isochron,
    label_plan,
    label_space,
)
from guidance.scenarios.settings import speed_set, standoff, target_game_m

_COURSE = {"color": "0.5", "linewidth": 0.8, "marker": ".", "markersize": 4}
_FENCE = {"color": "#b8860b", "linewidth": 1.0}


def draw_scenario(scenario: Scenario, path: Path) -> None:
    """Draw a scenario into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 0.06, 0.9])
    space = figure.add_subplot(grid[0], projection="3d")
    plan = figure.add_subplot(grid[2])
    played_s, *tracks = played(scenario)
    for axes, dimensions in ((space, 3), (plan, 2)):
        _players(axes, scenario, tracks, dimensions)
        _geometry(axes, scenario, dimensions)
    _courses(plan, scenario, 2.0 * played_s)
    label_space(space)
    space.locator_params(axis="z", nbins=3)
    label_plan(plan)
    _fence(plan, scenario)
    figure.suptitle(scenario.title)
    figure.legend(*plan.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    try:
        figure.savefig(path, dpi=130)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); choose another file") from error


def played(scenario: Scenario) -> tuple[float, Array, Array]:
    """Play a scenario as mathematics; return for how many s, and the tracks of pursuer and evader, (n, 3) each, m."""
    points = [(moment.now_s[0], moment.pursuer_m[0], moment.evader_m[0]) for moment in moments([scenario])]
    return float(points[-1][0]), np.array([point[1] for point in points]), np.array([point[2] for point in points])


def _players(axes: Any, scenario: Scenario, tracks: Sequence[Array], dimensions: int) -> None:  # noqa: ANN401
    begun = starts([scenario])
    for name, style, track, start in zip("PE", (PURSUER_LINE, EVADER_LINE), tracks, begun, strict=True):
        axes.plot(*track[:, :dimensions].T, **style, label=f"{name} in mathematics")
        axes.plot(*start[:, :dimensions].T, "o", color=style["color"], label=f"{name} at engagement")
    end = tracks[1][-1]
    draw_disc(axes, standoff(scenario), (float(end[0]), float(end[1]), 0.0), dimensions)


def _geometry(axes: Any, scenario: Scenario, dimensions: int) -> None:  # noqa: ANN401
    P, E = (_vector(start[0]) for start in starts([scenario]))
    flat = [np.zeros] * (dimensions - 2)
    batch = stack([scenario])
    curve = isochron(game_of(batch, batch.believed_m_s), P, E)
    axes.plot(*curve.T, *(zero(len(curve)) for zero in flat), **ISOCHRON_LINE, label="isochron")
    meeting = opening([scenario]).meeting_point_m[0]
    if np.isfinite(meeting).all():
        at = ([part] for part in meeting[:2])
        axes.plot(*at, *(zero(1) for zero in flat), "k*", markersize=11, linestyle="none", label="predicted meeting")
    target = target_game_m(scenario)
    if target is not None:
        axes.plot(*([c] for c in target[:dimensions]), "kX", markersize=9, linestyle="none", label="T, target")


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
            plan.plot(*places[:, :2].T, **_COURSE, label=f"course of {name}")


def _fence(plan: Any, scenario: Scenario) -> None:  # noqa: ANN401
    """Draw as much of the fence as is in view: a wide one would make all else small."""
    radius_m = scenario.envelope.fence_radius_m
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    home_x, home_y = scenario.home_m
    x, y = home_x + radius_m * np.cos(angle), home_y + radius_m * np.sin(angle)
    (west, east), (south, north) = plan.get_xlim(), plan.get_ylim()
    if np.any((west < x) & (x < east) & (south < y) & (y < north)):
        plan.plot(x, y, **_FENCE, label="fence", scalex=False, scaley=False)


def _vector(place: Array) -> Vector:
    x, y, z = (float(part) for part in place)
    return (x, y, z)
