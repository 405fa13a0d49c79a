"""The flavours (kinds of vehicles) by name and version."""

from dataclasses import replace
from functools import cache

from sitl_mock.errors import ConfigError
from sitl_mock.vehicle.flavour import Flavour
from sitl_mock.versions import NAMES, SPECS, VERSIONS

__all__ = ["NAMES", "flavour_named"]


@cache
def flavour_named(spec: str) -> Flavour:
    """Return a flavour by name, or by name@version, importing only its own modules.

    Raises:
        ConfigError: There is no such flavour.
    """
    if spec not in SPECS:
        raise ConfigError(f"flavour = {spec!r}: allowed are {', '.join(SPECS)}")
    name, _, version = spec.partition("@")
    versions = VERSIONS[name]
    if not version:
        version = versions[0]
    if name == "px4":
        from sitl_mock.px4 import PX4  # noqa: PLC0415 - imports are half of the start-up time

        flavour = PX4
    elif name == "arducopter":
        from sitl_mock.ardupilot.flavours import ARDUCOPTER  # noqa: PLC0415 - as above

        flavour = ARDUCOPTER
    else:
        from sitl_mock.ardupilot.flavours import ROVER_FLAVOUR  # noqa: PLC0415 - as above

        flavour = ROVER_FLAVOUR
    if version == versions[0]:
        return replace(flavour, version=version)
    # A later version differs from the recorded one as documented.
    if flavour.name == "px4":
        from sitl_mock.px4.later import px4_1_18  # noqa: PLC0415 - as above

        return px4_1_18(flavour, version)
    from sitl_mock.ardupilot.later import arducopter_4_7  # noqa: PLC0415 - as above

    return arducopter_4_7(flavour, version)
