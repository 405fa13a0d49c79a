"""Makes what a page shows of a flight from its cycles and events, live or recorded, as plain JSON values."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from guidance.certificate import Certificate
from guidance.control.follow import gaps_to_disc
from guidance.frames import ned_from_game
from guidance.game import Winner
from guidance.log import Aggregator, Cycle, CycleEntry, EventEntry, Item, SettingsOf, title_of
from guidance.log.codec import plain
from guidance.log.entries import BEGUN, CYCLE, CYCLE_TOPIC, EVENT, EVENT_TOPIC, RELOADED
from guidance.log.reader import CONFIG, entry_of
from guidance.messages import Attitude, Heartbeat, Home, Message, SystemStatus
from guidance.viz.panel import levels
from guidance.viz.shapes import fence_edges, isochron_at

if TYPE_CHECKING:
    from guidance.flight import FlightSettings
    from guidance.monitor import Alarm

ISOCHRON_INTERVAL_S: Final = 0.4
ALARM_SHOWN_S: Final = 10.0
"""How long an alarm is shown."""

_POINTS: Final = 49
_CENTIMETRES: Final = 2

Plain = dict[str, Any]


class SnapshotFold:
    """Accumulates the data of one flight.

    Args:
        settings_of: Makes settings from metadata.
        metadata: Metadata of the flight.
        source: Name for error messages.

    Attributes:
        scenes: Version of `scene` (fence, home, target); increases when it changes.

    Raises:
        ConfigError: If the metadata has no settings.
    """

    def __init__(self, settings_of: SettingsOf, metadata: Mapping[str, str], source: str) -> None:
        self._settings_of = settings_of
        self._settings: FlightSettings = settings_of(metadata)
        self._title = title_of(metadata)
        self._source = Path(source)
        self.scenes = 0
        self._begin()

    def _begin(self) -> None:
        self._aggregator = Aggregator(self._settings)
        self._heard: dict[type, Message] = {}
        self._report = ""
        self._cycle: Cycle | None = None
        self._row: CycleEntry | None = None
        self._alarm: tuple[float, Alarm] | None = None
        self._isochron: list[Any] | None = None
        self._isochron_s = -math.inf
        self._scene: Plain | None = None
        self._home_m: Any = None
        self.scenes += 1

    def take(self, item: Item) -> EventEntry | CycleEntry | None:
        """Add an item and return it decoded; items other than cycles and events are ignored.

        Raises:
            ConfigError: If it cannot be decoded.
        """
        if item.topic == EVENT_TOPIC:
            return self._event(entry_of(EVENT, item, self._source))
        if item.topic == CYCLE_TOPIC:
            row = entry_of(CYCLE, item, self._source)
            self._add_cycle(row)
            return row
        return None

    def _event(self, event: EventEntry) -> EventEntry:
        if event.event == RELOADED:
            self._settings = self._settings_of({CONFIG: event.detail})
            self._begin()
            return event._replace(detail="")
        if event.event == BEGUN:
            self._begin()
        return event

    def _add_cycle(self, row: CycleEntry) -> None:
        self._cycle, self._row = self._aggregator.cycle(row), row
        self._heard.update((type(message), message) for message in row.inputs.messages)
        for report in row.inputs.reports:
            self._report = report.source
        if row.alarm is not None:
            self._alarm = row.now_s, row.alarm
        if self._aggregator.home_m != self._home_m:
            self._home_m = self._aggregator.home_m
            self._scene = None
            self.scenes += 1

    @property
    def scene(self) -> Plain:
        """Home, fence, target, size of the stand-off disc and kind of game."""
        if self._scene is None:
            self._scene = self._make_scene()
        return self._scene

    def _make_scene(self) -> Plain:
        cycle, home, place = self._settings.cycle, self._aggregator.home_m, self._last(Home)
        envelope = self._aggregator.envelope
        return {
            "title": self._title,
            "unit": "s" if cycle.target_game_m is None else "m",
            "autopilot": self._settings.autopilot.name,
            "home_m": rounded(home),
            "home_deg": None if place is None else [place.latitude_deg, place.longitude_deg],
            "fence_m": [] if home is None else [np.round(one, 1).tolist() for one in fence_edges(envelope, home)],
            "floor_m": envelope.floor_m,
            "ceiling_m": envelope.ceiling_m,
            "target_m": rounded(cycle.target_game_m),
            "standoff_m": {"radius": cycle.standoff.radius_m, "height": cycle.standoff.height_m},
            "evader_timeout_s": cycle.evader_timeout_s,
        }

    def snapshot(self) -> Plain | None:
        """Return the last cycle, None before the first; unknown values are null."""
        cycle, row = self._cycle, self._row
        if cycle is None or row is None:
            return None
        heartbeat, status = self._last(Heartbeat), self._last(SystemStatus)
        autopilot, (gap_m, height_gap_m) = self._settings.autopilot, self._gaps_m()
        snapshot: Plain = {
            "now_s": round(cycle.now_s, 3),
            "state": str(row.state),
            "mode": "unknown" if heartbeat is None else autopilot.mode_title(autopilot.mode_of(heartbeat.custom_mode)),
            "armed": heartbeat is not None and heartbeat.armed,
            "battery": math.nan if status is None else status.battery_remaining,
            "streaming": row.setpoint is not None,
            "age_s": {
                "heartbeat": math.inf if heartbeat is None else cycle.now_s - heartbeat.received_s,
                "position": known_age(cycle.telemetry_age_s),
                "evader": known_age(cycle.evader_age_s),
                "late": cycle.late_s,
                "round_trip": cycle.round_trip_s,
            },
            "source": self._report,
            "pursuer_m": rounded(cycle.pursuer_m),
            "evader_m": rounded(cycle.evader_m),
            "gap_m": gap_m,
            "height_gap_m": height_gap_m,
            "yaw_rad": self._yaw(),
            "speed_m_s": {
                "flown": math.hypot(*cycle.flown_ned_m_s),
                "commanded": math.hypot(*cycle.commanded_ned_m_s),
                "desired": math.hypot(*cycle.desired_ned_m_s),
            },
            "game": None if row.certificate is None else self._game(row.certificate, row.now_s),
            "alarm": self._recent_alarm(row.now_s),
        }
        snapshot["levels"] = levels.of_snapshot(snapshot, self._settings)
        return dict(plain(snapshot))

    def _last(self, kind: type[Any]) -> Any:  # noqa: ANN401 - a message of this type
        return self._heard.get(kind)

    def _yaw(self) -> float:
        attitude = self._last(Attitude)
        return math.nan if attitude is None else round(attitude.yaw_rad, 3)

    def _gaps_m(self) -> tuple[float, float]:
        """Distances to the disc, also before and after the game; NaN if a position is unknown."""
        cycle, row = self._cycle, self._row
        if row is not None and row.certificate is not None:
            return row.certificate.gap_m, row.certificate.height_gap_m
        if cycle is None:
            return math.nan, math.nan
        here, evader = ned_from_game(cycle.pursuer_m), ned_from_game(cycle.evader_m)
        gaps = gaps_to_disc(here, evader, self._settings.cycle.standoff)
        return gaps.ground_m, gaps.height_m

    def _game(self, certificate: Certificate, now_s: float) -> Plain:
        meets = not certificate.no_game
        return {
            "winner": certificate.winner,
            "wins": Winner(certificate.vehicle_winner or 0).word,
            "value": certificate.value,
            "margin_s": certificate.margin_s,
            "vehicle_margin_s": certificate.vehicle_margin_s,
            "reachable_m_s": certificate.reachable_speed_m_s,
            "time_needed_s": certificate.time_needed_s,
            "assured_m": certificate.assured_distance_m,
            "limits": list(certificate.active_limits),
            "no_game": certificate.no_game,
            "captured": certificate.captured,
            "meeting_m": rounded(certificate.meeting_point_game_m) if meets else None,
            "isochron_m": self._curve(certificate, now_s) if meets else None,
        }

    def _curve(self, certificate: Certificate, now_s: float) -> list[Any] | None:
        # Computed a few times a second only, because it solves a batch of games.
        if self._isochron is None or not 0.0 <= now_s - self._isochron_s < ISOCHRON_INTERVAL_S:
            self._isochron_s = now_s
            self._isochron = finite(isochron_at(self._settings.cycle, certificate, _POINTS))
        return self._isochron

    def _recent_alarm(self, now_s: float) -> Plain | None:
        if self._alarm is None or now_s - self._alarm[0] > ALARM_SHOWN_S:
            return None
        since_s, alarm = self._alarm
        return {"what": str(alarm.violation), "amount": alarm.amount, "since_s": since_s}

    def history_row(self) -> list[Any] | None:
        """Return the last cycle as a row of the charts, None before the first; columns: `HISTORY`."""
        cycle = self._cycle
        if cycle is None:
            return None
        values = (
            cycle.now_s,
            *cycle.pursuer_m,
            *cycle.evader_m,
            *self._gaps_m(),
            cycle.value,
            cycle.time_needed_s,
            math.hypot(*cycle.flown_ned_m_s),
            math.hypot(*cycle.commanded_ned_m_s),
            math.hypot(*cycle.desired_ned_m_s),
            1e3 * known_age(cycle.telemetry_age_s),
            1e3 * known_age(cycle.evader_age_s),
        )
        return [round(value, 2) if math.isfinite(value) else None for value in values]


HISTORY: Final = (
    "now_s",
    "pursuer_x",
    "pursuer_y",
    "pursuer_z",
    "evader_x",
    "evader_y",
    "evader_z",
    "gap_m",
    "height_gap_m",
    "value",
    "time_needed_s",
    "flown_m_s",
    "commanded_m_s",
    "desired_m_s",
    "position_age_ms",
    "evader_age_ms",
)
"""Columns of `SnapshotFold.history_row`; positions in the game frame, m."""


def rounded(position: Any) -> list[float] | None:  # noqa: ANN401 - a vector, or None
    """Return a position rounded to 1 cm; None if unknown."""
    if position is None or not all(map(math.isfinite, position)):
        return None
    return [round(float(value), _CENTIMETRES) for value in position]


def known_age(age_s: float) -> float:
    """Return an age ≥ 0; infinite if nothing was received. A client that joins late may get an older cycle last."""
    return max(0.0, age_s) if math.isfinite(age_s) else math.inf


def finite(curve: NDArray[np.float64]) -> list[Any]:
    """Return the finite points of a curve, rounded to 1 cm."""
    points: list[Any] = np.round(curve[np.isfinite(curve).all(axis=-1)], _CENTIMETRES).tolist()
    return points
