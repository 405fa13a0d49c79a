"""Both tracks in space and from above, with the fence, the stand-off disc and what the evader could still reach."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from guidance.viz.figures import (
    BEFORE,
    EVADER,
    FENCE,
    ISOCHRON,
    ISOCHRON_LATER,
    MEETING,
    PURSUER,
    TARGET,
    draw_place,
    draw_standoff,
    figure_of,
    label_plan,
    label_space,
    legend_below,
    lifted,
    thinned,
)
from guidance.viz.report.story import Array, Story
from guidance.viz.shapes import fence_edges, isochron_at

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
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(min(0.0, low[2] + _MARGIN_M), high[2]))
    label_space(space, zoom=0.92)
    label_plan(plan, adjustable="box")
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    label_plan(whole, "from above, with the fence", adjustable="box")
    legend_below(figure, whole, columns=5)
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
    settings = story.settings.cycle
    for cycle, style, when in ((story.engaged, ISOCHRON, "engagement"), (story.captured, ISOCHRON_LATER, "capture")):
        certificate = None if cycle is None else story.certificates[cycle]
        if certificate is None or certificate.no_game:
            continue
        curve = isochron_at(settings, certificate)
        axes.plot(*lifted(curve, 0.0, dimensions), **style, label=f"isochron at {when}")
        if when == "engagement":
            name = "q*" if settings.target_game_m is None else "g*"
            place = certificate.meeting_point_game_m
            draw_place(axes, place, MEETING, dimensions, f"{name}, meeting point foreseen")
        else:
            draw_standoff(axes, settings.standoff, certificate.evader_game_m, dimensions, "stand-off disc at capture")
    if settings.target_game_m is not None:
        draw_place(axes, settings.target_game_m, TARGET, dimensions, "T, target")


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
        axes.plot(*lifted(shown, home[2], dimensions), **FENCE, label=None if number else "fence")


def _box(story: Story) -> tuple[Array, Array]:
    """Return the corners of what was flown, and of what the evader could reach, with a margin."""
    points = [story.column("pursuer_m"), story.column("evader_m")]
    certificate = None if story.engaged is None else story.certificates[story.engaged]
    if certificate is not None and not certificate.no_game:
        curve = isochron_at(story.settings.cycle, certificate)
        points.append(np.column_stack([curve, np.zeros(len(curve))]))
    if story.settings.cycle.target_game_m is not None:
        points.append(np.array([story.settings.cycle.target_game_m]))
    known = np.concatenate(points)
    known = known[np.isfinite(known).all(axis=-1)]
    if not len(known):
        known = np.zeros((1, 3))
    return known.min(axis=0) - _MARGIN_M, known.max(axis=0) + _MARGIN_M
