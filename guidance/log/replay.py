"""Runs the present code on recorded inputs: does it send the same commands, and which would other settings send?

Replay is open loop: the motion of the vehicle and the evader stays as recorded. With the settings of the flight, the
setpoints must be equal bit for bit. With other settings, the result is what would have been commanded at each recorded
moment, not how the flight would have continued.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from guidance.errors import ConfigError
from guidance.flight import Flight, Inputs, Outputs
from guidance.frames import Ned
from guidance.log.aggregator import SettingsOf
from guidance.log.entries import (
    BEGINNINGS,
    CONFIG,
    CYCLE,
    RELOADED,
    CycleEntry,
    EventEntry,
    cycle_entry,
)
from guidance.log.reader import Survey, metadata_of, row_of, scan
from guidance.messages import PositionTarget

COMPARED: Final = ("setpoint", "state", "requests", "by")
"""Compared parts of each cycle; `by` is absent in older records and then not compared."""


VectorPair = tuple[Ned, Ned]


class ReplayedCycle(NamedTuple):
    """One recorded cycle, the outputs of the present code, and the names of the outputs that differ."""

    row: CycleEntry
    outputs: Outputs
    differing: tuple[str, ...]


class Difference(NamedTuple):
    """Difference between recorded and replayed velocities, over the cycles that have both."""

    cycles: int
    angle_sum_rad: float
    angle_max_rad: float
    speed_sum_m_s: float
    speed_max_m_s: float


class Comparison(NamedTuple):
    """Result of a replay.

    Attributes:
        cycles: Number of cycles.
        setpoints: Number of cycles with a recorded setpoint.
        differing: Number of cycles that differ.
        first: The first of them.
        wanted: Velocities of the policy, before servo and limits.
        commanded: Velocities of the setpoints.
    """

    cycles: int
    setpoints: int
    differing: int
    first: ReplayedCycle | None
    wanted: Difference
    commanded: Difference


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
            if row.event in BEGINNINGS:
                flight = Flight(settings)
        if not isinstance(row, CycleEntry):
            continue
        inputs = row.inputs
        if what_if:
            inputs = inputs._replace(
                messages=[
                    message
                    for message in inputs.messages
                    if not isinstance(message, PositionTarget)
                ]
            )
        try:
            outputs = flight.step(row.now_s, inputs)
        except ConfigError as error:
            raise ConfigError(
                f"{path}: another version wrote the cycle at {row.now_s:.3f} s: {error}"
            ) from error
        # Their JSON is equal only if every bit is, including the sign of zero.
        present = cycle_entry(row.now_s, row.inputs, outputs)
        same: dict[str, Any] = dict.fromkeys(("certificate", "alarm", "timing", "vehicle")) | {
            "inputs": Inputs()
        }
        if row.by is None:
            same |= {"by": None}
        recorded_json, present_json = (
            CYCLE.encode(entry._replace(**same)) for entry in (row, present)
        )
        if recorded_json == present_json:
            differing = []
        else:
            before = json.loads(recorded_json)
            now = json.loads(present_json)
            differing = [
                name
                for name in COMPARED
                if json.dumps(before.get(name)) != json.dumps(now.get(name))
            ]
        yield ReplayedCycle(row, outputs, tuple(differing))


def compare(
    path: Path,
    settings_of: SettingsOf,
    *,
    what_if: bool = False,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[Comparison, Survey]:
    """Replay a whole record and count the differences.

    Args:
        path: The record.
        settings_of: Makes a flight's settings from a record's metadata.
        what_if: See `replay`.
        watch: Called with the flight's time (s) of each replayed cycle, to show progress.

    Raises:
        ConfigError: As `replay`.
    """
    survey = Survey()
    cycles = 0
    setpoints = 0
    differing = 0
    first: ReplayedCycle | None = None
    desired = list[VectorPair]()
    commanded = list[VectorPair]()
    for step in replay(path, settings_of, survey, what_if=what_if):
        row = step.row
        outputs = step.outputs
        watch(row.now_s)
        cycles += 1
        setpoints += row.setpoint is not None
        if step.differing:
            if not first:
                first = step
            differing += 1
        if row.setpoint is not None and outputs.setpoint is not None:
            commanded.append((row.setpoint.velocity_ned_m_s, outputs.setpoint.velocity_ned_m_s))
        if row.certificate is not None and outputs.certificate is not None:
            desired.append((row.certificate.desired_ned_m_s, outputs.certificate.desired_ned_m_s))
    return Comparison(
        cycles, setpoints, differing, first, difference_of(desired), difference_of(commanded)
    ), survey


def difference_of(pairs: Sequence[VectorPair]) -> Difference:
    """Compare pairs of velocities, m/s. A NaN (no game in that cycle) is not counted; a zero vector has no angle."""
    a, b = (
        np.array([pair for pair in pairs if not np.isnan(pair).any()])
        .reshape(-1, 2, 3)
        .swapaxes(0, 1)
    )
    angles_rad = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.vecdot(a, b))
    speeds_m_s = np.linalg.norm(a - b, axis=-1)
    return Difference(
        len(a),
        float(angles_rad.sum()),
        float(angles_rad.max(initial=0.0)),
        float(speeds_m_s.sum()),
        float(speeds_m_s.max(initial=0.0)),
    )
