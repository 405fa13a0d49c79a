"""How every picture looks: its figure, its lines, its axes, and what of a game is marked in it. Matplotlib lives here.

Lines are told apart by dashes and markers, not by colour alone. Axes are in space (3D) or seen from above (2D); what is
drawn in either takes the number of its dimensions.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from guidance.errors import ConfigError, OutputError
from guidance.frames import Vector
from guidance.game import StandOff
from guidance.viz.shapes import Array, circle

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
"""A curve has no more points than this: a picture is looked at, not measured."""


def figure_of(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def space_and_plan(width: float = 12.0, height: float = 6.4) -> tuple[Figure, Any, Any]:
    """Return a figure with axes in space and, beside them, axes seen from above."""
    figure = figure_of(width, height)
    grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 0.06, 0.9])  # room for the label of the height
    return figure, figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[2])


def literal(text: str) -> str:
    """Return a text of somebody's as it is to be read: a dollar sign begins no formula."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: Path, dpi: int = 130) -> None:
    """Write a figure in the format of its name.

    Raises:
        OutputError: If the file cannot be written.
    """
    try:
        figure.savefig(path, dpi=dpi)
    except (OSError, ValueError) as error:  # ValueError: a format that matplotlib does not know
        reason = error.strerror if isinstance(error, OSError) else str(error).split(" (")[0]
        raise OutputError(f"{path}: cannot be written ({reason}); choose another file, as flight.png") from error


def check_picture(path: Path) -> None:
    """Refuse a picture's name before anything is drawn for it.

    Raises:
        ConfigError: If its ending is of no format that can be drawn.
    """
    kinds = sorted(FigureCanvasAgg.get_supported_filetypes())
    if path.suffix.removeprefix(".") not in kinds:
        raise ConfigError(f"--out {path}: must end in one of {', '.join(f'.{kind}' for kind in kinds)}")


def thinned(values: Array) -> Array:
    """Leave out points of a long curve evenly, keeping both ends."""
    if len(values) <= MOST_POINTS:
        return values
    kept: Array = values[np.linspace(0, len(values) - 1, MOST_POINTS).round().astype(int)]
    return kept


def lifted(curve: Array, height_m: float, dimensions: int) -> list[Array]:
    """Return the coordinates of a plane curve (n, 2), with its height where it is drawn in space."""
    return [*curve.T, *([np.full(len(curve), height_m)] * (dimensions - 2))]


def draw_standoff(axes: Any, standoff: StandOff, evader_m: Vector, dimensions: int, label: str) -> None:  # noqa: ANN401
    """Draw the rim of the stand-off disc about an evader.

    Args:
        axes: In the plane or in space.
        standoff: Radius and height, m.
        evader_m: In the game frame.
        dimensions: 2 or 3.
        label: In the legend.
    """
    rim = circle(evader_m, standoff.radius_m, 73)
    axes.plot(*lifted(rim, standoff.height_m, dimensions), **STANDOFF, label=label)


def draw_place(axes: Any, place_m: Vector, style: dict[str, Any], dimensions: int, label: str) -> None:  # noqa: ANN401
    """Mark one place, as `MEETING` or `TARGET` does.

    Args:
        axes: In the plane or in space.
        place_m: In the game frame.
        style: `MEETING` or `TARGET`.
        dimensions: 2 or 3.
        label: In the legend.
    """
    axes.plot(*([part] for part in place_m[:dimensions]), **style, label=label)


def label_space(axes: Any, zoom: float = 0.95) -> None:  # noqa: ANN401
    """Label axes in space and give them equal scales."""
    axes.set(xlabel="x east, m", zlabel="z up, m")
    axes.set_ylabel("y north, m", labelpad=10.0)
    axes.locator_params(nbins=5)
    axes.set_zlim(bottom=min(0.0, axes.get_zlim3d()[0]))
    spans = [high - low for low, high in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
    axes.set_box_aspect(spans, zoom=zoom)  # equal scales, and room for the labels
    axes.view_init(elev=22.0, azim=-60.0)


def label_plan(axes: Any, title: str = "from above", adjustable: str = "datalim") -> None:  # noqa: ANN401
    """Label axes seen from above and give them equal scales."""
    axes.set(xlabel="x east, m", ylabel="y north, m", title=title)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.grid(visible=True, linewidth=0.3)


def legend_below(figure: Figure, axes: Any, columns: int = 4) -> None:  # noqa: ANN401
    """Explain the lines of `axes` below the whole figure."""
    lines = axes.get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def legend_beside(axes: Any) -> None:  # noqa: ANN401
    """Put the legend outside, where it covers nothing."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0.0, frameon=False, fontsize=9)


def panels(figure: Figure, count: int) -> list[Any]:
    """Return axes above each other on one time axis, with a thin grid."""
    axes = list(np.atleast_1d(figure.subplots(count, 1, sharex=True)))
    for one in axes:
        one.grid(visible=True, linewidth=0.3)
        one.margins(x=0.01)
    axes[-1].set_xlabel("time, s")
    return axes
