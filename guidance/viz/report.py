"""The report of a record: one self-contained HTML page without scripts, its pictures, and a moving picture.

The pictures show tracks, the game and its guarantee, velocities, ages and latencies, and events.
"""

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import ExifTags, Image

from guidance.errors import OutputError
from guidance.files import private_file, private_folder, whole_file, writing
from guidance.frames import Enu
from guidance.game.arrays import FloatArray
from guidance.log.entries import SCENARIO
from guidance.log.scene import circle_points, isochron_at, lifted
from guidance.screen import counted
from guidance.viz import figures
from guidance.viz.figures import (
    EVADER_STYLE,
    MARK,
    PURSUER_STYLE,
    STANDOFF,
    TARGET,
    Shape,
    Style,
    legend_beside,
    thinned,
)
from guidance.viz.history import (
    FlightHistory,
    TableRow,
    TeamHistory,
    history_of,
    opening_words,
    summary,
    team_history,
    team_opening_words,
    team_summary,
)

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

FRAMES: Final = 90
FRAME_MS: Final = 80
"""Frames of a moving picture, spread over the game, and how long each is shown."""

_TAIL_S: Final = 2.0
"""Time after the capture that is shown."""

_MARGIN_CYCLES: Final = 50
"""Cycles before and after the game that are shown."""

_MOST_EVENTS = 60
mpl.rcParams["svg.hashsalt"] = "report"  # an SVG is reproducible byte for byte
_SECTION: Final = re.compile(r'<section id="(\w+)">.*?</section>\n', re.DOTALL)
PlottedLine = tuple[str, FloatArray, FloatArray, Style, str | None]
"""A line over time: label of its axis, times, values, style, name."""

_Drawn = Iterable[tuple[str, Figure]]
"""Pictures by name, drawn one after the other."""

_SHADES = ("0.96", "0.86", "0.91", "0.82")


def draw_tracks(history: FlightHistory) -> Figure:
    """Draw the flight in space, from above, and from above with the whole fence."""
    return figures.chase_figure(shapes_of(history), history.flight.fence_m, with_whole_fence=True)


def draw_flight(record: Path, path: Path, title: str) -> None:
    """Draw a recorded flight in space and from above.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the file cannot be written.
    """
    history = history_of(record)
    figure = figures.chase_figure(shapes_of(history), history.flight.fence_m)
    figure.suptitle(title)
    figures.save(figure, path)


def shapes_of(history: FlightHistory) -> list[Shape]:
    """Return the shapes of a recorded flight."""
    settings = history.settings.cycle
    engaged = history.engaged
    captured = history.captured
    begin = len(history.cycles) if engaged is None else engaged.number
    end = begin + len(history.game)
    pursuer = history.column("pursuer_m")
    evader = history.column("evader_m")
    before = Shape(pursuer[:begin], figures.BEFORE, "pursuer before and after")
    after = Shape(pursuer[end:], figures.BEFORE, "pursuer before and after")
    shapes = [before, after]
    shapes += figures.player_tracks(pursuer[begin:end], evader[begin:end])
    if engaged is not None and not engaged.certificate.no_game:
        curve = isochron_at(settings, engaged.certificate)
        meeting_m = engaged.certificate.meeting_point_game_m
        shapes += figures.promise_of(curve, meeting_m, with_target=history.with_target)
    if captured is not None and not captured.certificate.no_game:
        curve = lifted(isochron_at(settings, captured.certificate), 0.0)
        shapes.append(Shape(curve, figures.ISOCHRON_LATER, "isochron at capture", is_framed=False))
    if captured is not None:
        reached_m = captured.certificate.evader_game_m
        shapes.append(figures.disc_of(reached_m, settings.game.standoff))
    shapes += figures.target_of(settings.target_game_m, settings.game.target_extent)
    return shapes


def draw_game(history: FlightHistory) -> Figure:
    """Draw range, time to go and guarantee: t + time needed never rises in PE, and L never falls in TAD."""

    def column(name: str) -> FloatArray:
        return history.column(name)[playing_span(history)]

    now_s = column("now_s")
    needed_s = column("time_needed_s")
    engaged_s = now_s[0] if history.engaged is None else history.engaged.now_s
    since_s = now_s - engaged_s
    game_style = EVADER_STYLE | {"linewidth": 0.9}
    own_style = PURSUER_STYLE | {"linewidth": 0.9}
    lines: list[PlottedLine] = [
        ("range, m", now_s, column("gap_m"), PURSUER_STYLE, "ground distance to the disc's rim"),
        ("range, m", now_s, column("height_gap_m"), EVADER_STYLE, "height above the disc"),
        ("time to go, s", now_s, column("meeting_time_s"), EVADER_STYLE, "the game's pursuer"),
        ("time to go, s", now_s, needed_s, PURSUER_STYLE, "this vehicle"),
    ]
    if history.with_target:
        panel = "guarantee L, m"
        own_m = column("assured_distance_m")
        lines += [
            (panel, now_s, column("value"), game_style, "L, evader's final\ndistance to T"),
            (panel, now_s, own_m, own_style, "the same, of\nthis vehicle"),
        ]
    else:
        panel = "time of capture, s"
        game_s = column("value") + since_s
        own_s = needed_s + since_s
        lines += [
            (panel, now_s, game_s, game_style, "V + t, the game's\npursuer"),
            (panel, now_s, own_s, own_style, "time of capture,\nthis vehicle"),
        ]
    figure, axes = over_time(history, 7.0, lines)
    axes[0].axhline(0.0, color="0.0", linewidth=0.6)
    # The promise at engagement, and the alarms.
    if history.engaged is not None:
        engaged = history.engaged.certificate
        promised = engaged.assured_distance_m if history.with_target else engaged.time_needed_s
        dotted = {"color": "0.15", "linewidth": 1.0, "linestyle": ":"}
        axes[2].axhline(promised, **dotted, label="promised at engagement")
    alarm_style = MARK | {"color": "0.0", "linestyle": "-"}
    label: str | None = "alarm"
    for alarm_s, _ in history.alarms:
        axes[2].axvline(alarm_s, **alarm_style, label=label)
        label = None
    legend_beside(axes[2])
    return figure


def draw_velocities(history: FlightHistory) -> Figure:
    """Draw the flown, commanded and desired velocity, by axis."""
    span = playing_span(history)
    lines = list[PlottedLine]()
    now_s = thinned(history.column("now_s")[span])
    thin = {"linewidth": 1.1}
    curves = (
        ("flown_ned_m_s", {"color": "0.55", "linewidth": 2.2}, "flown"),
        ("commanded_ned_m_s", PURSUER_STYLE | thin, "commanded"),
        ("desired_ned_m_s", EVADER_STYLE | thin, "wanted by the game"),
    )
    for name, style, label in curves:
        north_m_s, east_m_s, down_m_s = thinned(history.column(name)[span]).T
        lines.append(("velocity north, m/s", now_s, north_m_s, style, label))
        lines.append(("velocity east, m/s", now_s, east_m_s, style, None))
        lines.append(("velocity down, m/s", now_s, down_m_s, style, None))
    figure, _ = over_time(history, 7.0, lines)
    return figure


def draw_ages(history: FlightHistory) -> Figure:
    """Draw ages of data, round-trip times and the loop's delays."""
    now_s = history.column("now_s")

    def worst(panel: str, name: str, style: Style, label: str) -> PlottedLine:
        seconds, worst_s = worst_of_each_second(now_s, history.column(name))
        steps = style | {"drawstyle": "steps-post"}
        return panel, seconds, 1e3 * worst_s, steps, label

    dots: Style = {"color": "k", "marker": ".", "linestyle": "none", "markersize": 4}
    round_trip_ms = 1e3 * history.column("round_trip_s")
    age = "oldest in each\nsecond, ms"
    loop = "loop, longest in\neach second, ms"
    lines: list[PlottedLine] = [
        worst(age, "telemetry_age_s", PURSUER_STYLE, "vehicle's position"),
        worst(age, "evader_age_s", EVADER_STYLE, "evader's last report"),
        ("round trip, ms", now_s, round_trip_ms, dots, "TIMESYNC\nthere and back"),
        worst(loop, "late_s", PURSUER_STYLE, "began late by"),
        worst(loop, "worked_s", EVADER_STYLE, "worked for"),
    ]
    figure, axes = over_time(history, 6.4, lines)
    for panel_axes in axes:
        low, high = panel_axes.get_ylim()
        panel_axes.set_ylim(min(0.0, low), max(high, 1.0))
    return figure


def over_time(
    history: FlightHistory, height: float, lines: Sequence[PlottedLine]
) -> tuple[Figure, list[Any]]:
    """Draw panels of lines over time, mark engagement and capture; return the figure and the axes."""
    figure = figures.figure_of(11.0, height)
    panels = list(dict.fromkeys(panel for panel, *_ in lines))
    axes = list(figure.subplots(len(panels), 1, sharex=True))
    for panel, now_s, values, style, label in lines:
        number = panels.index(panel)
        axes[number].plot(now_s, values, **style, label=label)
    for panel_axes, panel in zip(axes, panels, strict=True):
        panel_axes.set(ylabel=panel, xmargin=0.01)
        panel_axes.grid(visible=True, linewidth=0.3)
        if panel_axes.get_legend_handles_labels()[0]:
            legend_beside(panel_axes)
    axes[-1].set_xlabel("time, s")
    above: dict[str, Any] = {
        "transform": axes[0].get_xaxis_transform(),
        "ha": "center",
        "va": "bottom",
        "fontsize": 9,
    }
    for name, moment in (("engaged", history.engaged), ("captured", history.captured)):
        if moment is not None:
            axes[0].text(moment.now_s, 1.01, name, **above)
            for panel_axes in axes:
                panel_axes.axvline(moment.now_s, **MARK)
    return figure, axes


def draw_events(history: FlightHistory) -> Figure:
    """Draw the states as a band with the events below."""
    events = history.events[:_MOST_EVENTS]
    figure = figures.figure_of(11.0, 1.4 + 0.27 * len(events))
    axes = figure.subplots()
    now_s = history.column("now_s")
    # The time of each state has a shade.
    states = np.array([row.state for row in history.rows])
    is_change = states[1:] != states[:-1]
    changes = 1 + np.flatnonzero(is_change)
    bounds = [0, *changes, len(now_s) - 1]
    for number, (first, last) in enumerate(pairwise(bounds)):
        shade = _SHADES[number % len(_SHADES)]
        axes.axvspan(now_s[first], now_s[last], color=shade, linewidth=0.0)
    middle_s = 0.5 * (now_s[0] + now_s[-1])
    for row, event in enumerate(events):
        axes.plot([event.now_s], [row], "ko", ms=4)
        # The words are on the side that has more room.
        label = f"{event.now_s:.2f} s  {event.event}"
        if event.detail:
            label += f"  ({event.words[:110]})"
        if event.now_s < middle_s:
            side = "left"
            shift = 7
        else:
            side = "right"
            shift = -7
        beside: dict[str, Any] = {"textcoords": "offset points", "ha": side, "va": "center"}
        axes.annotate(label, (event.now_s, row), xytext=(shift, 0), **beside, fontsize=8.5)
    axes.set(xlabel="time, s", ylim=(len(events) - 0.4, -0.6), yticks=[])
    axes.margins(x=0.02)
    title = "shades: the flight's states"
    unlabelled = len(history.events) - len(events)
    if unlabelled:
        title += f"; {unlabelled} later events are not shown"
    axes.set_title(title, fontsize=9)
    return figure


def draw_plan(team: TeamHistory) -> Figure:
    """Draw all vehicles and evaders from above."""
    figure = figures.figure_of(10.0, 7.5)
    axes: Any = figure.subplots()
    cycle = team.first.settings.cycle
    game = cycle.game
    # reports of one evader to several vehicles are dots: joined, they would go to and fro
    dots = EVADER_STYLE | {"linestyle": "none", "marker": ".", "markersize": 2}
    for name, flight in team.flights.items():
        _draw_track(axes, name, flight.column("pursuer_m"), PURSUER_STYLE, "vehicle")
    for name in team.evaders:
        reported = list[Enu]()
        for flight in team.flights.values():
            track = flight.evaders.get(name, ())
            reported += [position_m for _, position_m in track]
        _draw_track(axes, name, np.array(reported), dots, "evader")
    for capture in team.captures.values():
        disc = circle_points(capture.evader_m, game.standoff.radius_m)
        axes.plot(*disc.T, **STANDOFF, label="stand-off disc at capture")
    target = figures.target_of(cycle.target_game_m, game.target_extent)
    figures.draw(axes, target, 2)
    figures.label_plan(axes)
    axes.margins(0.1)
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    figures.draw_fence(axes, team.first.flight.fence_m, 2)
    figures.legend_below(figure, axes)
    return figure


def _draw_track(axes: Any, name: str, track: FloatArray, style: Style, kind: str) -> None:  # noqa: ANN401
    """Draw where a player was known to be from above, with its name at the begin."""
    is_finite = np.isfinite(track).all(axis=1)
    places_m = thinned(track[is_finite])[:, :2]
    axes.plot(*places_m.T, **style, label=kind)
    beside = {"xytext": (6, -4), "textcoords": "offset points"}
    axes.annotate(name, places_m[0], **beside, color=style["color"])


def worst_of_each_second(now_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the seconds with data and the largest value in each, which turns a sawtooth into a line."""
    is_finite = np.isfinite(values)
    whole_s = np.floor(now_s[is_finite])
    seconds, starts = np.unique(whole_s, return_index=True)
    if not len(starts):
        return seconds, np.zeros(0)
    return seconds, np.maximum.reduceat(values[is_finite], starts)


def playing_span(history: FlightHistory) -> slice:
    """The cycles from just before the game to just after the capture; all cycles without a game."""
    if not history.game:
        return slice(None)
    before = history.game[0].number - _MARGIN_CYCLES
    after = history.game[-1].number + _MARGIN_CYCLES
    return slice(max(0, before), min(len(history.cycles), after))


def write_animation(history: FlightHistory, path: Path) -> None:
    """Write the game as a moving picture, WebP: from above, and the height over the distance to the evader.

    Raises:
        OSError: If the file cannot be written.
    """
    span = playing_span(history)
    now_s = history.column("now_s")
    record_end_s = now_s[-1]
    engaged_s = record_end_s if history.engaged is None else history.engaged.now_s
    captured_s = record_end_s if history.captured is None else history.captured.now_s
    cycles = np.flatnonzero(now_s <= captured_s + _TAIL_S)[span]
    pursuer_m = history.column("pursuer_m")[cycles]
    evader_m = history.column("evader_m")[cycles]
    apart_m = pursuer_m - evader_m
    distance_m = np.linalg.norm(apart_m[:, :2], axis=-1)
    tracks = _MovingTracks(pursuer_m, evader_m, np.column_stack([distance_m, apart_m[:, 2]]))
    largest_m = np.nan_to_num(tracks.height).max(axis=0)
    stage = _stage(history, np.maximum(1.0, largest_m))
    images = []
    numbers = np.linspace(0, len(cycles) - 1, FRAMES).round().astype(int)
    frames = np.unique(numbers).tolist()
    for number in counted(frames, "drawing the moving picture", len(frames)):
        played_s = max(0.0, now_s[cycles[number]] - engaged_s)
        images.append(_frame(stage, history, tracks, number, played_s))
    # A loop that pauses at its end. The picture's description is the scenario.
    about = Image.Exif()
    about[ExifTags.Base.ImageDescription] = history.survey.metadata.get(SCENARIO, "")
    times_ms = [FRAME_MS] * (len(images) - 1) + [20 * FRAME_MS]
    images[0].save(
        private_file(path),
        save_all=True,
        append_images=images[1:],
        duration=times_ms,
        loop=0,
        quality=55,
        method=4,
        exif=about,
    )


class _MovingTracks(NamedTuple):
    """Places of vehicle and evader, (n, 3), and the vehicle's distance from the evader and height above it, (n, 2)."""

    pursuer_m: FloatArray
    evader_m: FloatArray
    height: FloatArray


class _Stage(NamedTuple):
    """The figure of a moving picture, and its moving parts.

    Attributes:
        figure: The whole figure.
        runs: The ways of vehicle and evader from above, and the vehicle's height.
        marks: The ends of these ways.
        rim: Of the stand-off disc.
        title: With the time.
    """

    figure: Figure
    runs: list[Line2D]
    marks: list[Line2D]
    rim: Line2D
    title: Text


def _stage(history: FlightHistory, most_m: FloatArray) -> _Stage:
    """Draw the static parts; `most_m` are the largest distance and height."""
    shapes = shapes_of(history)
    far_m, high_m = most_m
    figure = figures.figure_of(8.0, 4.4)
    figure.set_dpi(90)
    plan, side = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    # The static parts are drawn once, in a view that shows all shapes.
    still = figures.ISOCHRON, figures.MEETING, TARGET
    still_shapes = [shape for shape in shapes if shape.style in still]
    figures.draw(plan, still_shapes, 2)
    low, high = figures.box_of(shapes)
    figures.label_plan(plan)
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    side.set(xlabel="distance to the evader, m", ylabel="height above it, m", title="height")
    side.set(xlim=(0.0, 1.08 * far_m), ylim=(0.0, 1.15 * high_m))
    side.plot(
        [0.0, history.settings.cycle.game.standoff.radius_m],
        [history.settings.cycle.game.standoff.height_m] * 2,
        **STANDOFF,
    )
    side.grid(visible=True, linewidth=0.3)
    players = (
        (plan, PURSUER_STYLE, "o", "vehicle"),
        (plan, EVADER_STYLE, "^", "evader"),
        (side, PURSUER_STYLE, "o", None),
    )
    runs = []
    marks = []
    for axes, style, marker, name in players:
        runs += axes.plot([], [], **style, label=name)
        marks += axes.plot([], [], marker, color=style["color"])
    (rim,) = plan.plot([], [], **STANDOFF, label="stand-off disc")
    figures.legend_below(figure, plan, columns=5)
    return _Stage(figure, runs, marks, rim, figure.suptitle(""))


def _frame(
    stage: _Stage, history: FlightHistory, tracks: _MovingTracks, number: int, played_s: float
) -> Image.Image:
    """Draw one picture of those that move."""
    for run, mark, track in zip(stage.runs, stage.marks, tracks, strict=True):
        points = track[: number + 1, :2]
        run.set_data(*points.T)
        mark.set_data(*points[-1:].T)
    radius_m = history.settings.cycle.game.standoff.radius_m
    disc = circle_points(tracks.evader_m[number], radius_m, 49)
    stage.rim.set_data(*disc.T)
    stage.title.set_text(f"{history.title}: {played_s:.1f} s")
    canvas = cast("FigureCanvasAgg", stage.figure.canvas)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    return Image.fromarray(pixels).convert("RGB")


PICTURES: Final = {
    "tracks": draw_tracks,
    "game": draw_game,
    "velocities": draw_velocities,
    "ages": draw_ages,
    "events": draw_events,
}


def write_report(path: Path, folder: Path, *, animate: bool = False) -> list[Path]:
    """Write `report.html` and one PNG per picture into `folder`; return the files, the page first.

    Args:
        path: The record.
        folder: Made if it does not exist. An earlier report of the same record is replaced.
        animate: Write `flight.webp` too, a moving picture of the flight.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the folder cannot be written, or contains the report of another record.
    """
    history = history_of(path)
    drawn = ((name, draw(history)) for name, draw in PICTURES.items())
    words = opening_words(history)
    rows = summary(history)
    written = write_page(folder, [history], drawn, words, rows)
    if animate:
        moving_picture = folder / "flight.webp"
        written.append(moving_picture)
        with writing(folder), whole_file(moving_picture) as unfinished:
            write_animation(history, unfinished)
    return written


def write_team_report(records: Mapping[str, Path], folder: Path) -> list[Path]:
    """Write one report of the records of a team, by vehicle; return the files, the page first.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
        OutputError: If the folder cannot be written, or contains the report of other records.
    """
    team = team_history(records)
    flights = list(team.flights.values())
    drawn = [("plan", draw_plan(team))]
    words = team_opening_words(team)
    rows = team_summary(team)
    return write_page(folder, flights, drawn, words, rows)


def write_page(
    folder: Path,
    flights: Sequence[FlightHistory],
    drawn: _Drawn,
    words: str,
    rows: Iterable[TableRow],
) -> list[Path]:
    """Write a page and its pictures; return the files, the page first.

    Args:
        folder: Made if it does not exist.
        flights: The flights of the page; an earlier report of the same records is replaced.
        drawn: The pictures, by their section of `report.html`; the page keeps only those sections.
        words: The first paragraph.
        rows: Of the table.

    Raises:
        OutputError: If the folder cannot be written, or contains the report of other records.
    """
    page = folder / "report.html"
    # The lines of the page that say which records it reports.
    marks = []
    for flight in flights:
        survey = flight.survey
        length = f"{survey.messages.total()} messages, {survey.duration_s:.3f} s"
        identity = escape(f"{flight.path.name}, {length}")
        marks.append(f'<meta name="record" content="{identity}">')
    mark = "\n".join(marks)
    with writing(folder):
        if page.exists():
            earlier_page = page.read_text(encoding="utf-8", errors="replace")
            if mark not in earlier_page:
                raise OutputError(
                    f"{page}: is the report of another record; give --out another folder"
                )
        private_folder(folder)
        written = [page]
        images = {}
        for name, figure in drawn:
            picture = folder / f"{name}.png"
            written.append(picture)
            figures.save(figure, picture)
            figure.set_layout_engine(None)
            drawing = BytesIO()
            figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None})
            encoded = base64.b64encode(drawing.getvalue()).decode("ascii")
            images[name] = f"data:image/svg+xml;base64,{encoded}"
        table = "\n".join(
            f"<tr><th scope='row'>{escape(name)}</th><td>{escape(text)}</td></tr>"
            for name, text in rows
        )
        template_file = resources.files("guidance.viz").joinpath("report.html")
        template = template_file.read_text(encoding="utf-8")
        page_template = _SECTION.sub(
            lambda section: section[0] if section[1] in images else "", template
        )
        texts = {
            "title": escape(flights[0].title),
            "opening": escape(words),
            "rows": table,
        }
        text = Template(page_template).substitute(texts, **images, mark=mark)
        with whole_file(page) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    return written
