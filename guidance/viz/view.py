"""`guidance view`: draws a flight in Rerun, item by item, and serves it on loopback. Needs the extra `viz`.

The game is drawn in space, plots beside it, and events below. `view` shows a `RecordFile` or a
`guidance.log.broadcast.LiveFlight` in a file or on a page.
"""

import contextlib
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from guidance.cycle import Certificate
from guidance.errors import ConfigError
from guidance.files import private_file, private_folder, writing
from guidance.game import Winner
from guidance.game.arrays import FloatArray
from guidance.log import (
    Aggregator,
    Cycle,
    EventEntry,
    Item,
    metadata_of,
    scan,
    title_of,
)
from guidance.log.broadcast import LiveFlight
from guidance.log.entries import BEGINNINGS, Idle
from guidance.log.scene import circle_points, isochron_at, lifted, target_edge
from guidance.session.flight_files import recorded_settings
from guidance.viz.serving import recording_server, recording_uri, web_page

REDRAWN_EVERY_S: Final = 0.1
_NICE: Final = 10
"""Niceness of a live viewer, so that the flight's loop has priority."""

Colour = tuple[int, int, int]

COLOURS: Final[Mapping[str, Colour]] = {
    "game/pursuer": (214, 69, 58),
    "game/evader": (66, 140, 214),
    "game/stand_off_disc": (76, 175, 80),
    "game/isochron": (190, 190, 190),
    "game/meeting_point": (250, 214, 60),
    "game/fence": (240, 150, 40),
}
PURSUER, EVADER, DISC, ISOCHRON, MEETING, FENCE = COLOURS
GUARANTEE: Final = "plots/guarantee"
VALUE: Final = f"{GUARANTEE}/value"
EVENTS: Final = "events"
TIMELINE: Final = "flight"


class Curve(NamedTuple):
    """A number of every cycle; NaN is not drawn."""

    path: str
    label: str
    colour: Colour
    of: Callable[[Cycle], float]


_RED = COLOURS[PURSUER]
_BLUE = COLOURS[EVADER]
_GREY = (150, 150, 150)

PLOTS: Final[Mapping[str, str]] = {
    "plots/range": "Range to the stand-off disc, m",
    "plots/to_go": "Value to go, s",
    GUARANTEE: "",  # its unit depends on the game
    "plots/speed": "Speed, m/s",
    "plots/age": "Age of what is known, and the loop, ms",
}
"""Path -> title."""

CURVES: Final = (
    Curve("plots/range/ground_m", "to the rim, over ground", _RED, lambda cycle: cycle.gap_m),
    Curve("plots/range/height_m", "above the disc", _BLUE, lambda cycle: cycle.height_gap_m),
    Curve("plots/to_go/value_s", "the game's pursuer", _RED, lambda cycle: cycle.meeting_time_s),
    Curve("plots/to_go/needed_s", "this vehicle", _GREY, lambda cycle: cycle.time_needed_s),
    Curve("plots/speed/flown_m_s", "flown", _GREY, lambda cycle: math.hypot(*cycle.flown_ned_m_s)),
    Curve(
        "plots/speed/commanded_m_s",
        "commanded",
        _RED,
        lambda cycle: math.hypot(*cycle.commanded_ned_m_s),
    ),
    Curve(
        "plots/speed/wanted_m_s",
        "wanted by the game",
        _BLUE,
        lambda cycle: math.hypot(*cycle.desired_ned_m_s),
    ),
    Curve(
        "plots/age/vehicle_ms",
        "vehicle's position",
        _RED,
        lambda cycle: 1e3 * cycle.telemetry_age_s,
    ),
    Curve(
        "plots/age/evader_ms", "evader's last report", _BLUE, lambda cycle: 1e3 * cycle.evader_age_s
    ),
    Curve("plots/age/late_ms", "cycle began late by", _GREY, lambda cycle: 1e3 * cycle.late_s),
)

DRAWN_EVERY_S: Final = 0.2
"""Period of drawing the disc, the isochron and the meeting point."""

MOST_AT_ONCE: Final = 250
"""Largest number of cycles that are sent to the viewer together; sending each one would be slow."""

_POINTS: Final = 73
_WARNINGS: Final = (
    "lost",
    "guarantee",
    "barrier",
    "yield",
    "pilot",
    "foreign",
    "abort",
    "fence",
    "stopped",
    "late",
)


def entity_path(name: str, vehicle: str) -> str:
    """Return the path of an entity of one vehicle: in a team, the vehicle is below the common view."""
    if not vehicle:
        return name
    parts = name.split("/")
    parts.insert(2 if parts[0] == "plots" else 1, vehicle)
    return "/".join(parts)


def layout(vehicles: Sequence[str], *, with_target: bool) -> rrb.Blueprint:
    """Return the blueprint for these vehicles ("" is one alone); `with_target` selects the guarantee's unit."""
    # In space tracks are drawn up to the time that is shown.
    pursuer_tracks = [entity_path(f"{PURSUER}/track", vehicle) for vehicle in vehicles]
    evader_tracks = [entity_path(f"{EVADER}/track", vehicle) for vehicle in vehicles]
    start = rrb.TimeRangeBoundary.infinite()
    end = rrb.TimeRangeBoundary.cursor_relative()
    until_now = rrb.VisibleTimeRanges(timeline=TIMELINE, start=start, end=end)
    styles: dict[Any, Any] = dict.fromkeys(pursuer_tracks + evader_tracks, until_now)
    eye = rrb.EyeControls3D(
        position=(55.0, -85.0, 60.0), look_target=(0.0, 10.0, 8.0), eye_up=(0.0, 0.0, 1.0)
    )
    name = "The game: x east, y north, z up, m"
    space = rrb.Spatial3DView(origin="game", name=name, eye_controls=eye, overrides=styles)
    guarantee = "Guarantee L, m from T" if with_target else "Guarantee V + t, s"
    plots = [
        rrb.TimeSeriesView(origin=path, name=title or guarantee) for path, title in PLOTS.items()
    ]
    events = rrb.TextLogView(origin=EVENTS, name="Events")
    game = rrb.Vertical(space, events, row_shares=[3, 1])
    views = rrb.Horizontal(game, rrb.Vertical(*plots), column_shares=[3, 2])
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following")
    selection = rrb.SelectionPanel(state="hidden")
    blueprint = rrb.BlueprintPanel(state="hidden")
    return rrb.Blueprint(views, time, selection, blueprint)


class Painter:
    """Draws flights into one Rerun recording.

    Args:
        recording: The recording; the caller owns its sinks.
        flight: Reads the flights of the source.
        vehicle: Its name if the recording has several; else empty.
    """

    def __init__(
        self, recording: rr.RecordingStream, flight: Aggregator, vehicle: str = ""
    ) -> None:
        self._to = recording
        self._flight = flight
        self._vehicle = vehicle
        self._state = ""
        self._drawn_s = -math.inf
        self.cycles = 0
        self._begin()
        # Static entities: axes, colours, names, the target.
        self._to.log("game", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        # In a team, the label of an evader comes with the role
        pursuer_labels = [self._vehicle or "pursuer"]
        evader_labels = None if self._vehicle else ["evader"]
        for name, labels in ((PURSUER, pursuer_labels), (EVADER, evader_labels)):
            point = rr.Points3D.from_fields(colors=[COLOURS[name]], radii=[0.6], labels=labels)
            self._log(None, name, point)
        cycle = self._flight.settings.cycle
        target_m = cycle.target_game_m
        label = "V + t since engagement, s" if target_m is None else "L, m from T"
        self._draw_curve(VALUE, label, _RED)
        for curve in CURVES:
            self._draw_curve(curve.path, curve.label, curve.colour)
        if target_m is not None:
            target = rr.Points3D([target_m], radii=0.8, labels=["T"], colors=[(20, 20, 20)])
            self._log(None, "game/target", target)
            edge = target_edge(target_m, cycle.game.target_extent)
            if len(edge):
                strip = rr.LineStrips3D([lifted(edge, 0.0)])
                self._log(None, "game/target/edge", strip)

    def _begin(self) -> None:
        """Start a flight."""
        # the time of each cycle, and its drawings by path
        self._pending = list[tuple[float, dict[str, Any]]]()
        self._tails = dict[str, FloatArray]()
        self._fenced = False
        self._engaged_s: float | None = None

    def take(self, item: Item) -> None:
        """Draw one item. Only cycles and events are drawn.

        Raises:
            ConfigError: If another version wrote it.
        """
        entry = self._flight.take(item)
        if isinstance(entry, EventEntry):
            if entry.event in BEGINNINGS:
                self.flush()
                self._begin()
                for name in (DISC, ISOCHRON, MEETING):
                    self._log(entry.now_s, name, rr.Clear(recursive=False))
            text = f"{entry.event}  {entry.words}".rstrip()
            is_warning = any(word in text for word in _WARNINGS)
            level = "WARN" if is_warning else "INFO"
            self._log(entry.now_s, EVENTS, rr.TextLog(text, level=level))
        elif entry is not None:
            certificate = entry.certificate
            home_m = self._flight.home_m
            cycle = self._flight.cycle
            if certificate is not None and self._engaged_s is None:
                self._engaged_s = entry.now_s
            self.cycles += 1
            drawn: dict[str, Any] = {curve.path: curve.of(cycle) for curve in CURVES}
            drawn[PURSUER] = cycle.pursuer_m
            drawn[EVADER] = cycle.evader_m
            drawn[VALUE] = self._guaranteed(entry.now_s, certificate)
            self._pending.append((cycle.now_s, drawn))
            if not self._fenced and home_m is not None:
                self._fenced = True
                if edges := self._flight.fence_m:
                    self._log(None, FENCE, _line_strips(edges, FENCE))
            role = entry.inputs.role
            if role is not None:
                label = rr.Points3D.from_fields(labels=[role.evader])
                self._log(entry.now_s, EVADER, label)
            if entry.state != self._state:
                self._state = entry.state
                self._log(entry.now_s, "state", rr.TextDocument(entry.state))
            if certificate is not None and entry.now_s - self._drawn_s >= DRAWN_EVERY_S:
                self._drawn_s = entry.now_s
                self._draw_game(entry.now_s, certificate)
            if len(self._pending) >= MOST_AT_ONCE:
                self.flush()

    def flush(self) -> None:
        """Send the pending cycles."""
        pending = self._pending
        self._pending = []
        if not pending:
            return
        now_s = np.array([at_s for at_s, _ in pending])
        _, first = pending[0]
        for name in first:
            # A number or a position of every cycle that has one; of a position also the line from the last one.
            values = np.array([drawn[name] for _, drawn in pending])
            numbers = values.reshape(len(values), -1)
            is_finite = np.isfinite(numbers).all(axis=-1)
            if not is_finite.any():
                continue
            run = values[is_finite]
            times_s = now_s[is_finite]
            is_track = values.ndim > 1
            columns: Any
            if is_track:
                columns = rr.Points3D.columns(positions=run)
            else:
                columns = rr.Scalars.columns(scalars=run)
            indexes = [rr.TimeColumn(TIMELINE, duration=times_s)]
            path = entity_path(name, self._vehicle)
            self._to.send_columns(path, indexes=indexes, columns=columns)
            if is_track:
                tail = self._tails.get(name, run[:1])
                line = np.concatenate([tail, run])
                self._tails[name] = run[-1:]
                last_s = float(times_s[-1])
                self._log(last_s, f"{name}/track", _line_strips([line], name, 1.0))

    def _guaranteed(self, now_s: float, certificate: Certificate | None) -> float:
        """Return V + t since engagement (PE, s), or L (TAD, m): what a perfect pursuer never loses."""
        if certificate is None or certificate.winner != Winner.PURSUER:
            return math.nan
        with_target = self._flight.settings.cycle.target_game_m is not None
        if with_target or self._engaged_s is None:
            return certificate.value
        return certificate.value + (now_s - self._engaged_s)

    def _draw_curve(self, path: str, label: str, colour: Colour) -> None:
        """Send name and colour of a curve."""
        name = " ".join(filter(None, (self._vehicle, label)))
        self._log(None, path, rr.SeriesLines(names=[name], colors=[colour]))

    def _draw_game(self, now_s: float, certificate: Certificate) -> None:
        cycle = self._flight.settings.cycle
        evader_m = certificate.evader_game_m
        standoff = cycle.game.standoff
        height_m = evader_m[2] + standoff.height_m
        rim = lifted(circle_points(evader_m, standoff.radius_m, _POINTS), height_m)
        self._log(now_s, DISC, _line_strips([rim], DISC))
        if certificate.no_game:
            return
        isochron = lifted(isochron_at(cycle, certificate, _POINTS), 0.0)
        self._log(now_s, ISOCHRON, _line_strips([isochron], ISOCHRON))
        name = "q*" if cycle.target_game_m is None else "g*"
        meeting_m = certificate.meeting_point_game_m
        star = rr.Points3D([meeting_m], radii=0.5, labels=[name], colors=[COLOURS[MEETING]])
        self._log(now_s, MEETING, star)

    def _log(self, now_s: float | None, name: str, components: rr.AsComponents) -> None:
        """Log components from a time on; None logs them as static."""
        if now_s is not None:
            self._to.set_time(TIMELINE, duration=now_s)
        path = entity_path(name, self._vehicle)
        self._to.log(path, components, static=now_s is None)


def _line_strips(curves: list[FloatArray], name: str, width: float = 1.5) -> rr.LineStrips3D:
    radius = rr.Radius.ui_points(width)
    return rr.LineStrips3D(curves, colors=[COLOURS[name]], radii=radius)


class RecordFile(NamedTuple):
    """A record; `live` is one that is still being written."""

    path: Path
    live: bool = False

    @property
    def name(self) -> str:
        """Its name in errors."""
        return str(self.path)

    def metadata(self, idle: Idle) -> Mapping[str, str]:
        """Return the record's metadata."""
        return metadata_of(self.path, idle if self.live else None)

    def items(self, idle: Idle) -> Iterator[Item]:
        """Yield the record's messages."""
        return scan(self.path, idle=idle if self.live else None)


Source = RecordFile | LiveFlight


def view(
    sources: Mapping[str, Source],
    save: Path | None,
    ports: tuple[int, int],
    say: Callable[[str], None],
    ended: Event,
) -> int:
    """Show a flight until `ended` is set, or save it. Return the number of cycles.

    Args:
        sources: The flight, or the flights of a team by vehicle. Unreadable items are errors in a record; on a bus,
            where anyone can publish, they are ignored.
        save: A file; None serves a page.
        ports: Of the recording and of the page on loopback; 0 picks a free one.
        say: Receives the page's address.
        ended: Ends the viewer.

    Raises:
        ConfigError: If the record cannot be read.
        OutputError: If the file cannot be written.
        LinkError: If a port is in use.
    """
    with contextlib.ExitStack() as closing:
        if any(source.live for source in sources.values()):
            os.nice(_NICE)
        wait = partial(ended.wait, REDRAWN_EVERY_S)
        metadata = {name: source.metadata(wait) for name, source in sources.items()}
        first = next(iter(metadata.values()))
        recording = rr.RecordingStream("guidance")
        closing.callback(recording.disconnect)
        sink: Any
        if save is None:
            recording_port, page_port = ports
            port, sink = closing.enter_context(recording_server(recording_port))
            page = closing.enter_context(web_page(page_port, port))
            say(f"look at  {page}")
            say(f"or with  rerun --connect {recording_uri(port)}")
        else:
            with writing(save):
                private_folder(save.parent)
                # Rerun itself only logs a failure
                sink = rr.FileSink(private_file(save))
        if len(sources) > 1:
            vehicles = tuple(sources)
        else:
            vehicles = ("",)
        with_target = recorded_settings(first).cycle.target_game_m is not None
        recording.set_sinks(sink, default_blueprint=layout(vehicles, with_target=with_target))
        recording.send_recording_name(title_of(first))
        painters = []
        for vehicle, (name, source) in zip(vehicles, sources.items(), strict=True):
            flight = Aggregator(recorded_settings, metadata[name], source.name)
            painters.append(Painter(recording, flight, vehicle))
        paint = partial(_paint, ended)
        # One thread for each: a record that still grows keeps its thread
        with ThreadPoolExecutor(len(painters)) as pool:
            list(pool.map(paint, painters, sources.values()))  # raises a painter's error
        if save is None:
            ended.wait()
        return sum(painter.cycles for painter in painters)


def _paint(ended: Event, painter: Painter, source: Source) -> None:
    """Draw one flight until it ends, or until the view does."""

    def idle() -> bool:
        painter.flush()
        return ended.wait(REDRAWN_EVERY_S)

    ignored: tuple[type[Exception], ...] = ()
    if not isinstance(source, RecordFile):
        ignored = (ConfigError, KeyError, TypeError)
    for item in source.items(idle):
        with contextlib.suppress(*ignored):
            painter.take(item)
        if ended.is_set() and not source.live:  # a live flight is shown to its end
            break
    painter.flush()
