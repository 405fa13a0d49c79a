"""Both tracks in space and from above, with the fence, the stand-off disc and what the evader could still reach."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from guidance.records.outlines import circle, fence_edges, isochron_at
from guidance.report.drawing import (
    BEFORE,
    EVADER,
    FENCE,
    ISOCHRON,
    ISOCHRON_LATER,
    PURSUER,
    STANDOFF,
    figure_of,
    thinned,
)
from guidance.report.story import Array, Story

_MARGIN_M = 8.0


def tracks(story: Story) -> Figure:
    """Draw the flight in space, from above, and from above with the whole fence."""
    figure = figure_of(13.0, 5.8)
    grid = figure.add_gridspec(1, 4, width_ratios=[1.15, 0.08, 1.0, 0.7])  # room for the label of the height
    space = figure.add_subplot(grid[0], projection="3d")
    plan, whole = figure.add_subplot(grid[2]), figure.add_subplot(grid[3])
    low, high = _box(story)
    for axes, columns in ((space, [0, 1, 2]), (plan, [0, 1]), (whole, [0, 1])):
        _runs(axes, story, columns)
        _game(axes, story, len(columns))
    _fence(space, story, 3, (low, high))
    _fence(plan, story, 2, (low, high))
    _fence(whole, story, 2, None)
    _frame_space(space, low, high)
    _frame_plan(plan, "from above")
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    _frame_plan(whole, "from above, with the fence")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return figure


def _runs(axes: Any, story: Story, columns: list[int]) -> None:  # noqa: ANN401 - 2D or 3D axes
    pursuer, evader = story.column("pursuer_m"), story.column("evader_m")
    begin = len(pursuer) if story.engaged is None else story.engaged
    played = np.array([one is not None for one in story.certificates])
    end = begin + int(played[begin:].sum()) if begin < len(pursuer) else begin
    for part, name in ((slice(0, begin), "pursuer before and after"), (slice(end, None), None)):
        axes.plot(*thinned(pursuer[part])[:, columns].T, **BEFORE, label=name)
    for track, style, name, marks in ((pursuer, PURSUER, "pursuer", "os"), (evader, EVADER, "evader", "^v")):
        run = thinned(track[begin:end])[:, columns]
        axes.plot(*run.T, **style, label=name)
        if len(run):
            axes.plot(*run[:1].T, marks[0], color=style["color"], label=f"{name} at engagement")
            axes.plot(*run[-1:].T, marks[1], mfc="white", color=style["color"], label=f"{name} at the end")


def _game(axes: Any, story: Story, dimensions: int) -> None:  # noqa: ANN401
    tick = story.settings.tick
    for cycle, style, when in ((story.engaged, ISOCHRON, "engagement"), (story.captured, ISOCHRON_LATER, "capture")):
        certificate = None if cycle is None else story.certificates[cycle]
        if certificate is None or certificate.no_game:
            continue
        curve = isochron_at(story.settings.tick, certificate)
        axes.plot(*_lifted(curve, 0.0, dimensions), **style, label=f"isochron at {when}")
        if when == "engagement":
            name = "q*" if tick.target_game_m is None else "g*"
            place = certificate.meeting_point_game_m[:dimensions]
            axes.plot(*([c] for c in place), "k*", ms=11, linestyle="none", label=f"{name}, meeting point foreseen")
        else:
            disc = circle(certificate.evader_game_m, tick.standoff.radius_m)
            axes.plot(*_lifted(disc, tick.standoff.height_m, dimensions), **STANDOFF, label="stand-off disc at capture")
    if tick.target_game_m is not None:
        at = tick.target_game_m[:dimensions]
        axes.plot(*([c] for c in at), "kX", ms=9, linestyle="none", label="T, guarded place")


def _fence(axes: Any, story: Story, dimensions: int, box: tuple[Array, Array] | None) -> None:  # noqa: ANN401
    """Draw the fence about home; in a near view only where it is in view."""
    envelope, home = story.envelope, story.home_m
    if home is None:
        return
    for number, edge in enumerate(fence_edges(envelope, home)):
        shown = edge
        if box is not None:
            inside = np.all((edge >= box[0][:2]) & (edge <= box[1][:2]), axis=-1, keepdims=True)
            shown = np.where(inside, edge, np.nan)
        axes.plot(*_lifted(shown, home[2], dimensions), **FENCE, label=None if number else "fence")


def _lifted(curve: Array, height_m: float, dimensions: int) -> list[Array]:
    return [*curve.T, *([np.full(len(curve), height_m)] * (dimensions - 2))]


def _box(story: Story) -> tuple[Array, Array]:
    """Return the corners of what was flown, and of what the evader could reach, with a margin."""
    points = [story.column("pursuer_m"), story.column("evader_m")]
    certificate = None if story.engaged is None else story.certificates[story.engaged]
    if certificate is not None and not certificate.no_game:
        curve = isochron_at(story.settings.tick, certificate)
        points.append(np.column_stack([curve, np.zeros(len(curve))]))
    if story.settings.tick.target_game_m is not None:
        points.append(np.array([story.settings.tick.target_game_m]))
    known = np.concatenate(points)
    known = known[np.isfinite(known).all(axis=-1)]
    if not len(known):
        known = np.zeros((1, 3))
    return known.min(axis=0) - _MARGIN_M, known.max(axis=0) + _MARGIN_M


def _frame_space(axes: Any, low: Array, high: Array) -> None:  # noqa: ANN401
    axes.set(xlabel="x east, m", zlabel="z up, m", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_ylabel("y north, m", labelpad=10.0)
    axes.set_zlim(min(0.0, low[2] + _MARGIN_M), high[2])
    axes.locator_params(nbins=5)
    spans = [top - bottom for bottom, top in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
    axes.set_box_aspect(spans, zoom=0.92)  # equal scales, and room for the labels
    axes.view_init(elev=22.0, azim=-60.0)


def _frame_plan(axes: Any, title: str) -> None:  # noqa: ANN401
    axes.set(xlabel="x east, m", ylabel="y north, m", title=title)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(visible=True, linewidth=0.3)
