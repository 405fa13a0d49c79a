"""One flight's game as every picture draws it: both tracks, what the game promised, the target and the fence."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from guidance.frames import Vector
from guidance.game import StandOff
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
    lifted,
    thinned,
)
from guidance.viz.shapes import Array


class Chase(NamedTuple):
    """What is drawn of a flight, game frame, m; None or empty where there was none of it.

    Attributes:
        before: The pursuer's stretches outside the game, (n, 3) each.
        pursuer: Its track in the game, (n, 3).
        evader: The evader's in the game, (n, 3).
        standoff: The terminal disc.
        reached_m: Where the evader was when the disc was reached.
        isochron: Where an evader that runs straight is caught, at engagement, (n, 2).
        isochron_later: The same at capture.
        meeting_m: The meeting point foreseen at engagement.
        target_m: T of a TAD game.
        fence: Its edges, (n, 2) each.
        fence_height_m: At which they are drawn in space.
    """

    before: Sequence[Array]
    pursuer: Array
    evader: Array
    standoff: StandOff
    reached_m: Vector | None = None
    isochron: Array | None = None
    isochron_later: Array | None = None
    meeting_m: Vector | None = None
    target_m: Vector | None = None
    fence: Sequence[Array] = ()
    fence_height_m: float = 0.0


def draw_chase(axes: Any, chase: Chase, dimensions: int) -> None:  # noqa: ANN401 - 2D or 3D axes
    """Draw tracks, isochrons, stand-off disc, meeting point and target; the fence is `draw_fence`'s."""
    for number, part in enumerate(chase.before):
        axes.plot(*thinned(part)[:, :dimensions].T, **BEFORE, label=None if number else "pursuer before and after")
    _draw_run(axes, chase.pursuer, dimensions, "pursuer", PURSUER, "os")
    _draw_run(axes, chase.evader, dimensions, "evader", EVADER, "^v")
    for curve, style, when in (
        (chase.isochron, ISOCHRON, "engagement"),
        (chase.isochron_later, ISOCHRON_LATER, "capture"),
    ):
        if curve is not None:
            axes.plot(*lifted(curve, 0.0, dimensions), **style, label=f"isochron at {when}")
    if chase.meeting_m is not None:
        name = "q*" if chase.target_m is None else "g*"
        draw_place(axes, chase.meeting_m, MEETING, dimensions, f"{name}, meeting point foreseen")
    if chase.reached_m is not None:
        draw_standoff(axes, chase.standoff, chase.reached_m, dimensions, "stand-off disc at capture")
    if chase.target_m is not None:
        draw_place(axes, chase.target_m, TARGET, dimensions, "T, target")


def _draw_run(axes: Any, track: Array, dimensions: int, name: str, style: dict[str, Any], marks: str) -> None:  # noqa: ANN401
    run = thinned(track)[:, :dimensions]
    axes.plot(*run.T, **style, label=name)
    if len(run):
        axes.plot(*run[:1].T, marks[0], color=style["color"], label=f"{name} at engagement")
        axes.plot(*run[-1:].T, marks[1], mfc="white", color=style["color"], label=f"{name} at the end")


def draw_fence(axes: Any, edges: Sequence[Array], height_m: float, dimensions: int, *, whole: bool = False) -> None:  # noqa: ANN401
    """Draw a fence's edges as far as they are in view: a wide fence would make all else small.

    Args:
        axes: In space or from above; what else is drawn is there, and gives the view.
        edges: Closed curves, (n, 2) each, m.
        height_m: At which they lie in space.
        dimensions: 3 in space, 2 from above.
        whole: Widen the view to all of it.
    """
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    label: str | None = "fence"
    for edge in edges:
        x, y = edge.T
        inside = whole | ((west <= x) & (x <= east) & (south <= y) & (y <= north))
        if not inside.any():
            continue
        if dimensions == 2:
            axes.plot(x, y, **FENCE, label=label, scalex=whole, scaley=whole)
        else:  # axes in space clip nothing
            axes.plot(*lifted(np.where(inside[:, None], edge, np.nan), height_m, 3), **FENCE, label=label)
            axes.set(xlim=(west, east), ylim=(south, north))
        label = None
