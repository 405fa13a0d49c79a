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
from typing import Any, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image

from guidance.errors import OutputError
from guidance.files import private_file, private_folder, whole_file, writing
from guidance.frames import Enu
from guidance.game import StandOff
from guidance.log.scene import Array, circle, isochron_at, lifted
from guidance.screen import counted
from guidance.viz import figures
from guidance.viz.figures import (
    EVADER,
    MARK,
    PURSUER,
    STANDOFF,
    TARGET,
    Shape,
    Style,
    legend_beside,
    thinned,
)
from guidance.viz.story import (
    Row,
    Story,
    TeamStory,
    opening,
    story_of,
    summary,
    team_opening,
    team_story,
    team_summary,
)

FRAMES: Final = 90
FRAME_MS: Final = 80
"""Frames of a moving picture, spread over the game, and how long each is shown."""

_TAIL_S: Final = 2.0
"""Time after the capture that is shown."""

_MOST_EVENTS = 60
mpl.rcParams["svg.hashsalt"] = "report"  # an SVG is reproducible byte for byte
_SECTION: Final = re.compile(r'<section id="(\w+)">.*?</section>\n', re.DOTALL)
Line = tuple[str, Array, Array, Style, str | None]
"""A line over time: label of its axis, times, values, style, name."""

Drawn = Iterable[tuple[str, Figure]]
"""Pictures by name, drawn one after the other."""

_SHADES = ("0.96", "0.86", "0.91", "0.82")


def tracks(story: Story) -> Figure:
    """Draw the flight in space, from above, and from above with the whole fence."""
    return figures.chase_figure(shapes_of(story), story.flight.fence_m, with_whole_fence=True)


def draw_flight(record: Path, path: Path, title: str) -> None:
    """Draw a recorded flight in space and from above.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the file cannot be written.
    """
    story = story_of(record)
    figure = figures.chase_figure(shapes_of(story), story.flight.fence_m)
    figure.suptitle(title)
    figures.save(figure, path)


def shapes_of(story: Story) -> list[Shape]:
    """Return the shapes of a recorded flight."""
    settings = story.settings.cycle
    engaged = story.engaged
    captured = story.captured
    begin = len(story.cycles) if engaged is None else engaged.number
    end = begin + len(story.game)
    pursuer = story.column("pursuer_m")
    evader = story.column("evader_m")
    shapes = [
        Shape(part, figures.BEFORE, "pursuer before and after")
        for part in (pursuer[:begin], pursuer[end:])
    ]
    shapes += figures.players_of(pursuer[begin:end], evader[begin:end])
    if engaged is not None and not engaged.certificate.no_game:
        curve = isochron_at(settings, engaged.certificate)
        meeting_m = engaged.certificate.meeting_point_game_m
        shapes += figures.promise_of(curve, meeting_m, with_target=story.with_target)
    if captured is not None and not captured.certificate.no_game:
        curve = lifted(isochron_at(settings, captured.certificate), 0.0)
        shapes.append(Shape(curve, figures.ISOCHRON_LATER, "isochron at capture", is_framed=False))
    if captured is not None:
        shapes.append(figures.disc_of(captured.certificate.evader_game_m, settings.game.standoff))
    return [*shapes, *figures.target_of(settings.target_game_m, settings.game.target_extent)]


def game(story: Story) -> Figure:
    """Draw range, time to go and guarantee: t + time needed never rises in PE, and L never falls in TAD."""

    def column(name: str) -> Array:
        return story.column(name)[playing_span(story)]

    now_s = column("now_s")
    value = column("value")
    needed_s = column("time_needed_s")
    since_s = now_s - (now_s[0] if story.engaged is None else story.engaged.now_s)
    panel = "time of capture, s"
    ideal = "V + t, the game's\npursuer"
    own_label = "time of capture,\nthis vehicle"
    guaranteed = value + since_s
    own_guaranteed = needed_s + since_s
    if story.with_target:
        panel = "guarantee L, m"
        ideal = "L, evader's final\ndistance to T"
        own_label = "the same, of\nthis vehicle"
        guaranteed = value
        own_guaranteed = column("assured_distance_m")
    lines: list[Line] = [
        ("range, m", now_s, column("gap_m"), PURSUER, "ground distance to the disc's rim"),
        ("range, m", now_s, column("height_gap_m"), EVADER, "height above the disc"),
        ("time to go, s", now_s, column("meeting_time_s"), EVADER, "the game's pursuer"),
        ("time to go, s", now_s, needed_s, PURSUER, "this vehicle"),
        (panel, now_s, guaranteed, EVADER | {"linewidth": 0.9}, ideal),
        (panel, now_s, own_guaranteed, PURSUER | {"linewidth": 0.9}, own_label),
    ]
    figure, axes = over_time(story, 7.0, lines)
    axes[0].axhline(0.0, color="0.0", linewidth=0.6)
    if story.engaged is not None:
        engaged = story.engaged.certificate
        promised = engaged.assured_distance_m if story.with_target else engaged.time_needed_s
        axes[2].axhline(
            promised, color="0.15", linewidth=1.0, linestyle=":", label="promised at engagement"
        )
    for number, (alarm_s, _) in enumerate(story.alarms):
        axes[2].axvline(
            alarm_s, **MARK | {"color": "0.0", "linestyle": "-"}, label=None if number else "alarm"
        )
    legend_beside(axes[2])
    return figure


def velocities(story: Story) -> Figure:
    """Draw the flown, commanded and desired velocity, by axis."""
    span = playing_span(story)
    lines = list[Line]()
    now_s = thinned(story.column("now_s")[span])
    for name, style, label in (
        ("flown_ned_m_s", {"color": "0.55", "linewidth": 2.2}, "flown"),
        ("commanded_ned_m_s", PURSUER | {"linewidth": 1.1}, "commanded"),
        ("desired_ned_m_s", EVADER | {"linewidth": 1.1}, "wanted by the game"),
    ):
        for column, axis in zip(
            thinned(story.column(name)[span]).T, ("north", "east", "down"), strict=True
        ):
            lines.append(
                (f"velocity {axis}, m/s", now_s, column, style, label if axis == "north" else None)
            )
    return over_time(story, 7.0, lines)[0]


def ages(story: Story) -> Figure:
    """Draw ages of data, round-trip times and the loop's delays."""

    def worst(panel: str, name: str, style: Style, label: str) -> Line:
        seconds, worst_s = worst_of_each_second(story.column("now_s"), story.column(name))
        return panel, seconds, 1e3 * worst_s, style | {"drawstyle": "steps-post"}, label

    dots: Style = {"color": "k", "marker": ".", "linestyle": "none", "markersize": 4}
    trips = (
        story.column("now_s"),
        1e3 * story.column("round_trip_s"),
        dots,
        "TIMESYNC\nthere and back",
    )
    lines: list[Line] = [
        worst("oldest in each\nsecond, ms", "telemetry_age_s", PURSUER, "vehicle's position"),
        worst("oldest in each\nsecond, ms", "evader_age_s", EVADER, "evader's last report"),
        ("round trip, ms", *trips),
        worst("loop, longest in\neach second, ms", "late_s", PURSUER, "began late by"),
        worst("loop, longest in\neach second, ms", "worked_s", EVADER, "worked for"),
    ]
    figure, axes = over_time(story, 6.4, lines)
    for panel_axes in axes:
        low, high = panel_axes.get_ylim()
        panel_axes.set_ylim(min(0.0, low), max(high, 1.0))
    return figure


def over_time(story: Story, height: float, lines: Sequence[Line]) -> tuple[Figure, list[Any]]:
    """Draw panels of lines over time, mark engagement and capture; return the figure and the axes."""
    figure = figures.figure_of(11.0, height)
    panels = list(dict.fromkeys(panel for panel, *_ in lines))
    axes = list(figure.subplots(len(panels), 1, sharex=True))
    for panel, now_s, values, style, label in lines:
        axes[panels.index(panel)].plot(now_s, values, **style, label=label)
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
    for name, moment in (("engaged", story.engaged), ("captured", story.captured)):
        if moment is not None:
            axes[0].text(moment.now_s, 1.01, name, **above)
            for panel_axes in axes:
                panel_axes.axvline(moment.now_s, **MARK)
    return figure, axes


def events(story: Story) -> Figure:
    """Draw the states as a band with the events below."""
    events = story.events[:_MOST_EVENTS]
    figure = figures.figure_of(11.0, 1.4 + 0.27 * len(events))
    axes = figure.subplots()
    now_s = story.column("now_s")
    states = np.array([row.state for row in story.rows])
    changes = [0, *(1 + np.flatnonzero(states[1:] != states[:-1])), len(now_s) - 1]
    for number, (first, last) in enumerate(pairwise(changes)):
        axes.axvspan(now_s[first], now_s[last], color=_SHADES[number % len(_SHADES)], linewidth=0.0)
    for row, event in enumerate(events):
        axes.plot([event.now_s], [row], "ko", ms=4)
        if event.now_s < 0.5 * (now_s[0] + now_s[-1]):
            side = "left"
            shift = 7
        else:
            side = "right"
            shift = -7
        words = f"{event.now_s:.2f} s  {event.event}" + (
            f"  ({event.words[:110]})" if event.detail else ""
        )
        beside: dict[str, Any] = {
            "xytext": (shift, 0),
            "textcoords": "offset points",
            "ha": side,
            "va": "center",
        }
        axes.annotate(words, (event.now_s, row), **beside, fontsize=8.5)
    axes.set(xlabel="time, s", ylim=(len(events) - 0.4, -0.6), yticks=[])
    axes.margins(x=0.02)
    unlabelled = len(story.events) - len(events)
    axes.set_title(
        "shades: the flight's states"
        + (f"; {unlabelled} later events are not shown" if unlabelled else ""),
        fontsize=9,
    )
    return figure


def plan(team: TeamStory) -> Figure:
    """Draw all vehicles and evaders from above."""
    figure = figures.figure_of(10.0, 7.5)
    axes: Any = figure.subplots()
    game = team.first.settings.cycle.game
    # reports of one evader to several vehicles are dots: joined, they would go to and fro
    dots = EVADER | {"linestyle": "none", "marker": ".", "markersize": 2}
    tracks = [
        (name, story.column("pursuer_m"), PURSUER, "vehicle")
        for name, story in team.flights.items()
    ]
    for name in team.evaders:
        reported = list[Enu]()
        for flight in team.flights.values():
            reported += [position_m for _, position_m in flight.evaders.get(name, ())]
        tracks.append((name, np.array(reported), dots, "evader"))
    for name, track, style, kind in tracks:
        track_m = thinned(track[np.isfinite(track).all(axis=1)])
        axes.plot(*track_m[:, :2].T, **style, label=kind)
        axes.annotate(
            name, track_m[0, :2], xytext=(6, -4), textcoords="offset points", color=style["color"]
        )
    for capture in team.captures.values():
        axes.plot(
            *circle(capture.evader_m, game.standoff.radius_m).T,
            **STANDOFF,
            label="stand-off disc at capture",
        )
    figures.draw(
        axes, figures.target_of(team.first.settings.cycle.target_game_m, game.target_extent), 2
    )
    figures.label_plan(axes)
    axes.margins(0.1)
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())
    figures.draw_fence(axes, team.first.flight.fence_m, 2)
    figures.legend_below(figure, axes)
    return figure


def worst_of_each_second(now_s: Array, values: Array) -> tuple[Array, Array]:
    """Return the seconds with data and the largest value in each, which turns a sawtooth into a line."""
    finite = np.isfinite(values)
    seconds, starts = np.unique(np.floor(now_s[finite]), return_index=True)
    return seconds, np.maximum.reduceat(values[finite], starts) if len(starts) else np.zeros(0)


def playing_span(story: Story) -> slice:
    """The cycles from just before the game to just after the capture; all cycles without a game."""
    if not story.game:
        return slice(None)
    return slice(
        max(0, story.game[0].number - 50), min(len(story.cycles), story.game[-1].number + 50)
    )


def write_animation(story: Story, path: Path) -> None:
    """Write the game as a moving picture, WebP: from above, and the height over the distance to the evader.

    Raises:
        OSError: If the file cannot be written.
    """
    span = playing_span(story)
    now_s = story.column("now_s")
    begun_s, ended_s = (
        now_s[-1] if cycle is None else cycle.now_s for cycle in (story.engaged, story.captured)
    )
    cycles = np.flatnonzero(now_s <= ended_s + _TAIL_S)[span]
    pursuer, evader = (story.column(name)[cycles] for name in ("pursuer_m", "evader_m"))
    height = np.column_stack(
        [np.linalg.norm(pursuer[:, :2] - evader[:, :2], axis=-1), pursuer[:, 2] - evader[:, 2]]
    )
    stage = _stage(story, np.maximum(1.0, np.nan_to_num(height).max(axis=0)))
    radius_m = story.settings.cycle.game.standoff.radius_m
    images = []
    numbers = np.unique(np.linspace(0, len(cycles) - 1, FRAMES).round().astype(int)).tolist()
    for number in counted(numbers, "drawing the moving picture", len(numbers)):
        for run, mark, track in zip(
            stage.runs, stage.marks, (pursuer, evader, height), strict=True
        ):
            run.set_data(*track[: number + 1, :2].T)
            mark.set_data(*track[number : number + 1, :2].T)
        stage.rim.set_data(*circle(evader[number], radius_m, 49).T)
        played_s = max(0.0, now_s[cycles[number]] - begun_s)
        stage.title.set_text(f"{story.title}: {played_s:.1f} s")
        canvas = stage.figure.canvas
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))  # type: ignore[attr-defined]
    _save_moving(images, path)


class _Stage(NamedTuple):
    """The figure of a moving picture, and what moves in it.

    Attributes:
        figure: All of it.
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


def _stage(story: Story, most_m: Array) -> _Stage:
    """Draw what does not move; `most_m` are the largest distance and height."""
    shapes = shapes_of(story)
    far_m, high_m = most_m
    figure = figures.figure_of(8.0, 4.4)
    figure.set_dpi(90)
    plan, side = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    still = figures.ISOCHRON, figures.MEETING, TARGET
    figures.draw(plan, (shape for shape in shapes if shape.style in still), 2)
    low, high = figures.box_of(shapes)
    figures.label_plan(plan)
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    _label_height(side, far_m, high_m, story.settings.cycle.game.standoff)
    players = (
        (plan, PURSUER, "o", "vehicle"),
        (plan, EVADER, "^", "evader"),
        (side, PURSUER, "o", None),
    )
    runs = [axes.plot([], [], **style, label=name)[0] for axes, style, _, name in players]
    marks = [axes.plot([], [], mark, color=style["color"])[0] for axes, style, mark, _ in players]
    (rim,) = plan.plot([], [], **STANDOFF, label="stand-off disc")
    figures.legend_below(figure, plan, columns=5)
    return _Stage(figure, runs, marks, rim, figure.suptitle(""))


def _save_moving(images: Sequence[Image.Image], path: Path) -> None:
    """Write pictures as one that moves, in a loop, and stands still at its end."""
    times_ms = [FRAME_MS] * (len(images) - 1) + [20 * FRAME_MS]
    images[0].save(
        private_file(path),
        save_all=True,
        append_images=images[1:],
        duration=times_ms,
        loop=0,
        quality=55,
        method=4,
    )


def _label_height(axes: Any, far_m: float, high_m: float, standoff: StandOff) -> None:  # noqa: ANN401
    """Label the picture of the height over the distance, and draw the stand-off disc from the side."""
    axes.set(xlabel="distance to the evader, m", ylabel="height above it, m", title="height")
    axes.set(xlim=(0.0, 1.08 * far_m), ylim=(0.0, 1.15 * high_m))
    axes.plot([0.0, standoff.radius_m], [standoff.height_m] * 2, **STANDOFF)
    axes.grid(visible=True, linewidth=0.3)


PICTURES: Final = {
    "tracks": tracks,
    "game": game,
    "velocities": velocities,
    "ages": ages,
    "events": events,
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
    story = story_of(path)
    drawn = ((name, draw(story)) for name, draw in PICTURES.items())
    written = write_page(folder, [story], drawn, opening(story), summary(story))
    if animate:
        written.append(folder / "flight.webp")
        with writing(folder), whole_file(written[-1]) as unfinished:
            write_animation(story, unfinished)
    return written


def write_team_report(records: Mapping[str, Path], folder: Path) -> list[Path]:
    """Write one report of the records of a team, by vehicle; return the files, the page first.

    Raises:
        ConfigError: If a record cannot be read, or is not of a team.
        OutputError: If the folder cannot be written, or contains the report of other records.
    """
    team = team_story(records)
    words = team_opening(team)
    rows = team_summary(team)
    return write_page(folder, list(team.flights.values()), [("plan", plan(team))], words, rows)


def write_page(
    folder: Path, flights: Sequence[Story], drawn: Drawn, words: str, rows: Iterable[Row]
) -> list[Path]:
    """Write a page and its pictures; return the files, the page first.

    Args:
        folder: Made if it does not exist.
        flights: What the page is about; an earlier report of the same records is replaced.
        drawn: The pictures, by their section of `report.html`; the page keeps only those sections.
        words: The first paragraph.
        rows: Of the table.

    Raises:
        OutputError: If the folder cannot be written, or contains the report of other records.
    """
    page = folder / "report.html"
    ids = (
        f"{flight.path.name}, {flight.survey.messages.total()} messages, {flight.survey.duration_s:.3f} s"
        for flight in flights
    )
    mark = "\n".join(f'<meta name="record" content="{escape(identity)}">' for identity in ids)
    with writing(folder):
        if page.exists() and mark not in page.read_text(encoding="utf-8", errors="replace"):
            raise OutputError(f"{page}: is the report of another record; give --out another folder")
        private_folder(folder)
        written = [page]
        images = {}
        for name, figure in drawn:
            written.append(folder / f"{name}.png")
            figures.save(figure, written[-1])
            figure.set_layout_engine(None)  # keep this layout for the SVG
            figure.savefig(
                drawing := BytesIO(), format="svg", metadata={"Date": None, "Creator": None}
            )
            images[name] = (
                f"data:image/svg+xml;base64,{base64.b64encode(drawing.getvalue()).decode('ascii')}"
            )
        table = [
            f"<tr><th scope='row'>{escape(name)}</th><td>{escape(text)}</td></tr>"
            for name, text in rows
        ]
        template = (
            resources.files("guidance.viz").joinpath("report.html").read_text(encoding="utf-8")
        )
        page_template = _SECTION.sub(
            lambda section: section[0] if section[1] in images else "", template
        )
        texts = {
            "title": escape(flights[0].title),
            "opening": escape(words),
            "rows": "\n".join(table),
        }
        with whole_file(page) as unfinished:
            text = Template(page_template).substitute(texts, **images, mark=mark)
            unfinished.write_text(text, encoding="utf-8")
    return written
