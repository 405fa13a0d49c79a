"""Common style of all pictures: figures, axes, and the elements of a game. Only this package imports matplotlib.

Lines differ by dashes and markers, not by colour alone. Axes are in space (3D) or seen from above (2D); functions that
draw in either take the number of dimensions. All pictures of a flight show the same: both tracks, the promises of the
game, the target and the fence.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from guidance.errors import ConfigError, OutputError
from guidance.frames import Vector
from guidance.game import Extent, StandOff
from guidance.game.extent import POINT
from guidance.viz.shapes import Array, circle, target_edge

PURSUER: Final = {"color": "#b3261e", "linewidth": 1.8}
EVADER: Final = {"color": "#0b5fa5", "linewidth": 1.8, "linestyle": "--"}
BEFORE: Final = {"color": "0.6", "linewidth": 0.9}
COURSE: Final = {"color": "0.5", "linewidth": 0.8, "marker": ".", "markersize": 4}
FENCE: Final = {"color": "0.1", "linewidth": 1.2, "linestyle": (0, (8, 3, 1, 3))}
STANDOFF: Final = {"color": "#2e7d32", "linewidth": 1.3, "linestyle": "-."}
ISOCHRON: Final = {"color": "0.25", "linewidth": 1.1, "linestyle": ":"}
ISOCHRON_LATER: Final = {"color": "0.25", "linewidth": 1.6, "linestyle": (0, (1, 1))}
MARK: Final = {"color": "0.35", "linewidth": 0.8, "linestyle": (0, (2, 2))}
MEETING: Final = {"color": "black", "marker": "*", "markersize": 11, "linestyle": "none"}
TARGET: Final = {"color": "black", "marker": "X", "markersize": 9, "linestyle": "none"}

MOST_POINTS: Final = 3000
"""Largest number of points of a curve."""


class _Figure(Figure):
    """A figure without formula syntax: a dollar sign in a title stays a dollar sign."""

    def draw(self, renderer: Any) -> None:  # noqa: ANN401
        for text in self.findobj(Text):
            text.set_parse_math(False)
        super().draw(renderer)


def figure_of(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    figure = _Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def space_and_plan() -> tuple[Figure, Any, Any]:
    """Return a figure with axes in space and, beside them, axes seen from above."""
    figure = figure_of(12.0, 6.4)
    grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 0.06, 0.9])  # space for the height's label
    return figure, figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[2])


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of its name.

    Raises:
        OutputError: If the file cannot be written.
    """
    try:
        figure.savefig(path, dpi=130)
    except (OSError, ValueError) as error:  # ValueError: a format that matplotlib does not know
        reason = error.strerror if isinstance(error, OSError) else str(error).split(" (")[0]
        raise OutputError(f"{path}: cannot be written ({reason}); choose another file, as flight.png") from error


def check_picture(path: Path) -> None:
    """Refuse an unknown picture format before drawing.

    Raises:
        ConfigError: If its ending is of no format that can be drawn.
    """
    kinds = sorted(FigureCanvasAgg.get_supported_filetypes())
    if path.suffix.removeprefix(".") not in kinds:
        raise ConfigError(f"--out {path}: must end in one of {', '.join(f'.{kind}' for kind in kinds)}")


def thinned(values: Array) -> Array:
    """Thin out a long curve evenly, keeping both ends."""
    if len(values) <= MOST_POINTS:
        return values
    kept: Array = values[np.linspace(0, len(values) - 1, MOST_POINTS).round().astype(int)]
    return kept


def lifted(curve: Array, height_m: float, dimensions: int) -> list[Array]:
    """Return the coordinates of a plane curve (n, 2), with its height for 3D axes."""
    return [*curve.T, *([np.full(len(curve), height_m)] * (dimensions - 2))]


def draw_place(axes: Any, place_m: Vector, style: dict[str, Any], dimensions: int, label: str) -> None:  # noqa: ANN401
    """Mark a place in a style such as `MEETING` or `TARGET`.

    Args:
        axes: In the plane or in space.
        place_m: In the game frame.
        style: `MEETING` or `TARGET`.
        dimensions: 2 or 3.
        label: In the legend.
    """
    axes.plot(*([part] for part in place_m[:dimensions]), **style, label=label)


def label_space(axes: Any, zoom: float = 0.95) -> None:  # noqa: ANN401
    """Label 3D axes and give them equal scales."""
    axes.set(xlabel="x east, m", zlabel="z up, m")
    axes.set_ylabel("y north, m", labelpad=10.0)
    axes.locator_params(nbins=5)
    axes.set_zlim(bottom=min(0.0, axes.get_zlim3d()[0]))
    spans = [high - low for low, high in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
    axes.set_box_aspect(spans, zoom=zoom)  # equal scales, with space for the labels
    axes.view_init(elev=22.0, azim=-60.0)


def label_plan(axes: Any, title: str = "from above", adjustable: str = "datalim") -> None:  # noqa: ANN401
    """Label plan axes and give them equal scales."""
    axes.set(xlabel="x east, m", ylabel="y north, m", title=title)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.grid(visible=True, linewidth=0.3)


def legend_below(figure: Figure, axes: Any, columns: int = 4) -> None:  # noqa: ANN401
    """Put the legend of `axes` below the figure."""
    lines = axes.get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def legend_beside(axes: Any) -> None:  # noqa: ANN401
    """Put the legend beside the axes."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0.0, frameon=False, fontsize=9)


def panels(figure: Figure, count: int) -> list[Any]:
    """Return stacked axes with a common time axis and a thin grid."""
    axes = list(np.atleast_1d(figure.subplots(count, 1, sharex=True)))
    for one in axes:
        one.grid(visible=True, linewidth=0.3)
        one.margins(x=0.01)
    axes[-1].set_xlabel("time, s")
    return axes


class Chase(NamedTuple):
    """The drawn elements of a flight, game frame, m; missing ones are None or empty.

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
        target_extent: Its shape.
        fence: Its edges, (n, 2) each.
        fence_height_m: Height of the fence in space.
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
    target_extent: Extent = POINT
    fence: Sequence[Array] = ()
    fence_height_m: float = 0.0


def draw_chase(axes: Any, chase: Chase, dimensions: int) -> None:  # noqa: ANN401 - 2D or 3D axes
    """Draw tracks, isochrons, stand-off disc, meeting point and target."""
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
        rim = circle(chase.reached_m, chase.standoff.radius_m, 73)
        disc = lifted(rim, chase.standoff.height_m, dimensions)
        axes.plot(*disc, **STANDOFF, label="stand-off disc at capture")
    if chase.target_m is not None:
        draw_target(axes, chase.target_m, chase.target_extent, dimensions)


def draw_target(axes: Any, place_m: Vector, extent: Extent, dimensions: int) -> None:  # noqa: ANN401
    """Draw a target and the edge of its shape."""
    draw_place(axes, place_m, TARGET, dimensions, "T, target")
    axes.plot(*lifted(target_edge(place_m, extent), place_m[2], dimensions), color=TARGET["color"])


def _draw_run(axes: Any, track: Array, dimensions: int, name: str, style: dict[str, Any], marks: str) -> None:  # noqa: ANN401
    run = thinned(track)[:, :dimensions]
    axes.plot(*run.T, **style, label=name)
    if len(run):
        axes.plot(*run[:1].T, marks[0], color=style["color"], label=f"{name} at engagement")
        axes.plot(*run[-1:].T, marks[1], mfc="white", color=style["color"], label=f"{name} at the end")


def draw_fence(axes: Any, edges: Sequence[Array], height_m: float, dimensions: int, *, whole: bool = False) -> None:  # noqa: ANN401
    """Draw the visible part of a fence's edges, so that a wide fence does not shrink the rest.

    Args:
        axes: In space or from above; what else is drawn is there, and gives the view.
        edges: Closed curves, (n, 2) each, m.
        height_m: Their height in space.
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
        else:  # 3D axes do not clip
            axes.plot(*lifted(np.where(inside[:, None], edge, np.nan), height_m, 3), **FENCE, label=label)
            axes.set(xlim=(west, east), ylim=(south, north))
        label = None
