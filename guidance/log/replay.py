"""Feed recorded inputs through the present code: does it still command the same, and what would another have commanded?

Replay is open loop: the vehicle's and the evader's motion stay as recorded, whatever is commanded. With the settings of
the flight the setpoints must come back bit for bit; with others the answer is what would have been commanded at each
recorded moment, not how that flight would have gone on.
"""

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from guidance.certificate import Certificate
from guidance.errors import ConfigError, OutputError
from guidance.flight import Flight, Inputs, Outputs
from guidance.frames import Vector
from guidance.log.entries import (
    BEGUN,
    CYCLE,
    CYCLE_TOPIC,
    EVENT,
    EVENT_TOPIC,
    RELOADED,
    CycleEntry,
    InputsEntry,
    cycle_entry,
)
from guidance.log.reader import CONFIG, SettingsOf, Survey, entry_of, metadata_of, scan
from guidance.messages import PositionTarget, Setpoint

COMPARED: Final = ("setpoint", "state", "requests", "by")
"""What a replay compares of each cycle; `by` only if it was recorded."""


class ReplayedCycle(NamedTuple):
    """One cycle: as recorded and as the present code has it."""

    row: CycleEntry
    outputs: Outputs
    differing: tuple[str, ...]


@dataclass(slots=True)
class Apart:
    """How far two velocities lay apart, over the cycles that had both."""

    cycles: int = 0
    angle_sum_rad: float = 0.0
    angle_most_rad: float = 0.0
    speed_sum_m_s: float = 0.0
    speed_most_m_s: float = 0.0

    def add(self, a: Vector, b: Vector) -> None:
        """Count one pair, m/s."""
        speed_m_s, angle_rad = math.dist(a, b), angle_between_rad(a, b)
        if math.isnan(speed_m_s):  # there was no game, and so nothing was wanted
            return
        self.cycles += 1
        self.angle_sum_rad += angle_rad
        self.angle_most_rad = max(self.angle_most_rad, angle_rad)
        self.speed_sum_m_s += speed_m_s
        self.speed_most_m_s = max(self.speed_most_m_s, speed_m_s)


@dataclass(slots=True)
class Comparison:
    """What a replay came to: `wanted` is what the policy asked for, `commanded` what left the servo and the limits."""

    cycles: int = 0
    setpoints: int = 0
    differing: int = 0
    first: ReplayedCycle | None = None
    wanted: Apart = field(default_factory=Apart)
    commanded: Apart = field(default_factory=Apart)

    def add(self, step: ReplayedCycle) -> None:
        """Count one cycle."""
        self.cycles += 1
        self.setpoints += step.row.setpoint is not None
        if step.differing:
            self.differing += 1
            self.first = self.first or step
        setpoint, certificate = step.row.setpoint, step.row.certificate
        if setpoint is not None and step.outputs.setpoint is not None:
            self.commanded.add(setpoint.velocity_ned_m_s, step.outputs.setpoint.velocity_ned_m_s)
        if certificate is not None and step.outputs.certificate is not None:
            self.wanted.add(certificate.desired_ned_m_s, step.outputs.certificate.desired_ned_m_s)


def replay(
    path: Path, settings_of: SettingsOf, survey: Survey | None = None, *, what_if: bool = False
) -> Iterator[ReplayedCycle]:
    """Run the present code over a record, cycle by cycle.

    Args:
        path: The record.
        settings_of: Makes the flight's settings, or others, of its metadata. A daemon that read its configuration
            again goes on with that one.
        survey: Filled along the way.
        what_if: The settings are not the flight's: what the autopilot echoed of the recorded setpoints is left out,
            since the flight would take that for another hand on the vehicle.

    Raises:
        ConfigError: If the record cannot be read, or was written by a version that knew other messages.
    """
    settings = settings_of(metadata_of(path))
    flight = Flight(settings)
    for item in scan(path, survey):
        if item.topic == EVENT_TOPIC:
            event = entry_of(EVENT, item, path)
            if event.event == RELOADED and not what_if:
                settings = settings_of({CONFIG: event.detail})
            if event.event in {BEGUN, RELOADED}:
                flight = Flight(settings)
        if item.topic != CYCLE_TOPIC:
            continue
        row = entry_of(CYCLE, item, path)
        try:
            outputs = flight.step(_without_echo(row.flight_inputs) if what_if else row.flight_inputs)
        except ConfigError as error:
            raise ConfigError(
                f"{path}: the cycle at {row.now_s:.3f} s was written by another version: {error}"
            ) from error
        yield ReplayedCycle(row, outputs, tuple(_differing(row, outputs)))


def compare(path: Path, settings_of: SettingsOf, *, what_if: bool = False) -> tuple[Comparison, Survey]:
    """Replay a whole record and count.

    Raises:
        ConfigError: As `replay`.
    """
    comparison, survey = Comparison(), Survey()
    for step in replay(path, settings_of, survey, what_if=what_if):
        comparison.add(step)
    return comparison, survey


def angle_between_rad(a: Vector, b: Vector) -> float:
    """Angle between two vectors, radians; zero where one of them has no direction."""
    (ax, ay, az), (bx, by, bz) = a, b
    across = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return math.atan2(across, ax * bx + ay * by + az * bz)


def _without_echo(inputs: Inputs) -> Inputs:
    heard = tuple(message for message in inputs.messages if not isinstance(message, PositionTarget))
    return inputs._replace(messages=heard)


def _differing(row: CycleEntry, outputs: Outputs) -> Iterator[str]:
    """Name what differs. The shortest digits of two numbers are equal only where every bit is, -0.0 included."""
    recorded, present = decided(row), decided(cycle_entry(row.flight_inputs, outputs))
    for name in COMPARED:
        if name == "by" and row.by is None:
            continue
        if json.dumps(recorded.get(name)) != json.dumps(present.get(name)):
            yield name


def decided(row: CycleEntry) -> Mapping[str, Any]:
    """Return what is compared of a cycle, as its record has it."""
    nothing = InputsEntry((), (), ())
    written: Mapping[str, Any] = CYCLE.plain(row._replace(inputs=nothing, certificate=None, alarm=None, timing=None))
    return written


_AXES: Final = ("north", "east", "down")

REPLAY_COLUMNS: Final = (
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

    Args:
        path: The record.
        settings_of: Makes a flight's settings of a record's metadata.
        out: A CSV file for both velocities; None compares only.
        what_if: The settings are not the flight's: see `replay`.

    Raises:
        ConfigError: As `replay`.
        OutputError: If `out` cannot be written.
    """
    if out is None:
        return compare(path, settings_of, what_if=what_if)
    comparison, survey = Comparison(), Survey()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with out.open("w", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(REPLAY_COLUMNS)
            for step in replay(path, settings_of, survey, what_if=what_if):
                comparison.add(step)
                table.writerow(_cells(step))
    except OSError as error:
        raise OutputError(f"--out {out}: cannot be written ({error.strerror}); choose another file") from error
    return comparison, survey


def _cells(step: ReplayedCycle) -> list[object]:
    row, outputs = step.row, step.outputs
    recorded, replayed = (row.certificate, row.setpoint), (outputs.certificate, outputs.setpoint)
    return [row.now_s, row.state, *_velocities(*recorded), *_velocities(*replayed)]


def _velocities(certificate: Certificate | None, setpoint: Setpoint | None) -> tuple[object, ...]:
    wanted = ("", "", "") if certificate is None else certificate.desired_ned_m_s
    return (*wanted, *(("", "", "") if setpoint is None else setpoint.velocity_ned_m_s))
