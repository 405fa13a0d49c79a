"""The sensors that PX4 wants calibrated: its parameters name the ids of calibrated sensors."""

from typing import Final, NamedTuple

from sitl_mock.protocols import ParameterStore


class CalibratedSensor(NamedTuple):
    """A sensor that PX4 needs: MAV_SYS_STATUS_SENSOR bit, name in texts, parameters with the ids of calibrated ones."""

    bit: int
    title: str
    slots: tuple[str, ...]


def _calibrated(bit: int, title: str, kind: str) -> CalibratedSensor:
    return CalibratedSensor(bit, title, tuple(f"CAL_{kind}{slot}_ID" for slot in range(4)))


_CALIBRATED_SENSORS: Final = (
    _calibrated(1, "Gyro", "GYRO"),
    _calibrated(2, "Accel", "ACC"),
    _calibrated(4, "Compass", "MAG"),
)


def uncalibrated(parameters: ParameterStore) -> list[CalibratedSensor]:
    """Return the sensors whose first instance is in none of their slots (the recorded id is the instance's)."""
    missing = []
    for sensor in _CALIBRATED_SENSORS:
        first = sensor.slots[0]
        device = parameters.default_of(first)
        if parameters[first] != device and device not in map(parameters.get, sensor.slots):
            missing.append(sensor)
    return missing
