"""Draws a flight in Rerun, item by item: the game in space, plots beside it, events below."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from guidance.certificate import Certificate
from guidance.game import Winner
from guidance.log import Aggregator, Cycle, CycleEntry, Item, SettingsOf
from guidance.log.entries import BEGUN, CYCLE, CYCLE_TOPIC, EVENT, EVENT_TOPIC, RELOADED
from guidance.log.reader import CONFIG, entry_of
from guidance.viz.shapes import Array, circle, fence_edges, isochron_at, target_edge

PURSUER: Final = "game/pursuer"
EVADER: Final = "game/evader"
DISC: Final = "game/stand_off_disc"
ISOCHRON: Final = "game/isochron"
MEETING: Final = "game/meeting_point"
FENCE: Final = "game/fence"
TARGET: Final = "game/target"
GUARANTEE: Final = "plots/guarantee"
STATE: Final = "state"
EVENTS: Final = "events"

COLUMN: Final[Mapping[str, str]] = {PURSUER: "pursuer_m", EVADER: "evader_m"}
"""Column of a cycle with the entity's position."""

TIMELINE: Final = "flight"

Colour = tuple[int, int, int]

COLOURS: Final[Mapping[str, Colour]] = {
    PURSUER: (214, 69, 58),
    EVADER: (66, 140, 214),
    DISC: (76, 175, 80),
    ISOCHRON: (190, 190, 190),
    MEETING: (250, 214, 60),
    FENCE: (240, 150, 40),
}


class Curve(NamedTuple):
    """A number of every cycle; NaN is not drawn."""

    path: str
    label: str
    colour: Colour
    of: Callable[[Cycle], float]


_RED, _BLUE, _GREY = COLOURS[PURSUER], COLOURS[EVADER], (150, 150, 150)

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
    Curve("plots/speed/commanded_m_s", "commanded", _RED, lambda cycle: math.hypot(*cycle.commanded_ned_m_s)),
    Curve("plots/speed/wanted_m_s", "wanted by the game", _BLUE, lambda cycle: math.hypot(*cycle.desired_ned_m_s)),
    Curve("plots/age/vehicle_ms", "vehicle's position", _RED, lambda cycle: 1e3 * cycle.telemetry_age_s),
    Curve("plots/age/evader_ms", "evader's last report", _BLUE, lambda cycle: 1e3 * cycle.evader_age_s),
    Curve("plots/age/late_ms", "cycle began late by", _GREY, lambda cycle: 1e3 * cycle.late_s),
)

DRAWN_EVERY_S: Final = 0.2
"""Period of drawing the disc, the isochron and the meeting point."""

MOST_AT_ONCE: Final = 250
"""Largest number of cycles that are sent to the viewer together; sending each one would be slow."""

_POINTS: Final = 73
_WARNINGS: Final = ("lost", "guarantee", "barrier", "yield", "pilot", "foreign", "abort", "fence", "stopped", "late")


def layout(*, with_target: bool) -> rrb.Blueprint:
    """Return the blueprint; `with_target` selects the guarantee's unit."""
    until_now = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    space = rrb.Spatial3DView(
        origin="game",
        name="The game: x east, y north, z up, m",
        eye_controls=rrb.EyeControls3D(
            position=(55.0, -85.0, 60.0), look_target=(0.0, 10.0, 8.0), eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={f"{name}/track": until_now for name in (PURSUER, EVADER)},
    )
    guarantee = "Guarantee L, m from T" if with_target else "Guarantee V + t, s"
    plots = [rrb.TimeSeriesView(origin=path, name=title or guarantee) for path, title in PLOTS.items()]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.TextLogView(origin=EVENTS, name="Events"), row_shares=[3, 1]),
            rrb.Vertical(*plots),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


class Painter:
    """Draws flights into one Rerun recording.

    Args:
        recording: The recording; the caller owns its sinks.
        settings_of: Returns the flight's settings for its metadata.
        metadata: The flight's metadata.
        source: Name of the source, for errors.
    """

    def __init__(
        self, recording: rr.RecordingStream, settings_of: SettingsOf, metadata: Mapping[str, str], source: str
    ) -> None:
        self._to = recording
        self._settings_of = settings_of
        self._settings = settings_of(metadata)
        self._source = Path(source)
        self._aggregator = Aggregator(self._settings)
        self._cycles: list[tuple[Cycle, Certificate | None]] = []
        self._tails: dict[str, Array] = {}
        self._drawn_s = -math.inf
        self._engaged_s: float | None = None
        self._fenced = False
        self._state = ""
        self.cycles = 0
        self._still()

    def take(self, item: Item) -> None:
        """Draw one item. Only cycles and events are drawn.

        Raises:
            ConfigError: If another version wrote it.
        """
        if item.topic == EVENT_TOPIC:
            event = entry_of(EVENT, item, self._source)
            if event.event == RELOADED:
                self._settings = self._settings_of({CONFIG: event.detail})
                event = event._replace(detail="")
            if event.event in {BEGUN, RELOADED}:
                self._begin(event.now_s)
            self._say(event.now_s, f"{event.event}  {event.detail}".rstrip())
        elif item.topic == CYCLE_TOPIC:
            self._cycle(entry_of(CYCLE, item, self._source))
            if len(self._cycles) >= MOST_AT_ONCE:
                self.flush()

    def flush(self) -> None:
        """Send the pending cycles."""
        told, self._cycles = self._cycles, []
        if not told:
            return
        cycles = [cycle for cycle, _ in told]
        now_s = np.array([cycle.now_s for cycle in cycles])
        for name in (PURSUER, EVADER):
            self._track(name, now_s, np.array([getattr(cycle, COLUMN[name]) for cycle in cycles]))
        for curve in CURVES:
            self._plot(curve.path, now_s, np.array([curve.of(cycle) for cycle in cycles]))
        certificates = [certificate for _, certificate in told]
        self._plot(f"{GUARANTEE}/value", now_s, np.array(list(map(self._guaranteed, cycles, certificates))))

    def _begin(self, now_s: float) -> None:
        """Start a flight and forget the previous one."""
        self.flush()
        self._aggregator = Aggregator(self._settings)
        self._tails.clear()
        self._engaged_s = None
        self._fenced = False
        for name in (DISC, ISOCHRON, MEETING):
            self._log(now_s, name, rr.Clear(recursive=False))

    def _cycle(self, row: CycleEntry) -> None:
        cycle, certificate = self._aggregator.cycle(row), row.certificate
        self.cycles += 1
        self._cycles.append((cycle, certificate))
        if certificate is not None and self._engaged_s is None:
            self._engaged_s = row.now_s
        if not self._fenced and self._aggregator.home_m is not None:
            self._fence()
        if row.state != self._state:
            self._state = row.state
            self._log(row.now_s, STATE, rr.TextDocument(row.state))
        if certificate is not None and row.now_s - self._drawn_s >= DRAWN_EVERY_S:
            self._drawn_s = row.now_s
            self._game(row.now_s, certificate)

    def _guaranteed(self, cycle: Cycle, certificate: Certificate | None) -> float:
        """Return V + t since engagement (PE, s), or L (TAD, m): what a perfect pursuer never loses."""
        if certificate is None or certificate.winner != Winner.PURSUER:
            return math.nan
        if self._settings.cycle.target_game_m is not None:
            return certificate.value
        return certificate.value + cycle.now_s - (self._engaged_s or 0.0)

    def _still(self) -> None:
        """Send what never changes: axes, colours, names, the target."""
        self._to.log("game", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name in (PURSUER, EVADER):
            points = rr.Points3D.from_fields(colors=[COLOURS[name]], radii=[0.6], labels=[name.split("/")[1]])
            self._to.log(name, points, static=True)
        target_m = self._settings.cycle.target_game_m
        label = "V + t since engagement, s" if target_m is None else "L, m from T"
        promised = (f"{GUARANTEE}/value", label, COLOURS[PURSUER])
        for path, name, colour in (promised, *((curve.path, curve.label, curve.colour) for curve in CURVES)):
            self._to.log(path, rr.SeriesLines(names=[name], colors=[colour]), static=True)
        if target_m is not None:
            at = rr.Points3D([target_m], radii=0.8, labels=["T"], colors=[(20, 20, 20)])
            self._to.log(TARGET, at, static=True)
            edge = target_edge(target_m, self._settings.cycle.target_extent)
            if len(edge):
                strip = np.column_stack([edge, np.zeros(len(edge))])
                self._to.log(f"{TARGET}/edge", rr.LineStrips3D([strip]), static=True)

    def _fence(self) -> None:
        home = self._aggregator.home_m
        if home is None:
            return
        self._fenced = True
        edges = [lifted(edge, home[2]) for edge in fence_edges(self._aggregator.envelope, home)]
        if edges:
            strips = rr.LineStrips3D(edges, colors=[COLOURS[FENCE]], radii=rr.Radius.ui_points(1.5))
            self._to.log(FENCE, strips, static=True)

    def _game(self, now_s: float, certificate: Certificate) -> None:
        cycle = self._settings.cycle
        evader = certificate.evader_game_m
        rim = lifted(circle(evader, cycle.standoff.radius_m, _POINTS), evader[2] + cycle.standoff.height_m)
        self._line(now_s, DISC, rim)
        if certificate.no_game:
            return
        self._line(now_s, ISOCHRON, lifted(isochron_at(cycle, certificate, _POINTS), 0.0))
        name = "q*" if cycle.target_game_m is None else "g*"
        star = rr.Points3D([certificate.meeting_point_game_m], radii=0.5, labels=[name], colors=[COLOURS[MEETING]])
        self._log(now_s, MEETING, star)

    def _line(self, now_s: float, name: str, curve: Array) -> None:
        self._log(now_s, name, rr.LineStrips3D([curve], colors=[COLOURS[name]], radii=rr.Radius.ui_points(1.5)))

    def _say(self, now_s: float, text: str) -> None:
        warned = any(word in text for word in _WARNINGS)
        self._log(now_s, EVENTS, rr.TextLog(text, level="WARN" if warned else "INFO"))

    def _track(self, name: str, now_s: Array, positions: Array) -> None:
        """Send the position at every cycle, and the line from the last position."""
        known = np.isfinite(positions).all(axis=-1)
        if not known.any():
            return
        run = positions[known]
        self._columns(name, now_s[known], rr.Points3D.columns(positions=run))
        line = np.concatenate([self._tails.get(name, run[:1]), run])
        self._tails[name] = run[-1:]
        strip = rr.LineStrips3D([line], colors=[COLOURS[name]], radii=rr.Radius.ui_points(1.0))
        self._log(float(now_s[known][-1]), f"{name}/track", strip)

    def _plot(self, name: str, now_s: Array, values: Array) -> None:
        known = np.isfinite(values)
        if known.any():
            self._columns(name, now_s[known], rr.Scalars.columns(scalars=values[known]))

    def _columns(self, name: str, now_s: Array, columns: Any) -> None:  # noqa: ANN401 - of any of Rerun's types
        self._to.send_columns(name, indexes=[rr.TimeColumn(TIMELINE, duration=now_s)], columns=columns)

    def _log(self, now_s: float, name: str, what: rr.AsComponents) -> None:
        self._to.set_time(TIMELINE, duration=now_s)
        self._to.log(name, what)


def lifted(curve: Array, height_m: float) -> Array:
    """Lift a curve (n, 2) to a height: (n, 3)."""
    return np.column_stack([curve, np.full(len(curve), height_m)])
