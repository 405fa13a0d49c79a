"""Garbage is collected between cycles, when there is time for it, and never within one."""

import gc
import math
from typing import Final

YOUNG_EVERY_S: Final = 0.5
OLD_EVERY_S: Final = 30.0
OVERDUE_S: Final = 10.0
"""A loop that never has the time collects nevertheless: a late cycle is less than no memory left."""

_YOUNG_NEEDS_S: Final = 0.004
_OLD_NEEDS_S: Final = 0.012


class GcScheduler:
    """Collects by itself what the interpreter would at a moment of its own choosing."""

    def __init__(self) -> None:
        self._young_s = self._old_s = 0.0

    def begin(self, now_s: float) -> None:
        """From now on nothing is collected but here; what was made so far stays, and is not looked at again."""
        gc.collect()
        gc.freeze()
        gc.disable()
        self._young_s = self._old_s = now_s

    def between(self, now_s: float, free_s: float) -> None:
        """Collect, if it is time to and `free_s` until the next cycle are enough for it, or it is long overdue."""
        if now_s - self._young_s >= OVERDUE_S:
            free_s = math.inf
        if now_s - self._old_s >= OLD_EVERY_S and free_s >= _OLD_NEEDS_S:
            self._old_s = self._young_s = now_s
            gc.collect()
        elif now_s - self._young_s >= YOUNG_EVERY_S and free_s >= _YOUNG_NEEDS_S:
            self._young_s = now_s
            gc.collect(0)

    @staticmethod
    def end() -> None:
        """Leave it to the interpreter again."""
        gc.enable()
        gc.unfreeze()
