"""Reads records for the panel, in a child process: outcomes for the list, frames for a replay.

`python -m guidance.viz.panel.playback outcomes FILE…` and `… frames FILE` write JSON to standard output. A large,
damaged or hostile record cannot disturb the panel.
"""

import json
import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any, Final

from guidance.errors import GuidanceError
from guidance.flight import Event
from guidance.log import EventEntry, metadata_of, record_errors, scan, survey_of, title_of
from guidance.log.codec import plain
from guidance.log.entries import CYCLE_TOPIC, EVENT, EVENT_TOPIC
from guidance.log.reader import Survey, entry_of
from guidance.monitor import Violation
from guidance.session.flight_files import recorded_settings
from guidance.viz.panel.snapshot import HISTORY, SnapshotFold, event_row

MAX_FRAMES: Final = 2500
"""Frames of a replay, spread over the flight. Enough for ten a second over four minutes."""

MIN_STEP_S: Final = 0.1


def outcome_of(path: Path) -> dict[str, Any]:
    """Summarise a record and the end of its flight, as far as it can be read.

    Raises:
        ConfigError: If the file is not a record.
    """
    survey, events = Survey(), Counter[str]()
    last_cycle = b"{}"
    with record_errors(path):
        for item in scan(path, survey):
            if item.topic == CYCLE_TOPIC:
                last_cycle = item.data
            elif item.topic == EVENT_TOPIC:
                events[entry_of(EVENT, item, path).event] += 1
        return {
            "title": title_of(survey.metadata),
            "started_utc": survey.metadata.get("started_utc", ""),
            "duration_s": round(survey.duration_s, 1),
            "captured": Event.CAPTURED in events,
            "alarms": sum(events[violation] for violation in Violation),
            "ended": json.loads(last_cycle).get("state", ""),
            "torn": survey.torn,
        }


def frames_of(path: Path) -> dict[str, Any]:
    """Return the frames, scenes and events of a record, and the columns of the charts.

    Raises:
        ConfigError: If the record cannot be read.
    """
    with record_errors(path):
        metadata, survey = metadata_of(path), survey_of(path)
        fold = SnapshotFold(recorded_settings, metadata, str(path))
        step_s = max(MIN_STEP_S, survey.duration_s / MAX_FRAMES)
        frames, events, scenes = list[Any](), list[Any](), list[Any]()
        last_s = -math.inf
        for item in scan(path):
            entry = fold.take(item)
            if isinstance(entry, EventEntry):
                events.append(event_row(entry))
            elif entry is not None and entry.now_s - last_s >= 0.99 * step_s:
                last_s = entry.now_s
                if not scenes or scenes[-1]["scene"] is not fold.scene:
                    scenes.append({"from_s": round(entry.now_s, 3), "scene": fold.scene})
                frames.append(fold.snapshot())
    return {"name": title_of(metadata), "scenes": scenes, "columns": HISTORY, "frames": frames, "events": events}


def main(what: str, *files: str) -> int:
    """Write the frames of a file as JSON, or the outcome of each as a line; unreadable files give `{"error": …}`."""
    for path in map(Path, files):
        try:
            result = (frames_of if what == "frames" else outcome_of)(path)
        except GuidanceError as error:
            result = {"error": str(error)}
        print(json.dumps(plain(result if what == "frames" else [str(path), result]), allow_nan=False), flush=True)  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
