"""Common style of all pictures: figures, axes, and the elements of a game. Only this package imports matplotlib.

Lines differ by dashes and markers, not by colour alone. Axes are in space (3D) or seen from above (2D); functions that
draw in either take the number of dimensions. All pictures of a flight show the same: both tracks, the promises of the
game, the target and the fence.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from guidance.certificate import Certificate
from guidance.cycle import CycleSettings
from guidance.errors import ConfigError, OutputError
from guidance.files import private_file
from guidance.frames import Vector
from guidance.game import Extent, StandOff
from guidance.game.extent import POINT
from guidance.log.scene import Array, circle, isochron_at, lifted, target_edge

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

_MARGIN_M: Final = 8.0

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


def save_twice(figure: Figure, stem: Path, *, dpi: float, private: bool = False) -> list[Path]:
    """Write a figure as PNG and as PDF with the same layout, `private` for their owner only; return the paths.

    Raises:
        OSError: If a file cannot be written.
    """
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in ("png", "pdf")]
    for path, metadata in zip(paths, (None, {"CreationDate": None}), strict=True):
        figure.savefig(private_file(path) if private else path, dpi=dpi, metadata=metadata)
        figure.set_layout_engine(None)
    return paths


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


def draw_place(axes: Any, place_m: Vector, style: dict[str, Any], dimensions: int, label: str) -> None:  # noqa: ANN401
    """Mark a place in a style such as `MEETING` or `TARGET`."""
    axes.plot(*([part] for part in place_m[:dimensions]), **style, label=label)


def label_space(axes: Any) -> None:  # noqa: ANN401
    """Label 3D axes and give them equal scales."""
    axes.set(xlabel="x east, m", zlabel="z up, m")
    axes.set_ylabel("y north, m", labelpad=10.0)
    axes.locator_params(nbins=5)
    axes.set_zlim(bottom=min(0.0, axes.get_zlim3d()[0]))
    spans = [high - low for low, high in (axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d())]
    axes.set_box_aspect(spans, zoom=0.93)  # equal scales, with space for the labels
    axes.view_init(elev=22.0, azim=-60.0)


def label_plan(axes: Any, title: str = "from above", *, adjustable: str = "box") -> None:  # noqa: ANN401
    """Label plan axes and give them equal scales."""
    axes.set(xlabel="x east, m", ylabel="y north, m", title=title)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.grid(visible=True, linewidth=0.3)


def legend_below(figure: Figure, *axes: Any, columns: int = 4, title: str = "") -> None:  # noqa: ANN401
    """Put the legend of all axes below the figure; each name is there once."""
    named: dict[str, Any] = {}
    for one in axes:
        for line, name in zip(*one.get_legend_handles_labels(), strict=True):
            named.setdefault(name, line)
    style: dict[str, Any] = {"frameon": False, "fontsize": 9, "title": title or None}
    figure.legend(named.values(), named, loc="outside lower center", ncols=columns, **style)


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
        courses: Places of the courses that players follow, by name, (n, 3) each; drawn from above only.
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
    courses: Mapping[str, Array] = {}

    @property
    def box(self) -> tuple[Array, Array]:
        """The corners of everything but courses and fence, with a margin."""
        points = [*self.before, self.pursuer, self.evader]
        if self.isochron is not None:
            points.append(lifted(self.isochron, 0.0))
        if self.target_m is not None:
            points.append(np.array([self.target_m]))
        known = np.concatenate(points)
        known = known[np.isfinite(known).all(axis=-1)] if np.isfinite(known).any() else np.zeros((1, 3))
        return known.min(axis=0) - _MARGIN_M, known.max(axis=0) + _MARGIN_M


def flown_chase(
    settings: CycleSettings,
    pursuer: Array,
    evader: Array,
    game: slice,
    first: Certificate | None,
    last: Certificate | None = None,
    **more: Any,  # noqa: ANN401
) -> Chase:
    """Return the elements of a flown game.

    Args:
        settings: Of the flight.
        pursuer: Track of the whole flight, (n, 3).
        evader: Of the evader, (n, 3).
        game: The part of the tracks in the game.
        first: Certificate at engagement.
        last: Certificate at capture.
        **more: Further elements.
    """
    first, last = (None if one is None or one.no_game else one for one in (first, last))
    return Chase(
        (pursuer[: game.start], pursuer[game.stop :]),
        pursuer[game],
        evader[game],
        settings.standoff,
        isochron=None if first is None else isochron_at(settings, first),
        isochron_later=None if last is None else isochron_at(settings, last),
        meeting_m=None if first is None else (*first.meeting_point_game_m[:2], 0.0),
        target_m=settings.target_game_m,
        target_extent=settings.target_extent,
        **more,
    )


def chase_figure(chase: Chase, *, with_whole_fence: bool = False, columns: int = 4) -> Figure:
    """Draw a chase in space and from above, and from above with the whole fence if asked for."""
    if with_whole_fence:
        figure, widths = figure_of(13.0, 5.8), [1.15, 0.08, 1.0, 0.7]  # with space for the height's label
    else:
        figure, widths = figure_of(12.0, 6.4), [1.0, 0.06, 0.9]
    grid = figure.add_gridspec(1, len(widths), width_ratios=widths)
    space = figure.add_subplot(grid[0], projection="3d")
    plan, *whole = (figure.add_subplot(grid[place]) for place in range(2, len(widths)))
    low, high = chase.box
    for axes, dimensions in ((space, 3), (plan, 2), *((axes, 2) for axes in whole)):
        draw_chase(axes, chase, dimensions)
        if axes is space or (whole and axes is plan):
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    label_plan(plan, adjustable="box" if whole else "datalim")
    for axes in whole:
        label_plan(axes, "from above, with the fence", adjustable="box")
    for axes, dimensions in ((space, 3), (plan, 2), *((axes, 2) for axes in whole)):
        draw_fence(axes, chase.fence, chase.fence_height_m, dimensions, whole=axes in whole)
    space.set_zlim(min(0.0, low[2] + _MARGIN_M), high[2])
    label_space(space)
    legend_below(figure, *whole or (plan,), columns=columns)
    return figure


def draw_chase(axes: Any, chase: Chase, dimensions: int) -> None:  # noqa: ANN401 - 2D or 3D axes
    """Draw tracks, isochrons, stand-off disc, meeting point and target."""
    for number, part in enumerate(chase.before):
        axes.plot(*thinned(part)[:, :dimensions].T, **BEFORE, label=None if number else "pursuer before and after")
    for name, places in chase.courses.items() if dimensions == 2 else ():
        axes.plot(*places[:, :2].T, **COURSE, label=f"course of {name}")
    _draw_run(axes, chase.pursuer, dimensions, "pursuer", PURSUER, "os")
    _draw_run(axes, chase.evader, dimensions, "evader", EVADER, "^v")
    for curve, style, when in (
        (chase.isochron, ISOCHRON, "engagement"),
        (chase.isochron_later, ISOCHRON_LATER, "capture"),
    ):
        if curve is not None:
            axes.plot(*lifted(curve, 0.0)[:, :dimensions].T, **style, label=f"isochron at {when}")
    if chase.meeting_m is not None:
        name = "q*" if chase.target_m is None else "g*"
        draw_place(axes, chase.meeting_m, MEETING, dimensions, f"{name}, meeting point foreseen")
    if chase.reached_m is not None:
        rim = circle(chase.reached_m, chase.standoff.radius_m, 73)
        disc = lifted(rim, chase.standoff.height_m)
        axes.plot(*disc[:, :dimensions].T, **STANDOFF, label="stand-off disc at capture")
    if chase.target_m is not None:
        draw_place(axes, chase.target_m, TARGET, dimensions, "T, target")
        edge = target_edge(chase.target_m, chase.target_extent)
        axes.plot(*lifted(edge, chase.target_m[2])[:, :dimensions].T, color=TARGET["color"])


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
            axes.plot(*lifted(np.where(inside[:, None], edge, np.nan), height_m).T, **FENCE, label=label)
            axes.set(xlim=(west, east), ylim=(south, north))
        label = None
