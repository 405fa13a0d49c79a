"""Replaying a log's commands through the stepped dynamics alone: no MAVLink, no modes."""

import numpy as np

from sitl_mock.calibrate.measures import Samples
from sitl_mock.calibrate.step_log import StepLog
from sitl_mock.dynamics import CALM, Kind, Setpoint, Vehicle

_FAR_BELOW_M = 1e6


def replay(log: StepLog, vehicle: Vehicle) -> Samples:
    """Velocities the mock reports at the log's times under the log's commands, shape (rows, 3), m/s.

    The mock starts in hover trim at the log's first position and velocity, its nose to the north as the logs have it
    (mask 2503, yaw 0). The ground is put far below: the log's origin says nothing about it.
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
            setpoint = Setpoint(Kind.STREAM, velocity_ned_m_s=(n, e, d), yaw_rad=0.0)
    return np.array(answers)
