"""A mock autopilot that real MAVLink clients can fly: PX4, ArduCopter and a rover, nothing to build."""

from sitl_mock.errors import ConfigError, MockError, TransportError
from sitl_mock.vehicle import MockVehicle
from sitl_mock.world import DEFAULT_HOME, Home

__all__ = ["DEFAULT_HOME", "ConfigError", "Home", "MockError", "MockVehicle", "TransportError"]
