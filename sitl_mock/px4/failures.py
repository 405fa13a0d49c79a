"""Failures that INJECT_FAILURE causes in PX4's SIH, mapped to the mock's conditions."""

from dataclasses import dataclass
from typing import Final

from sitl_mock.vehicle.state import VehicleState

BATTERY: Final = 100
MOTOR: Final = 101
"""FAILURE_UNIT."""
_WORKING: Final = 0
_OFF: Final = 1
_STUCK: Final = 2
_WRONG: Final = 4
"""FAILURE_TYPE."""
_MOTORS: Final = 8
"""Motors that PX4 has, of which this airframe uses four."""
_USED: Final = 0b1111
_THRUST_WITHOUT_MOTOR: Final = 0.1
"""A quadrotor that has lost a motor turns over and falls: 19 m in 3.4 s (measured)."""


def fail_battery(state: VehicleState, kind: int, instance: int) -> bool | None:
    """Empty or restore the battery; False if that is not supported, None without an answer."""
    if kind not in {_WORKING, _OFF}:
        return None
    if instance != 0:
        return False
    state.battery.failed = kind == _OFF
    return True


@dataclass(slots=True)
class MotorFailures:
    """Motors that have been stopped.

    Attributes:
        fails_motors: SYS_FAILURE_EN was 1 at the boot; set later, it does not reach the motors.
        stopped: Bits of the motors.
    """

    fails_motors: bool
    stopped: int = 0

    def fail_motor(self, state: VehicleState, kind: int, instance: int) -> bool:
        """Stop motors or let them turn again; False if that is not supported.

        A stopped motor has an effect only with CA_FAILURE_MODE above 0. Other types concern telemetry of speed
        controllers, which do not exist here.
        """
        if kind not in {_WORKING, _OFF, _STUCK, _WRONG} or not 0 <= instance <= _MOTORS:
            return False
        motors = (1 << _MOTORS) - 1 if instance == 0 else 1 << (instance - 1)
        if kind == _OFF:
            self.stopped |= motors
        elif kind == _WORKING:
            self.stopped &= ~motors
        is_felt = self.stopped & _USED and int(state.parameters["CA_FAILURE_MODE"]) > 0
        state.conditions.put("thrust_share", _THRUST_WITHOUT_MOTOR if is_felt else 1.0)
        return True
