"""The errors a user can meet, a small family by meaning. Every message says what is wrong and what to do next."""


class GuidanceError(Exception):
    """Base of every error that this package raises on purpose. `exit_code` is what a command ends with."""

    exit_code = 1


class ConfigError(GuidanceError):
    """A configuration or an argument is wrong: the message names the key, the value and what is allowed."""

    exit_code = 2


class LinkError(GuidanceError):
    """A vehicle or an evader cannot be reached, or stopped answering."""

    exit_code = 3


class FlightError(GuidanceError):
    """The flight could not go on: refused by the autopilot, lost, or ended by a pilot."""

    exit_code = 4


class OutputError(GuidanceError):
    """Results cannot be written: a full disk, or a folder without permission. What was written before is kept."""

    exit_code = 5
