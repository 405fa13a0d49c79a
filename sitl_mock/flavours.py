"""The flavours (kinds of vehicles) by name."""

from sitl_mock.errors import ConfigError
from sitl_mock.flavour import Flavour

NAMES = ("px4", "arducopter", "rover")


def flavour_named(name: str) -> Flavour:
    """Return a flavour by name, importing only its own modules.

    Raises:
        ConfigError: There is no such flavour.
    """
    if name == "px4":
        from sitl_mock.px4 import PX4  # noqa: PLC0415 - imports are half of the start-up time

        return PX4
    if name == "arducopter":
        from sitl_mock.ardupilot.flavours import ARDUCOPTER  # noqa: PLC0415 - as above

        return ARDUCOPTER
    if name == "rover":
        from sitl_mock.ardupilot.flavours import ROVER_FLAVOUR  # noqa: PLC0415 - as above

        return ROVER_FLAVOUR
    raise ConfigError(f"flavour = {name!r}: allowed are {', '.join(NAMES)}")
