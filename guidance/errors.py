"""The errors a user can see, one class for each meaning. Every message states the fault and the remedy."""


class GuidanceError(Exception):
    """Base of all errors that this package raises on purpose. `exit_code` is the command's exit status."""

    exit_code = 1


class ConfigError(GuidanceError):
    """A wrong configuration or argument. The message names the key, the value and the allowed values."""

    exit_code = 2


class LinkError(GuidanceError):
    """A vehicle or an evader cannot be reached or stopped answering."""

    exit_code = 3


class FlightError(GuidanceError):
    """The flight ended early: the autopilot refused, contact was lost, or a pilot took over."""

    exit_code = 4


class OutputError(GuidanceError):
    """Results cannot be written, for example to a full disk. Earlier output is kept."""

    exit_code = 5
