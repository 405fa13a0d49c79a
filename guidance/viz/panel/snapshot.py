"""Makes what a page shows of a flight from its cycles and events, live or recorded, as plain JSON values.

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
from functools import reduce
from pathlib import Path
from typing import Any, Final

import numpy as np

from guidance.control.follow import gaps_to_disc
from guidance.cycle import Certificate, Violation
from guidance.errors import GuidanceError
from guidance.flight import Event, FlightSettings, State
from guidance.flight.detection import HEARTBEAT_LIMIT_S, TELEMETRY_LIMIT_S
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

ISOCHRON_INTERVAL_S: Final = 1.0
ALARM_SHOWN_S: Final = 10.0
"""How long an alarm is shown."""

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
    return {"now_s": round(event.now_s, 2), "event": event.event, "detail": event.words[:300]}


def history_row(snapshot: Plain | None) -> list[Any]:
    """Return a snapshot as a row of the charts."""
    parts: list[Any] = [
        reduce(lambda part, step: part and part[step], path.split("."), snapshot)
        for path in HISTORY
    ]
    return [round(part, 2) if isinstance(part, float) else part for part in parts]


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
    game = snapshot["game"]
    gps = snapshot["gps"]
    minimum = settings.battery_minimum
    timeout_s = settings.cycle.evader_timeout_s
    return {
        "state": _STATES.get(state, Level.OK),
        "heartbeat": level_of(ages["heartbeat"], 0.5 * HEARTBEAT_LIMIT_S, HEARTBEAT_LIMIT_S),
        "position": level_of(ages["position"], 0.3, TELEMETRY_LIMIT_S),
        "evader": level_of(ages["evader"], 0.5 * timeout_s, timeout_s),
        "battery": level_of(snapshot["battery"], minimum + BATTERY_CAUTION, minimum),
        "link": level_of(snapshot["link"], _LINK_CAUTION, _LINK_WARNING),
        "gps": Level.UNKNOWN
        if gps is None
        else Level.OK
        if gps["fix"] >= _FIX_3D
        else Level.WARNING,
        "stream": Level.WARNING
        if state in SETPOINT_STATES and not snapshot["streaming"]
        else Level.OK,
        "reach": Level.UNKNOWN if game is None else _REACH.get(game["reach"], Level.WARNING),
        "limits": Level.CAUTION if game is not None and game["active_limits"] else Level.OK,
    }


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
            self._add_cycle(entry)
        elif entry is not None and entry.event in BEGINNINGS:
            self._begin()
        return entry

    def _add_cycle(self, row: CycleEntry) -> None:
        cycle = self._flight.cycle
        inputs = row.inputs
        self._last = row
        self._shown = None
        self._round_trip_s = (
            cycle.round_trip_s if math.isfinite(cycle.round_trip_s) else self._round_trip_s
        )
        if self._flight.vehicle.armed != math.isfinite(self._armed_s):
            self._armed_s = row.now_s if self._flight.vehicle.armed else math.nan
        self._positions_s.extend(
            one.received_s for one in inputs.messages if isinstance(one, LocalPosition)
        )
        while self._positions_s and self._positions_s[0] < row.now_s - LINK_WINDOW_S:
            self._positions_s.popleft()
        self._most_positions = max(self._most_positions, len(self._positions_s))
        self._source = inputs.reports[-1].source if inputs.reports else self._source
        if row.alarm is not None:
            self._alarm = {
                "what": str(row.alarm.violation),
                "amount": row.alarm.amount,
                "since_s": row.now_s,
            }
        if self._flight.home_m != self._home_m:
            self._set_scene()

    def _set_scene(self) -> None:
        cycle = self._flight.settings.cycle
        envelope = self._flight.envelope
        target = cycle.target_game_m
        standoff = cycle.game.standoff
        self._home_m = self._flight.home_m
        place = self._flight.vehicle.latest.get(Home)
        outline = (
            []
            if target is None
            else np.round(target_edge(target, cycle.game.target_extent), 1).tolist()
        )
        self.scene: Plain = {
            "unit": "s" if target is None else "m",
            "home_m": rounded(self._home_m),
            "home_deg": None if place is None else [place.latitude_deg, place.longitude_deg],
            "fence_m": [np.round(edge[:, :2], 1).tolist() for edge in self._flight.fence_m],
            "floor_m": envelope.floor_m,
            "ceiling_m": envelope.ceiling_m,
            "target_m": rounded(target),
            "target_edge_m": outline,
            "standoff_m": {"radius": standoff.radius_m, "height": standoff.height_m},
        }

    def snapshot(self) -> Plain | None:
        """Return the last cycle, as one object until the next; None before the first. Unknown values are null."""
        row = self._last
        cycle = self._flight.cycle
        if row is None or self._shown is not None:
            return self._shown
        certificate = row.certificate
        alarm = self._alarm
        vehicle = self._flight.vehicle
        pursuer, evader = map(ned_from_game, (cycle.pursuer_m, cycle.evader_m))
        gaps = gaps_to_disc(pursuer, evader, self._flight.settings.cycle.game.standoff)
        before = math.isnan(cycle.gap_m)  # the disc exists also before and after the game
        autopilot = self._flight.settings.autopilot
        latest = vehicle.latest
        heartbeat = latest.get(Heartbeat)
        status = latest.get(SystemStatus)
        gps = latest.get(GpsFix)
        snapshot: Plain = {
            "mode": "unknown"
            if heartbeat is None
            else autopilot.mode_title(autopilot.mode_of(heartbeat.custom_mode)),
            "armed": vehicle.armed,
            "flight_s": cycle.now_s - self._armed_s,
            "battery": math.nan if status is None else status.battery_remaining,
            "voltage_v": math.nan if status is None else status.voltage_v,
            "gps": None if gps is None else {"fix": gps.fix_type, "satellites": gps.satellites},
            "link": len(self._positions_s) / self._most_positions
            if self._most_positions
            else math.nan,
            "yaw_rad": math.nan if latest.get(Attitude) is None else round(vehicle.yaw_rad, 3),
            "now_s": round(row.now_s, 3),
            "state": str(row.state),
            "state_words": state_words(row.state, airborne=vehicle.armed and not vehicle.on_ground),
            "streaming": row.setpoint is not None,
            "against": self._flight.playing or "",
            "source": self._source,
            "gap_m": gaps.ground_m if before else cycle.gap_m,
            "height_gap_m": gaps.height_m if before else cycle.height_gap_m,
            "pursuer_m": rounded(cycle.pursuer_m),
            "evader_m": rounded(cycle.evader_m),
            "speed_m_s": {
                name: math.hypot(*getattr(cycle, f"{name}_ned_m_s")) for name in _VELOCITIES
            },
            "game": None if certificate is None else game_of(certificate),
            "alarm": alarm
            if alarm is not None and row.now_s - alarm["since_s"] <= ALARM_SHOWN_S
            else None,
            "age_s": {
                "heartbeat": vehicle.age_s(Heartbeat, row.now_s),
                "position": known_age(cycle.telemetry_age_s),
                "evader": known_age(cycle.evader_age_s),
                "round_trip": self._round_trip_s,
            },
        }
        snapshot["levels"] = of_snapshot(snapshot, self._flight.settings)
        self._shown = dict(plain(snapshot))
        if certificate is not None and not certificate.no_game:
            # Seldom: it solves a batch of games
            if not 0.0 <= row.now_s - self._isochron[0] < ISOCHRON_INTERVAL_S:
                curve = isochron_at(self._flight.settings.cycle, certificate, 49)
                curve = curve[np.isfinite(curve).all(axis=-1)]
                self._isochron = row.now_s, np.round(curve, _CENTIMETRES).tolist()
            self._shown["game"]["isochron_m"] = self._isochron[1]  # plain already, and long
        return self._shown


def game_of(certificate: Certificate) -> Plain:
    """Return what the page shows of a game."""
    meeting_m = None if certificate.no_game else rounded(certificate.meeting_point_game_m)
    game = {name: getattr(certificate, name) for name in (*_OF_THE_GAME, "active_limits")}
    return game | {"reach": reach_of(certificate), "meeting_m": meeting_m, "isochron_m": None}


def reach_of(certificate: Certificate) -> str:
    """Say whether the vehicle can reach the evader (TAD: before the target): yes, no, too fast, or uncertain."""
    if certificate.no_game:
        return "too fast"
    winner = (
        certificate.winner if certificate.vehicle_winner is None else certificate.vehicle_winner
    )
    return {Winner.PURSUER: "yes", Winner.EVADER: "no"}.get(Winner(winner), "uncertain")


def rounded(position: Any) -> list[float] | None:  # noqa: ANN401 - a vector, or None
    """Return a position rounded to 1 cm; None if unknown."""
    if position is None or not all(map(math.isfinite, position)):
        return None
    return [round(float(value), _CENTIMETRES) for value in position]


def known_age(age_s: float) -> float:
    """Return an age ≥ 0; infinite if nothing was received. A client that joins late may get an older cycle last."""
    return max(0.0, age_s) if math.isfinite(age_s) else math.inf


def outcome_of(path: Path) -> Plain:
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
            "title": title_of(survey.metadata),
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
    said = {"name": title_of(metadata), "vehicle": path.parent.name, "columns": HISTORY}
    return said | {"scenes": scenes, "frames": frames, "events": events}


def replay_of(path: Path) -> Plain:
    """Return the frames of a record and, as `mates`, those of the other vehicles of its team flight.

    Raises:
        ConfigError: If the record cannot be read.
    """
    of_team = path.name == RECORD and recorded_settings(metadata_of(path)).team is not None
    mates = sorted(set(path.parent.parent.glob(f"*/{RECORD}")) - {path}) if of_team else []
    return frames_of(path) | {"mates": [said_of(frames_of, mate) for mate in mates]}


def said_of(read: Callable[[Path], Plain], path: Path) -> Plain:
    """Read a record; an unreadable one gives `{"error": …}`."""
    try:
        return read(path)
    except GuidanceError as error:
        return {"error": str(error)}


def main(what: str, *files: str) -> int:
    """Write the replay of a file as JSON, or the outcome of each as a line."""
    for path in map(Path, files):
        said = (
            said_of(replay_of, path) if what == "frames" else [str(path), said_of(outcome_of, path)]
        )
        print(json.dumps(plain(said), allow_nan=False), flush=True)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
