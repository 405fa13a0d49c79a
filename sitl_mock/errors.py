"""Errors for users of the mock. Each message has the key, its value and the allowed values."""


class MockError(Exception):
    """Base class of this package's errors; `exit_code` is the exit code of commands."""

    exit_code = 1


class ConfigError(MockError):
    """A setting is wrong."""

    exit_code = 2


class TransportError(MockError):
    """An endpoint cannot be opened, mostly because its port is taken."""

    exit_code = 3
