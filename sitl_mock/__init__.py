"""A mock autopilot that real MAVLink clients can fly: PX4, ArduCopter and a rover, nothing to build.

Exports are imported on first use, so that `sitl-mock --help` and a pytest run that does not use the plugin need not
load MAVLink's dialect.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sitl_mock.errors import ConfigError, MockError, TransportError
    from sitl_mock.vehicle.mock_vehicle import MockVehicle
    from sitl_mock.world import DEFAULT_HOME, Home

__all__ = ["DEFAULT_HOME", "ConfigError", "Home", "MockError", "MockVehicle", "TransportError"]

_IN = {
    "DEFAULT_HOME": "sitl_mock.world",
    "ConfigError": "sitl_mock.errors",
    "Home": "sitl_mock.world",
    "MockError": "sitl_mock.errors",
    "MockVehicle": "sitl_mock.vehicle.mock_vehicle",
    "TransportError": "sitl_mock.errors",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - as different as the exports
    if name not in _IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_IN[name]), name)
