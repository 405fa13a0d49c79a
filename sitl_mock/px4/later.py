"""PX4 v1.18: what its release notes change of v1.17. Nothing of it is recorded; dynamics and texts are v1.17's."""

from dataclasses import replace
from typing import Final

from sitl_mock.parameters import parameters_of
from sitl_mock.protocols import px4_identity
from sitl_mock.vehicle.flavour import Flavour

_OLD_REQUESTS: Final = frozenset({410, 519, 520, 525, 528})
"""GET_HOME_POSITION and requests of version, capabilities, storage and flight, which REQUEST_MESSAGE replaces."""
_MORE: Final = frozenset({611})
"""DO_SET_GLOBAL_ORIGIN."""
_DEVELOPMENT: Final = frozenset({"GNSS_INTEGRITY"})
"""The dialect `development` is no longer built in."""


def px4_1_18(recorded: Flavour, version: str) -> Flavour:
    """Return v1.18 made from v1.17."""
    quick = {
        kind: {name: rate for name, rate in rates.items() if name not in _DEVELOPMENT}
        for kind, rates in recorded.rates_hz.items()
    }
    return replace(
        recorded,
        version=version,
        title="PX4 1.18 quadrotor",
        parameters=parameters_of("px4", version),
        rates_hz=quick,
        identity=lambda uid: replace(px4_identity(uid), version=(1, 18, 0), commit=b""),
        stream_rules=replace(recorded.stream_rules, old_requests={}),
        refused_commands=_OLD_REQUESTS,
        more_commands=_MORE,
        withheld=recorded.withheld | _DEVELOPMENT,
        takes_keys=True,
    )
