"""Replaying a log's commands through the stepped dynamics, and comparing the answers."""

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from sitl_mock.calibrate.measures import Response, Samples, Segment, response_of, segments_of
from sitl_mock.calibrate.step_log import StepLog
from sitl_mock.dynamics import CALM, Kind, Setpoint, Vehicle, arducopter_quadrotor, px4_quadrotor

RMS_LIMIT_M_S = 0.15
"""A mock whose velocity differs by more than this from the real vehicle's, per axis and over the file, is not it."""

_FAR_BELOW_M = 1e6


class Flavour(StrEnum):
    """Autopilots with a calibrated copter."""

    PX4 = "px4"
    ARDUCOPTER = "arducopter"


@dataclass(frozen=True)
class AxisComparison:
    """One axis of one segment: the real vehicle against the mock."""

    axis: str
    command_m_s: float
    real: Response
    mock: Response
    rms_m_s: float


@dataclass(frozen=True)
class SegmentComparison:
    """One segment; `axes` are north, east, down."""

    start_s: float
    end_s: float
    varying: bool
    axes: tuple[AxisComparison, AxisComparison, AxisComparison]


@dataclass(frozen=True)
class Comparison:
    """A whole file."""

    flavour: Flavour
    guessed_by: str
    segments: tuple[SegmentComparison, ...]
    rms_ned_m_s: tuple[float, float, float]
    mock_velocity_ned_m_s: Samples

    @property
    def passed(self) -> bool:
        """Whether every axis is within `RMS_LIMIT_M_S`."""
        return max(self.rms_ned_m_s) <= RMS_LIMIT_M_S


def vehicle_of(flavour: Flavour) -> Vehicle:
    """The calibrated copter of a flavour."""
    return px4_quadrotor() if flavour is Flavour.PX4 else arducopter_quadrotor()


def replay(log: StepLog, vehicle: Vehicle) -> Samples:
    """Velocities the mock reports at the log's times under the log's commands, shape (rows, 3), m/s.

    The mock starts in hover trim at the log's first position and velocity. The ground is put far below: the log's
    origin says nothing about it.
    """
    north, east, down = log.position_ned_m[0].tolist()
    v_n, v_e, v_d = log.velocity_ned_m_s[0].tolist()
    motion = vehicle.initial((north, east, down), 0.0, flying=True)
    motion = motion._replace(body=motion.body._replace(velocity_ned_m_s=(v_n, v_e, v_d)))
    around = CALM._replace(ground_down_m=_FAR_BELOW_M)
    steps_s = [0.0, *np.diff(log.time_s).tolist()]
    setpoint = Setpoint(Kind.BRAKE)
    answers = []
    for command, step_s in zip(log.command_ned_m_s.tolist(), steps_s, strict=True):
        if step_s > 0.0:
            motion = vehicle.step(motion, setpoint, around, step_s)
        answers.append(vehicle.estimate(motion.body, around).velocity_ned_m_s)
        if setpoint.velocity_ned_m_s != tuple(command):
            n, e, d = command
            setpoint = Setpoint(Kind.STREAM, velocity_ned_m_s=(n, e, d))
    return np.array(answers)


def compare(log: StepLog, flavour: Flavour, guessed_by: str = "") -> Comparison:
    """Replay a log through a flavour's copter and measure both, segment by segment."""
    mock = replay(log, vehicle_of(flavour))
    segments = tuple(_segment(log, mock, segment) for segment in segments_of(log.time_s, log.command_ned_m_s))
    rms = np.sqrt(np.mean((mock - log.velocity_ned_m_s) ** 2, axis=0)).tolist()
    return Comparison(flavour, guessed_by, segments, (rms[0], rms[1], rms[2]), mock)


def guess(path: Path, log: StepLog) -> tuple[Flavour, str]:
    """The flavour a file is of, by its name, else by which copter fits better; and how it was found."""
    name = path.name.lower()
    if "px4" in name:
        return Flavour.PX4, "the file's name"
    if "ardu" in name or "copter" in name:
        return Flavour.ARDUCOPTER, "the file's name"
    misfit = {one: float(np.mean((replay(log, vehicle_of(one)) - log.velocity_ned_m_s) ** 2)) for one in Flavour}
    return min(Flavour, key=misfit.__getitem__), "the better fit"


def _segment(log: StepLog, mock: Samples, segment: Segment) -> SegmentComparison:
    rows = slice(segment.first, segment.last)
    n, e, d = (_axis(log, mock, segment, axis) for axis in range(3))
    time_s = log.time_s[rows]
    return SegmentComparison(float(time_s[0]), float(time_s[-1]), segment.varying, (n, e, d))


def _axis(log: StepLog, mock: Samples, segment: Segment, axis: int) -> AxisComparison:
    rows = slice(segment.first, segment.last)
    time_s, real, ours = log.time_s[rows], log.velocity_ned_m_s[rows, axis], mock[rows, axis]
    command = float(log.command_ned_m_s[segment.first, axis])
    rms = float(np.sqrt(np.mean((ours - real) ** 2)))
    name = "NED"[axis]
    if segment.varying:
        nothing = Response(math.nan, math.nan, math.nan)
        return AxisComparison(name, math.nan, nothing, nothing, rms)
    before = max(segment.first - 1, 0)
    stepped = command != (log.command_ned_m_s[before, axis] if segment.first else 0.0)
    if not stepped:
        # Not asked to change: what is left is how well it stays.
        return AxisComparison(
            name, command, response_of(time_s, real, command, command), response_of(time_s, ours, command, command), rms
        )
    return AxisComparison(
        name,
        command,
        response_of(time_s, real, float(log.velocity_ned_m_s[before, axis]), command),
        response_of(time_s, ours, float(mock[before, axis]), command),
        rms,
    )
