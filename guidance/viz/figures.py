"""Common style of all pictures: figures, axes, and the elements of a game. Only this package imports matplotlib.

Lines differ by dashes and markers, not by colour alone. Axes are in space (3D) or seen from above (2D); functions that
draw in either take the number of dimensions. All pictures of a flight show the same: both tracks, the promises of the
game, the target and the fence. So do the pictures of a scenario as the mathematics plays it.

In the picture of a game of teams, the points that an evader reaches before a pursuer form a disc, before two pursuers
the intersection of two discs. The evader ends at the point of it that is closest to the target.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from guidance.errors import ConfigError
from guidance.files import whole_file, writing
from guidance.frames import Enu
from guidance.game import End, Extent, StandOff
from guidance.game.arrays import FLOATS, FloatArray
from guidance.game.extent import to_set
from guidance.game.team import Matching, TeamRollout
from guidance.game.team.regions import regions_of, survived
from guidance.log.scene import circle_points, isochron, lifted, target_edge
from guidance.sim.batch import Batch, stack, target_extent, target_game_m
from guidance.sim.maths import moments, opening
from guidance.sim.scenario import Scenario
from guidance.sim.teams import Teams, TeamScenario, game_of, played_teams, teams_of

Style = dict[str, Any]

PURSUER_STYLE: Final[Style] = {"color": "#b3261e", "linewidth": 1.8}
EVADER_STYLE: Final[Style] = {"color": "#0b5fa5", "linewidth": 1.8, "linestyle": "--"}
BEFORE: Final = {"color": "0.6", "linewidth": 0.9}
COURSE: Final = {"color": "0.5", "linewidth": 0.8, "marker": ".", "markersize": 4}
FENCE: Final = {"color": "0.1", "linewidth": 1.2, "linestyle": (0, (8, 3, 1, 3))}
STANDOFF: Final = {"color": "#2e7d32", "linewidth": 1.3, "linestyle": "-."}
ISOCHRON: Final = {"color": "0.25", "linewidth": 1.1, "linestyle": ":"}
ISOCHRON_LATER: Final = {"color": "0.25", "linewidth": 1.6, "linestyle": (0, (1, 1))}
MARK: Final = {"color": "0.35", "linewidth": 0.8, "linestyle": (0, (2, 2))}
MEETING: Final = {"color": "black", "marker": "*", "markersize": 11, "linestyle": "none"}
TARGET: Final = {"color": "black", "marker": "X", "markersize": 9, "linestyle": "none"}

_POINTS_A_STEP = 8
_EVADERS = ("#0b5fa5", "#2e7d32", "#8e44ad", "#c77800", "#00838f", "#ad1457", "#5d4037", "#546e7a")
"""A colour for each evader and its discs; repeated after the last."""

_PURSUER = "#c1272d"

_MARGIN_M: Final = 8.0

DPI: Final = 130
MOST_POINTS: Final = 3000
"""Largest number of points of a curve."""

mpl.rcParams["text.parse_math"] = False  # a dollar sign in a title stays a dollar sign


def figure_of(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of its name, for its owner only.

    Raises:
        OutputError: If the file cannot be written.
    """
    with writing(path), whole_file(path) as out:
        figure.savefig(out, dpi=DPI)


def save_twice(figure: Figure, stem: Path, *, dpi: float) -> list[Path]:
    """Write a figure as PNG and as PDF with the same layout, for their owner only; return the paths.

    Raises:
        OSError: If a file cannot be written.
    """
    png_path = stem.with_name(f"{stem.name}.png")
    pdf_path = stem.with_name(f"{stem.name}.pdf")
    paths = [png_path, pdf_path]
    for path, metadata in ((png_path, None), (pdf_path, {"CreationDate": None})):
        with whole_file(path) as out:
            figure.savefig(out, dpi=dpi, metadata=metadata)
        figure.set_layout_engine(None)
    return paths


def check_picture(path: Path) -> None:
    """Refuse an unknown picture format before drawing.

    Raises:
        ConfigError: If its ending is of no format that can be drawn.
    """
    kinds = sorted(FigureCanvasAgg.get_supported_filetypes())
    if path.suffix.removeprefix(".") not in kinds:
        endings = ", ".join(f".{kind}" for kind in kinds)
        raise ConfigError(f"--out {path}: must end in one of {endings}")


def thinned(values: FloatArray) -> FloatArray:
    """Thin out a long curve evenly, keeping both ends."""
    count = min(len(values), MOST_POINTS)
    numbers = np.linspace(0, len(values) - 1, count).round().astype(int)
    return np.asarray(values[numbers])


def label_plan(axes: Any, title: str = "from above", *, adjustable: str = "box") -> None:  # noqa: ANN401
    """Label plan axes and give them equal scales."""
    axes.set(xlabel="x east, m", ylabel="y north, m", title=title)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.grid(visible=True, linewidth=0.3)


def legend_below(figure: Figure, *axes: Any, columns: int = 4, title: str = "") -> None:  # noqa: ANN401
    """Put the legend of all axes below the figure; each name is there once."""
    named: dict[str, Any] = {}
    for axis in axes:
        for line, name in zip(*axis.get_legend_handles_labels(), strict=True):
            named.setdefault(name, line)
    style: dict[str, Any] = {
        "ncols": columns,
        "frameon": False,
        "fontsize": 9,
        "title": title or None,
    }
    figure.legend(named.values(), named, loc="outside lower center", **style)


def legend_beside(axes: Any) -> None:  # noqa: ANN401
    """Put the legend beside the axes."""
    axes.legend(
        loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0.0, frameon=False, fontsize=9
    )


class Shape(NamedTuple):
    """Something to draw in space and from above.

    Attributes:
        places_m: Its places in the game frame, (n, 3).
        style: Of its line or marker.
        name: In the legend; empty for none.
        is_framed: Whether the view is wide enough for it.
        dimensions: Where it is drawn: 3 in space, 2 from above.
    """

    places_m: FloatArray
    style: Style
    name: str
    is_framed: bool = True
    dimensions: Sequence[int] = (2, 3)


def box_of(shapes: Iterable[Shape]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of all framed shapes, with a margin."""
    places_m = np.concatenate([shape.places_m for shape in shapes if shape.is_framed])
    is_finite = np.isfinite(places_m)
    if is_finite.any():
        framed_m = places_m[is_finite.all(axis=-1)]
    else:
        framed_m = np.zeros((1, 3))
    low_m = framed_m.min(axis=0) - _MARGIN_M
    high_m = framed_m.max(axis=0) + _MARGIN_M
    return low_m, high_m


def player_tracks(pursuer: FloatArray, evader: FloatArray) -> Iterator[Shape]:
    """Yield the tracks of both players in the game, (n, 3), m, and their ends."""
    players = (
        ("pursuer", pursuer, PURSUER_STYLE, "o", "s"),
        ("evader", evader, EVADER_STYLE, "^", "v"),
    )
    for name, track, style, begin_marker, end_marker in players:
        mark = {"color": style["color"], "linestyle": "none"}
        begin_style = mark | {"marker": begin_marker}
        end_style = mark | {"marker": end_marker, "mfc": "white"}
        yield Shape(track, style, name)
        if len(track):
            yield Shape(track[:1], begin_style, f"{name} at engagement")
            yield Shape(track[-1:], end_style, f"{name} at the end")


def promise_of(
    curve: FloatArray, meeting_m: Sequence[float] | None, *, with_target: bool
) -> Iterator[Shape]:
    """Yield the game's promise: the isochron at engagement, (n, 2), and the meeting point foreseen, m."""
    yield Shape(lifted(curve, 0.0), ISOCHRON, "isochron at engagement")
    if meeting_m is not None:
        x, y, *_ = meeting_m
        place_m = np.array([[x, y, 0.0]])
        symbol = "g*" if with_target else "q*"
        yield Shape(place_m, MEETING, f"{symbol}, meeting point foreseen", is_framed=False)


def disc_of(reached_m: Sequence[float], standoff: StandOff) -> Shape:
    """Return the stand-off disc about the place of the evader at capture."""
    x, y, *_ = reached_m
    rim = circle_points((x, y, 0.0), standoff.radius_m, 73)
    disc = lifted(rim, standoff.height_m)
    return Shape(disc, STANDOFF, "stand-off disc at capture", is_framed=False)


def target_of(place_m: Enu | None, extent: Extent) -> Iterator[Shape]:
    """Yield the target of a TAD game and the edge of its shape."""
    if place_m is not None:
        edge = lifted(target_edge(place_m, extent), place_m[2])
        edge_style = {"color": TARGET["color"]}
        yield Shape(np.array([place_m]), TARGET, "T, target")
        yield Shape(edge, edge_style, "", is_framed=False)


def chase_figure(
    shapes: Sequence[Shape], fence: Sequence[FloatArray], *, with_whole_fence: bool = False
) -> Figure:
    """Draw a chase in space and from above; `with_whole_fence` adds a view from above with the whole fence.

    Args:
        shapes: Of the chase.
        fence: The fence's closed edges, (n, 3) each.
        with_whole_fence: Draw a third view.
    """
    if with_whole_fence:
        size = (13.0, 5.8)
        widths = [1.15, 0.08, 1.0, 0.7]
    else:
        size = (12.0, 6.4)
        widths = [1.0, 0.06, 0.9]
    figure = figure_of(*size)
    # The second one is for the height's label
    grid = figure.add_gridspec(1, len(widths), width_ratios=widths)
    space = figure.add_subplot(grid[0], projection="3d", elev=22.0, azim=-60.0)
    plan, *other_axes = (figure.add_subplot(grid[column]) for column in range(2, len(widths)))
    views = ((space, 3), (plan, 2), *((axes, 2) for axes in other_axes))
    low, high = box_of(shapes)
    for axes, dimensions in views:
        draw(axes, shapes, dimensions)
        if axes is space or (other_axes and axes is plan):
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        draw_fence(axes, fence, dimensions, whole=axes in other_axes)
    label_plan(plan, adjustable="box" if other_axes else "datalim")
    for axes in other_axes:
        label_plan(axes, "from above, with the fence")
    # Equal scales; the ground or the lowest point is the bottom.
    bottom_m = min(0.0, low[2] + _MARGIN_M)
    space.set(xlabel="x east, m", zlabel="z up, m", zlim=(bottom_m, high[2]))
    space.set_ylabel("y north, m", labelpad=10.0)
    space.locator_params(nbins=5)
    limits = (space.get_xlim3d(), space.get_ylim3d(), space.get_zlim3d())
    spans = [largest - least for least, largest in limits]
    space.set_box_aspect(spans, zoom=0.93)  # equal scales, with space for the labels
    if other_axes:
        legend_below(figure, *other_axes, columns=5)
    else:
        legend_below(figure, plan, columns=4)
    return figure


def draw(axes: Any, shapes: Iterable[Shape], dimensions: int) -> None:  # noqa: ANN401 - 2D or 3D axes
    """Draw shapes, in space or from above."""
    for shape in shapes:
        if dimensions in shape.dimensions:
            places_m = thinned(shape.places_m)[:, :dimensions]
            axes.plot(*places_m.T, **shape.style, label=shape.name)


def draw_fence(
    axes: Any,  # noqa: ANN401
    edges: Sequence[FloatArray],
    dimensions: int,
    *,
    whole: bool = False,
) -> None:
    """Draw the visible part of a fence's edges, so that a wide fence does not shrink the rest.

    Args:
        axes: In space or from above; the rest is drawn already, and gives the view.
        edges: Closed curves, (n, 3) each, m.
        dimensions: 3 in space, 2 from above.
        whole: Widen the view to the whole fence.
    """
    (west, east) = axes.get_xlim()
    (south, north) = axes.get_ylim()
    label: str | None = "fence"
    for edge in edges:
        x, y, _ = edge.T
        is_between_sides = (west <= x) & (x <= east)
        is_between_ends = (south <= y) & (y <= north)
        is_visible = whole | (is_between_sides & is_between_ends)
        if not is_visible.any():
            continue
        if dimensions == 2:
            axes.plot(x, y, **FENCE, label=label, scalex=whole, scaley=whole)
        else:  # 3D axes do not clip
            visible_edge = np.where(is_visible[:, None], edge, np.nan)
            axes.plot(*visible_edge.T, **FENCE, label=label)
            axes.set(xlim=(west, east), ylim=(south, north))
        label = None


def draw_scenario(scenario: Scenario, path: Path) -> None:
    """Draw a scenario, as the mathematics plays it, into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    batch = stack([scenario])
    played_s, pursuer, evader = played(batch)
    meeting_m = opening(batch).meeting_point_m[0]
    foreseen_m = meeting_m if np.isfinite(meeting_m).all() else None
    target_m = target_game_m(scenario)
    curve = isochron(batch.believed, batch.pursuer_m[0], batch.evader_m[0])
    shapes = list[Shape]()
    for name, course in (("P", batch.pursuer.course), ("E", batch.evader.course)):
        if course is not None:
            # No more places than the game needs: some courses go on for minutes.
            is_early = course.times_s[0, :-1] <= 2.0 * played_s
            is_needed = np.concatenate([[True], is_early])
            places_m = course.places_m[0][is_needed]
            label = f"course of {name}"
            shapes.append(Shape(places_m, COURSE, label, is_framed=False, dimensions=(2,)))
    shapes += [
        *player_tracks(pursuer, evader),
        *promise_of(curve, foreseen_m, with_target=target_m is not None),
        disc_of(evader[-1], batch.game.standoff),
        *target_of(target_m, batch.game.target_extent),
    ]
    fence = circle_points(scenario.home_m, scenario.limits.fence_radius_m, 361)
    figure = chase_figure(shapes, [lifted(fence, 0.0)])
    figure.suptitle(scenario.title)
    save(figure, path)


def played(batch: Batch) -> tuple[float, FloatArray, FloatArray]:
    """Play a batch of one game as mathematics; return the duration (s) and both tracks, (n, 3), m.

    A step may be long. Hermite's cubic draws it from the positions and velocities at both ends.
    """
    steps = list(moments(batch))
    after = [*steps[1:], steps[-1]]
    now_s = np.array([step.now_s[0] for step in steps])
    pursuer_m = [step.pursuer_m[0] for step in steps]
    evader_m = [step.evader_m[0] for step in steps]
    pursuer_m_s = [step.flown_m_s[0] for step in after]
    evader_m_s = [step.run_m_s[0] for step in after]
    pursuer = _curved(now_s, pursuer_m, pursuer_m_s)
    evader = _curved(now_s, evader_m, evader_m_s)
    return float(now_s[-1]), pursuer, evader


def _curved(
    now_s: FloatArray, places: Sequence[FloatArray], rates: Sequence[FloatArray]
) -> FloatArray:
    """Return a track through places (m), with more points between them; the rates (m/s) are those of the steps."""
    places_m = np.array(places)
    rates_m_s = np.array(rates)
    s = np.arange(_POINTS_A_STEP)[None, :, None] / _POINTS_A_STEP
    steps_s = np.diff(now_s)[:, None, None]
    begin_tangent_m = steps_s * rates_m_s[:-1, None]
    end_tangent_m = steps_s * rates_m_s[1:, None]
    begin_m = places_m[:-1, None]
    steps_m = np.diff(places_m, axis=0)[:, None]
    begin_bend_m = (1.0 - s) * (begin_tangent_m - steps_m)
    end_bend_m = s * (end_tangent_m - steps_m)
    straight_m = begin_m + s * steps_m
    curved_m = straight_m + s * (1.0 - s) * (begin_bend_m - end_bend_m)
    return np.concatenate([curved_m.reshape(-1, 3), places_m[-1:]])


def draw_teams(scenario: TeamScenario, path: Path) -> None:
    """Draw a scenario of teams into a PNG.

    Raises:
        OutputError: If the file cannot be written.
    """
    teams = teams_of(scenario)
    rollout = played_teams(scenario, [teams], keep_path=True)
    matching = Matching(*(field[0] for field in rollout.first))
    figure = figure_of(9.6, 8.4)
    axes = figure.add_subplot()
    for j in range(len(teams.evaders_m)):
        _draw_region(axes, scenario, matching, j)
    _draw_players(axes, teams, rollout)
    # The target of all evaders, and the edge of its shape.
    place_m = target_game_m(scenario)
    if place_m is not None:
        cross: Style = {"markeredgecolor": "white", "zorder": 5, "linestyle": "none"}
        x, y, _ = place_m
        axes.plot(x, y, "kX", markersize=14, **cross, label="T, target")
        edge_x, edge_y, *_ = target_edge(place_m, target_extent(scenario)).T
        axes.plot(edge_x, edge_y, color=TARGET["color"])
    label_plan(axes, adjustable="datalim")
    axes.set_axisbelow(True)
    figure.suptitle(scenario.title, fontsize=13)
    captured = int(np.count_nonzero(rollout.end == End.CAPTURED))
    unit = "s" if scenario.game == "pe" else "m from T"
    guaranteed = int(matching.guaranteed)
    total = float(matching.total)
    title = f"{guaranteed} captures guaranteed, {total:.2f} {unit} in all; {captured} captured"
    axes.set_title(title, fontsize=10, color="0.3")
    legend_below(figure, axes)
    save(figure, path)


def region(
    scenario: TeamScenario, pursuers: list[int], evader: int, points: int = 721
) -> FloatArray:
    """Return the edge of the points that an evader reaches before some pursuers, (points, 2), m.

    Args:
        scenario: All players.
        pursuers: Numbers of the pursuers.
        evader: Number of the evader.
        points: Number of directions.
    """
    angle_rad = np.linspace(0.0, 2.0 * np.pi, points)
    x = np.cos(angle_rad)
    y = np.sin(angle_rad)
    teams = teams_of(scenario)
    pursuer_speed_m_s = teams.pursuer_speed_m_s[pursuers]
    evader_speed_m_s = float(teams.evader_speed_m_s[evader])
    evader_m = teams.evaders_m[evader]
    game = game_of(scenario, pursuer_speed_m_s, evader_speed_m_s)
    regions = regions_of(game, teams.pursuers_m[pursuers], evader_m)
    distances_m = survived(regions, (x[:, None], y[:, None]))
    far_m = distances_m.min(axis=1)
    directions = np.stack([x, y], axis=-1)
    return np.asarray(evader_m[:2] + far_m[:, None] * directions)


def _draw_region(axes: Any, scenario: TeamScenario, matching: Matching, j: int) -> None:  # noqa: ANN401 - matplotlib's
    """Draw the discs of an evader and its pursuers, shade their intersection, and mark the meeting point."""
    colour = _EVADERS[j % len(_EVADERS)]
    roles = {"first": int(matching.first[j]), "second": int(matching.second[j])}
    pursuers = {role: number for role, number in roles.items() if number >= 0}
    thin: Style = {"color": colour, "linewidth": 0.9, "linestyle": (0, (4, 3))}
    for i in pursuers.values():
        disc = region(scenario, [i], j)
        axes.plot(*disc.T, **thin, label="first there, before one pursuer")
    if not pursuers:
        return
    shade = {"facecolor": to_rgba(colour, 0.14), "edgecolor": colour, "linewidth": 1.6}
    intersection = region(scenario, list(pursuers.values()), j)
    axes.fill(*intersection.T, **shade, label="before both: the intersection")
    x, y, _ = matching.meeting_point_m[j]
    target = scenario.target
    if target is not None:
        # The guaranteed distance: from the meeting point to the nearest point of the target.
        east, north = target.position_m
        way_x, way_y = to_set(FLOATS, target.extent, (float(x) - east, float(y) - north))
        way: Style = {"color": colour, "linewidth": 1.0, "alpha": 0.6, "label": "L, guaranteed"}
        axes.plot([x, x + way_x], [y, y + way_y], **way)
    pursuers_m = teams_of(scenario).pursuers_m
    # A line from each matched pursuer to the meeting point.
    dashes: Style = {"first": "-", "second": (0, (2, 1.5))}
    for role, i in pursuers.items():
        line = {"color": "0.2", "linewidth": 1.4, "linestyle": dashes[role], "zorder": 4}
        axes.plot([pursuers_m[i][0], x], [pursuers_m[i][1], y], **line, label=f"matched, {role}")
    star = {"markeredgecolor": "white", "markersize": 17, "zorder": 6, "linestyle": "none"}
    axes.plot([x], [y], "*", color=colour, **star, label="X*, meeting point")


def _draw_players(axes: Any, teams: Teams, rollout: TeamRollout) -> None:  # noqa: ANN401
    """Draw the tracks as played, and all players at their start."""
    marker_style = {"markeredgecolor": "white", "zorder": 5, "linestyle": "none"}
    beside: dict[str, Any] = {
        "textcoords": "offset points",
        "fontsize": 10,
        "zorder": 7,
        "fontweight": "bold",
    }
    beside["path_effects"] = [withStroke(linewidth=3.0, foreground="white")]
    pursuer_mark = marker_style | {"color": _PURSUER, "markersize": 12}
    for i, (x, y, z) in enumerate(teams.pursuers_m):
        track = np.array([sample.pursuers_m[0, i, :2] for sample in rollout.path])
        label = f"P{i} · {z:g} m"
        axes.plot(*track.T, color=_PURSUER, linewidth=4.0, alpha=0.3, label="pursuer as played")
        axes.plot([x], [y], "^", **pursuer_mark, label="pursuer, and its height")
        axes.annotate(label, (x, y), xytext=(9, -4), color=_PURSUER, **beside)
    for j, (x, y, _) in enumerate(teams.evaders_m):
        colour = _EVADERS[j % len(_EVADERS)]
        track = np.array([sample.evaders_m[0, j, :2] for sample in rollout.path])
        axes.plot(*track.T, color=colour, linewidth=4.0, alpha=0.5, label="evader as played")
        if rollout.end[0, j] == End.ARRIVED:
            ring = {"mfc": "none", "color": colour, "markersize": 18}
            axes.plot(*track[-1:].T, "o", **ring, label="arrived")
        evader_mark = marker_style | {"color": colour, "markersize": 11}
        axes.plot([x], [y], "o", **evader_mark, label="evader")
        axes.annotate(f"E{j}", (x, y), xytext=(8, 6), color=colour, **beside)
