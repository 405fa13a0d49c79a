"""A replay into a CSV: what was commanded and what would have been, cycle by cycle."""

import csv
from pathlib import Path
from typing import Final

from guidance.certificate import Certificate
from guidance.errors import ConfigError
from guidance.log.reader import SettingsOf, Survey
from guidance.log.replay import Comparison, ReplayedCycle, compare, replay
from guidance.messages import Setpoint

_AXES: Final = ("north", "east", "down")
COLUMNS: Final = (
    "now_s",
    "state",
    *(
        f"{whose}_{what}_{axis}_m_s"
        for whose in ("recorded", "replayed")
        for what in ("wanted", "commanded")
        for axis in _AXES
    ),
)


def compare_into(path: Path, settings_of: SettingsOf, out: Path | None, *, what_if: bool) -> tuple[Comparison, Survey]:
    """Replay a record, and write both velocities where a file is given.

    Raises:
        ConfigError: As `replay`, or if `out` cannot be written.
    """
    if out is None:
        return compare(path, settings_of, what_if=what_if)
    comparison, survey = Comparison(), Survey()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with out.open("w", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(COLUMNS)
            for step in replay(path, settings_of, survey, what_if=what_if):
                comparison.add(step)
                table.writerow(_cells(step))
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot be written ({error.strerror})") from error
    return comparison, survey


def _cells(step: ReplayedCycle) -> list[object]:
    row, outputs = step.row, step.outputs
    recorded, replayed = (row.certificate, row.setpoint), (outputs.certificate, outputs.setpoint)
    return [row.now_s, row.state, *_velocities(*recorded), *_velocities(*replayed)]


def _velocities(certificate: Certificate | None, setpoint: Setpoint | None) -> tuple[object, ...]:
    wanted = ("", "", "") if certificate is None else certificate.desired_ned_m_s
    return (*wanted, *(("", "", "") if setpoint is None else setpoint.velocity_ned_m_s))
