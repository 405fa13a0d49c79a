"""Makes a page's data of a flight from its cycles and events, live or recorded, as plain JSON values.

`python -m guidance.viz.panel.snapshot outcomes FILE…` and `… frames FILE` write JSON of records to standard output. The
panel reads records in such a child process, so a large, damaged or hostile one cannot disturb it.

Each displayed value has a severity by the limits that the flight itself uses. The page shows it as a colour, a shape
and a word.
"""

import json
import math
import sys
from collections import Counter, deque
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np

from guidance.control.follow import gaps_to_disc
from guidance.cycle import Certificate, Violation
from guidance.errors import GuidanceError
from guidance.flight import Event, FlightSettings, State
from guidance.flight.freshness import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S
from guidance.flight.table import SETPOINT_STATES, state_words
from guidance.frames import ned_from_game
from guidance.game import Winner
from guidance.log import Aggregator, CycleEntry, EventEntry, Item, metadata_of, record_errors, scan
from guidance.log.codec import plain
from guidance.log.entries import BEGINNINGS, CYCLE, EVENT, title_of
from guidance.log.reader import Survey, entry_of, survey_of
from guidance.log.scene import isochron_at, target_edge
from guidance.messages import Attitude, GpsFix, Heartbeat, Home, LocalPosition, SystemStatus
from guidance.session.flight_files import RECORD, recorded_settings
from guidance.texts import printable

ISOCHRON_INTERVAL_S: Final = 1.0
_ALARM_SHOWN_S: Final = 10.0
"""Time for showing an alarm."""

BATTERY_CAUTION: Final = 0.1
"""Caution below the minimum of the battery plus this (0 to 1). The flight returns at the minimum."""

LINK_WINDOW_S: Final = 5.0
"""Positions are counted over this time. Link quality is their number over the largest number so far."""

_LINK_CAUTION = 0.8
_LINK_WARNING = 0.5
_FIX_3D: Final = 3
_CENTIMETRES: Final = 2

MAX_FRAMES: Final = 2500
"""Frames of a replay, spread over the flight. Enough for ten a second over four minutes."""

MIN_STEP_S: Final = 0.1

Plain = dict[str, Any]


class Level(StrEnum):
    """Severity."""

    OK = "ok"
    CAUTION = "caution"
    WARNING = "warning"
    UNKNOWN = "unknown"  # no value, which is no fault


_STATES: Final[Mapping[State, Level]] = {
    **dict.fromkeys((State.CONNECTING, State.CHECKING, State.PAUSED, State.HOLDING), Level.CAUTION),
    **dict.fromkeys((State.YIELDED, State.FAILED), Level.WARNING),
}
"""States that need a person; the others are OK."""

_REACH: Final[Mapping[str, Level]] = {"yes": Level.OK, "uncertain": Level.CAUTION}

_OF_THE_GAME: Final = (
    "value",
    "time_needed_s",
    "vehicle_margin_s",
    "reachable_speed_m_s",
    "assured_distance_m",
)
_VELOCITIES: Final = ("flown", "commanded", "desired")
HISTORY: Final = (
    "now_s", "pursuer_m", "evader_m", "gap_m", "height_gap_m", "game.value", "game.time_needed_s",
    "game.assured_distance_m", "speed_m_s.flown", "speed_m_s.commanded", "speed_m_s.desired", "age_s.position",
    "age_s.evader",
)  # fmt: skip
"""Columns of the charts: where each value is in a snapshot. The page makes further rows by the same table."""


def event_row(event: EventEntry) -> Plain:
    """Return an event as the page lists it."""
    return {
        "now_s": round(event.now_s, 2),
        "event": printable(event.event),
        "detail": printable(event.words[:300]),
    }


def history_row(snapshot: Plain | None) -> list[Any]:
    """Return a snapshot as a row of the charts."""
    row = list[Any]()
    for path in HISTORY:
        # Such as "age_s.evader"; None where a step has none.
        value: Any = snapshot
        for step in path.split("."):
            if not value:
                break
            value = value[step]
        row.append(round(value, 2) if isinstance(value, float) else value)
    return row


def level_of(value: float, caution: float, warning: float) -> Level:
    """Severity by two limits: of an age above them, of a share such as the battery's (`warning` is the lower) below."""
    if math.isnan(value):
        return Level.UNKNOWN
    exceeded = [
        value > limit if warning > caution else value < limit for limit in (caution, warning)
    ]
    return (Level.OK, Level.CAUTION, Level.WARNING)[sum(exceeded)]


def of_operator(status: Mapping[str, Any]) -> Plain | None:
    """Severity of the time since the last sign of life; None if the vehicle file requires none."""
    silence_s = status.get("operator_silence_s")
    limit_s = status.get("operator_timeout_s")
    if not (isinstance(silence_s, int | float) and isinstance(limit_s, int | float)):
        return None
    return {
        "level": level_of(silence_s, 0.5 * limit_s, limit_s),
        "silence_s": silence_s,
        "limit_s": limit_s,
    }


def of_snapshot(snapshot: Plain, settings: FlightSettings) -> dict[str, Level]:
    """Severities of a snapshot. Its unknown values are NaN."""
    state = State(snapshot["state"])
    ages = snapshot["age_s"]
    minimum = settings.battery_minimum
    timeout_s = settings.cycle.evader_timeout_s
    is_silent = state in SETPOINT_STATES and not snapshot["streaming"]
    levels = {
        "state": _STATES.get(state, Level.OK),
        "heartbeat": level_of(ages["heartbeat"], 0.5 * HEARTBEAT_LIMIT_S, HEARTBEAT_LIMIT_S),
        "position": level_of(ages["position"], 0.3, TELEMETRY_LIMIT_S),
        "evader": level_of(ages["evader"], 0.5 * timeout_s, timeout_s),
        "battery": level_of(snapshot["battery"], minimum + BATTERY_CAUTION, minimum),
        "link": level_of(snapshot["link"], _LINK_CAUTION, _LINK_WARNING),
        "gps": Level.UNKNOWN,
        "stream": Level.WARNING if is_silent else Level.OK,
        "reach": Level.UNKNOWN,
        "limits": Level.OK,
    }
    gps = snapshot["gps"]
    if gps is not None:
        levels["gps"] = Level.OK if gps["fix"] >= _FIX_3D else Level.WARNING
    game = snapshot["game"]
    if game is not None:
        levels["reach"] = _REACH.get(game["reach"], Level.WARNING)
        levels["limits"] = Level.CAUTION if game["active_limits"] else Level.OK
    return levels


class SnapshotFold:
    """Accumulates the data of one flight; arguments of `Aggregator`.

    Attributes:
        scene: Home, fence, target, size of the stand-off disc and kind of game; another object when it changes.

    Raises:
        ConfigError: If the metadata has no settings.
    """

    def __init__(self, metadata: Mapping[str, str], source: str) -> None:
        self._flight = Aggregator(recorded_settings, metadata, source)
        self._begin()

    def _begin(self) -> None:
        self._last: CycleEntry | None = None
        self._shown: Plain | None = None
        self._alarm: Plain | None = None
        self._isochron: tuple[float, list[Any]] = (-math.inf, [])
        self._armed_s = self._round_trip_s = math.nan
        self._source = ""
        self._positions_s = deque[float]()
        self._most_positions = 0
        self._set_scene()

    def take(self, item: Item) -> EventEntry | CycleEntry | None:
        """Add an item and return it decoded; items other than cycles and events are ignored.

        Raises:
            ConfigError: If it cannot be decoded.
        """
        entry = self._flight.take(item)
        if isinstance(entry, CycleEntry):
            round_trip_s = self._flight.cycle.round_trip_s
            reports = entry.inputs.reports
            armed = self._flight.vehicle.armed
            self._last = entry
            self._shown = None
            if math.isfinite(round_trip_s):
                self._round_trip_s = round_trip_s
            if armed != math.isfinite(self._armed_s):
                self._armed_s = entry.now_s if armed else math.nan
            if reports:
                self._source = reports[-1].source
            if entry.alarm is not None:
                self._alarm = {
                    "what": str(entry.alarm.violation),
                    "amount": entry.alarm.amount,
                    "since_s": entry.now_s,
                }
            for message in entry.inputs.messages:
                if isinstance(message, LocalPosition):
                    self._positions_s.append(message.received_s)
            while self._positions_s and self._positions_s[0] < entry.now_s - LINK_WINDOW_S:
                self._positions_s.popleft()
            self._most_positions = max(self._most_positions, len(self._positions_s))
            if self._flight.home_m != self._home_m:
                self._set_scene()
        elif entry is not None and entry.event in BEGINNINGS:
            self._begin()
        return entry

    def _set_scene(self) -> None:
        cycle = self._flight.settings.cycle
        envelope = self._flight.envelope
        standoff = cycle.game.standoff
        self._home_m = self._flight.home_m
        home = self._flight.vehicle.latest.get(Home)
        home_deg = None
        if home is not None:
            home_deg = [home.latitude_deg, home.longitude_deg]
        target_m = cycle.target_game_m
        unit = "s"
        outline_m: list[Any] = []
        if target_m is not None:
            unit = "m"
            outline_m = np.round(target_edge(target_m, cycle.game.target_extent), 1).tolist()
        self.scene: Plain = {
            "unit": unit,
            "home_m": rounded(self._home_m),
            "home_deg": home_deg,
            "fence_m": [np.round(edge[:, :2], 1).tolist() for edge in self._flight.fence_m],
            "floor_m": envelope.floor_m,
            "ceiling_m": envelope.ceiling_m,
            "target_m": rounded(target_m),
            "target_edge_m": outline_m,
            "standoff_m": {"radius": standoff.radius_m, "height": standoff.height_m},
        }

    def snapshot(self) -> Plain | None:
        """Return the last cycle, as one object until the next; None before the first. Unknown values are null."""
        row = self._last
        if row is None or self._shown is not None:
            return self._shown
        certificate = row.certificate
        cycle = self._flight.cycle
        alarm = self._alarm
        if alarm is None or row.now_s - alarm["since_s"] > _ALARM_SHOWN_S:
            lasting_alarm = None
        else:
            lasting_alarm = alarm
        snapshot: Plain = {
            **self._telemetry(row),
            **self._places(),
            "game": None if certificate is None else game_shown(certificate),
            "alarm": lasting_alarm,
            "age_s": (
                {
                    "heartbeat": self._flight.vehicle.age_s(Heartbeat, row.now_s),
                    "position": known_age(cycle.telemetry_age_s),
                    "evader": known_age(cycle.evader_age_s),
                    "round_trip": self._round_trip_s,
                }
            ),
        }
        snapshot["levels"] = of_snapshot(snapshot, self._flight.settings)
        self._shown = dict(plain(snapshot))
        if certificate is not None and not certificate.no_game:
            # Plain already, and long
            # The isochron of at most a second ago: it solves a batch of games.
            made_s, curve_m = self._isochron
            if not 0.0 <= row.now_s - made_s < ISOCHRON_INTERVAL_S:
                curve = isochron_at(self._flight.settings.cycle, certificate, 49)
                curve = curve[np.isfinite(curve).all(axis=-1)]
                curve_m = np.round(curve, _CENTIMETRES).tolist()
                self._isochron = (row.now_s, curve_m)
            self._shown["game"]["isochron_m"] = curve_m
        return self._shown

    def _telemetry(self, row: CycleEntry) -> Plain:
        """Return the autopilot's status and the flight's state."""
        vehicle = self._flight.vehicle
        autopilot = self._flight.settings.autopilot
        latest = vehicle.latest
        heartbeat = latest.get(Heartbeat)
        status = latest.get(SystemStatus)
        gps = latest.get(GpsFix)
        airborne = vehicle.armed and not vehicle.on_ground
        telemetry: Plain = {
            "mode": "unknown",
            "armed": vehicle.armed,
            "flight_s": self._flight.cycle.now_s - self._armed_s,
            "battery": math.nan,
            "voltage_v": math.nan,
            "gps": None,
            "link": math.nan,
            "yaw_rad": math.nan,
            "now_s": round(row.now_s, 3),
            "state": str(row.state),
            "state_words": state_words(row.state, airborne=airborne),
            "streaming": row.setpoint is not None,
            "against": self._flight.playing or "",
            "source": self._source,
        }
        if heartbeat is not None:
            telemetry["mode"] = autopilot.mode_title(autopilot.mode_of(heartbeat.custom_mode))
        if status is not None:
            telemetry["battery"] = status.battery_remaining
            telemetry["voltage_v"] = status.voltage_v
        if gps is not None:
            telemetry["gps"] = {"fix": gps.fix_type, "satellites": gps.satellites}
        if self._most_positions:
            telemetry["link"] = len(self._positions_s) / self._most_positions
        if latest.get(Attitude) is not None:
            telemetry["yaw_rad"] = round(vehicle.yaw_rad, 3)
        return telemetry

    def _places(self) -> Plain:
        """Return where both players are, how far the disc is, and the speeds."""
        cycle = self._flight.cycle
        ground_gap_m = cycle.gap_m
        height_gap_m = cycle.height_gap_m
        if math.isnan(cycle.gap_m):  # the disc exists also before and after the game
            pursuer_ned_m = ned_from_game(cycle.pursuer_m)
            evader_ned_m = ned_from_game(cycle.evader_m)
            standoff = self._flight.settings.cycle.game.standoff
            gaps = gaps_to_disc(pursuer_ned_m, evader_ned_m, standoff)
            ground_gap_m = gaps.ground_m
            height_gap_m = gaps.height_m
        return {
            "gap_m": ground_gap_m,
            "height_gap_m": height_gap_m,
            "pursuer_m": rounded(cycle.pursuer_m),
            "evader_m": rounded(cycle.evader_m),
            "speed_m_s": {
                name: math.hypot(*getattr(cycle, f"{name}_ned_m_s")) for name in _VELOCITIES
            },
        }


def game_shown(certificate: Certificate) -> Plain:
    """Return the page's data of a game."""
    meeting_m = None if certificate.no_game else rounded(certificate.meeting_point_game_m)
    game = {name: getattr(certificate, name) for name in (*_OF_THE_GAME, "active_limits")}
    return game | {"reach": reach_of(certificate), "meeting_m": meeting_m, "isochron_m": None}


def reach_of(certificate: Certificate) -> str:
    """Say whether the vehicle can reach the evader (TAD: before the target): yes, no, too fast, or uncertain."""
    if certificate.no_game:
        return "too fast"
    winner = certificate.vehicle_winner
    if winner is None:
        winner = certificate.winner
    return {Winner.PURSUER: "yes", Winner.EVADER: "no"}.get(Winner(winner), "uncertain")


def rounded(position: Any) -> list[float] | None:  # noqa: ANN401 - a vector, or None
    """Return a position rounded to 1 cm; None if unknown."""
    if position is None or not all(map(math.isfinite, position)):
        return None
    return [round(float(value), _CENTIMETRES) for value in position]


def known_age(age_s: float) -> float:
    """Return an age ≥ 0; infinite if nothing was received. A client that joins late may get an older cycle last."""
    return max(0.0, age_s) if math.isfinite(age_s) else math.inf


def record_summary(path: Path) -> Plain:
    """Summarise a record and the end of its flight, as far as it can be read.

    Raises:
        ConfigError: If the file is not a record.
    """
    survey = Survey()
    events = Counter[str]()
    last_cycle = b"{}"
    with record_errors(path):
        for item in scan(path, survey):
            if item.topic == CYCLE.topic:
                last_cycle = item.data
            elif item.topic == EVENT.topic:
                events[entry_of(EVENT, item, path).event] += 1
        return {
            "title": printable(title_of(survey.metadata)),
            "started_utc": survey.metadata.get("started_utc", ""),
            "duration_s": round(survey.duration_s, 1),
            "captured": Event.CAPTURED in events,
            "alarms": sum(events[violation] for violation in Violation),
            "ended": json.loads(last_cycle).get("state", ""),
            "torn": "; ".join(survey.faults) or None,
        }


def frames_of(path: Path) -> Plain:
    """Return the frames, scenes and events of a record, and the columns of the charts.

    Raises:
        ConfigError: If the record cannot be read.
    """
    with record_errors(path):
        metadata = metadata_of(path)
        survey = survey_of(path)
        fold = SnapshotFold(metadata, str(path))
        step_s = max(MIN_STEP_S, survey.duration_s / MAX_FRAMES)
        last_s = -math.inf
        frames = list[Any]()
        events = list[Any]()
        scenes = list[Any]()
        for item in scan(path):
            entry = fold.take(item)
            if isinstance(entry, EventEntry):
                events.append(event_row(entry))
            elif entry is not None and entry.now_s - last_s >= 0.99 * step_s:
                last_s = entry.now_s
                if not scenes or scenes[-1]["scene"] is not fold.scene:
                    scenes.append({"from_s": round(entry.now_s, 3), "scene": fold.scene})
                frames.append(fold.snapshot())
    return {
        "name": printable(title_of(metadata)),
        "vehicle": printable(path.parent.name),
        "columns": HISTORY,
        "scenes": scenes,
        "frames": frames,
        "events": events,
    }


def replay_of(path: Path) -> Plain:
    """Return the frames of a record and, as `mates`, those of the other vehicles of its team flight.

    Raises:
        ConfigError: If the record cannot be read.
    """
    mates = set[Path]()
    if path.name == RECORD and recorded_settings(metadata_of(path)).team is not None:
        mates = set(path.parent.parent.glob(f"*/{RECORD}")) - {path}
    replays = [read_or_error(frames_of, mate) for mate in sorted(mates)]
    return {**frames_of(path), "mates": replays}


def read_or_error(read: Callable[[Path], Plain], path: Path) -> Plain:
    """Read a record; an unreadable one gives `{"error": …}`."""
    try:
        return read(path)
    except GuidanceError as error:
        return {"error": str(error)}


def write_json(what: str, *files: str) -> int:
    """Write the replay of a file as JSON, or the outcome of each as a line."""
    for path in map(Path, files):
        shown: Any
        if what == "frames":
            shown = read_or_error(replay_of, path)
        else:
            shown = [str(path), read_or_error(record_summary, path)]
        print(json.dumps(plain(shown), allow_nan=False), flush=True)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(write_json(*sys.argv[1:]))
