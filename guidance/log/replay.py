"""Runs the present code on recorded inputs: does it send the same commands, and which would other settings send?

Replay is open loop: the motion of the vehicle and the evader stays as recorded. With the settings of the flight, the
setpoints must be equal bit for bit. With other settings, the result is what would have been commanded at each recorded
moment, not how the flight would have continued.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from guidance.errors import ConfigError
from guidance.flight import Flight, Inputs, Outputs
from guidance.frames import Vector
from guidance.log.aggregator import SettingsOf
from guidance.log.entries import BEGUN, CYCLE, RELOADED, CycleEntry, EventEntry, cycle_entry
from guidance.log.reader import CONFIG, Survey, metadata_of, row_of, scan
from guidance.messages import PositionTarget

COMPARED: Final = ("setpoint", "state", "requests", "by")
"""Compared parts of each cycle; `by` is absent in older records and then not compared."""


class ReplayedCycle(NamedTuple):
    """One recorded cycle, the outputs of the present code, and the names of the outputs that differ."""

    row: CycleEntry
    outputs: Outputs
    differing: tuple[str, ...]


@dataclass(slots=True)
class Difference:
    """Difference between recorded and replayed velocities, over the cycles that have both."""

    cycles: int = 0
    angle_sum_rad: float = 0.0
    angle_max_rad: float = 0.0
    speed_sum_m_s: float = 0.0
    speed_max_m_s: float = 0.0

    def add(self, a: Vector, b: Vector) -> None:
        """Add one pair of velocities, m/s; NaN (no game in that cycle) is not counted."""
        speed_m_s, angle_rad = math.dist(a, b), angle_between_rad(a, b)
        if math.isnan(speed_m_s):
            return
        self.cycles += 1
        self.angle_sum_rad += angle_rad
        self.angle_max_rad = max(self.angle_max_rad, angle_rad)
        self.speed_sum_m_s += speed_m_s
        self.speed_max_m_s = max(self.speed_max_m_s, speed_m_s)


@dataclass(slots=True)
class Comparison:
    """Result of a replay.

    Attributes:
        cycles: Number of cycles.
        setpoints: Number of cycles with a recorded setpoint.
        differing: Number of cycles that differ.
        first: The first of them.
        wanted: Velocities of the policy, before servo and limits.
        commanded: Velocities of the setpoints.
    """

    cycles: int = 0
    setpoints: int = 0
    differing: int = 0
    first: ReplayedCycle | None = None
    wanted: Difference = field(default_factory=Difference)
    commanded: Difference = field(default_factory=Difference)

    def add(self, step: ReplayedCycle) -> None:
        """Add one cycle."""
        row, outputs = step.row, step.outputs
        self.cycles += 1
        self.setpoints += row.setpoint is not None
        if step.differing:
            self.differing += 1
            self.first = self.first or step
        if row.setpoint is not None and outputs.setpoint is not None:
            self.commanded.add(row.setpoint.velocity_ned_m_s, outputs.setpoint.velocity_ned_m_s)
        if row.certificate is not None and outputs.certificate is not None:
            self.wanted.add(row.certificate.desired_ned_m_s, outputs.certificate.desired_ned_m_s)


def replay(
    path: Path, settings_of: SettingsOf, survey: Survey | None = None, *, what_if: bool = False
) -> Iterator[ReplayedCycle]:
    """Run the present code over a record, cycle by cycle.

    Args:
        path: The record.
        settings_of: Makes the flight's settings, or others, from its metadata. After a reload of the configuration,
            the reloaded one is used.
        survey: Filled while reading.
        what_if: The settings are not the flight's. The setpoints that the autopilot echoed are then left out: they
            would look like those of a second controller.

    Raises:
        ConfigError: If the record cannot be read, or was written by a version with other messages.
    """
    settings = settings_of(metadata_of(path))
    flight = Flight(settings)
    for item in scan(path, survey):
        row = row_of(item, path)
        if isinstance(row, EventEntry):
            if row.event == RELOADED and not what_if:
                settings = settings_of({CONFIG: row.detail})
            if row.event in {BEGUN, RELOADED}:
                flight = Flight(settings)
        if not isinstance(row, CycleEntry):
            continue
        inputs = row.inputs
        if what_if:
            inputs = inputs._replace(messages=[one for one in inputs.messages if not isinstance(one, PositionTarget)])
        try:
            outputs = flight.step(row.now_s, inputs)
        except ConfigError as error:
            raise ConfigError(f"{path}: another version wrote the cycle at {row.now_s:.3f} s: {error}") from error
        yield ReplayedCycle(row, outputs, tuple(_differing(row, outputs)))


def compare(path: Path, settings_of: SettingsOf, *, what_if: bool = False) -> tuple[Comparison, Survey]:
    """Replay a whole record and count the differences.

    Args:
        path: The record.
        settings_of: Makes a flight's settings from a record's metadata.
        what_if: See `replay`.

    Raises:
        ConfigError: As `replay`.
    """
    comparison, survey = Comparison(), Survey()
    for step in replay(path, settings_of, survey, what_if=what_if):
        comparison.add(step)
    return comparison, survey


def angle_between_rad(a: Vector, b: Vector) -> float:
    """Return the angle between two vectors, radians; zero if one of them is zero."""
    (ax, ay, az), (bx, by, bz) = a, b
    across = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return math.atan2(across, ax * bx + ay * by + az * bz)


def _differing(row: CycleEntry, outputs: Outputs) -> list[str]:
    """Name the outputs that differ: their JSON is equal only if every bit is, including the sign of zero."""
    present = cycle_entry(row.now_s, row.inputs, outputs)
    present = present if row.by is not None else present._replace(by=None)
    recorded_json, present_json = (
        CYCLE.encode(one._replace(inputs=Inputs(), certificate=None, alarm=None, timing=None, vehicle=None))
        for one in (row, present)
    )
    if recorded_json == present_json:
        return []
    before, now = json.loads(recorded_json), json.loads(present_json)
    return [name for name in COMPARED if json.dumps(before.get(name)) != json.dumps(now.get(name))]
