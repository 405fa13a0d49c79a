"""Flights that are over, in a process of its own: how each ended, and all moments of one as the page draws them.

`python -m guidance.viz.panel.playback outcomes FILE…` and `… frames FILE` write JSON to standard output. A record
that is large, damaged or a stranger's costs the panel nothing but the wait.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any, Final

from guidance.errors import GuidanceError
from guidance.flight import Event, State
from guidance.log import EventEntry, metadata_of, record_errors, scan, survey_of, title_of
from guidance.log.codec import plain
from guidance.log.entries import EVENT, EVENT_TOPIC
from guidance.log.reader import Survey, entry_of
from guidance.monitor import Violation
from guidance.session.flight_files import recorded_settings
from guidance.viz.panel.snapshot import HISTORY, SnapshotFold

MOST_FRAMES: Final = 2500
"""Of a replay, spread over the flight: ten a second of four minutes."""

LEAST_STEP_S: Final = 0.1
_HISTORY_SHARE: Final = 2


def outcome_of(path: Path) -> dict[str, Any]:
    """Say what a record holds and how its flight ended, as far as it can be read.

    Raises:
        ConfigError: If it is no record.
    """
    survey = Survey()
    state, captured, alarms = "", False, 0
    with record_errors(path):
        for item in scan(path, survey):
            if item.topic != EVENT_TOPIC:
                continue
            event = entry_of(EVENT, item, path)
            captured |= event.event == Event.CAPTURED
            alarms += _is_alarm(event)
            state = _state_after(event) or state
        title = title_of(survey.metadata)
    return {
        "title": title,
        "started_utc": survey.metadata.get("started_utc", ""),
        "duration_s": round(survey.duration_s, 1),
        "captured": captured,
        "alarms": alarms,
        "ended": state,
        "torn": survey.torn,
    }


def _state_after(event: EventEntry) -> str:
    """Return the state that an event led to; empty where it led to none."""
    _, arrow, after = event.detail.partition(" -> ")
    after = after.partition(":")[0]
    return after if arrow and after in set(State) else ""


def _is_alarm(event: EventEntry) -> bool:
    """Whether an event is an alarm of the monitor."""
    return event.event in set(Violation)


def frames_of(path: Path) -> dict[str, Any]:
    """Fold a whole record into moments, as many as a slider can tell apart.

    Raises:
        ConfigError: If it cannot be read.
    """
    with record_errors(path):
        metadata, survey = metadata_of(path), survey_of(path)
        fold = SnapshotFold(recorded_settings, metadata, str(path))
        step_s = max(LEAST_STEP_S, survey.duration_s / MOST_FRAMES)
        frames: list[dict[str, Any]] = []
        rows: list[Any] = []
        events: list[dict[str, Any]] = []
        scenes: list[dict[str, Any]] = []
        told = -1
        last_s = -math.inf
        for item in scan(path):
            entry = fold.take(item)
            if isinstance(entry, EventEntry):
                events.append({"now_s": round(entry.now_s, 2), "event": entry.event, "detail": entry.detail[:300]})
            elif entry is not None and entry.now_s - last_s >= 0.99 * step_s:
                last_s = entry.now_s
                if fold.scenes != told:
                    told = fold.scenes
                    scenes.append({"from_s": round(entry.now_s, 3), "scene": fold.scene})
                seen = fold.snapshot()
                if seen is not None:
                    frames.append(seen)
                if len(frames) % _HISTORY_SHARE == 1:
                    rows.append(fold.history_row())
    return {
        "name": title_of(metadata),
        "scenes": scenes,
        "columns": HISTORY,
        "rows": rows,
        "frames": frames,
        "events": events,
    }


def main(what: str, *files: str) -> int:
    """Write what was asked for; a file that cannot be read is an `error` in its place."""
    paths = [Path(name) for name in files]
    if what == "frames":
        try:
            said: Any = frames_of(paths[0])
        except GuidanceError as error:
            said = {"error": str(error)}
    else:
        said = {str(path): _outcome_or_error(path) for path in paths}
    json.dump(plain(said), sys.stdout, separators=(",", ":"), allow_nan=False)
    return 0


def _outcome_or_error(path: Path) -> dict[str, Any]:
    try:
        return outcome_of(path)
    except GuidanceError as error:
        return {"error": str(error)}


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
