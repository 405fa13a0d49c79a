"""MAVSDK's C++ log goes to Python's `logging`, instead of to standard output with colours."""

import ctypes
import logging
from typing import Final

from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback

LOGGER: Final = logging.getLogger("guidance.links.mavsdk")
_LEVELS: Final = (logging.DEBUG, logging.DEBUG, logging.INFO, logging.WARNING)  # one lower: MAVSDK's INFO is chatter


def _log(level: int, message: bytes | None, _file: bytes | None, _line: int, _user: ctypes.c_void_p) -> bool:
    LOGGER.log(_LEVELS[min(max(level, 0), 3)], "%s", (message or b"").decode(errors="replace"))
    return True  # handled: nothing is printed


_callback = LogCallback(_log)


def route_to_logging() -> None:
    """Take over MAVSDK's log, for the whole process; calling it again changes nothing.

    The library's own `log_subscribe` is not used since it prints an error when a vehicle sends text that is not UTF-8.
    """
    if not any(isinstance(handler, logging.NullHandler) for handler in LOGGER.handlers):
        LOGGER.addHandler(logging.NullHandler())  # silent unless the program sets logging up
        _cmavsdk_lib.mavsdk_log_subscribe(_callback, None)
