"""Both tracks in space and from above, with the fence, the stand-off disc and what the evader could still reach."""

import numpy as np
from matplotlib.figure import Figure

from guidance.viz.chase import Chase, draw_chase, draw_fence
from guidance.viz.figures import figure_of, label_plan, label_space, legend_below
from guidance.viz.report.story import Array, Story
from guidance.viz.shapes import fence_edges, isochron_at

_MARGIN_M = 8.0


def tracks(story: Story) -> Figure:
    """Draw the flight in space, from above, and from above with the whole fence."""
    figure = figure_of(13.0, 5.8)
    grid = figure.add_gridspec(1, 4, width_ratios=[1.15, 0.08, 1.0, 0.7])  # room for the label of the height
    space = figure.add_subplot(grid[0], projection="3d")
    plan, whole = figure.add_subplot(grid[2]), figure.add_subplot(grid[3])
    chase = chase_of(story)
    low, high = _box(story, chase)
    for axes, dimensions in ((space, 3), (plan, 2), (whole, 2)):
        draw_chase(axes, chase, dimensions)
        if axes is not whole:
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        draw_fence(axes, chase.fence, chase.fence_height_m, dimensions, whole=axes is whole)
    space.set_zlim(min(0.0, low[2] + _MARGIN_M), high[2])
    label_space(space, zoom=0.92)
    label_plan(plan, adjustable="box")
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    label_plan(whole, "from above, with the fence", adjustable="box")
    legend_below(figure, whole, columns=5)
    return figure


def chase_of(story: Story) -> Chase:
    """Return what is drawn of a recorded flight."""
    settings = story.settings.cycle
    pursuer, evader = story.column("pursuer_m"), story.column("evader_m")
    begin = len(pursuer) if story.engaged is None else story.engaged
    played = np.array([one is not None for one in story.certificates])
    end = begin + int(played[begin:].sum()) if begin < len(pursuer) else begin
    first, last = (
        None if cycle is None or (one := story.certificates[cycle]) is None or one.no_game else one
        for cycle in (story.engaged, story.captured)
    )
    return Chase(
        (pursuer[:begin], pursuer[end:]),
        pursuer[begin:end],
        evader[begin:end],
        settings.standoff,
        reached_m=None if last is None else last.evader_game_m,
        isochron=None if first is None else isochron_at(settings, first),
        isochron_later=None if last is None else isochron_at(settings, last),
        meeting_m=None if first is None else first.meeting_point_game_m,
        target_m=settings.target_game_m,
        fence=() if story.home_m is None else fence_edges(story.envelope, story.home_m),
        fence_height_m=0.0 if story.home_m is None else story.home_m[2],
    )


def _box(story: Story, chase: Chase) -> tuple[Array, Array]:
    """Return the corners of what was flown, and of what the evader could reach, with a margin."""
    points = [story.column("pursuer_m"), story.column("evader_m")]
    if chase.isochron is not None:
        points.append(np.column_stack([chase.isochron, np.zeros(len(chase.isochron))]))
    if chase.target_m is not None:
        points.append(np.array([chase.target_m]))
    known = np.concatenate(points)
    known = known[np.isfinite(known).all(axis=-1)]
    if not len(known):
        known = np.zeros((1, 3))
    return known.min(axis=0) - _MARGIN_M, known.max(axis=0) + _MARGIN_M
