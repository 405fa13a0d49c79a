"""Every parameter of each vehicle, as data: name, type and default of the real autopilot, and limits where known."""

from sitl_mock.parameters.table import parameters_of

__all__ = ["parameters_of"]
