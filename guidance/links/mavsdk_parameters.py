"""Parameters that MAVSDK's JSON cannot carry: PX4's negative integers, whose bytes read as a NaN, hence `null`."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from mavsdk.plugins.param import Param, ParamError
from mavsdk.system import System


class IntegerParameters:
    """Reads integers through MAVSDK's own parameter plugin, one after another, on a thread of its own."""

    def __init__(self, system: System, deliver: Callable[[str, int], None]) -> None:
        self._param = Param(system)
        self._deliver = deliver
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="mavsdk parameters")
        self._reading: set[str] = set()
        self.failed = 0

    def read(self, name: str) -> None:
        """Ask for one, unless it is being asked for; `deliver(name, value)` is called on our thread when it comes."""
        if name not in self._reading:
            self._reading.add(name)
            self._executor.submit(self._read, name)

    def _read(self, name: str) -> None:
        try:
            self._deliver(name, self._param.get_param_int(name))
        except ParamError:
            self.failed += 1
            self.done(name)

    def done(self, name: str) -> None:
        """The answer was taken: the next request asks again."""
        self._reading.discard(name)

    def close(self) -> None:
        """Forget what waits, and wait for the one that is being read (3 s at most, MAVSDK's own patience)."""
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._param.destroy()
