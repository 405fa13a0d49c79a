"""How ArduCopter 4.5.7 answers the commands that change nothing in the mock: measured on the ground, all parameters 0.

What is in neither this table nor `commands` is UNSUPPORTED.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from sitl_mock.protocols import Result

_ACCEPTED: Final = (
    181,
    182,
    195,
    197,
    198,
    201,
    202,
    203,
    206,
    207,
    208,
    209,
    216,
    2001,
    2520,
    2600,
    32000,
    42001,
    42651,
)
_FAILED: Final = (183, 184, 204, 205, 211, 218, 500, 601, 1000, 1001, 2000, 2500, 2501, 10001, 42600)
_DENIED: Final = (32, 532, 534, 42007, 42700)

ANSWERED: Mapping[int, Result] = MappingProxyType(
    {
        **dict.fromkeys(_ACCEPTED, Result.ACCEPTED),
        **dict.fromkeys(_FAILED, Result.FAILED),
        **dict.fromkeys(_DENIED, Result.DENIED),
    }
)
"""MAV_RESULT by number of MAV_CMD."""
