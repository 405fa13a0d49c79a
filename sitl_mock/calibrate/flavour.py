"""The flavours that have a calibrated copter, and which of them a log is of."""

from enum import StrEnum
from pathlib import Path

import numpy as np

from sitl_mock.calibrate.replay import replay
from sitl_mock.calibrate.step_log import StepLog
from sitl_mock.dynamics import Vehicle, arducopter_quadrotor, px4_quadrotor


class Flavour(StrEnum):
    """Autopilots with a calibrated copter."""

    PX4 = "px4"
    ARDUCOPTER = "arducopter"


def vehicle_of(flavour: Flavour) -> Vehicle:
    """The calibrated copter of a flavour."""
    return px4_quadrotor() if flavour is Flavour.PX4 else arducopter_quadrotor()


def guess(path: Path, log: StepLog) -> tuple[Flavour, str]:
    """The flavour a file is of, by its name, else by which copter fits better; and how it was found."""
    name = path.name.lower()
    if "px4" in name:
        return Flavour.PX4, "the file's name"
    if "ardu" in name or "copter" in name:
        return Flavour.ARDUCOPTER, "the file's name"
    misfit = {one: float(np.mean((replay(log, vehicle_of(one)) - log.velocity_ned_m_s) ** 2)) for one in Flavour}
    return min(Flavour, key=misfit.__getitem__), "the better fit"
