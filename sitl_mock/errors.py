"""The errors a user of the mock can meet. Every message names what is wrong, its value, and what is allowed."""


class MockError(Exception):
    """Base of every error that this package raises on purpose. `exit_code` is what a command ends with."""

    exit_code = 1


class ConfigError(MockError):
    """A setting is wrong: the message names the key, the value and what is allowed."""

    exit_code = 2


class TransportError(MockError):
    """An endpoint cannot be opened, mostly because its port is taken."""

    exit_code = 3
