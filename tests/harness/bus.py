"""A control bus that a test opens and closes."""

import contextlib

from guidance.session.control_bus import control_bus


class ControlBus:
    """Takes orders until it is closed; arguments as of `control_bus`."""

    def __init__(self, *given, **more):
        self._open = contextlib.ExitStack()
        self.session = self._open.enter_context(control_bus(*given, **more))

    def close(self):
        self._open.close()
